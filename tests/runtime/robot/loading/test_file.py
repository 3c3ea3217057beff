"""Diagram files: what they may be, what they may import, and what is said of those that cannot be used."""

import os
import sys

import pytest

from graph import Diagram
from runtime.host.diagram_folders import DiagramFolder
from runtime.host.errors import BAD_INPUT, CHECK_FAILED, OK
from runtime.robot.loading.file import load
from tests.runtime.runs import KNEE, KNEE_EXO, finished, knee, line_of, write

WAVE = """
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Diagram

{before}
with Diagram("wave", rate=100) as diagram:
    Sine(amplitude={amplitude})
    CsvRecorder()
"""

BUILD = """
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Diagram


def build({parameters}):
    {before}
    with Diagram("wave", rate=100) as diagram:
        Sine(amplitude=amplitude)
        CsvRecorder()
    return diagram
"""


@pytest.fixture
def refused(command_line):
    """Runs a file that cannot be used. Returns the complaint without `tickwork: `; asserts code, silence and
    cleanliness.
    """

    def run(path, *options, code=BAD_INPUT):
        return command_line.refused(path, *options, code=code)

    return run


def test_a_file_may_offer_a_diagram(tmp_path):
    file, diagram = load(write(tmp_path, WAVE.format(before="", amplitude=2.0)))
    assert isinstance(diagram, Diagram) and diagram["sine"].amplitude == 2.0
    assert not file.has_plant


def test_parameters_of_build_may_have_any_name(tmp_path):
    path = write(
        tmp_path,
        BUILD.format(
            parameters="file='', function=0, path='', amplitude=1.0", before="amplitude = amplitude + function"
        ),
    )
    assert (
        load(path, [("file", "walking.csv"), ("function", "2"), ("path", "x"), ("amplitude", "1.0")])[1][
            "sine"
        ].amplitude
        == 3.0
    )


def test_a_file_may_offer_build_with_parameters(tmp_path):
    path = write(tmp_path, BUILD.format(parameters="amplitude=1.0", before="pass"))
    assert load(path)[1]["sine"].amplitude == 1.0
    assert load(path, [("amplitude", "2.5")])[1]["sine"].amplitude == 2.5


def test_an_edit_in_the_same_second_is_detected(tmp_path):
    path = write(tmp_path, WAVE.format(before="", amplitude=1.5))
    load(path)
    stamp = path.stat().st_mtime_ns
    write(tmp_path, WAVE.format(before="", amplitude=2.5))
    os.utime(path, ns=(stamp, stamp))
    assert load(path)[1]["sine"].amplitude == 2.5


def test_a_file_leaves_no_bytecode_beside_it(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    load(write(tmp_path, WAVE.format(before="", amplitude=1.5)))
    assert [path.name for path in tmp_path.iterdir()] == ["robot.py"]


def test_a_file_imports_its_neighbours(tmp_path):
    write(tmp_path, "AMPLITUDE = 4.0\n", "amplitudes.py")
    path = write(tmp_path, WAVE.format(before="from amplitudes import AMPLITUDE", amplitude="AMPLITUDE"))
    assert load(path)[1]["sine"].amplitude == 4.0


def test_each_file_imports_its_own_neighbour_of_a_common_name(tmp_path):
    paths = []
    for name, amplitude in (("a", 2.0), ("b", 5.0)):
        (tmp_path / name).mkdir()
        write(tmp_path / name, f"AMPLITUDE = {amplitude}\n", "common_amplitude.py")
        text = WAVE.format(before="from common_amplitude import AMPLITUDE", amplitude="AMPLITUDE")
        paths.append(write(tmp_path / name, text))
    amplitudes = [load(paths[place])[1]["sine"].amplitude for place in (0, 1, 0, 1, 1)]
    assert amplitudes == [2.0, 5.0, 2.0, 5.0, 5.0]


def test_files_beside_the_diagram_never_shadow_a_library(tmp_path):
    """A folder with a `blocks` of its own, or a `json`, does not change what Tickwork or Python mean by the name."""
    for name in ("json", "blocks", "numpy"):
        write(tmp_path, "raise RuntimeError('the wrong one')\n", f"{name}.py")
    _, diagram = load(write(tmp_path, WAVE.format(before="import json, numpy", amplitude=1.0)))
    assert len(diagram) == 2
    libraries = [place for place, entry in enumerate(sys.path) if not isinstance(entry, DiagramFolder)]
    assert sys.path.index(str(tmp_path)) == max(libraries) + 1


def test_files_of_the_working_folder_do_not_shadow_those_beside_the_diagram(tmp_path):
    """As from a folder with a `wearer.py` of one's own, whatever was imported from there before."""
    write(tmp_path, "raise RuntimeError('the wrong one')\n", "wearer.py")
    robots = sorted(path for path in KNEE_EXO.parent.glob("*.py") if "wearer as plant" in path.read_text())
    assert len(robots) > 5
    for robot in robots[:3]:
        found = finished("check", robot, cwd=tmp_path)
        assert (found.returncode, found.stderr) == (OK, "")


def test_a_neighbour_with_a_librarys_name_is_reported(tmp_path, refused):
    write(tmp_path, "GAINS = 3.0\n", "json.py")
    path = write(tmp_path, WAVE.format(before="from json import GAINS", amplitude=1.0))
    complaint = refused(path)
    assert "ImportError: cannot import name 'GAINS' from 'json'" in complaint
    assert "json.py beside robot.py has the name of a library: rename it" in complaint


@pytest.mark.parametrize("name", ["nothing.py", "folder/nothing.py", "nothing"])
def test_a_missing_file_is_reported(tmp_path, refused, name):
    assert refused(name) == f"file {name} does not exist"


def test_a_mistyped_file_is_suggested(tmp_path, refused):
    knee(tmp_path)
    assert refused("robto.py") == "file robto.py does not exist: did you mean 'robot.py'?"


def test_a_folder_in_place_of_a_file_is_reported(tmp_path, refused):
    (tmp_path / "robots").mkdir()
    assert refused("robots") == "robots is a folder: name a diagram file in it, such as robots/knee_exo.py"
    knee(tmp_path / "robots")
    assert refused("robots").endswith("such as robots/robot.py")


@pytest.mark.parametrize("content", [b"\x7fELF\x02\x01\x01\x00\x00\x00", b"\x00", b"x = 1\n\x00\xff"])
def test_a_binary_file_is_reported(tmp_path, refused, content):
    (tmp_path / "robot.py").write_bytes(content)
    assert refused("robot.py") == "robot.py is not text: a diagram file is Python"


def test_a_file_in_another_encoding(tmp_path, refused):
    (tmp_path / "robot.py").write_bytes(b"a = 1\nb = '\xe9'\n")
    assert refused("robot.py").startswith("robot.py:")
    old, new = "(unicode error) 'utf-8' codec can't decode byte 0xe9", "Non-UTF-8 code starting with '\\xe9' on line 2"
    assert f"syntax error: {old if sys.version_info < (3, 14) else new}" in refused("robot.py")


def test_a_file_that_is_not_python_by_name(tmp_path, refused):
    (tmp_path / "robot.toml").write_text("")
    assert refused("robot.toml") == "robot.toml is not a Python file: its name must end in .py"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read(tmp_path, refused):
    knee(tmp_path).chmod(0)
    assert refused("robot.py") == "cannot read robot.py: Permission denied"


@pytest.mark.parametrize("content", ["", "x = 1\n", "diagram = 'knee'\n", "build = 3\n"])
def test_a_file_without_a_diagram(tmp_path, refused, content):
    write(tmp_path, content)
    assert refused("robot.py") == (
        "robot.py has no diagram: write `with Diagram(...) as diagram:`, or a function `build()` that returns a Diagram"
    )


def test_a_syntax_error_has_its_line_and_place(tmp_path, refused):
    write(tmp_path, "from graph import Diagram\n\ndef build(:\n    pass\n")
    assert refused("robot.py") == "robot.py:3: syntax error: invalid syntax\n    def build(:\n              ^"


def test_a_syntax_error_in_a_neighbour_names_the_neighbour(tmp_path, refused):
    write(tmp_path, "a = 1\nb = (\n", "broken_neighbour.py")
    write(tmp_path, "import broken_neighbour\n")
    assert refused("robot.py").startswith("broken_neighbour.py:2: syntax error: '(' was never closed")


def test_an_exception_in_the_file_has_its_line(tmp_path, refused):
    write(tmp_path, "a = 0\nb = 1 / a\n")
    assert refused("robot.py") == "robot.py:2: ZeroDivisionError: division by zero\n    b = 1 / a"


def test_an_exception_in_build_has_the_users_innermost_line(tmp_path, refused):
    write(tmp_path, "import math\n\ndef helper():\n    return math.exp(1e3)\n\ndef build():\n    return helper()\n")
    assert refused("robot.py") == "robot.py:4: OverflowError: math range error\n    return math.exp(1e3)"


def test_an_exception_in_tickwork_is_reported_with_the_users_line(tmp_path, refused):
    """What raises is Diagram's; what is shown is who asked."""
    path = write(tmp_path, KNEE.format(law="return 0.0") + "\n\ndef plant(robot):\n    return robot['kne']\n")
    line = line_of(path, "robot['kne']")
    assert refused("robot.py") == (
        f"robot.py:{line}: KeyError: knee has no block 'kne': did you mean 'knee'?\n    return robot['kne']"
    )


def test_a_misspelt_port_has_the_users_line_and_a_suggestion(tmp_path, refused):
    path = write(tmp_path, WAVE.format(before="", amplitude=1.0) + "    diagram['sine'].amplitud\n")
    line = line_of(path, "].amplitud")
    told = "AttributeError: 'Sine' object has no attribute 'amplitud'; did you mean 'amplitude'? Its outputs are y"
    assert refused("robot.py") == f"robot.py:{line}: {told}\n    diagram['sine'].amplitud"


@pytest.mark.parametrize(
    "written, told",
    [
        ("spring(0.5).powr", "'Outputs' object has no attribute 'powr'; did you mean 'power'?"),
        ("spring(0.5).speed", "'Outputs' object has no attribute 'speed'; its signals are torque, power"),
        ("spring.heat", "'Spring' object has no attribute 'heat'; its outputs are torque, power"),
    ],
)
def test_a_name_that_an_own_block_does_not_have_is_reported_with_those_it_has(tmp_path, refused, written, told):
    block = "class Spring(Block):\n    angle = Input('rad')\n    torque = Output('N·m')\n    power = Output('W')\n"
    block += "    def step(self, angle):\n        return angle, angle\n"
    head = "from graph import Block, Diagram, Input, Output\n" + block + "with Diagram('d', rate=100):\n"
    path = write(tmp_path, f"{head}    spring = Spring()\n    {written}\n")
    assert refused("robot.py") == f"robot.py:{line_of(path, written)}: AttributeError: {told}\n    {written}"


def test_an_exception_in_plant_has_its_line(tmp_path, refused):
    path = write(
        tmp_path, KNEE.format(law="return 0.0") + "\n\ndef plant(robot):\n    raise RuntimeError('not today')\n"
    )
    line = line_of(path, "not today")
    assert refused("robot.py", "--duration", "1") == (
        f"robot.py:{line}: RuntimeError: not today\n    raise RuntimeError('not today')"
    )


@pytest.mark.parametrize("body, words", [("sys.exit(5)", "SystemExit: 5"), ("raise Exception", "Exception")])
def test_a_diagram_file_that_exits_is_reported(tmp_path, refused, body, words):
    write(tmp_path, f"import sys\n{body}\n")
    assert refused("robot.py") == f"robot.py:2: {words}\n    {body}"


def test_endless_recursion_is_reported(tmp_path, refused):
    write(tmp_path, "def build():\n    return build()\n")
    assert refused("robot.py").startswith("robot.py:2: RecursionError: maximum recursion depth exceeded")


def test_a_missing_library_is_reported_with_the_line(tmp_path, refused):
    write(tmp_path, "\nimport no_such_library\n")
    assert refused("robot.py") == (
        "robot.py:2: ModuleNotFoundError: No module named 'no_such_library'; install its library, as in: pip "
        "install no-such-library\n"
        "    import no_such_library"
    )


def test_a_mistyped_block_is_suggested(tmp_path, refused):
    write(tmp_path, "from blocks.filters import Butterwort\n")
    assert "did you mean 'Butterworth'?" in refused("robot.py")


MADE_OUTSIDE = """
from blocks.actuators import CubeMars
from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.safety import EStopHeartbeat
from blocks.sinks import PlotJuggler
from blocks.sources import Sine
from graph import Diagram


def build():
    with Diagram("wave", rate=100) as diagram:
        Sine(amplitude=1.0)
    {within}
    return diagram


{outside}
"""


@pytest.mark.parametrize(
    "block", ["CsvRecorder()", "PlotJuggler()", "EStopHeartbeat(bus='estop')", "CubeMars('AK80-9')", "Sine()"]
)
@pytest.mark.parametrize("place", ["within", "outside"])
def test_a_block_outside_every_diagram_is_an_error(tmp_path, refused, block, place):
    text = MADE_OUTSIDE.format(**{"within": "pass", "outside": "", place: block})
    path = write(tmp_path, text)
    complaint = refused(path)
    assert f"{path.name}:{line_of(path, block)}: error TW011 outside a diagram: " in complaint
    assert complaint.endswith("indent this line so that it is inside `with Diagram(...)`")


def test_a_block_that_only_computes_may_be_outside(tmp_path):
    assert len(
        load(write(tmp_path, MADE_OUTSIDE.format(within="assert Gain(gain=2.0).step(3.0) == 6.0", outside="")))[1]
    )


@pytest.mark.parametrize("returned", ["7", "None", "'knee'"])
@pytest.mark.parametrize("function", ["build", "plant"])
def test_a_function_that_returns_no_diagram_is_reported(tmp_path, refused, function, returned):
    head = KNEE.format(law="return 0.0") if function == "plant" else ""
    path = write(
        tmp_path, f"{head}\ndef {function}({'robot' if function == 'plant' else ''}):\n    return {returned}\n"
    )
    assert refused("robot.py", "--duration", "1") == (
        f"robot.py:{line_of(path, f'def {function}')}: {function}() returned {returned}, and must return a Diagram: "
        f"end it with `return {'plant' if function == 'plant' else 'diagram'}`"
    )


def test_build_with_a_parameter_that_has_no_value(tmp_path, refused):
    path = write(tmp_path, BUILD.format(parameters="amplitude", before="pass"))
    line = line_of(path, "def build")
    assert refused("robot.py") == (
        f"robot.py:{line}: build() cannot be called: missing a required argument: 'amplitude'; "
        "give the parameter a default, or set its value"
    )
    assert load(path, [("amplitude", "3")])[1]["sine"].amplitude == 3.0


def test_a_plant_function_without_a_robot_argument_is_reported(tmp_path, refused):
    path = write(tmp_path, KNEE.format(law="return 0.0") + "\n\ndef plant():\n    pass\n")
    line = line_of(path, "def plant")
    assert refused("robot.py") == (
        f"robot.py:{line}: plant() cannot be called: too many positional arguments; declare it as plant(robot)"
    )


def test_a_diagram_without_blocks_is_reported(tmp_path, refused):
    write(tmp_path, "from graph import Diagram\n\nwith Diagram('empty', rate=100) as diagram:\n    pass\n")
    assert refused("robot.py") == "robot.py: the diagram 'empty' has no blocks: make them inside `with Diagram(...)`"


def test_a_mistake_in_a_blocks_parameter_has_its_line(tmp_path, refused):
    path = write(tmp_path, WAVE.format(before="", amplitude=1.0).replace("amplitude=", "amplitud="))
    line = line_of(path, "amplitud=")
    assert refused("robot.py") == (
        f"robot.py:{line}: error TW010 wrong parameter: Sine: has no parameter 'amplitud'\n    did you mean "
        "'amplitude'?"
    )


@pytest.mark.parametrize("rate", ["0", "-5", "float('nan')", "float('inf')", "'fast'"])
def test_a_diagram_whose_own_rate_is_impossible(tmp_path, refused, rate):
    path = write(tmp_path, f"from graph import Diagram\nwith Diagram('d', rate={rate}) as diagram:\n    pass\n")
    assert refused(path.name).startswith(
        "robot.py:2: error TW010 wrong parameter: d: the rate must be a number above 0 Hz and at most 1e+09 Hz, got "
    )


def test_a_compile_error_is_a_diagram_error(tmp_path, refused):
    """Every mistake is told, with its line; the exit code is another."""
    path = write(
        tmp_path,
        KNEE.format(law="return 0.0")
        .replace("TorqueLimiter(limit=5.0)(torque)", "torque")
        .replace("knee.position, knee.velocity", "knee.position"),
    )
    complaint = refused("robot.py", code=CHECK_FAILED)
    unwired, unbounded = line_of(path, "Law(name="), line_of(path, "knee(torque_command")
    assert f"robot.py:{unwired}: error TW001 unconnected input: law.velocity" in complaint
    assert f"robot.py:{unbounded}: error TW007 command not provably inside its limit: knee.torque_command" in complaint
    assert complaint.endswith("tickwork: 2 errors; nothing was armed")


HOOK = """
from blocks.recorders import CsvRecorder
from graph import Block, Diagram, Output

class Broken(Block):
    y = Output("1")
    calls = 0

    def {hook}:
        self.calls += 1
        if self.calls > {allowed}:
            raise LookupError("on purpose")
{rest}
with Diagram("broken", rate=100) as diagram:
    Broken()
    CsvRecorder()
"""
STEP = "\n    def step(self):\n        return 1.0\n"


@pytest.mark.parametrize(
    "hook, allowed, rest",
    [
        ("output_range(self)", 0, STEP),
        ("prepare(self, dt)", 0, STEP),
        ("prepare(self, dt)", 1, STEP),
        ("reset(self)", 0, STEP),
        ("reset(self)", 1, STEP),
    ],
)
def test_an_exception_in_a_hook_of_the_users_block_has_its_line(tmp_path, refused, hook, allowed, rest):
    """Whether it comes while the block is made or when the diagram is compiled."""
    path = write(tmp_path, HOOK.format(hook=hook, allowed=allowed, rest=rest))
    line = line_of(path, "on purpose")
    assert refused("robot.py", "--duration", "1") == (
        f'robot.py:{line}: LookupError: on purpose\n    raise LookupError("on purpose")'
    )


def test_the_knee_exoskeleton_loads():
    file, diagram = load(KNEE_EXO)
    assert diagram.name == "knee_exo" and file.has_plant
