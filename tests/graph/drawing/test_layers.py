"""Columns: where loops are opened, how far left a box stands, and the order in a column."""

import random
from itertools import pairwise, permutations

import pytest

from graph.drawing.layers import Edge, Node, arrange, crossings, feedback, share


def node(name, eager=False, side=""):
    return Node(name, 10.0, 10.0, {"in": 3.0, "late": 6.0}, {"out": 5.0}, eager=eager, side=side)


def edge(source, target, delayed=False):
    return Edge(source, "out", target, "late" if delayed else "in", delayed)


def column_of(columns):
    return {n.what: index for index, column in enumerate(columns) for n in column if not n.passes}


def test_a_chain_is_placed_from_left_to_right():
    a, b, c = map(node, "abc")
    columns, nets, _ = arrange([c, b, a], [edge(b, c), edge(a, b)])
    assert column_of(columns) == {"a": 0, "b": 1, "c": 2} and not any(net.back for net in nets)


def test_a_loop_is_opened_where_a_block_does_not_need_its_input_within_the_tick():
    a, b, c = map(node, "abc")
    loop = [edge(a, b), edge(b, c, delayed=True), edge(c, a)]
    assert feedback([a, b, c], loop) == {loop[1]}


def test_a_loop_through_a_device_is_opened_at_the_device():
    delay, drive, law = node("delay"), node("drive", eager=True), node("law")
    loop = [edge(drive, delay, delayed=True), edge(delay, law), edge(law, drive, delayed=True)]
    assert feedback([delay, law, drive], loop) == {loop[2]}


def test_two_delays_in_one_loop_open_it_once():
    a, b, c = map(node, "abc")
    loop = [edge(a, b, delayed=True), edge(b, c, delayed=True), edge(c, a)]
    columns, nets, _ = arrange([a, b, c], loop)
    assert [net.back for net in nets].count(True) == 1 and sorted(column_of(columns).values()) == [0, 1, 2]


def test_a_loop_without_delays_is_opened_too_so_that_a_wrong_diagram_can_be_drawn():
    a, b = map(node, "ab")
    assert len(feedback([a, b], [edge(a, b), edge(b, a)])) == 1


def test_a_block_that_feeds_itself_is_feedback():
    a = node("a")
    itself = edge(a, a, delayed=True)
    assert feedback([a], [itself]) == {itself}


def test_subsystems_that_feed_each_other_are_in_one_column():
    """As the two legs of a robot: their drawing is half as wide as side by side."""
    source, left, right, sink = map(node, ["source", "left", "right", "sink"])
    left.frame = right.frame = True
    across = [edge(left, right), edge(right, left)]
    links = [edge(source, left), edge(source, right), *across, edge(left, sink), edge(right, sink)]
    columns, nets, _ = arrange([source, left, right, sink], links)
    assert column_of(columns) == {"source": 0, "left": 1, "right": 1, "sink": 2}
    assert [edge for net in nets if net.back for edge in net.edges] == across


def test_a_block_without_inputs_is_placed_beside_its_first_target():
    a, b, c, late = map(node, ["a", "b", "c", "late"])
    columns, _, _ = arrange([a, late, b, c], [edge(a, b), edge(b, c), edge(late, c)])
    assert column_of(columns)["late"] == 1


def test_pins_are_placed_in_the_outermost_columns():
    first, a, b, last = node("first", side="first"), node("a"), node("b"), node("last", side="last")
    columns, _, _ = arrange([first, last, a, b], [edge(a, last), edge(first, b), edge(a, b)])
    assert column_of(columns) == {"first": 0, "a": 1, "b": 2, "last": 3}


def test_a_long_line_has_one_track_in_each_column():
    chain = [node(str(i)) for i in range(5)]
    edges = [edge(a, b) for a, b in pairwise(chain)] + [
        Edge(chain[0], "out", chain[3], "late"),
        Edge(chain[0], "out", chain[4], "late"),
    ]
    columns, nets, hops = arrange(chain, edges)
    [long] = [net for net in nets if net.source is chain[0]]
    assert sorted(long.stops) == [1, 2, 3] and [len(column) for column in columns] == [1, 2, 2, 2, 1]
    assert all(hop.target.layer == hop.source.layer + 1 for hop in hops)


def test_crossed_lines_are_uncrossed():
    a, b, c, d = map(node, "abcd")
    columns, _, _ = arrange([a, b, c, d], [edge(a, d), edge(b, c)])
    assert [[n.what for n in column] for column in columns] in ([["a", "b"], ["d", "c"]], [["b", "a"], ["c", "d"]])


@pytest.mark.parametrize("seed", range(8))
def test_crossings_equal_a_count_over_all_pairs(seed):
    chance = random.Random(seed)
    left, right = [node(f"l{i}") for i in range(6)], [node(f"r{i}") for i in range(6)]
    _, _, hops = arrange(
        left + right, [edge(chance.choice(left), chance.choice(right), chance.random() < 0.5) for _ in range(12)]
    )
    leaving = {n: [hop for hop in hops if hop.source is n] for n in left + right}
    ends = [
        (left.index(h.source) + share(h.source.right, h.output), right.index(h.target) + share(h.target.left, h.input))
        for h in hops
    ]
    expected = sum(a < c and b > d for (a, b), (c, d) in permutations(ends, 2))
    assert crossings([left, right], leaving) == expected
