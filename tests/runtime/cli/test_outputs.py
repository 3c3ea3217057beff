"""An output option replaces a file as a whole: after a full disk or a kill in the middle, the old file is there."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import runtime
from tests.runtime.runs import KNEE_EXO, ROOT, environment, finished, forked
from tests.soaking import soaked

LIMIT = 1000  # bytes, of a file that a command can write
OLD = "what was there before\n" * 200
# The limit holds from the moment at which the output is opened: shared memory is a file, too
COMMAND = f"""
import resource, signal, sys
from runtime.cli.main import main

def limit(event, arguments):
    if event == "open" and sys.argv[-1] in str(arguments[0]) and "r" not in str(arguments[1]):
        resource.setrlimit(resource.RLIMIT_FSIZE, ({LIMIT}, {LIMIT}))

signal.signal(signal.SIGXFSZ, signal.Handlers(int(sys.argv.pop(1))))
sys.dont_write_bytecode = True  # CPython does not notice that it writes only a part
sys.addaudithook(limit)
sys.exit(main())
"""
# {command: (name of the output, words)}, of all commands with -o
COMMANDS = {
    "draw": ("robot.svg", [KNEE_EXO]),
    "plot": ("figure.png", ["trial.mcap", "left/knee.torque"]),
    "diff": ("figure.png", ["trial.mcap", "other.mcap"]),
    "profile": ("bars.png", [KNEE_EXO, "--duration", "0.2", "--fast"]),
    "plotjuggler": ("layout.xml", [KNEE_EXO]),
}
ELSEWHERE = {  # {command with -o: test of its output}
    "analyse": "test_linearise.py, with the same writer as plot",
    "convert": "test_convert.py::test_a_failed_conversion_leaves_no_file",
    "study": "replaces only a table of the same study",
}


def words_of(command):
    name, words = COMMANDS[command]
    return [command, *(str(ROOT / word) if word == KNEE_EXO else word for word in words), "-o", name]


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("outputs")
    for name, scale in (("trial", "0.1"), ("other", "0.2")):
        words = [KNEE_EXO, "--fast", "--duration", "8", "--record", folder / name, "--set"]
        words = [*words, f"left/profile.scale={scale}"]
        assert finished(*words, cwd=ROOT).returncode == 0
        [path] = (folder / name).glob("*.mcap")
        path.rename(folder / f"{name}.mcap")
    return folder


def test_every_command_with_an_output_is_here():
    sources = Path(runtime.__file__).with_name("cli").glob("*.py")
    found = {path.stem for path in sources if re.search(r'"-o"|"--output"', path.read_text())}
    assert found == COMMANDS.keys() | ELSEWHERE.keys()


@pytest.mark.parametrize("ending", ["full", "killed"])
@pytest.mark.parametrize("command", soaked(COMMANDS, but=[1, 3]))
def test_the_old_file_survives_a_full_disk_and_a_kill_in_the_middle(recordings, command, ending):
    output = recordings / COMMANDS[command][0]
    output.write_text(OLD)
    before = {path.name for path in recordings.iterdir()}
    action = signal.SIG_IGN if ending == "full" else signal.SIG_DFL
    words = [sys.executable, "-c", COMMAND, str(int(action)), *words_of(command)]
    how = {"cwd": recordings, "env": environment(), "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    with forked(words, text=True, **how) as process:
        error = process.communicate(timeout=60)[1]
    assert output.read_text() == OLD, error
    if ending == "full":
        assert process.returncode == 2 and f"cannot write {output.name}: File too large" in error, error
        assert {path.name for path in recordings.iterdir()} == before
    else:
        assert process.returncode == -signal.SIGXFSZ, error
