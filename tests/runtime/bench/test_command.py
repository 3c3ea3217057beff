"""`python -m runtime bench` as a person, or a machine, reads it."""

import json
import re

from runtime.base.errors import BAD_INPUT, OK
from runtime.bench import compiling
from runtime.bench.measure import Times

QUICK = ("--seconds", "0.002", "--repeats", "1")


def test_a_diagram_is_a_table_of_all_who_computed_it(command_line):
    code, out, err = command_line("bench", "--only", "chain", *QUICK)
    lines = out.splitlines()
    assert (code, err) == (OK, "") and "chain: 102 blocks" in out
    matches = map(re.compile(r"  (\S.{34,}?)((?:\s+[\d.e+]+){5})").fullmatch, lines)
    rows = {match[1]: list(map(float, match[2].split())) for match in matches if match}
    assert [name.strip() for name in rows] == [
        "Tickwork, native blocks",
        "Tickwork, Python blocks",
        "plain Python, one straight line",
        "C, one straight line",
    ]
    for least, median, most, a_block, _ in rows.values():
        assert least <= median <= most and abs(a_block - median * 1e3 / 102) < 0.01 * a_block


def test_it_says_the_same_for_machines(command_line):
    code, out, _ = command_line("bench", "--only", "chain", "--json", *QUICK)
    told = json.loads(out)
    row = told["chain"]["us_a_tick"]["Tickwork, native blocks"]
    assert code == OK and 0.0 < row["min"] <= row["median"] <= row["max"] and row["times_native"] == 1.0
    assert {goal["what"] for goal in told["goals"]} == {"chain, a native block", "chain, a Python block"}


def test_a_part_that_is_not_there_is_refused(command_line):
    assert command_line.refused("bench", "--only", "kne") == "--only kne: there is no part 'kne'; did you mean 'knee'?"


def test_starting_is_measured_from_outside(command_line):
    code, out, err = command_line("bench", "start", "--repeats", "1")
    assert (code, err) == (OK, "")
    first, memory = re.search(r"knee_exo\.py, to the first tick +([\d.e+]+) +\S+ +\S+ +([\d.]+)", out).groups()
    assert 50.0 < float(first) < 20_000.0 and 20.0 < float(memory) < 200.0


def test_starting_refuses_a_file_that_is_not_there(command_line):
    assert command_line.refused("bench", "start", "nowhere.py") == "there is no file nowhere.py"


def test_a_start_that_fails_says_why(command_line, tmp_path):
    (tmp_path / "broken.py").write_text("raise SystemExit('not today')\n")
    code, _, err = command_line("bench", "start", str(tmp_path / "broken.py"), "--repeats", "1")
    assert code == BAD_INPUT and "the run did not come to its first tick: " in err and "broken.py" in err


def test_growth_is_the_exponent_between_two_sizes():
    def compiled(blocks, ms):
        made = compiling.Compiles.__new__(compiling.Compiles)
        made.blocks, made.compile = blocks, Times([ms])
        return made

    assert abs(compiling.exponent(compiled(1000, 2.0), compiled(10_000, 20.0)) - 1.0) < 1e-12
    assert abs(compiling.exponent(compiled(1000, 2.0), compiled(10_000, 200.0)) - 2.0) < 1e-12
    assert 1.12 < compiling.n_log_n(compiled(1000, 1.0), compiled(10_000, 1.0)) < 1.13
