"""Rules between live parameters, as `set`, the keys, a simulation, a replay and an optimisation report them."""

import signal

import numpy as np
import pytest

import runtime
from graph import compile
from runtime.cli.set import set_live
from runtime.experiments.optimisation.live_robot import Targets
from runtime.experiments.optimisation.parameters import Parameter
from runtime.host.errors import BadInput
from runtime.host.live.running import shared_state_of
from runtime.host.live.sending import batches
from runtime.host.live.table import describe, parse
from runtime.robot.loading.file import load
from tests.runtime.host.live.test_set import going
from tests.runtime.runs import Files, finished, write
from tests.runtime.terminals import patient

ENDS = """\
from blocks.limiters import Saturation
from blocks.recorders import CsvRecorder
from blocks.sources import Constant, Sine
from graph import Diagram, Live

with Diagram("ends", rate=100) as diagram:
    Saturation(lower=Live(-1.0, min=-10.0, max=10.0), upper=Live(1.0, min=-10.0, max=10.0), name="sat")(
        Sine(amplitude=20.0, frequency=1.0).y
    )
    for number in range(20):
        Constant(Live(0.0, min=0.0, max=1.0), name=f"c{number:02}")()
    CsvRecorder()
"""
RULE = "sat: lower must be at most upper ({}), got {}"


@pytest.fixture
def ends(tmp_path):
    return write(tmp_path, ENDS, "ends.py")


@pytest.fixture
def table(ends):
    return parse(describe(compile(load(ends)[1]))[1])


def refusal(pid, name, text):
    """The complaint of `set` about one change."""
    with pytest.raises(BadInput) as caught:
        set_live(pid, [(name, text)])
    return str(caught.value)


def test_set_names_the_rule_that_a_change_breaks_and_takes_both_ends_together(tmp_path, ends, command_line):
    with going(tmp_path, "ends.py") as run:
        command_line("set", run.pid, "sat.lower=0.9")
        assert (
            refusal(run.pid, "sat.lower", "5")
            == f"process {run.pid} rejected sat.lower ({RULE.format(1, 5)}); nothing was changed"
        )
        assert [target for _, target in shared_state_of(run.pid).live_values()[20:]] == [0.9, 1.0]
        code, out, err = command_line("set", run.pid, "sat.lower=5", "sat.upper=7")
        assert (code, err, len(out.splitlines())) == (0, "", 2)
        shared = shared_state_of(run.pid)
        patient(lambda: shared.live_values()[20:] == [(5.0, 5.0), (7.0, 7.0)])
        assert (
            refusal(run.pid, "sat.upper", "4")
            == f"process {run.pid} rejected sat.upper ({RULE.format(4, 5)}); nothing was changed"
        )
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=30)
    files = Files(tmp_path / "recordings")
    assert 5.0 <= files.table["sat.y"][-1] <= 7.0
    code, out, err = command_line("replay", files.one(".mcap"))
    assert (code, err) == (0, "") and "the same, bit for bit" in out
    write(tmp_path, ENDS.replace("upper=Live(1.0", "upper=Live(0.5"), "narrow.py")
    said = command_line.refused("replay", files.one(".mcap"), "--diagram", "narrow.py")
    assert said.endswith(f"a recorded change breaks a rule of the diagram: {RULE.format(0.5, 0.9)}")


def test_settings_at_the_start_obey_a_rule_together(tmp_path, ends):
    options = ("--fast", "--duration", "0.2", "--no-record")
    process = finished("ends.py", *options, "--set", "sat.lower=5", "--set", "sat.upper=7", cwd=tmp_path)
    assert process.returncode == 0, process
    process = finished("ends.py", *options, "--set", "sat.lower=5", "--set", "sat.upper=3", cwd=tmp_path)
    assert process.returncode == 2
    assert "setting sat.lower=5, sat.upper=3: lower must be at most upper (3), got 5" in process.stderr


def test_a_simulation_reports_the_rule_and_changes_both_ends_together(ends):
    with runtime.simulate(ends) as robot:
        with pytest.raises(BadInput) as caught:
            robot["sat.lower"] = 5.0
        assert str(caught.value) == f"{RULE.format(1, 5)}; nothing was changed"
        robot.set({"sat.lower": 5.0, "sat.upper": 7.0})
        robot.step(3.0)
        assert (robot["sat.lower"], robot["sat.upper"]) == (5.0, 7.0)
    y = robot.trial["sat.y"]
    assert np.all(y[150:] >= 5.0) and np.all(y <= 7.0)


def test_changes_that_a_rule_relates_are_in_one_request(table):
    """The rule's two ends are the first and the last of 22 settings."""
    lower, upper = (next(each for each in table.parameters if each.path == f"sat.{end}") for end in ("lower", "upper"))
    others = [[(each, 1.0)] for each in table.parameters if each not in (lower, upper)]
    first, second = batches([[(lower, 5.0)], *others, [(upper, 7.0)]], table.rules)
    assert first[:2] == [(lower, 5.0), (upper, 7.0)] and len(first) + len(second) == 22


def test_bounds_of_an_optimisation_that_allow_values_against_a_rule_are_refused(table):
    def targets(lower, upper, zero=()):
        return Targets(table, [Parameter("sat.lower", *lower), Parameter("sat.upper", *upper)], zero)

    with pytest.raises(BadInput) as caught:
        targets((-5.0, 2.0), (1.0, 5.0))
    assert str(caught.value) == (
        f"--over allows values that break a rule: {RULE.format(1, 2)}. Choose bounds within which it holds"
    )
    with pytest.raises(BadInput, match=r"lower must be at most upper \(-3\), got 1"):
        Targets(table, [Parameter("sat.lower", -5.0, 1.0)], [("sat.upper", "-3")])
    with pytest.raises(BadInput, match=r"lower must be at most upper \(1\), got 2"):
        Targets(table, [Parameter("sat.lower", -5.0, 2.0)])
    assert targets((-5.0, 1.0), (1.0, 5.0)).live.keys() == {"sat.lower", "sat.upper"}
