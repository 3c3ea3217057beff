"""Held exceptions and NaN of a block are counted and reported: in the summary, in the recording, and as JSON."""

import json

from runtime.host.errors import FAULT, OK
from runtime.session.check.report import check
from tests.runtime.runs import finished, line_of, write

ROBOT = '''
import sys

from blocks.logic import Compare
from blocks.recorders import CsvRecorder
from blocks.safety import EmergencyStop
from blocks.sources import Ramp
from graph import Block, Diagram, Output


class Flaky(Block):
    """Fails now and then."""

    y = Output("1", "a one")

    def step(self, tick):
        {law}
        return 1.0


with Diagram("flaky", rate=100) as diagram:
    Flaky(hold_exceptions=3, name="sensor")
    {more}
    CsvRecorder()
'''


def robot(folder, law, more=""):
    return write(folder, ROBOT.format(law=law, more=more), "flaky.py")


def sidecar(folder):
    [path] = [path for path in (folder / "recordings").glob("*.json") if "diagram" not in path.name]
    return json.loads(path.read_text())


def test_held_exceptions_are_in_the_summary_and_the_recording(tmp_path):
    file = robot(tmp_path, "assert tick % 50 not in (20, 21), 'no data'")
    process = finished(file.name, "--duration", "1", "--fast", cwd=tmp_path)
    assert process.returncode == OK, process.stderr
    where = f"flaky.py:{line_of(file, 'no data')}"
    [line] = [line for line in process.stdout.splitlines() if line.startswith("  held")]
    assert line == (
        f"  held        sensor held 4 exceptions, the first at 0.2 s; the last: AssertionError: no data ({where})"
    )
    told = sidecar(tmp_path)
    assert told["end"]["held"] == [
        {"block": "sensor", "count": 4, "first_tick": 20, "last": "AssertionError: no data", "at": where}
    ]
    assert [event for event in told["events"] if event["event"] == "exception held"] == [
        {"event": "exception held", "block": "sensor", "tick": 20}
    ]


def test_one_exception_too_many_is_a_fault_with_its_line(tmp_path):
    file = robot(tmp_path, "assert tick < 30")
    process = finished(file.name, "--duration", "1", "--fast", "--no-record", cwd=tmp_path)
    assert process.returncode == FAULT
    assert "FAULT at sensor, tick 33 (0.33 s): its step raised an exception" in process.stderr
    assert f"flaky.py:{line_of(file, 'assert tick')}" in process.stderr and "held 3 exceptions" in process.stdout


def test_sys_exit_in_block_is_reported(tmp_path):
    file = robot(tmp_path, "tick == 30 and sys.exit('enough')")
    process = finished(file.name, "--duration", "1", "--fast", "--no-record", cwd=tmp_path)
    assert process.returncode == FAULT and "Traceback" not in process.stderr
    assert "FAULT at sensor, tick 30 (0.3 s): its step exited the program (SystemExit: enough)" in process.stderr
    assert f"flaky.py:{line_of(file, 'sys.exit')}" in process.stderr


def test_check_prints_number_of_held_exceptions(tmp_path):
    file = robot(tmp_path, "pass")
    assert {block["path"]: block["hold_exceptions"] for block in check(file)["blocks"]} == {
        "sensor": 3,
        "csv_recorder": 0,
    }
    process = finished("check", file.name, cwd=tmp_path)
    assert "flaky.py:22, holds 3 exceptions in a row" in process.stdout


def test_emergency_stop_is_reported_and_exits_with_fault_code(tmp_path):
    file = robot(tmp_path, "pass", 'EmergencyStop(name="stop")(Compare(">")(Ramp(1.0)(), 0.495))')
    process = finished(file.name, "--duration", "1", "--fast", cwd=tmp_path)
    assert process.returncode == FAULT
    assert "FAULT at stop, tick 50 (0.5 s): the emergency stop was pressed" in process.stderr
    assert sidecar(tmp_path)["ended"] == "fault: e-stop at stop, tick 50"


def test_nan_of_a_block_is_in_the_summary_although_nothing_reads_it(tmp_path):
    """In all steps, in some, and not at all in one whose values are numbers."""
    file = robot(tmp_path, "return float('nan') if tick >= 60 else 1.0", 'Flaky(name="other", every=2)')
    process = finished(file.name, "--duration", "1", "--fast", "--no-record", cwd=tmp_path)
    assert process.returncode == OK, process.stderr
    assert (
        "  NaN         sensor.y was NaN in 40 of 100 steps\n              other.y was NaN in 20 of 50 steps\n"
    ) in process.stdout
    file = robot(tmp_path, "return tick")
    assert "NaN" not in finished(file.name, "--duration", "1", "--fast", "--no-record", cwd=tmp_path).stdout
