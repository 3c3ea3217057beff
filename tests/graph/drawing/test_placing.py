"""Heights: the sum of bends is the smallest there is, boxes keep their distance, chains run straight."""

import random

import numpy as np
import pytest

from graph.drawing.layers import Edge, Node, arrange
from graph.drawing.placing import gap, place, stack


def column(chance, count):
    return [Node(str(i), 10.0, float(chance.choice((0, 20, 46))), {}, {}) for i in range(count)]


@pytest.mark.parametrize("seed", range(12))
def test_columns_have_the_weighted_bends_of_linear_programming(seed):
    linprog = pytest.importorskip("scipy.optimize", reason="needs SciPy (extra test)").linprog
    chance = random.Random(seed)
    nodes = column(chance, 7)
    wishes = {
        node: [(float(chance.randint(-200, 200)), chance.choice((1.0, 2.0, 8.0))) for _ in range(chance.randint(1, 4))]
        for node in nodes
    }
    stack(nodes, {node: 0.0 for node in nodes}, wishes)
    bends = sum(weight * abs(node.y - y) for node in nodes for y, weight in wishes[node])
    assert all(a.y + a.height + gap(a, b) <= b.y + 1e-9 for a, b in zip(nodes, nodes[1:]))

    flat = [(index, y, weight) for index, node in enumerate(nodes) for y, weight in wishes[node]]
    rows, limits = [], []
    for k, (index, y, _) in enumerate(flat):  # |height - wish| <= slack
        for sign in (1.0, -1.0):
            row = np.zeros(len(nodes) + len(flat))
            row[index], row[len(nodes) + k] = sign, -1.0
            rows.append(row)
            limits.append(sign * y)
    for index, (a, b) in enumerate(zip(nodes, nodes[1:])):
        row = np.zeros(len(nodes) + len(flat))
        row[index], row[index + 1] = 1.0, -1.0
        rows.append(row)
        limits.append(-a.height - gap(a, b))
    costs = [0.0] * len(nodes) + [weight for *_, weight in flat]
    best = linprog(costs, np.array(rows), limits, bounds=[(None, None)] * len(nodes) + [(0, None)] * len(flat))
    assert bends == pytest.approx(best.fun, abs=1e-6)


def test_a_chain_of_ports_at_different_heights_runs_straight():
    nodes = [Node(str(i), 10.0, 60.0 + 10 * i, {"in": 10.0 + 7 * i}, {"out": 20.0 + 5 * i}) for i in range(5)]
    columns, _, hops = arrange(nodes, [Edge(a, "out", b, "in") for a, b in zip(nodes, nodes[1:])])
    place(columns, hops)
    assert all(a.y + a.right["out"] == b.y + b.left["in"] for a, b in zip(nodes, nodes[1:]))
    assert min(node.y for node in nodes) == 0
