"""`python -m runtime bench`: native blocks, Python blocks and a plain function, measured beside each other."""

import re

import pytest

from runtime.bench import GROUPS, Chain, Plain, bench, check_equal, native_chain, python_chain

BLOCKS = 1 + 3 * GROUPS


def rows_of(lines):
    """ns a tick: min, median, max, and ns a block: min, median; by the name of the row."""
    pattern = re.compile(r"(native blocks|Python blocks|plain Python function)\s+(\d+)\s+(\d+)\s+(\d+)\s+(\d+\.\d\d)\s+(\d+\.\d\d)")
    return {match[1]: tuple(map(float, match.groups()[1:])) for match in map(pattern.fullmatch, lines) if match}


def test_every_chain_computes_the_same_at_every_tick():
    rows = [Chain(*native_chain()), Chain(*python_chain()), Plain()]
    for ticks in (1, 2, 17, 250, 1001):
        values = []
        for row in rows:
            row.seconds(ticks)
            values.append(row.value)
        assert values[0] == values[1] == values[2]


def test_chains_that_disagree_are_not_compared():
    class Other(Plain):
        value = property(lambda self: 0.0, lambda self, value: None)

    with pytest.raises(AssertionError, match="the rows disagree"):
        check_equal({"native": Chain(*native_chain()), "other": Other()})


def test_it_tells_ns_a_tick_and_a_block():
    lines = bench(0.005, 3)
    assert lines[0].startswith(f"a chain of {BLOCKS} blocks")
    rows = rows_of(lines)
    assert list(rows) == ["native blocks", "Python blocks", "plain Python function"]
    for least, median, most, least_block, median_block in rows.values():
        assert least <= median <= most
        assert least_block == pytest.approx(least / BLOCKS, abs=0.5 / BLOCKS + 0.005)
        assert median_block == pytest.approx(median / BLOCKS, abs=0.5 / BLOCKS + 0.005)


def test_a_native_block_is_a_matter_of_nanoseconds():
    """5 ns and 150 ns on the machine it was written on; the best of several, and room for slower machines that do other things too."""
    rows = rows_of(bench(0.01, 7))
    assert rows["native blocks"][3] < 20.0
    assert rows["Python blocks"][3] < 600.0
    assert rows["native blocks"][0] < rows["plain Python function"][0] < rows["Python blocks"][0]


def test_it_prints_the_table(command_line):
    code, out, err = command_line("bench", "--seconds", "0.002", "--repeats", "1")
    assert (code, err) == (0, "") and len(rows_of(out.splitlines())) == 3
