"""Blocks that change the state of their process, and machines without room: a run with a recording ends in order.

One second after the end no process of the run exists, and no file but the recording.
"""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from tests.runtime.runs import Files, environment, finished, knee
from tests.soaking import soaked

SETUP = """
import os, resource, shutil, signal, sys, threading, time

folder = os.getcwd()


def limit(name, value):
    resource.setrlimit(getattr(resource, "RLIMIT_" + name), (value, value))


def spin():
    while True:
        pass
"""
COMPLETE, ENDED, DIED = "200 of 200 done", "done, 0 missed", ""
ATTACKS = {  # expression in tick 20, exit code, text in the summary, text on standard error
    "chdir": ("os.chdir('/')", 0, COMPLETE, ""),
    # again where the recorder has put a file into a folder that was just emptied
    "folder deleted": (
        "[shutil.rmtree(folder, ignore_errors=True) for _ in range(9)]",
        4,
        "its file was deleted",
        "its file was deleted",
    ),
    "_exit": ("os._exit(7)", 7, DIED, "died in law after tick 19"),
    "exec": ("os.execv('/bin/sh', ['sh', '-c', 'exit 5'])", 5, DIED, "died in law after tick 19"),
    "sys.exit": ("sys.exit(5)", 3, "20 of 200 done", "SystemExit"),
    "SIGTERM": ("signal.raise_signal(signal.SIGTERM)", 143, ENDED, "stopped by SIGTERM"),
    "SIGALRM": ("signal.raise_signal(signal.SIGALRM)", -signal.SIGALRM, DIED, "died in law after tick 19"),
    "SIGKILL": ("signal.raise_signal(signal.SIGKILL)", -signal.SIGKILL, DIED, "died in law after tick 19"),
    "SIGSEGV": ("signal.raise_signal(signal.SIGSEGV)", -signal.SIGSEGV, DIED, "died of SIGSEGV in law"),
    "spinning thread": ("threading.Thread(target=spin).start()", 0, COMPLETE, ""),
    "3 descriptors": ("limit('NOFILE', 3)", 0, COMPLETE, ""),
    "no descriptors": ("limit('NOFILE', 0)", 0, "the report of the recorder is missing", ""),
    "files of 0 bytes": ("limit('FSIZE', 0)", 0, COMPLETE, ""),
    "1 MiB of memory": ("limit('AS', 1 << 20)", 0, COMPLETE, ""),
    "no processes": ("limit('NPROC', 0)", 0, COMPLETE, ""),
    "umask": ("os.umask(0o777)", 0, COMPLETE, ""),
    "descriptors closed": ("os.closerange(3, 1024)", 0, "the report of the recorder is missing", ""),
    "all closed": ("os.closerange(0, 1024)", 0, "", ""),
    "excepthook": ("setattr(sys, 'excepthook', None)", 0, COMPLETE, ""),
    "modules": ("sys.modules.clear()", 0, COMPLETE, ""),
    "fork": ("os.fork()", 0, COMPLETE, "its child process returned to the loop"),
}


def processes_with(name, value):
    """Processes whose environment has a variable with this value."""
    matches = []
    for process in psutil.process_iter():
        try:
            if process.environ().get(name) == value and process.status() != psutil.STATUS_ZOMBIE:
                matches.append(process)
        except (psutil.AccessDenied, psutil.NoSuchProcess):
            pass
    return matches


def assert_no_process(tag):
    deadline = time.monotonic() + 1.0
    while (left := processes_with("RUN_TAG", tag)) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not left, [process.cmdline() for process in left]


@pytest.mark.parametrize("attack", soaked(ATTACKS, but=[1, 3, 4, 8, 11, 13, 17, 20]))
def test_a_block_that_corrupts_its_process_does_not_damage_the_recording(tmp_path, attack):
    expression, code, summary, error = ATTACKS[attack]
    path = knee(tmp_path, f"tick == 20 and ({expression}); return 1.0")
    path.write_text(path.read_text().replace("import math", "import math" + SETUP, 1))
    words = (path, "--fast", "--duration", "1", "--record", "out")
    # a forked process has the memory of its server, and room in it
    process = finished(*words, cwd=tmp_path, cold=attack == "1 MiB of memory", RUN_TAG=str(tmp_path))
    assert process.returncode == code, process.stderr
    assert summary in process.stdout and error in process.stderr, process.stdout + process.stderr
    assert "Traceback" not in process.stderr
    assert_no_process(str(tmp_path))
    if attack == "folder deleted":
        assert not tmp_path.exists()
        return
    assert {path.name for path in tmp_path.iterdir()} <= {"out", "robot.py", "__pycache__"}
    files = Files(tmp_path / "out")
    assert sorted(name.partition(".")[2] for name in files.names) == ["csv", "json", "mcap"]
    rows = 200 if code == 0 else files.sidecar["ticks"]
    assert len(files.table["tick"]) == rows >= 20 and files.table["tick"].tolist() == list(range(rows))


def limited(tmp_path, folder, **limits):
    """A run in a process with resource limits. Returns the CompletedProcess."""
    words = (knee(tmp_path), "--fast", "--duration", "1", "--record", folder)
    return finished(*words, cwd=tmp_path, limits=limits, RUN_TAG=str(tmp_path))


@pytest.mark.parametrize(
    "limits, folder, text",
    [
        ({"RLIMIT_FSIZE": 4096}, "out", "File too large: a limit of the system was reached"),
        ({"RLIMIT_NOFILE": 10}, "out", "Too many open files: a limit of the system was reached"),
        ({}, "/proc/self/out", "cannot record into '/proc/self/out': No such file or directory"),
        ({}, "robot.py", "robot.py is not a folder"),
    ],
)
def test_insufficient_resources_are_reported_before_the_run(tmp_path, limits, folder, text):
    process = limited(tmp_path, folder, **limits)
    assert process.returncode == 2 and text in process.stderr, process.stderr
    assert process.stdout == "" and len(process.stderr.splitlines()) == 1
    assert_no_process(str(tmp_path))
    assert {path.name for path in tmp_path.iterdir()} <= {"robot.py", "__pycache__"}


def test_a_full_disk_ends_the_recording_and_not_the_run(tmp_path):
    """The limit of 1.2 MB holds the shared memory of the run, and not its flight log."""
    words = (knee(tmp_path), "--fast", "--duration", "60", "--record", "out")
    process = finished(*words, cwd=tmp_path, limits={"RLIMIT_FSIZE": 1_200_000}, RUN_TAG=str(tmp_path))
    assert process.returncode == 4 and "12000 of 12000 done" in process.stdout, process.stderr
    assert process.stdout.startswith("THE RECORDING IS NOT COMPLETE: incomplete: out/robot_")
    assert "plot the recording" not in process.stdout
    assert "File too large" in process.stdout and "Traceback" not in process.stderr
    assert_no_process(str(tmp_path))


def test_a_recording_needs_neither_a_usable_time_zone_nor_the_working_folder(tmp_path):
    """What describes a recording is null where it cannot be had."""
    path, gone = knee(tmp_path), tmp_path / "gone"
    text = path.read_text().replace("import math", "import math, os, shutil, tempfile", 1)
    path.write_text(text + "\nshutil.rmtree(os.getcwd())\n")
    gone.mkdir()
    out = tmp_path / "out"
    process = finished(path, "--fast", "--duration", "1", "--record", out, cwd=gone, TZ="XYZ-99:99:99", cold=True)
    assert (process.returncode, process.stderr) == (0, "") and not gone.exists()
    files = Files(out)
    assert files.sidecar["began"] is None and len(files.table["tick"]) == 200
    assert files.sidecar["versions"]["tickwork"] and files.sidecar["machine"]["processors"]


def test_a_working_folder_that_was_deleted_is_reported(tmp_path):
    path, gone = knee(tmp_path), tmp_path / "gone"
    gone.mkdir()
    command = f'cd {gone} && rmdir {gone} && "{sys.executable}" -m runtime ../robot.py --fast --duration 1'
    process = subprocess.run(["/bin/sh", "-c", command], env=environment(), capture_output=True, text=True)
    assert process.returncode == 2 and path.exists()
    assert process.stderr == "tickwork: the working folder was deleted: change to another folder\n", process.stderr
    assert os.listdir(tmp_path) == ["robot.py"]


FORK = """
if not os.fork():  # a second run, in another folder
    os.mkdir("child")
    os.chdir("child")
    for number in (1, 2):
        os.dup2(os.open("output", os.O_WRONLY | os.O_CREAT | os.O_APPEND), number)
"""


@pytest.mark.paced
@pytest.mark.parametrize(
    "does, code",
    [
        ("os.closerange(3, 1024)", 0),
        ("os.system('kill -9 $(pgrep -P $PPID -f recorder.process)')", 0),
        (FORK, 0),
        ("1 / 0", 2),
    ],
    ids=["descriptors closed", "recorder killed", "fork", "exception"],
)
def test_a_diagram_cannot_break_the_recorder_that_waits_for_it(tmp_path, does, code):
    """It waits while the diagram is loaded; another starts where it cannot be used, and without a run it ends."""
    path = knee(tmp_path)
    path.write_text(path.read_text().replace("import math", f"import math, os\n\n{does}\n", 1))
    words = (path, "--duration", "0.2", "--record", "out")
    process = finished(*words, cwd=tmp_path, cold=True, RUN_TAG=str(tmp_path))
    assert process.returncode == code, process.stderr
    assert_no_process(str(tmp_path))
    if code == 0:
        files = Files(tmp_path / "out")
        assert process.stderr == "" and files.sidecar["ended"] == "ok" and len(files.table["tick"]) > 20
