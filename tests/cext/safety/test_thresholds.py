"""One table of safety thresholds: loop, watchdog, guardian, recorder and the documentation read it, and none has a
number of its own.
"""

import io
import re
import tokenize
from typing import NamedTuple

import pytest

from cext.safety import thresholds
from tests.runtime.runs import ROOT

# Modules whose every time is a safety threshold, and literals in them that are none.
MODULES = (
    "cext/schedule/arming.pyx",
    "cext/schedule/executor.pyx",
    "cext/schedule/publisher.pyx",
    "cext/schedule/lifecycle.pyx",
    "cext/schedule/watchdog.pyx",
    "runtime/robot/guardian/__init__.py",
    "runtime/robot/guardian/lock.py",
    "runtime/robot/guardian/process.py",
    "runtime/robot/guardian/stop.py",
    "runtime/session/session.py",
)
UNITS = {1e9, 1e-9, 1e6, 1e3, 1e15}  # conversions, and an upper bound of a count
NO_THRESHOLDS = {  # times of processes and of Python, sizes, bit masks
    "READY_TIMEOUT",
    "LEAVE_TIMEOUT",
    "START_LIMIT",
    "SWITCH",
    "EVENT_TIMEOUT",
    "POLL_PERIOD",
    "FLAGS",
    "STACK",
    "ORDERS",
    "RECENT",
    "DRAIN_PERIOD",
    "BACKLOG",
    "NAME_BYTES",
    "EXIT_CODE",
    "FOREVER",
    "GO_ON_PERIOD",
}


class Threshold(NamedTuple):
    name: str
    value: int
    unit: str
    meaning: str


def table():
    """The Thresholds of thresholds.pxd, each with the unit and the meaning in the comment above it."""
    text = re.sub(r"\n    #     ", " ", (ROOT / "cext/safety/thresholds.pxd").read_text())
    rows = re.findall(r"^    # ([^:\n]+): (.+)\n    ([A-Z_]+) = (-?\d+)$", text, re.MULTILINE)
    return [Threshold(name, int(value), unit, meaning) for unit, meaning, name, value in rows]


def in_words(threshold):
    if threshold.unit != "ns":
        return f"{threshold.value} {threshold.unit}"
    value = threshold.value * 1e-9
    return f"{value:g} s" if value >= 1.0 else f"{threshold.value * 1e-6:g} ms"


def shown():
    """The table as docs/reference/safe_stop.md has it."""
    rows = [f"| `{each.name}` | {in_words(each)} | {each.meaning} |" for each in table()]
    return "\n".join(["| threshold | value | |", "|---|--:|---|", *rows]) + "\n"


def constants_of(path):
    """(line, name) of each constant of a module that is defined as a number of its own."""
    pattern = re.compile(
        r"^(?:cdef \w+ )?(?:    )?([A-Z][A-Z_]*(?:, [A-Z_]+)*) = "
        r"(?:-|\()?\d|\b(fade|\w*timeout|\w*limit)=\d"
    )
    return [
        (number, found[1] or found[2])
        for number, line in enumerate((ROOT / path).read_text().splitlines(), 1)
        if (found := pattern.search(line))
    ]


def large_numbers_of(path):
    """Literals of a Python module or a Cython one that can be times: ns from 100 µs on."""
    with open(ROOT / path, "rb") as file:
        tokens = list(tokenize.tokenize(io.BytesIO(file.read()).readline))
    numbers = [
        (token.start[0], float(token.string.replace("_", "")))
        for token in tokens
        if token.type == tokenize.NUMBER and not token.string.lower().startswith("0x")
    ]
    return [(line, number) for line, number in numbers if number >= 1e5 and number not in UNITS]


def test_every_threshold_has_a_value_a_unit_and_a_meaning():
    assert {each.name: each.value for each in table()} == {
        name: int(value) for name, value in vars(thresholds).items() if name.isupper()
    }
    units = {"ns", "s", "‰", "periods", "ticks", "failures", "replies", "%", "mrad", "mrad/s", "rad/s²", "°C"}
    assert all(each.unit in units and (each.value > 0 or each.unit == "°C") for each in table())


def test_every_threshold_is_used():
    folders = [ROOT / package for package in ("blocks", "cext", "graph", "runtime")]
    files = [path for folder in folders for form in ("*.py", "*.pyx", "*.pxd") for path in folder.rglob(form)]
    words = {word for path in files if path.stem != "thresholds" for word in re.findall(r"\w+", path.read_text())}
    assert [each.name for each in table() if each.name not in words] == []


def test_thresholds_are_consistent():
    """A run whose watchdog works is not taken for one that stalls; the guardian looks often enough to be believed
    alive.
    """
    value = {each.name: each.value for each in table()}
    assert value["HANG_PERIODS"] < value["LOOP_STALL_PERIODS"] and value["HANG_MINIMUM"] < value["LOOP_STALL_MINIMUM"]
    assert (
        value["GUARDIAN_LOOK_PERIOD"] * 4
        < value["LOOP_STALL_MINIMUM"]
        < value["GUARDIAN_SILENCE"]
        < value["GUARDIAN_DEATH"]
    )
    assert value["STOP_DAMP_ROUND"] < value["STOP_ROUND"] < value["STOP_LIMIT"]


@pytest.mark.parametrize("path", MODULES)
def test_thresholds_are_defined_only_in_thresholds_module(path):
    constants = constants_of(path)
    others = {line for line, name in constants if name in NO_THRESHOLDS}
    assert [found for found in constants if found[0] not in others] == []
    assert [found for found in large_numbers_of(path) if found[0] not in others] == []


def test_the_documentation_shows_the_table():
    assert shown() in (ROOT / "docs/reference/safe_stop.md").read_text(), (
        f"docs/reference/safe_stop.md lacks this table:\n{shown()}"
    )
