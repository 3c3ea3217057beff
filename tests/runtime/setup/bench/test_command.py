"""`python -m runtime bench`: its tables, and the same as JSON."""

import json
import math
import re

import pytest

from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import compile
from runtime.host.errors import OK
from runtime.setup.bench import blocks
from runtime.setup.bench.measure import Times

QUICK = ("--seconds", "0.002", "--repeats", "1")


@pytest.fixture
def quick(monkeypatch):
    """Two small compiles instead of up to 10,000 blocks."""
    monkeypatch.setattr(blocks, "COMPILE_REPEATS", {3: 1, 30: 1})


def test_a_table_shows_native_blocks_python_blocks_and_compiles(command_line, quick):
    code, out, err = command_line("bench", *QUICK)
    assert (code, err) == (OK, "") and "a chain of 102 blocks" in out and "  93 blocks" in out
    matches = map(re.compile(r"  (\S.{34,}?)((?:\s+[\d.e+-]+){5})").fullmatch, out.splitlines())
    rows = {match[1].strip(): list(map(float, match[2].split())) for match in matches if match}
    assert list(rows) == ["native blocks", "Python blocks"]
    for least, median, most, a_block, _ in rows.values():
        assert least <= median <= most and abs(a_block - median * 1e3 / 102) < 0.01 * a_block


def test_json_has_the_same_numbers(command_line, quick):
    code, out, _ = command_line("bench", "--json", *QUICK)
    report = json.loads(out)
    row = report["chain"]["us_a_tick"]["native blocks"]
    assert code == OK and 0.0 < row["min"] <= row["median"] <= row["max"] and row["times_native"] == 1.0
    assert [size["blocks"] for size in report["compile"]["rows"]] == [12, 93]


@pytest.mark.parametrize("kinds", [blocks.NATIVE, blocks.PYTHON], ids=["native", "Python"])
def test_a_chain_computes_its_equations(kinds):
    schedule = compile(blocks.chain(kinds, 2))
    program = Program(schedule)
    Executor(program, blocks.RATE, virtual=True).run(251)
    [column] = [column for sink in schedule.sinks for column in sink.columns]
    y = math.sin(2.0 * math.pi * 0.25)
    for _ in range(2):
        y = max(-1.0, min(1.01 * y, 1.0)) - 0.001
    assert program.values[schedule.columns[column.index]] == pytest.approx(y, abs=1e-12)


def test_growth_is_the_exponent_between_two_sizes():
    def compiled(size, ms):
        made = blocks.Compiles.__new__(blocks.Compiles)
        made.blocks, made.compile = size, Times([ms])
        return made

    assert abs(blocks.exponent(compiled(1000, 2.0), compiled(10_000, 20.0)) - 1.0) < 1e-12
    assert abs(blocks.exponent(compiled(1000, 2.0), compiled(10_000, 200.0)) - 2.0) < 1e-12
    assert 1.12 < blocks.n_log_n(compiled(1000, 1.0), compiled(10_000, 1.0)) < 1.13
