"""The recorder process from start to end: real processes, real signals, real files."""

import json
import math
import os
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from cext.memory.shared_state import SharedState
from runtime.record.recorder import RecorderError, RecorderProcess
from tests.runtime.record.recorder.processes import all_ended, ends_by_itself, writers
from tests.runtime.record.recorder.running import (
    CSV,
    STRIDES,
    columns,
    counting,
    leg,
    plan,
    read_csv,
    record,
    row,
    run,
    sink,
)
from tests.runtime.runs import open_files
from tests.runtime.terminals import patient

pytestmark = pytest.mark.paced

ROOT = Path(__file__).parents[4]
SIGNALS = columns("a.x m")


@pytest.fixture(autouse=True)
def forked_children():
    """Start the recorders as a run does: these tests are of their processes."""


def test_every_row_of_a_run_arrives_in_order_with_the_computed_values(tmp_path):
    outcome, report, shared = run(counting(), tmp_path, 3000, shared=SharedState(1 << 14))  # a ring of a hundred rows
    header, rows = read_csv(tmp_path / "counting.csv")
    assert header == ["time [s]", "tick", "counter.odd", "counter.value [m]", "counter.whole"]
    assert rows == [
        [repr(tick / 200), str(tick), str(tick % 2), repr(0.1 * tick), str(tick // 3)] for tick in range(3000)
    ]
    assert (
        report["ticks"] == shared.statistics()["ticks"] == 3000 and report["dropped"] == 0 and report["ended"] == "ok"
    )


def test_in_real_time_every_completed_tick_is_in_the_file(tmp_path):
    outcome, report, shared = run(counting(rate=1000), tmp_path, 300, virtual=False)
    ticks = [int(cells[1]) for cells in read_csv(tmp_path / "counting.csv")[1]]
    statistics = shared.statistics()
    assert (
        ticks == sorted(set(ticks)) and len(ticks) == statistics["ticks"] and len(ticks) + statistics["missed"] == 300
    )
    assert report["first_tick"] == ticks[0] and report["last_tick"] == ticks[-1] == statistics["last_tick"]


def test_data_files_of_two_identical_runs_are_byte_identical(tmp_path):
    for name in ("a", "b"):
        diagram, plant = leg()
        run(diagram, tmp_path / name, 1000, plant=plant)
    for name in ("leg.csv", "leg.can.log", "leg.mcap"):
        first = (tmp_path / "a" / name).read_bytes()
        assert len(first) > 50_000 and first == (tmp_path / "b" / name).read_bytes()


def test_sidecar_describes_run_and_outcome(tmp_path):
    diagram, plant = leg()
    outcome, report, shared = run(
        diagram, tmp_path, 100, plant=plant, metadata={"trial": {"subject": "S03"}, "odd": math.nan}
    )
    sidecar = json.loads(
        (tmp_path / "leg.json").read_text(), parse_constant=lambda word: pytest.fail(f"{word} is not JSON")
    )
    assert (
        sidecar["name"] == "leg"
        and sidecar["rate"] == 200
        and sidecar["virtual"] is True
        and sidecar["simulated"] is True
    )
    assert sidecar["metadata"] == {"trial": {"subject": "S03"}, "odd": None}
    assert sidecar["ticks"] == 100 and sidecar["missed"] == sidecar["dropped"] == 0 and sidecar["ended"] == "ok"
    assert sidecar["statistics"]["frames"]["sent"] == shared.statistics()["frames"]["sent"] > 100
    assert sidecar["began"].startswith("20") and sidecar["began"][-6] in "+-"  # ISO 8601 with the offset
    assert sidecar["files"] == report["files"] and {Path(f["path"]).name for f in sidecar["files"]} == {
        p.name for p in tmp_path.iterdir()
    }


def ended(event, folder):
    shared = SharedState(1 << 16)
    recorder = RecorderProcess(shared)
    recorder.configure(plan(folder, sink(CSV, "a", SIGNALS)))
    if event:
        shared.push(3, json.dumps({"event": "end", "culprit": None, "signal": 0, "tick": 7, **event}).encode())
    shared.close()
    return recorder.finish()["ended"]


def test_report_describes_how_the_run_ended(tmp_path):
    assert ended({"status": "ok"}, tmp_path) == "ok"
    assert ended({"status": "ok", "signal": 2}, tmp_path) == "stopped by SIGINT"
    assert ended({"status": "not finite", "culprit": "left/knee"}, tmp_path) == "fault: not finite at left/knee, tick 7"
    assert ended(None, tmp_path) == "without an end event"


CONTROL = """
import os, sys
from cext.memory.shared_state import RECORD_EVENT, SharedState
from tests.runtime.record.recorder.running import counting, run
shared = SharedState(fd=int(sys.argv[1]))
announce = lambda recorder: print(recorder.pid, flush=True)
run(counting(rate=500), sys.argv[2], -1, virtual=False, shared=shared, before=announce)
"""


class Controller:
    """A control process in real time, and what it and its recorder write to standard error."""

    def __init__(self, folder, **options):
        self.shared = SharedState(1 << 20)
        self.folder = folder
        self.process = subprocess.Popen(
            [sys.executable, "-c", CONTROL, str(self.shared.fd), str(folder)],
            cwd=ROOT,
            pass_fds=[self.shared.fd],
            text=True,
            stdout=subprocess.PIPE,
            **{"stderr": subprocess.PIPE, **options},
        )
        self.recorder = int(self.process.stdout.readline())

    def run_until(self, ticks):
        while self.shared.statistics()["ticks"] < ticks:
            assert self.process.poll() is None
            select.select([], [], [], 0.01)

    def kill(self):
        self.process.kill()
        self.process.wait(10)
        self.process.stdout.close()

    def ticks_in_file(self):
        return [int(cells[1]) for cells in read_csv(self.folder / "counting.csv")[1]]


@pytest.mark.hazard("H15b")
def test_after_kill_9_of_the_control_process_every_completed_tick_is_on_disk_and_the_recorder_ends(tmp_path):
    control = Controller(tmp_path)
    control.run_until(300)
    control.kill()
    assert ends_by_itself(control.recorder)
    statistics = control.shared.statistics()
    ticks = control.ticks_in_file()
    assert len(ticks) - statistics["ticks"] in (0, 1)  # killed between the row and the count, at worst
    assert ticks == sorted(set(ticks)) and ticks[-1] - statistics["last_tick"] in (0, 1) and len(ticks) >= 300
    sidecar = json.loads((tmp_path / "counting.json").read_text())
    assert sidecar["ended"] == "the control process died" and sidecar["end"] is None and sidecar["ticks"] == len(ticks)
    said = control.process.stderr.read()
    control.process.stderr.close()
    how = (
        f"after tick {statistics['last_tick']} without ending the run: it was killed, or a block called exit, "
        "os._exit or exec"
    )
    assert said.splitlines() == [
        f"tickwork recorder: the control process died {how}; {len(ticks)} ticks were recorded, the last is "
        f"{ticks[-1]}: "
        f"{tmp_path}/counting.csv, {tmp_path}/counting.mcap, {tmp_path}/counting.json"
    ]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["counting.csv", "counting.json", "counting.mcap"]


def test_neither_signals_nor_a_broken_terminal_end_it_while_control_lives(tmp_path):
    reader, writer = os.pipe()
    control = Controller(tmp_path, stderr=writer)
    os.close(writer)
    os.close(reader)  # nobody reads what it says
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE, signal.SIGQUIT, signal.SIGUSR1):
        os.kill(control.recorder, number)
    control.run_until(200)
    control.kill()
    assert ends_by_itself(control.recorder)
    assert len(control.ticks_in_file()) >= control.shared.statistics()["ticks"]


def test_ctrl_c_in_the_terminal_reaches_the_controller_only(tmp_path):
    control = Controller(tmp_path)
    assert os.getsid(control.recorder) == control.recorder != os.getsid(control.process.pid)
    control.run_until(100)
    control.process.send_signal(signal.SIGINT)  # the executor's own handler: a safe stop, a whole recording
    assert control.process.wait(20) == 0
    assert ends_by_itself(control.recorder)
    sidecar = json.loads((tmp_path / "counting.json").read_text())
    assert sidecar["ended"] == "stopped by SIGINT" and sidecar["ticks"] == control.shared.statistics()["ticks"]
    assert control.process.stderr.read() == ""
    control.process.stdout.close()
    control.process.stderr.close()


def test_a_folder_that_is_deleted_ends_its_files_with_a_line_each_and_leaves_no_process(tmp_path, capfd):
    (tmp_path / "work").mkdir()
    before = os.getcwd()
    os.chdir(tmp_path / "work")
    try:
        shared = SharedState(1 << 20)
        recorder = RecorderProcess(shared)
        recorder.configure(plan("recordings", sink(CSV, "csv", SIGNALS)))
        session = os.getsid(recorder.pid)
        shutil.rmtree(tmp_path / "work")
    finally:
        os.chdir(before)
    for tick in range(5):
        assert shared.push(*row(tick, 1.0))
    shared.close()
    report = recorder.finish()
    problems = report["problems"]
    assert ends_by_itself(recorder.pid, 5.0) and all_ended(session)
    assert {file["note"] for file in report["files"]} == {"deleted while it was written"}
    deleted = [
        f"{name} stopped at 0.02 s: its file was deleted: recordings/bench_1.{end}"
        for name, end in (("csv", "csv"), ("flight log", "mcap"))
    ]
    assert problems == [*deleted, "recordings/bench_1.json: No such file or directory"]
    told = capfd.readouterr().err.splitlines()
    assert told == [f"tickwork recorder: {line}; the run continues" for line in deleted]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.soak
def test_no_writer_starts_once_the_control_process_has_ended(tmp_path):
    control = Controller(tmp_path)
    session = os.getsid(control.recorder)
    control.run_until(100)
    [writer] = patient(lambda: writers(session))
    os.kill(writer, signal.SIGSTOP)
    control.kill()
    os.kill(writer, signal.SIGKILL)
    assert ends_by_itself(control.recorder, 5.0) and all_ended(session)
    said = control.process.stderr.read()
    control.process.stderr.close()
    assert said == (
        "tickwork recorder: the writer of part 1 died (SIGKILL); recording stops and the run continues without it\n"
    )
    assert len(list(tmp_path.glob("*.mcap"))) == 1


def refused(folder, *sinks, match):
    shared = SharedState(1 << 12)
    recorder = RecorderProcess(shared)
    with pytest.raises(RecorderError, match=match) as caught:
        recorder.configure(plan(folder, *sinks))
    recorder.abandon()  # as the caller does: harmless
    assert "\n" not in str(caught.value)


def test_a_folder_that_cannot_be_written_is_refused_before_the_run(tmp_path):
    csv = sink(CSV, "csv_recorder", SIGNALS)
    (tmp_path / "file").write_text("")
    refused(tmp_path / "file", csv, match=r"cannot record into '.*file': .*file is not a folder")
    refused(tmp_path / "file" / "below", csv, match=r"cannot record into '.*below': Not a directory")
    refused(
        "/proc/tickwork", csv, match="cannot record into '/proc/tickwork': No such file or directory: /proc/tickwork"
    )
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o555)
    if os.getuid() != 0:  # who is root may write anywhere
        refused(closed, csv, match="cannot record into '.*closed': Permission denied")
    assert list(closed.iterdir()) == []


def test_files_of_a_rejected_recording_are_removed(tmp_path):
    bad = sink(CSV, "bad_recorder", SIGNALS, file="x" * 300)
    good = sink(CSV, "csv_recorder", SIGNALS)
    refused(tmp_path / "new" / "newer", good, bad, match="bad_recorder cannot start: File name too long")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "service, match",
    [
        ("no_such_package.csv:Writer", "mine cannot start: ModuleNotFoundError: No module named 'no_such_package'"),
        ("runtime.record.recorder.services.csv:NoSuchWriter", "mine cannot start: AttributeError: .*NoSuchWriter"),
        (STRIDES, "mine cannot start: ValueError: wire all five inputs"),
    ],
)
def test_a_service_that_cannot_start_is_named(tmp_path, service, match):
    refused(tmp_path, sink(service, "mine", SIGNALS), match=match)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_stops_the_writer_and_nothing_else(tmp_path, capfd):
    shared = SharedState(1 << 20)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, hard))  # the child inherits it: no file above 8 KiB
    try:
        recorder = RecorderProcess(shared)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    wide = columns(*(f"a.x{index} m" for index in range(20)))
    recorder.configure(
        plan(tmp_path, sink(CSV, "wide", wide, flush_rows=10), sink(CSV, "narrow", wide[:1], file="narrow"))
    )
    for tick in range(400):
        assert shared.push(*row(tick, *range(20)))
    shared.close()
    report = recorder.finish()
    assert [re.sub(r"[\d.]+ s", "# s", problem) for problem in sorted(report["problems"])] == [
        "flight log stopped at # s: File too large",
        "wide stopped at # s: File too large",
    ]
    assert capfd.readouterr().err.splitlines() == [
        f"tickwork recorder: {problem}; the run continues" for problem in report["problems"]
    ]
    assert report["ticks"] == 400 and len(read_csv(tmp_path / "narrow.csv")[1]) == 400
    cut = read_csv(tmp_path / "bench_1.csv")[1]
    assert 10 <= len(cut) < 400 and all(len(cells) == 22 for cells in cut)
    assert {"path": str(tmp_path / "bench_1.csv"), "note": "incomplete"} in report["files"]


def test_deleted_files_are_reported_and_others_continue(tmp_path, capfd):
    shared, folder = SharedState(1 << 20), tmp_path / "out"
    recorder = RecorderProcess(shared)
    recorder.configure(plan(folder, sink(CSV, "csv", SIGNALS), sink(CSV, "kept", SIGNALS, file="kept"), virtual=False))
    for tick in range(100):
        assert shared.push(*row(tick, 1.0))
    patient(lambda: (folder / "bench_1.csv").stat().st_size > 500)
    for ending in ("csv", "mcap"):
        (folder / f"bench_1.{ending}").unlink()
    for tick in range(100, 200):
        assert shared.push(*row(tick, 1.0))
    patient(lambda: (folder / "kept.csv").read_text().count("\n") == 201)
    shared.close()
    report = recorder.finish()
    # in either order: a look may lie between the two deletions
    assert sorted(re.sub(r" at [\d.]+ s", "", problem) for problem in report["problems"]) == [
        f"{path} stopped: its file was deleted: {folder}/bench_1.{ending}"
        for path, ending in (("csv", "csv"), ("flight log", "mcap"))
    ]
    told = capfd.readouterr().err
    assert told.count("; the run continues") == 2 and "Traceback" not in told
    assert (
        report["ticks"] == 200
        and {"path": f"{folder}/bench_1.csv", "note": "deleted while it was written"} in report["files"]
    )
    assert len(read_csv(folder / "kept.csv")[1]) == 200


LAB = """
import json
from pathlib import Path
from runtime.record.recorder.service import Service

class Summer(Service):
    def open(self):
        self.total = 0.0
    def row(self, tick, time, values):
        if tick == self.sink["parameters"].get("breaks_at"):
            raise RuntimeError("broken on purpose")
        self.total += sum(values)
    def close(self):
        return {"total": self.total}
    @classmethod
    def conclude(cls, plan, services):
        return {"grand_total": sum(service.total for service in services)}
"""


def test_custom_service_is_loaded(tmp_path, monkeypatch):
    (tmp_path / "lab_package.py").write_text(LAB)
    monkeypatch.syspath_prepend(str(tmp_path))
    signals = columns("a.x m", "a.y m")
    service = "lab_package:Summer"
    report = record(
        plan(
            None,
            sink(service, "both", signals),
            sink(service, "one", signals[1:]),
            sink(service, "broken", signals, breaks_at=5),
        ),
        [row(tick, 1.0, 10.0) for tick in range(10)],
    )
    assert (
        report["sinks"]["both"] == {"total": 110.0}
        and report["sinks"]["one"] == {"total": 100.0}
        and report["grand_total"] == 210.0
    )
    assert (
        report["sinks"]["broken"]["failed"]
        == report["problems"][0]
        == ("broken stopped at 0.02 s: RuntimeError: broken on purpose")
    )
    assert report["ticks"] == 10


@pytest.mark.parametrize("configured", [True, False])
def test_an_abandoned_recording_leaves_no_files(tmp_path, configured):
    recorder = RecorderProcess(SharedState(1 << 12))
    if configured:
        recorder.configure(plan(tmp_path / "new", sink(CSV, "a", SIGNALS), buses=["legs"]))
        assert {path.name for path in (tmp_path / "new").iterdir()} >= {
            "bench_1.csv",
            "bench_1.can.log",
            "bench_1.mcap",
            "bench_1.json",
        }
    recorder.abandon()
    recorder.abandon()
    # the writer removes its files after its parent has ended, if that takes longer than ABANDON_TIMEOUT
    patient(lambda: list(tmp_path.iterdir()) == [], 1.0)
    assert ends_by_itself(recorder.pid, 0.0)


def test_a_recorder_that_waits_takes_over_what_the_loading_of_a_diagram_changes(tmp_path, monkeypatch):
    """Its process starts before the diagram is loaded, whose code can change folder, path and environment."""
    recorder = RecorderProcess()
    libraries, work = tmp_path / "libraries", tmp_path / "work"
    libraries.mkdir()
    work.mkdir()
    (libraries / "spy.py").write_text(
        "import os, time\nfrom runtime.record.recorder.service import Service\n\nclass Spy(Service):\n"
        "    def close(self):\n        return {'environment': ascii(os.environ), 'zone': time.tzname[0]}\n"
    )
    monkeypatch.chdir(work)
    monkeypatch.syspath_prepend(libraries)
    monkeypatch.setenv("ADDED", "\udcff text")
    monkeypatch.setenv("TZ", "XYZ-5")
    monkeypatch.delenv("PATH")
    assert recorder.usable
    shared = SharedState(1 << 20, empty=recorder.memory)
    recorder.configure(plan("out", sink("spy:Spy", "spy", SIGNALS)))
    recorder.dismiss()  # does nothing: the recorder has its plan
    assert shared.push(*row(0, 1.0))
    shared.close()
    report = recorder.finish()
    assert report["sinks"]["spy"] == {"environment": ascii(os.environ), "zone": "XYZ"} and report["problems"] == []
    assert report["ticks"] == 1 and (work / "out" / "bench_1.mcap").exists()


def test_a_recorder_without_a_run_is_dismissed(tmp_path):
    recorder = RecorderProcess()
    recorder.dismiss()
    assert ends_by_itself(recorder.pid, 0.0) and not recorder.usable
    os.close(recorder.memory)


def test_a_control_process_that_dies_before_the_run_leaves_no_files(tmp_path):
    script = (
        "import os, sys\nfrom cext.memory.shared_state import SharedState\n"
        "from runtime.record.recorder import RecorderProcess\n"
        "from tests.runtime.record.recorder.running import CSV, columns, plan, sink\n"
        "recorder = RecorderProcess(SharedState(4096))\n"
        "if sys.argv[2] == 'configured': recorder.configure(plan(sys.argv[1], sink(CSV, 'a', columns('a.x m'))))\n"
        "print(recorder.pid, flush=True)\nos.kill(os.getpid(), 9)\n"
    )
    for when in ("configured", "spawned"):
        command = [sys.executable, "-c", script, str(tmp_path / "new"), when]
        died = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
        assert died.returncode == -9 and ends_by_itself(int(died.stdout)) and died.stderr == ""
        assert list(tmp_path.iterdir()) == []


def test_child_imports_same_packages_as_parent_from_any_working_folder(tmp_path):
    for name in ("runtime", "cext", "graph", "json", "mmap", "msgspec", "select"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('imported from the working folder')")
    script = tmp_path / "elsewhere" / "control.py"
    script.parent.mkdir()
    script.write_text(
        f"import sys\nsys.path.insert(1, {str(ROOT)!r})\n"
        "from tests.runtime.record.recorder.running import counting, run\n"
        "outcome, report, page = run(counting(), 'here', 100)\nprint(report['ticks'], report['problems'])\n"
    )
    done = subprocess.run([sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.stdout == "100 []\n", done.stderr
    assert len(read_csv(tmp_path / "here" / "counting.csv")[1]) == 100


def test_the_child_process_imports_neither_numpy_nor_graph(tmp_path):
    (tmp_path / "spy.py").write_text(
        "import sys\nfrom runtime.record.recorder.service import Service\n\n"
        "class Spy(Service):\n    def close(self):\n        return {'modules': sorted(sys.modules)}\n"
    )
    script = (
        "import sys\nsys.path.insert(0, sys.argv[1])\nfrom tests.runtime.record.recorder.running import *\n"
        "signals = columns('a.x m')\n"
        "sinks = [sink('spy:Spy', 'spy', signals), sink(CSV, 'a', signals)]\n"
        "report = record(plan(sys.argv[1], *sinks, buses=['legs']), [row(0, 1.0)])\n"
        "print([name for name in ('numpy', 'networkx', 'matplotlib', 'graph', 'can') if name in "
        "report['sinks']['spy']['modules']])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert done.stdout == "['can']\n", done.stderr


def test_the_control_process_imports_no_unneeded_library():
    script = (
        "import sys; import runtime.record.recorder; print([n for n in ('numpy', 'networkx', 'msgspec', 'can', 'cext') "
        "if n in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.stdout == "[]\n", done.stderr


def test_no_descriptor_and_no_process_remains_after_a_run(tmp_path):
    def once():
        record(plan(tmp_path, sink(CSV, "a", SIGNALS)), [row(0, 1.0)])

    once()
    before, children = open_files(), psutil.Process().children()
    for _ in range(3):
        once()
    assert not open_files() - before and psutil.Process().children() == children


def test_a_recorder_that_the_diagram_has_stopped_continues_with_a_plan_larger_than_a_pipe(tmp_path):
    recorder = RecorderProcess()
    os.kill(recorder.pid, signal.SIGSTOP)
    shared = SharedState(1 << 20, empty=recorder.memory)
    many = columns(*(f"a_source_with_a_long_name_{number}.y m" for number in range(1000)))
    recorder.configure(plan(tmp_path, sink(CSV, "csv", many, file="", signals="")))
    shared.close()
    assert recorder.finish()["problems"] == []


def test_a_recorder_that_stays_stopped_ends_the_run_within_a_bound(tmp_path, monkeypatch):
    recorder, killpg = RecorderProcess(), os.killpg
    os.kill(recorder.pid, signal.SIGSTOP)
    monkeypatch.setattr(os, "killpg", lambda group, number: number == signal.SIGCONT or killpg(group, number))
    monkeypatch.setattr("runtime.record.recorder.READY_TIMEOUT", 0.3)
    many = columns(*(f"a_source_with_a_long_name_{number}.y m" for number in range(1000)))
    with pytest.raises(RecorderError, match="not ready within 0.3 s: a debugger or the diagram has stopped it"):
        recorder.configure(plan(tmp_path, sink(CSV, "csv", many, file="", signals="")))
    assert not recorder.alive and list(tmp_path.iterdir()) == []
