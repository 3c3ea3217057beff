"""runtime.simulate: a run in virtual time that a script advances step by step."""

import math
import os
import signal

import numpy as np
import pytest

import runtime
from blocks.controllers import Impedance
from blocks.logic import Compare
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Block, Diagram, Live, Output, Param
from runtime.host.errors import BadInput, RunFault
from runtime.session import simulate
from tests.runtime.runs import KNEE_EXO, knee
from tests.runtime.session.test_simulate import calling, same, sine


def springs():
    """A native block with a slew of 200 per second, and a Python block whose parameter steps."""

    class Wave(Block):
        angle = Param(0.5, "rad", min=-1.0, max=1.5, live=True, slew=math.inf)
        on = Param(True, "1", min=False, max=True, live=True)
        y = Output("1")

        def step(self):
            return self.angle + 10.0 * self.on

    with Diagram("springs", rate=100) as diagram:
        Impedance(stiffness=Live(30.0, max=150.0, slew=200.0), name="spring")(position=1.0, velocity=0.0)
        Wave(name="wave")
        CsvRecorder()
    return diagram


def test_any_division_into_steps_gives_the_signals_of_one_run(monkeypatch):
    monkeypatch.setattr(simulate, "ROWS", 300)  # so that memory is taken several times
    whole = runtime.run(KNEE_EXO, 5, seed=3)
    with runtime.simulate(KNEE_EXO, seed=3) as sim:
        for count in (1, 1, 7, 291, 300, 0.4):
            sim.step(count / 200 if count >= 1 else None)
        while sim.tick < 1000:
            sim.step(min(33, 1000 - sim.tick) / 200)
    assert same(sim.trial, whole) and sim.trial.events == whole.events and sim.trial.diagram == whole.diagram
    assert (sim.tick, sim.time, sim.fault) == (1000, 5.0, None)


def test_signals_and_parameters_are_read_between_steps():
    with runtime.simulate(springs) as sim:
        sim.step()
        assert sim["spring.torque"] == -30.0 and sim["wave.y"] == 10.5 and sim.time == 0.01
        assert sim["spring.stiffness"] == 30.0 and sim["wave.on"] is True and sim["spring.damping"] == 1.0
        with pytest.raises(KeyError, match="did you mean 'spring.torque'"):
            sim["spring.torqe"]
    with runtime.simulate(lambda: vector()) as sim:
        sim.step()
        assert sim["above.y"] is False and sim["sine.y"] == 0.0


def vector():
    with Diagram("vector", rate=100) as diagram:
        Compare(name="above")(Sine(name="sine")(), 0.5)
    return diagram


def test_live_parameters_ramp_within_their_bounds_and_are_recorded():
    with runtime.simulate(springs) as sim:
        sim.step(0.02)
        sim["spring.stiffness"] = np.float64(33.0)
        sim["wave.*"] = 1
        sim.step(0.05)
        for value, message in ((200.0, "150"), (math.nan, "finite|nan"), ("fast", "number")):
            with pytest.raises(BadInput, match=message):
                sim["spring.stiffness"] = value
        with pytest.raises(BadInput, match="no live parameter 'spring.dampin'"):
            sim["spring.dampin"] = 1.0
    trial = sim.trial
    assert trial["spring.torque"] == pytest.approx([-30, -30, -32, -33, -33, -33, -33])
    assert trial["wave.y"] == pytest.approx([10.5, 10.5, 11, 11, 11, 11, 11])
    first, *others, _ = trial.events
    assert first == {
        "event": "set", "path": "spring.stiffness", "value": 33.0, "from": 30.0, "tick": 2, "by": "step", "slew": 200.0
    }  # fmt: skip
    assert [event["path"] for event in others] == ["wave.angle", "wave.on"]


def test_a_diagram_keeps_its_parameters_after_a_simulation_that_changed_them():
    diagram = springs()
    with runtime.simulate(diagram, settings={"spring.damping": 2.0}, rate=200) as sim:
        sim["wave.angle"] = -1.0
        sim.step()
        assert diagram["wave"].angle == -1.0 and sim["spring.damping"] == 2.0
    assert (diagram["wave"].angle, diagram["spring"].damping, diagram.rate) == (0.5, 1.0, 100)
    assert '"damping": 2.0' in str(sim.trial.diagram).replace("'", '"')


def test_a_fault_ends_the_simulation_and_raises(tmp_path):
    with runtime.simulate(knee(tmp_path, "return 1.0 / (100 - tick)")) as sim:
        with pytest.raises(RunFault, match="FAULT at law, tick 100") as error:
            sim.step(2.0)
        assert sim.fault["status"] == "exception" and error.value.fault == sim.fault and sim.tick == 100
        with pytest.raises(RunFault, match="tick 100"):
            sim.step()
        with pytest.raises(BadInput, match="has ended"):
            sim["law.gain"] = 1.0
    assert len(sim.trial) == 100 and "fault: exception" in repr(sim)


def test_signals_of_the_plant_are_recorded_at_the_end_of_each_tick(monkeypatch):
    monkeypatch.setattr(simulate, "ROWS", 64)
    torque = "plant/walker.left_knee_torque"
    seen, bare = [], runtime.run(KNEE_EXO, 1)
    with runtime.simulate(KNEE_EXO, plant_signals="walker.*_knee_torque, walker.pelvis_motion") as sim:
        while sim.tick < 200:
            sim.step()
            seen.append(sim[torque])
    assert sim.trial[torque].tolist() == seen and len(set(seen)) > 100
    assert sim.trial.unit(torque) == "N·m" and sim.trial["plant/walker.pelvis_motion"].shape == (200, 9)
    assert all(np.array_equal(sim.trial[name], bare[name], equal_nan=True) for name in bare.names)
    assert set(sim.trial.names) - set(bare.names) == {
        torque,
        torque.replace("left", "right"),
        "plant/walker.pelvis_motion",
    }


def test_report_of_a_fault_is_the_same_with_signals_of_the_plant(tmp_path):
    path = knee(tmp_path, "return 1.0 / (100 - tick)")
    bare, more = runtime.run(path, 1), runtime.run(path, 1, plant_signals=["*"])
    assert bare.fault["status"] == "exception" and more.fault == bare.fault
    assert len(more.signals) > len(bare.signals)


@pytest.mark.parametrize("seconds", [0.007, 0.0, -1.0, math.nan, math.inf])
def test_a_step_is_a_whole_number_of_ticks(seconds):
    with runtime.simulate(sine) as sim, pytest.raises(BadInput, match="whole number of ticks, which take 0.01 s"):
        sim.step(seconds)


def test_a_simulation_has_a_trial_only_after_its_end():
    sim = runtime.simulate(sine)
    with pytest.raises(BadInput, match="has not ended"):
        sim.trial
    sim.close()
    sim.close()
    assert len(sim.trial) == 0
    with pytest.raises(BadInput, match="has ended"):
        sim.step()


def test_drives_that_do_not_answer_end_a_simulation_before_its_first_tick(tmp_path):
    def nothing(robot):
        with Diagram("nothing", rate=robot.rate) as plant:
            Sine(name="sine")()
        return plant

    with runtime.simulate(knee(tmp_path), plant=nothing) as sim, pytest.raises(RunFault, match="no reply"):
        sim.step()


def test_ctrl_c_between_two_ticks_leaves_a_simulation_that_continues():
    def strike(tick):
        if tick == 50:
            os.kill(os.getpid(), signal.SIGINT)
        return 0.0

    with runtime.simulate(calling(strike)) as sim:
        with pytest.raises(KeyboardInterrupt):
            sim.step(1.0)
        assert sim.tick == 51 and sim.fault is None
        sim.step(0.1)
    assert len(sim.trial) == 61


def test_a_block_cannot_advance_its_own_simulation():
    with runtime.simulate(calling(lambda tick: sim.step())) as sim, pytest.raises(RunFault, match="already"):
        sim.step()
