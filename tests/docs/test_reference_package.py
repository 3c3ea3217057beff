"""The comparison with Epically Powerful lists each of its public names once, and what it shows of Tickwork exists."""

import ast
import inspect
import json
import re
from importlib import import_module

import pytest

import runtime
from blocks.families import find_model
from graph import Block
from runtime.record.analysis.trial import Trial
from tests.checkout import ROOT
from tests.docs.block_pages import homes
from tests.docs.command_lines import refusal, words
from tests.docs.reference_package import STORED

PACKAGE = json.loads(STORED.read_text())
PAGE = (ROOT / "docs" / "coming_from" / "epically_powerful_interface.md").read_text()
SECTIONS = re.split(r"^#+ .*\n", PAGE, flags=re.MULTILINE)[1:]
CODE = re.compile(r"`([^`]+)`")
MODELS = (
    "| model | rated there | rated here | encoded torque there | here | encoded speed there | here |\n"
    "|---|--:|--:|--:|--:|--:|--:|\n"
)
STAND_INS = {"knee": ("CubeMars", "RobStride", "CubeMarsServo"), "imu": ("MicroStrain", "MPU9250", "OpenImu")}
OBJECTS = {"trial": Trial, "robot": import_module("runtime.session.connected").ConnectedRobot}
BLOCKS = {kind.__name__: kind for kind in homes()}
FUNCTIONS = ("blocks.actuators", "graph", "runtime")  # modules with further public names
WORDS = {  # code of the right-hand side that is not a name of an interface
    "throttle", "disable", "kill -9", "interface", "channel", "invert = true", "False", "timestamp", "jetson_clocks",
    "configure", "build",
}  # fmt: skip


STARTS = (
    ["knee.py"],
    ["stream", "actuator", "3"],
    ["stream", "imu"],
    ["stream", "i2c"],
    ["configure", "3"],
    ["calibrate", "leg.py"],
)


def rows(text):
    """Return (cells) of the rows of the tables of a text, without their heads."""
    for table in re.findall(r"^\|[^\n]*\n\|[-|: ]+\n((?:\|.*\n?)+)", text, re.MULTILINE):
        for line in table.splitlines():
            yield [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def parameters(names):
    """Return the parameters with a default of signatures, as name=default."""
    for name in names:
        if "(" not in name:
            continue
        call = ast.parse(f"def f{name[name.index('(') :]}: ...").body[0].args
        words = [argument.arg for argument in call.args[len(call.args) - len(call.defaults) :]]
        yield from (f"{word}={ast.unparse(value)}".replace("'", '"') for word, value in zip(words, call.defaults))


def stored(section):
    """Return the names that a section must list: of its modules, and of the command in its first row."""
    found = {name for module in modules(section) for name in PACKAGE["modules"][module]}
    found |= {*parameters(name for name in found if re.match(r"[A-Z]\w*\(|\.from_dict|timed_loop", name))}
    for command, options in PACKAGE["commands"].items():
        if f"\n| `{command}` |" in section:
            found |= {command, *options}
    return found


def modules(text):
    """Return the modules that a section names above its table."""
    return [name for lines in re.findall(r"^Modules? (?:.+\n)+", text, re.MULTILINE) for name in CODE.findall(lines)]


def listed(section):
    return {name for left, *_ in rows(section) for name in CODE.findall(left)}


def test_every_module_and_command_of_the_package_has_a_section():
    assert sorted(modules(PAGE)) == sorted(PACKAGE["modules"])
    for command in PACKAGE["commands"]:
        assert f"\n| `{command}` |" in PAGE, command


@pytest.mark.parametrize("section", [text for text in SECTIONS if stored(text)], ids=lambda text: text[:40])
def test_a_section_lists_every_name_of_its_modules_and_no_other(section):
    names = stored(section)
    assert names - listed(section) == set()
    assert listed(section) - names - {*parameters(names)} == set()
    for left, right in rows(section):
        assert right, left


def test_files_and_environment_variables_are_listed():
    assert not PACKAGE["environment"] and "reads no environment variable" in PAGE
    assert PACKAGE["files"] == sorted(listed(SECTIONS[-2]))


def model_rows():
    """Return the lines of the table of models, with a dash where Tickwork has the same number."""
    for name, numbers in PACKAGE["models"].items():
        drive, found = find_model(name)
        cells = [name]
        for key, own in (
            ("rated_torque_limits", found.rated),
            ("torque_limits", found.wire_torque),
            ("velocity_limits", found.wire_velocity),
        ):
            cells += [f"{numbers[key][1]:g}", "same" if own == numbers[key][1] else f"**{own:g}**"]
        yield f"| {' | '.join(cells)} |\n"


def test_the_table_of_models_has_the_numbers_of_both():
    assert PAGE.endswith(MODELS + "".join(model_rows()))


def resolved(text):
    """Return what a name of the right-hand side stands for, or raise an error."""
    first, *rest = text.split(".")
    if first in BLOCKS:
        return BLOCKS[first]
    if first == "runtime":
        target = runtime
        for number, name in enumerate(rest):
            target = getattr(target, name, None) or import_module(".".join(["runtime", *rest[: number + 1]]))
        return target
    for module in FUNCTIONS:
        if hasattr(import_module(module), first):
            return getattr(import_module(module), first)
    return getattr(import_module(text.rpartition(".")[0]), rest[-1])


def ports(kinds):
    return {name for kind in kinds for table in (kind.inputs, kind.outputs, kind.parameters) for name in table}


def check_expression(node):
    """Check an expression of the right-hand side: names, ports, methods and parameters exist."""
    if isinstance(node, ast.Constant):
        return
    if isinstance(node, ast.Subscript):
        check_expression(node.value)
    elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in STAND_INS:
        assert node.attr in ports(BLOCKS[kind] for kind in STAND_INS[node.value.id]), ast.unparse(node)
    elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in OBJECTS:
        kind = OBJECTS[node.value.id]
        assert hasattr(kind, node.attr) or node.attr in inspect.getsource(kind.__init__), ast.unparse(node)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in STAND_INS:
        kinds = [BLOCKS[kind] for kind in STAND_INS[node.func.id]]
        kinds.append(type(BLOCKS["CubeMarsServo"]("AK80-9", mode="current")))
        assert {word.arg for word in node.keywords} <= ports(kinds) | {"current_command"}, ast.unparse(node)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        if node.func.attr != "to":  # of a signal
            check_expression(node.func)
    elif isinstance(node, ast.Call):
        target = resolved(ast.unparse(node.func))
        if inspect.isclass(target) and issubclass(target, Block):
            values = {word.arg: ast.literal_eval(word.value) for word in node.keywords}
            assert values.keys() <= target.parameters.keys() | {"name"}, ast.unparse(node)
            for name, value in values.items():
                choices = target.parameters[name].choices
                assert not choices or value in choices, ast.unparse(node)
        else:
            assert callable(target)
    else:
        resolved(ast.unparse(node))


def right_hand_codes():
    return sorted({code for section in SECTIONS for row in rows(section) for code in CODE.findall(row[1])})


@pytest.mark.parametrize("code", right_hand_codes())
def test_names_of_the_right_hand_side_exist(code):
    if code in WORDS or re.fullmatch(r'"\w+"|[\w/-]+\.(toml|csv|mcap)|/dev/[\w-]+|0x[\w.:]+|-servo', code):
        return
    if code.startswith("python -m runtime"):
        assert not refusal(words(code.removeprefix("python -m runtime "))), code
    elif code.startswith("--"):
        assert any(not refusal([*start, *words(code)]) for start in STARTS), code
        if code.startswith("--set ") and "." in code:
            block, parameter = re.match(r"--set (\w+)\.(\w+)=", code).groups()
            assert parameter in ports(BLOCKS[name] for name in STAND_INS.get(block, ("PlotJuggler",)))
    elif code.startswith("for "):
        assert hasattr(OBJECTS["robot"], "__iter__")
    elif re.fullmatch(r"\w+=[^=]+", code):  # a parameter of a drive
        assert code.partition("=")[0] in ports([BLOCKS["CubeMars"]])
    else:
        check_expression(ast.parse(code, mode="eval").body)
