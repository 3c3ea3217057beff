"""Random networks: the order of making and wiring never shows, native and plain Python agree bit for bit, and no proved
range is left.
"""

import math

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, compile
from graph.compilation import Compilation
from graph.compiler import prove, sort
from graph.signal import Signal
from graph.type_checks import check_shapes, check_units
from graph.wire_checks import check_wires
from tests.cext.reference import ARITY, BLOCKS, OPEN, SOURCES, Node, execute
from tests.cext.rigs import Rig

RATE, TICKS = 125.0, 24
MILD = st.floats(-3.0, 3.0)
WILD = st.one_of(
    MILD, st.floats(allow_nan=False), st.sampled_from([0.0, -0.0, 1e-320, 1e308, -1e308, math.inf, -math.inf])
)


def parameters(kind, number):
    if kind == "Saturation":
        return st.tuples(number, number).map(lambda pair: {"lower": min(pair), "upper": max(pair)})
    return st.fixed_dictionaries(
        {
            "Sine": {"amplitude": number, "frequency": st.floats(0.0, 40.0), "phase": MILD, "bias": number},
            "StepSource": {"before": number, "after": number, "time": st.floats(0.0, 0.2)},
            "Gain": {"gain": number},
            "Sum": {"signs": st.text("+-", min_size=3, max_size=3)},
            "SlewRate": {"rate": number.map(abs)},
            "Butterworth": {"order": st.integers(1, 5), "cutoff": st.floats(0.1, 12.0)},
            "UnitDelay": {"initial": number},
        }.get(kind, {})
    )


@st.composite
def networks(draw, number=MILD):
    count = draw(st.integers(2, 14))
    kinds = [draw(st.sampled_from(SOURCES)), *(draw(st.sampled_from(sorted(BLOCKS))) for _ in range(count - 1))]
    nodes = []
    for i, kind in enumerate(kinds):
        readable = [k for k in range(count) if kinds[k] in OPEN or kind in OPEN or k < i]
        near = [k for k in readable if k < i][-2:] or readable  # chains are longer than chance would make them
        inputs = tuple(draw(st.sampled_from(near) | st.sampled_from(readable)) for _ in range(ARITY.get(kind, 1)))
        nodes.append(Node(kind, draw(parameters(kind, number)), inputs, draw(st.sampled_from([1, 1, 1, 2, 4]))))
    return nodes


def build(nodes, making, wiring):
    """The diagram of a network, made and wired in those orders."""
    blocks = {}
    with Diagram("network", rate=RATE) as diagram:
        for i in making:
            blocks[i] = nodes[i].block(name=f"n{i:02}", every=nodes[i].every, **nodes[i].parameters)
        for i in wiring:
            ports = list(blocks[i].inputs)
            for port, k in zip(ports, nodes[i].inputs):
                blocks[i](**{port: blocks[k].y})
    return diagram


def trace(diagram, nodes):
    """Rows of outputs, one a tick: the last of a run of one tick, of two, and so on."""
    schedule = compile(diagram)
    program = Program(schedule)
    executor = Executor(program, RATE)
    slots = [schedule.signals[f"n{i:02}.y"].slot for i in range(len(nodes))]
    rows = []
    for ticks in range(1, TICKS + 1):
        executor.spin(ticks)
        rows.append(program.values[slots])
    return np.array(rows)


def bits(rows):
    """Bytes, in which every NaN is one NaN: its sign and payload are ignored."""
    rows = np.array(rows, dtype=float)
    return np.where(np.isnan(rows), np.nan, rows).tobytes()


SLOW = settings(suppress_health_check=[HealthCheck.too_slow])


@SLOW
@given(networks(), st.randoms(use_true_random=False))
def test_the_result_does_not_depend_on_the_order_of_construction(nodes, random):
    straight = list(range(len(nodes)))
    making, wiring = random.sample(straight, len(nodes)), random.sample(straight, len(nodes))
    assert bits(trace(build(nodes, straight, straight), nodes)) == bits(trace(build(nodes, making, wiring), nodes))


@SLOW
@given(networks(WILD))
def test_native_blocks_agree_with_plain_python_bit_for_bit(nodes):
    straight = range(len(nodes))
    found, expected = trace(build(nodes, straight, straight), nodes), np.array(execute(nodes, RATE, TICKS))
    assert bits(found) == bits(expected), [(i, nodes[i]) for i in straight if bits(found[:, i]) != bits(expected[:, i])]


@SLOW
@given(networks(WILD))
def test_no_output_leaves_the_range_that_is_proved(nodes):
    straight = range(len(nodes))
    diagram = build(nodes, straight, straight)
    compilation = Compilation(diagram)
    for check in (check_wires, check_shapes, check_units, sort, prove):
        check(compilation)
    ranges = [compilation.ranges[Signal(diagram[f"n{i:02}"], "y")] for i in straight]
    for row in execute(nodes, RATE, TICKS):
        for node, interval, value in zip(nodes, ranges, row):
            assert math.isnan(value) or value in interval, (node, interval, value)


def test_repeated_runs_give_identical_bits():
    nodes = [
        Node("Sine", {"frequency": 3.0}),
        Node("Butterworth", {"order": 3, "cutoff": 9.0}, (0,)),
        Node("Integral", {}, (1,)),
        Node("Sum", {"signs": "+-+"}, (0, 1, 2)),
        Node("SlewRate", {"rate": 3.0}, (3,), 2),
    ]
    rig = Rig(build(nodes, range(5), range(5)))
    expected = bits(execute(nodes, RATE, TICKS))
    for _ in range(3):
        rig.run(TICKS)
        assert bits(np.array([rig[f"n{i:02}.y"] for i in range(5)]).T) == expected
