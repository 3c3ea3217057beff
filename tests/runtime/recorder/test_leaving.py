"""A block that ends the control process behind the back of the run: what the recorder prints, and what it leaves."""

from types import SimpleNamespace

import pytest

from runtime.recorder.writer import cause_of_death
from tests.runtime.runs import Files, finished, knee

pytestmark = pytest.mark.timing


@pytest.mark.parametrize(
    "call, code", [("os._exit(0)", 0), ("os._exit(7)", 7), ("os.execv('/bin/sh', ['sh', '-c', 'exit 5'])", 5)]
)
def test_a_block_that_leaves_the_process_is_reported_with_its_tick_and_the_exit_code_is_its_own(tmp_path, call, code):
    path = knee(tmp_path, f"import os; tick == 20 and {call}; return 1.0")
    process = finished(path, "--fast", "--duration", "5", cwd=tmp_path, timeout=20)
    assert process.returncode == code and process.stdout == "" and "Traceback" not in process.stderr
    assert (
        "tickwork recorder: the control process died after tick 19 without ending the run: it was killed, or a "
        "block called"
    ) in process.stderr
    assert "os._exit or exec; 20 ticks were recorded, the last is 19: " in process.stderr
    files = Files(tmp_path / "recordings")
    assert files.sidecar["ended"] == "the control process died" and files.sidecar["last_tick"] == 19


@pytest.mark.parametrize(
    "state, tick, crashed, said",
    [
        ("arming", -1, 0, "while arming without"),
        ("ready", -1, 0, "before it was armed without"),
        ("running", -1, 0, "in its first tick without"),
        ("running", 41, 0, "after tick 41 without"),
        ("stopping", 41, 0, "during the safe stop without"),
        ("running", 41, 11, "of SIGSEGV"),
    ],
)
def test_the_cause_names_the_state_or_the_signal_that_the_page_shows(state, tick, crashed, said):
    page = SimpleNamespace(state=state, crashed=crashed, statistics=lambda: {"last_tick": tick})
    assert cause_of_death(page).startswith(said)
