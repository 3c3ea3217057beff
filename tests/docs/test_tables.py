"""Tables of names on the pages have the names of the code, all of them, and tables of messages its messages."""

import ast
import inspect
import re
from dataclasses import fields
from functools import cache

import pytest

from blocks import sinks
from cext.schedule.outcome import STATUS, SURVIVED
from graph import Param, Sink, units
from runtime.cli.main import COMMANDS
from runtime.experiments.studies import objectives
from runtime.host.live import table
from runtime.record.recorder import panel
from runtime.robot.rig.battery import Battery
from runtime.robot.rig.file import KEYS
from runtime.session.request import Request
from tests.checkout import ROOT
from tests.docs.pages import NAMES

DOCS = ROOT / "docs"
CODE = re.compile(r"`([^`]+)`")
MESSAGES = re.compile(
    r"^\| (?:message|symptom|message in the journal) \|[^\n]*\n\|[-|: ]+\n((?:\|.*\n)+)", re.MULTILINE
)
OF_OTHERS = (
    "No module named",
    "cannot import name",
    "Python.h",
    "KilledWorker",
    "KeyError",
    "mocap.",
    "trial 0",
    "can0 ...",
)


def page(name):
    return (DOCS / f"{name}.md").read_text()


def section(name, heading):
    """Return the text below a heading, up to the next one."""
    return re.split(r"^#+ ", page(name).split(f"# {heading}\n")[1], flags=re.MULTILINE)[0]


def column(text, number=0):
    """Return the names in code in one column of the tables of a text."""
    rows = [line.split("|")[1:-1] for line in text.splitlines() if line.startswith("| ")]
    return [name for row in rows for name in CODE.findall(row[number])]


def test_objectives_of_a_study():
    own = {}
    for name, value in inspect.getmembers(objectives, inspect.isfunction):
        parameters = [*inspect.signature(value).parameters]
        if value.__module__ == objectives.__name__ and parameters[0] == "trial" and not name.startswith("_"):
            own[name] = [parameter for parameter in parameters[1:] if parameter != "after"]
    shown = {}
    for line in section("how_to/studies", "Objectives").splitlines():
        if line.startswith("| `"):
            names, arguments, _ = line.split("|")[1:-1]
            shown |= {name: CODE.findall(arguments) for name in CODE.findall(names)}
    assert shown == own


def test_return_values_of_decode():
    enum = re.search(
        r"cdef enum: # return values of decode_t\n(.*?)\n\n", (ROOT / "cext/abi.pxd").read_text(), re.DOTALL
    )[1]
    names = re.findall(r"^    ([A-Z]+) =", enum, re.MULTILINE)
    assert sorted(column(section("how_to/device_families", "Return values of `decode`"))) == sorted(names)


def test_keys_of_a_bus_and_of_the_battery_in_a_rig_file():
    text = page("reference/rigs")
    assert all(re.search(rf"`{key}`|^{key} = |\b{key}\b = |\.{key}\]", text, re.MULTILINE) for key in KEYS)
    battery = text[text.index("[battery]\n") :].split("```")[0]
    assert set(re.findall(r"^(\w+) =", battery, re.MULTILINE)) == {field.name for field in fields(Battery)}


def test_keys_of_the_terminal():
    keys = [
        line.split("|")[1].strip()
        for line in section("how_to/tuning", "From the keyboard").splitlines()
        if line.startswith("| ")
    ]
    named = set(re.findall(r"Tab|Shift-Tab|up|down|right|left|space|Enter|\b[a-z0]\b", " ".join(panel.HELP)))
    assert named - {"a"} <= {word for key in keys for word in re.split(r"[ ,]+", key)} | {"q"}
    assert table.STEPS == 20 and table.FINE == 10  # "about a twentieth of the range", "a tenth of such a step"


def test_declarations_of_a_parameter():
    shown = re.findall(r"^\| `(\w+)=True`", section("how_to/blocks", "Parameters"), re.MULTILINE)
    assert shown and set(shown) <= set(inspect.signature(Param.__init__).parameters)


def test_every_command_is_on_a_page():
    text = "".join((ROOT / name).read_text() for name in NAMES)
    assert [name for name in COMMANDS if not re.search(rf"python -m runtime {name}\b|`{name}`", text)] == []


def test_every_option_of_run_is_on_a_page():
    text = "".join((ROOT / name).read_text() for name in NAMES)
    flags = [flag for field in fields(Request) for flag in field.metadata.get("flags", ())[:1]]
    options = [flag for flag in flags if flag.startswith("--") and flag != "--report"]  # of the package itself
    assert [flag for flag in options if not re.search(rf"{flag}\b", text)] == []


def test_every_fault_is_in_the_table_of_faults_and_provoked_by_a_test():
    rows = re.findall(r"^\| `([^`]+)` \| .* \| (yes|no) \|$", section("reference/running", "Faults"), re.MULTILINE)
    statuses = {name: number in SURVIVED for number, name in STATUS.items() if number}
    assert dict(rows) == {name: "yes" if survived else "no" for name, survived in statuses.items()} | {
        "kernel status N": "yes"
    }
    tests = "".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    assert [name for name in statuses if f'"{name}"' not in tests] == []


def test_every_unit_is_on_the_page_of_blocks():
    [listed] = re.findall(r"with whole exponents: ([^.]+)\.", section("how_to/blocks", "Ports"))
    assert re.findall(r"`([^`]+)`", listed) == list(units._BASE)


def test_every_viewer_that_sends_signals_is_on_the_page_of_subjects_data():
    text = (ROOT / "docs/how_to/subjects_data.md").read_text()
    viewers = [name for name, kind in vars(sinks).items() if isinstance(kind, type) and issubclass(kind, Sink)]
    viewers.remove("Sink")
    assert "PlotJuggler" in viewers and [name for name in viewers if name not in text] == []


@cache
def messages():
    """Return the texts of the program, in which a null byte stands for a value."""
    found = []
    for path in (path for folder in ("graph", "blocks", "runtime") for path in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.JoinedStr):
                found.append("".join(part.value if isinstance(part, ast.Constant) else "\0" for part in node.values))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    return "\n".join(found)


def is_printed(message):
    """Return whether three words in a row of a message, or all of a shorter one, are in a text of the program."""
    words = message.replace("...", " ").split()
    runs = [" ".join(words[start : start + 3]) for start in range(max(1, len(words) - 2))]
    return any(run in messages() for run in runs)


@pytest.mark.parametrize("name", [name for name in NAMES if MESSAGES.search((ROOT / name).read_text())])
def test_the_messages_of_a_page_are_printed(name):
    for rows in MESSAGES.findall((ROOT / name).read_text()):
        for message in column(rows):
            assert any(words in message for words in OF_OTHERS) or is_printed(message), message
