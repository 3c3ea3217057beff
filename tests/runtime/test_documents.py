"""What README and docs show is what happens."""

import re
import shutil
import subprocess
import sys
import sysconfig
from importlib.util import find_spec

import pytest

import runtime
from runtime.host.errors import OK
from runtime.host.live.running import shared_state_of
from runtime.setup.bench import blocks
from tests.docs.fences import agree, without_numbers
from tests.peers import __main__ as peers
from tests.runtime.runs import KNEE_EXO, ROOT, environment, finished, started, write
from tests.runtime.terminals import patient

README = (ROOT / "README.md").read_text()
RUNNING, BLOCKS, NATIVE, TUNING, RECORDINGS, PLOTJUGGLER, SPEED = (
    (ROOT / "docs" / f"{name}.md").read_text()
    for name in (
        "reference/running",
        "how_to/blocks",
        "how_to/native_blocks",
        "how_to/tuning",
        "reference/recordings",
        "how_to/plotjuggler",
        "explanation/speed",
    )
)


def python_of(text):
    """Every block of Python in a page."""
    return re.findall(r"^```python(?: notest)?\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def shown_after(text, words):
    """The lines of the first indented block behind these words."""
    lines = []
    for line in text[text.index(words) :].splitlines():
        if line.startswith("    ") or (not line and lines):
            lines.append(line[4:])
        elif lines:
            break
    return "\n".join(lines).rstrip().splitlines()


@pytest.fixture
def sample(tmp_path):
    """The diagram of the README, as knee.py."""
    return write(tmp_path, python_of(README)[0], "knee.py")


def test_the_readme_shows_the_output_of_its_diagram(sample):
    process = finished("knee.py", "--duration", "5", "--fast", cwd=sample.parent)
    assert (process.returncode, process.stderr) == (OK, "")
    shown = shown_after(README, "knee.py --duration 5 --fast` simulates")
    assert len(python_of(README)[0].splitlines()) <= 15
    for line, printed in zip(shown, process.stdout.splitlines(), strict=True):
        assert agree(line, printed), (line, printed)
    plot = finished("plot", "recordings", "knee", cwd=sample.parent)
    assert (plot.returncode, plot.stderr) == (OK, "") and "`python -m runtime plot recordings knee`" in README


def test_the_readmes_diagram_moves(sample):
    trial = runtime.run(sample, 5)
    position = trial["knee.position"]
    assert position.max() > 0.2 and position.min() < -0.05 and abs(position[trial.time > 4.4]).max() > 0.01
    assert abs(position[(trial.time > 2.2) & (trial.time < 2.5)]).max() < 0.01


def test_the_readme_has_the_figures_of_the_speed_page():
    knee = "\n".join(shown_after(SPEED, "tests.peers")).split("\n\n")[0]
    shared = re.findall(r"^  (\w.*?)  +[\d.]+ +([\d.]+)", knee, re.MULTILINE)
    rows = re.findall(r"^\| (Tickwork, .*|0\.\d.*) \|$", README, re.MULTILINE)
    names, values = (row.split(" | ") for row in rows)
    assert len(names) == len(values) == 6
    for name, value in zip(names, values):
        median = next(float(text) for full, text in shared if full.startswith(name))  # fused is the first
        assert float(value) == pytest.approx(median, rel=0.02), name


def test_the_speed_page_shows_the_tables_of_bench_and_of_the_peers(command_line, monkeypatch, capsys):
    """The peers may be missing; so may the compiles and the goals, which follow the table."""
    monkeypatch.setattr(blocks, "COMPILE_REPEATS", {3: 1, 30: 1})
    _, out, _ = command_line("bench", "--seconds", "0.002", "--repeats", "7")
    printed = without_numbers(out.splitlines())
    shown = without_numbers(shown_after(SPEED, "measures your machine"))
    assert [line for line in shown[1:] if line not in printed] == [] and len(shown) == 6

    monkeypatch.setattr(sys, "argv", ["peers", "knee", "--seconds", "0.002", "--repeats", "1"])
    peers.main()
    printed = without_numbers(capsys.readouterr().out.splitlines())
    shown = without_numbers("\n".join(shown_after(SPEED, "tests.peers")).split("\n\n")[0].splitlines())
    own = [line for line in shown if line.lstrip()[:7] not in ("Drake, ", "PathSim", "bdsim #")]
    assert [line for line in own if line not in printed] == [] and len(own) == 6


def test_commands_of_the_pages_run(tmp_path):
    """Every line that starts a diagram, in virtual time and shorter; what is there to be read then is read by the
    page's own script.
    """
    write(tmp_path, python_of(RUNNING)[0], "hold.py")
    commands = [
        line.split("#")[0].split()[3:] for line in RUNNING.splitlines() if line.startswith("    python -m runtime ")
    ]
    assert len(commands) >= 4
    for file, *options in ([word for word in words if word != "--fast"] for words in commands):
        if file == "check":
            words = [file, *options]
        else:
            if "--duration" in options:
                where = options.index("--duration")
                del options[where : where + 2]
            words = [ROOT / file if "/" in file else file, *options, "--duration", "1", "--fast"]
        process = finished(*words, cwd=tmp_path)
        assert process.returncode == OK, f"{words}: {process.stderr}"
    simulated, reader = (
        subprocess.run(
            [sys.executable, write(tmp_path, python_of(RUNNING)[place], "script.py")],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=60,
        )
        for place in (1, 2)
    )
    assert simulated.stdout == "1000 ticks, final angle 0.524 rad, fault: None\n", simulated.stderr
    assert re.fullmatch(r"hold_.*\.csv: at 0\.995 s the knee was at 0\.\d\d rad\n", reader.stdout), reader.stderr


@pytest.mark.soak
def test_examples_of_the_recordings_page_have_the_documented_output(tmp_path):
    write(tmp_path, python_of(RUNNING)[0], "hold.py")
    for _ in range(2):
        assert finished("hold.py", "--fast", "--duration", "1", "--trial", "subject=S03", cwd=tmp_path).returncode == OK
    reader = subprocess.run(
        [sys.executable, write(tmp_path, python_of(RECORDINGS)[0], "read.py")],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert reader.stdout.splitlines() == [
        "200 samples in rad, until 0.995 s",
        "{'subject': 'S03'}",
        "996 samples at 1000 Hz",
        "2 trials, 400 rows",
    ], reader.stderr
    commands = [
        line.split("#")[0].split()[3:]
        for line in (RECORDINGS + PLOTJUGGLER).splitlines()
        if line.startswith("    python -m runtime ")
    ]
    assert len(commands) == 13
    one = min(str(path) for path in (tmp_path / "recordings").glob("hold_*.mcap"))
    walk = finished(KNEE_EXO, "--fast", "--duration", "12", "--trial", "mass=72", "--record", "walk", cwd=tmp_path)
    assert walk.returncode == OK, walk.stderr
    [recording] = (tmp_path / "walk").glob("*.mcap")
    for name in ("without", "assisted", "trial"):
        shutil.copy(recording, tmp_path / f"{name}.mcap")
    for words in commands:
        needs = {"parquet": "pyarrow", "mat": "scipy"}
        if any(
            find_spec(module) is None
            for kind, module in needs.items()
            if any(kind in word.split(",") for word in words)
        ):
            continue
        words = [one if word.startswith("recordings/") else "0.1" if word == "10" else word for word in words]
        process = finished(*words, cwd=tmp_path)
        assert process.returncode == OK, f"{words}: {process.stderr}"


def test_set_prints_the_output_of_the_page(tmp_path):
    write(tmp_path, python_of(RUNNING)[0], "hold.py")
    shown = shown_after(TUNING, "From another shell")
    commands = [number for number, line in enumerate(shown) if line.startswith("$ ")]
    run = started("hold.py", "--no-record", cwd=tmp_path)
    try:
        patient(lambda: (shared := shared_state_of(run.pid)) and shared.statistics()["ticks"] > 0)
        for first, last in zip(commands, [*commands[1:], len(shown)]):
            words = shown[first].removeprefix("$ python -m runtime ").replace("4711", str(run.pid)).split()
            process = finished(*words, cwd=tmp_path)
            assert (process.returncode, process.stderr) == (OK, "")
            for line, printed in zip(shown[first + 1 : last], process.stdout.splitlines(), strict=True):
                line, printed = (re.sub(r"(process|tick) \d+", r"\1", text) for text in (line, printed))
                assert agree(line, printed), (line, printed)
    finally:
        run.kill()
        run.communicate()


def test_the_block_of_the_page_works_as_written():
    namespace = {}
    exec("\n".join(python_of(BLOCKS)[:2]), namespace)
    assert namespace["hold"].step(3.0) == 3.0


@pytest.mark.skipif(shutil.which(sysconfig.get_config_var("CC").split()[0]) is None, reason="needs a C compiler")
@pytest.mark.soak
def test_the_native_block_of_the_page_compiles_and_runs(tmp_path):
    [kernel] = re.findall(r"^```cython\n(.*?)^```", NATIVE, re.DOTALL | re.MULTILINE)
    path = write(tmp_path, kernel, "my_kernels.pyx")
    compiled = subprocess.run(
        [sys.executable, "-c", "from Cython.Build.Cythonize import main; main()", "-3", "-i", str(path)],
        cwd=ROOT,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert compiled.returncode == 0, compiled.stderr
    write(tmp_path, python_of(NATIVE)[0] + "\nprint(Square().step(3.0))\n", "square.py")
    process = subprocess.run(
        [sys.executable, "square.py"], cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=60
    )
    assert process.stdout == "9.0\n", process.stderr


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_the_kernel_in_c_of_the_page_compiles_and_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    [source] = re.findall(r"^```c\n(.*?)^```", NATIVE, re.DOTALL | re.MULTILINE)
    write(tmp_path, source, "gain.c")
    command = re.search(r"gain\.c: (.*)", source)[1]
    assert command.startswith("cc ") and subprocess.run(command.split(), timeout=60).returncode == 0
    names = {"__name__": "sample"}
    exec(python_of(NATIVE)[1], names)
    assert names["Gain"](gain=2.0).step([1.0, 3.0]).tolist() == [2.0, 6.0]
