"""runtime.run in the kernel of a real notebook: what cells show, and the interrupt that stops a robot."""

import os

import pytest
from jupyter_client.manager import start_new_kernel

import runtime
from tests.runtime.robot.guardian.bus import PATIENT, ROBOT, Bus
from tests.runtime.runs import DISABLE, KNEE_EXO, NOTHING, environment, write
from tests.runtime.session.test_own_process import sent

pytestmark = pytest.mark.paced

SIMULATED = f"""
import runtime
trial = runtime.run({str(KNEE_EXO)!r}, 5)
trial
"""
STEPPED = f"""
with runtime.simulate({str(KNEE_EXO)!r}) as sim:
    while sim.time < 1.0:
        sim.step(0.005)
        sim["*/profile.scale"] = 0.5
print(len(sim.trial), sim["left/profile.scale"])
"""
REAL_TIME = f"trial = runtime.run({str(KNEE_EXO)!r}, 0.6, fast=False); len(trial)"
ON_A_RIG = 'runtime.run("robot.py", rig="lab.toml"{more})'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("notebook")
    write(made, ROBOT.format(law="pass", torque=2.0, more="", blocks="", drive=PATIENT))
    return made


@pytest.fixture(scope="module")
def kernel(folder):
    manager, client = start_new_kernel(kernel_name="python3", cwd=str(folder), env=environment(), startup_timeout=120)
    made = Kernel(manager, client)
    assert made.run("import runtime") == ("", {}, "")
    yield made
    client.stop_channels()
    manager.shutdown_kernel(now=True)


class Kernel:
    """Kernel of a notebook. `run` carries out a cell, and returns its streams, its result and its error."""

    def __init__(self, manager, client):
        self.manager, self.client = manager, client

    def start(self, code, **how):
        return self.client.execute(code, **how)

    def run(self, code):
        return self.outputs(self.start(code, allow_stdin=False))

    def outputs(self, request, timeout=60):
        streams, result, error = "", {}, ""
        while True:
            message = self.client.get_iopub_msg(timeout=timeout)
            if message["parent_header"].get("msg_id") != request:
                continue
            kind, content = message["msg_type"], message["content"]
            if kind == "stream":
                streams += content["text"]
            elif kind == "execute_result":
                result = content["data"]
            elif kind == "error":
                error, self.shown = f"{content['ename']}: {content['evalue']}", content["traceback"]
            elif kind == "status" and content["execution_state"] == "idle":
                return streams, result, error

    @property
    def children(self):
        return self.run("import psutil; [child.name() for child in psutil.Process().children(recursive=True)]")[1]


@pytest.mark.soak
def test_a_cell_simulates_and_shows_the_trial(kernel):
    streams, result, error = kernel.run(SIMULATED)
    assert (streams, error) == ("", "") and "1000 at 200 Hz, 5 s" in result["text/html"]
    assert kernel.run(STEPPED) == ("200 0.5\n", {}, "")


def test_a_cell_runs_in_real_time_and_shows_its_lines(kernel):
    streams, result, error = kernel.run(REAL_TIME)
    assert error == "" and int(result["text/plain"]) > 50
    assert "knee_exo: 0.6 s at 200 Hz, simulated" in streams and "/0.6 s" in streams.partition("\n")[0]


def test_the_interrupt_stops_the_robot_safely_and_leaves_the_kernel_alive(kernel, folder):
    kernel.run("answer = 42")
    with Bus(folder, number=12) as bus:
        request = kernel.start(ON_A_RIG.format(more=", yes=True"), allow_stdin=False)
        bus.await_torque()
        kernel.manager.interrupt_kernel()
        streams, _, error = kernel.outputs(request)
    assert error.startswith("KeyboardInterrupt: the run was stopped; its recording is recordings/robot_")
    assert kernel.shown == [f"tickwork: stopped by Ctrl-C: {error.partition(' ')[2]}"]
    assert "stopped by SIGINT (Ctrl-C)" in streams and "confirmed by left/knee, right/knee" in streams
    trial = runtime.load(os.path.join(folder, error.rpartition(" ")[2]))
    assert trial.complete and trial.end["ended"] == "stopped by SIGINT" and sent(trial)[-2:] == [NOTHING, DISABLE]
    assert kernel.run("answer")[1]["text/plain"] == "42" and kernel.children["text/plain"] == "[]"


@pytest.mark.soak
def test_a_rig_is_armed_by_the_input_field_of_the_notebook(kernel, folder):
    with Bus(folder, number=12) as bus:
        request = kernel.start(ON_A_RIG.format(more=", duration=0.3"), allow_stdin=True)
        asked = kernel.client.get_stdin_msg(timeout=60)["content"]["prompt"]
        assert asked == "Enter arms the robot, q ends the run: "
        kernel.client.input("")
        bus.await_torque()
        streams, _, error = kernel.outputs(request)
        assert error == "" and "2 devices, no problems" in streams and "on the rig lab.toml" in streams
        _, _, error = kernel.run(ON_A_RIG.format(more=""))  # without an input field
        assert error.startswith("BadInput: cannot ask for the confirmation")
