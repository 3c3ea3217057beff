"""The order of a tick is networkx's: its graph, its sort and its loops, with a key of our own."""

import random
import re
import subprocess
import sys

import networkx as nx
import pytest

from blocks.discrete import UnitDelay
from blocks.mathematics import Gain, Sum
from blocks.sources import Sine
from graph import Block, Diagram, Input, Output, compile
from graph.compilation import Compilation
from graph.compiler import examine
from graph.order import dependencies, kind, ordered
from tests.checkout import ROOT


class Twice(Block):
    """A block in Python."""

    u = Input("any")
    y = Output("any")

    def step(self, u):
        return 2.0 * u


def mixed(seed, count=60):
    """A random diagram of native and Python blocks, some of which run every second tick."""
    draw = random.Random(seed)
    with Diagram("mixed", rate=100) as diagram:
        signals = [Sine(name=f"sine{number}").y for number in range(3)]
        for number in range(count):
            kinds = (Gain, {}), (Twice, {}), (Twice, {"every": 2}), (UnitDelay, {})
            make, options = draw.choice(kinds)
            signals.append(make(name=f"block{number}", **options)(draw.choice(signals[-20:])))
        Sum("++", name="sum")(signals[-1], signals[-2])
    return diagram


@pytest.mark.parametrize("seed", range(5))
def test_the_order_is_that_of_the_sort_of_networkx(seed, monkeypatch):
    sorted_by_networkx, graphs = [], []
    real = nx.lexicographical_topological_sort

    def sort(graph, key=None):
        graphs.append(graph)
        sorted_by_networkx.append(list(real(graph, key)))
        return iter(sorted_by_networkx[-1])

    monkeypatch.setattr(nx, "lexicographical_topological_sort", sort)
    compilation = examine(mixed(seed))
    assert not compilation.errors
    assert sorted_by_networkx == [compilation.order] and type(graphs[0]) is nx.DiGraph
    schedule = compile(mixed(seed))
    assert [step.name for step in schedule.output] == [block.path for block in sorted_by_networkx[-1]]


@pytest.mark.parametrize("seed", range(20))
def test_the_order_obeys_every_dependency_and_keeps_steps_of_one_kind_adjacent(seed):
    compilation = examine(mixed(seed))
    graph = dependencies(compilation.blocks, compilation.sources)
    place = {block: number for number, block in enumerate(ordered(graph))}
    assert len(place) == len(graph) and all(place[before] < place[after] for before, after in graph.edges)
    kinds = [kind(block) for block in place]
    longest = max(
        sum(kind(before) != kind(after) for before, after in zip(path, path[1:]))
        for path in [nx.dag_longest_path(weighted(graph))]
    )
    segments = 1 + sum(before != after for before, after in zip(kinds, kinds[1:]))
    assert segments <= len(set(kinds)) * (longest + 1)


def weighted(graph):
    """The graph with the changes of kind as weights."""
    copy = nx.DiGraph()
    copy.add_nodes_from(graph)
    copy.add_weighted_edges_from((a, b, float(kind(a) != kind(b))) for a, b in graph.edges)
    return copy


def test_the_loops_are_the_strongly_connected_components_of_networkx(monkeypatch):
    with Diagram("loop", rate=100) as diagram:
        first, second = Gain(name="first"), Gain(name="second")
        second(first(second.y))
    found = []
    real = nx.strongly_connected_components
    monkeypatch.setattr(
        nx, "strongly_connected_components", lambda graph: found.append(list(map(set, real(graph)))) or found[-1]
    )
    compilation = examine(diagram)
    assert [error.code for error in compilation.errors] == ["TW006"] and {first, second} in found[0]


def test_the_graph_of_a_compile_has_the_wire_of_each_edge():
    with Diagram("edges", rate=100) as diagram:
        source = Sine(name="sine")
        gain = Gain(name="gain")
        gain(source.y)
    compilation = examine(diagram)
    graph = dependencies(compilation.blocks, compilation.sources)
    assert isinstance(compilation, Compilation) and graph.edges[source, gain] == {"port": "u", "source": "y"}


@pytest.mark.soak
def test_every_compile_imports_networkx():
    code = (
        "from graph import Diagram, compile\nfrom blocks.sources import Sine\n"
        "with Diagram('d', rate=100) as diagram:\n    Sine()\ncompile(diagram)"
    )
    done = subprocess.run([sys.executable, "-X", "importtime", "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0 and re.search(r"\|\s+networkx\n", done.stderr), done.stderr[-300:]
