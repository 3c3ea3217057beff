"""A block that ends the control process behind the back of the run: what the recorder prints, and what it leaves."""

import signal
import time
from contextlib import nullcontext
from types import SimpleNamespace

import psutil
import pytest

from runtime.record.recorder.writer import cause_of_death
from tests.runtime.robot.guardian.bus import Bus
from tests.runtime.runs import Files, finished, knee, started


@pytest.mark.parametrize(
    "call, code", [("os._exit(0)", 0), ("os._exit(7)", 7), ("os.execv('/bin/sh', ['sh', '-c', 'exit 5'])", 5)]
)
def test_block_that_exits_process_is_reported_with_tick_and_exit_code(tmp_path, call, code):
    path = knee(tmp_path, f"import os; tick >= 20 and {call}; return 1.0")
    process = finished(path, "--fast", "--duration", "5", cwd=tmp_path, timeout=20)
    assert process.returncode == code and process.stdout == "" and "Traceback" not in process.stderr
    assert (
        "tickwork recorder: the control process died in law after tick 19 without ending the run: it was killed, or a "
        "block called"
    ) in process.stderr
    assert "os._exit or exec; 20 ticks were recorded, the last is 19: " in process.stderr
    files = Files(tmp_path / "recordings")
    assert files.sidecar["ended"] == "the control process died" and files.sidecar["last_tick"] == 19


@pytest.mark.parametrize(
    "state, tick, at, crashed, hung, said",
    [
        ("arming", -1, 1, 0, None, "while arming without"),
        ("ready", -1, 1, 0, None, "before it was armed without"),
        ("running", -1, -1, 0, None, "in its first tick without"),
        ("running", -1, 1, 0, None, "in left/law in its first tick without"),
        ("running", 41, -1, 0, None, "after tick 41 without"),
        ("running", 41, 0, 0, None, "in receiving after tick 41 without"),
        ("stopping", 41, 1, 0, None, "during the safe stop without"),
        ("running", 41, 1, 11, 1, "of SIGSEGV in left/law"),
        ("running", 41, 1, 11, -1, "of SIGSEGV"),
    ],
)
def test_the_cause_of_death_names_the_block_and_the_state_or_signal(state, tick, at, crashed, hung, said):
    shared = SimpleNamespace(state=state, at=at, crashed=crashed, hung=hung, statistics=lambda: {"last_tick": tick})
    shared.in_run = False
    cause = cause_of_death(shared, ["receiving", "left/law"])
    assert cause == said if crashed else cause.startswith(said)


def test_the_cause_of_death_in_a_run_of_machine_code_names_its_first_block():
    shared = SimpleNamespace(
        state="running", at=1, crashed=0, hung=None, in_run=True, statistics=lambda: {"last_tick": 41}
    )
    cause = cause_of_death(shared, ["receiving", "left/law"])
    assert cause.startswith("in left/law or a native block after it, after tick 41 without")


@pytest.mark.parametrize("options", [["--fast"], []])
def test_a_block_that_aborts_a_simulation_is_reported_with_its_signal(tmp_path, options):
    path = knee(tmp_path, "import os; tick >= 20 and os.abort(); return 1.0")
    process = finished(path, *options, "--duration", "5", cwd=tmp_path, timeout=20)
    assert process.returncode == -signal.SIGABRT
    assert "tickwork recorder: the control process died of SIGABRT in law; " in process.stderr
    sidecar = Files(tmp_path / "recordings").sidecar
    assert f" ticks were recorded, the last is {sidecar['last_tick']}: " in process.stderr
    assert sidecar["ended"] == "the control process died" and 0 < sidecar["last_tick"] < 20
    assert sidecar["last_tick"] == 19 or not options  # real time can skip the ticks before


@pytest.mark.parametrize("rig", [False, True], ids=["simulated", "on a rig"])
def test_exec_in_block_leaves_no_recorder_or_guardian(tmp_path, rig):
    """The process lives on under its number, so that its end is none to wait for."""
    call = "__import__('os').execv('/bin/sleep', ['sleep', '30'])"
    with Bus(tmp_path, number=7) if rig else nullcontext() as bus:
        if rig:
            process = bus.start("--record", "out", law=f"tick >= 20 and {call}")
        else:
            path = knee(tmp_path, f"tick >= 20 and {call}; return 1.0")
            process = started(path, "--record", "out", "--fast", "--duration", "5", cwd=tmp_path)
        await_end_of_children(process)
        assert process.poll() is None
        process.kill()
        _, err = process.communicate()
        if rig:
            bus.listen(0.2)
            bus.stopped_after(0.0)  # the motors were stopped, and not commanded again
    sidecar = Files(tmp_path / "out").sidecar
    assert f" ticks were recorded, the last is {sidecar['last_tick']}: " in err and "Traceback" not in err
    assert "os._exit or exec; " in err and sidecar["ended"] == "the control process died"
    assert sidecar["last_tick"] == 19 or rig and 0 < sidecar["last_tick"] < 19  # real time can skip the ticks before


def alive(process):
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:  # ended after it was listed
        return False


def await_end_of_children(process):
    """Until a run has had children and has none any more."""
    run, seen, deadline = psutil.Process(process.pid), False, time.monotonic() + 60.0
    while time.monotonic() < deadline:
        here = [child for child in run.children(recursive=True) if alive(child)]
        if seen and not here:
            return
        seen = seen or run.name() == "sleep"
        time.sleep(0.01)
    raise AssertionError(f"still there: {here}")
