"""The goals are compared with the figures of each command, also those of `python -m runtime bench`."""

import json

import pytest

from runtime.host.errors import BAD_INPUT, OK
from runtime.setup.bench import blocks
from tests.bench.goals import GOALS, Goal

pytestmark = pytest.mark.soak


def test_a_goal_compares_its_value_with_the_bound():
    assert Goal("a", 1.0, 1.0, "ns").reached and not Goal("a", 1.1, 1.0, "ns").reached
    assert Goal("a", 90.0, 90.0, "times", True).reached and not Goal("a", 89.0, 90.0, "times", True).reached


def test_the_commands_of_users_are_compared_with_goals(bench, monkeypatch):
    monkeypatch.setattr(blocks, "COMPILE_REPEATS", {3: 1, 30: 1})
    code, out, err = bench("blocks", "--json", "--seconds", "0.002", "--repeats", "1")
    assert (code, err) == (OK, "")
    assert [goal["what"] for goal in json.loads(out)["goals"]] == [
        "a chain, native blocks",
        "a chain, Python blocks",
        "compile 12 blocks",
        "growth of the compile time, p in blocks^p",
    ]
    code, out, _ = bench("bus", "--rounds", "200", "--trips", "3")
    assert code == OK and "a bus, without its two system calls" in out.partition("\ngoals ")[2]


def test_help_lists_every_command(bench):
    code, out, _ = bench("--help")
    assert code == OK and [line.split()[0] for line in out.splitlines() if "    " in line] == sorted(GOALS)
    assert bench("speed")[0] == BAD_INPUT
