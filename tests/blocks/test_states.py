"""State machines: nested states, actions and history against an interpreter in Python; errors; the names of states."""

import math
import random

import pytest

from blocks.states import StateMachine
from graph import Diagram, Interval
from graph.drawing.chart import chart_of
from tests.blocks.playing import source
from tests.blocks.running import run
from tests.graph.complaints import refusal

RATE = 100.0
LEG = {
    "takes": {"angle": "rad", "load": "1"},
    "gives": {"stiffness": "N·m/rad", "damping": "N·m·s/rad"},
    "holds": {"start": ("rad", 0.5), "strides": ("1", 0.0), "walked": ("1", 0)},
    "states": {
        "walking": {
            "damping": 1.0,
            "states": {
                "stance": {"stiffness": 60.0, "entry": {"start": "angle", "strides": "strides + 1"}},
                "swing": {"stiffness": 0.0, "damping": 0.4},
            },
            "history": True,
            "exit": {"walked": 1},
        },
        "seated": {"stiffness": 5.0, "damping": 0.2},
    },
    "transitions": (
        ("walking", "seated", "angle > 1.2 and time_in_state > 0.035"),
        ("stance", "swing", "load < 0.1"),
        ("swing", "stance", "load > 0.1 and time_in_state > 0.015"),
        ("seated", "walking", "load > 0.5"),
    ),
}


def machine(angle, load, ticks, **parameters):
    with Diagram("leg", rate=RATE) as diagram:
        StateMachine(name="leg", **{**LEG, **parameters})(source(angle, "rad"), load=source(load, "1"))
    return diagram, run(diagram, ticks)


def test_a_leg_walks_sits_down_and_resumes_the_part_of_the_stride():
    angle = [0.1, 0.2, 0.3, 0.4, 1.3, 1.3, 1.3, 0.7, 0.8, 0.9]
    load = [1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.9, 0.0, 1.0, 1.0]
    diagram, table = machine(angle, load, 10)
    assert diagram["leg"].names == ["walking.stance", "walking.swing", "seated"]
    # The first tick that ends a swing is the second after it; the time of `walking` counts both of its inner states.
    assert table["leg.state"].tolist() == [0, 1, 1, 0, 2, 2, 0, 1, 1, 0]
    assert table["leg.time_in_state"].tolist() == pytest.approx([0, 0, 0.01, 0, 0, 0.01, 0, 0, 0.01, 0])
    assert table["leg.stiffness"].tolist() == [60, 0, 0, 60, 5, 5, 60, 0, 0, 60]
    assert table["leg.damping"].tolist() == [1.0, 0.4, 0.4, 1.0, 0.2, 0.2, 1.0, 0.4, 0.4, 1.0]
    assert table["leg.strides"].tolist() == [1, 1, 1, 2, 2, 2, 3, 3, 3, 4]
    assert table["leg.start"].tolist() == [0.1, 0.1, 0.1, 0.4, 0.4, 0.4, 1.3, 1.3, 1.3, 0.9]
    assert table["leg.walked"].tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 1, 1]


def test_ranges_follow_from_the_innermost_states_and_from_constant_actions():
    ranges = StateMachine(**LEG).output_range()
    assert ranges["stiffness"] == Interval(0.0, 60.0) and ranges["damping"] == Interval(0.2, 1.0)
    assert ranges["state"] == Interval(0.0, 2.0) and ranges["walked"] == Interval(0.0, 1.0) and "start" not in ranges


def test_nan_makes_every_output_nan_and_neither_starts_nor_changes_a_state():
    _, table = machine([math.nan, 0.2, 0.3, math.inf, 0.4], [0.0, 1.0, 0.0, 1.0, 0.0], 5)
    assert table["leg.state"].tolist() == [0, 0, 1, 1, 1]
    assert table["leg.start"].tolist()[1:3] == [0.2, 0.2] and table["leg.start"].tolist()[4] == 0.2
    for name in ("start", "strides", "stiffness", "time_in_state"):
        assert [math.isnan(value) for value in table[f"leg.{name}"]] == [True, False, False, True, False]


class Chart:
    """Interpreter of the same charts: a state is a path of names, and each step moves along it."""

    def __init__(self, states, transitions):
        self.states, self.transitions = {}, transitions
        self.flatten(states, ())
        self.history, self.entered, self.trace, self.active = {}, {}, 0.0, ()
        self.enter(next(iter(self.states)), (), 0)

    def flatten(self, states, around):
        for name, content in states.items():
            self.states[(*around, name)] = content
            self.flatten(content.get("states", {}), (*around, name))

    def act(self, path, kind, u):
        for expression in self.states[path].get(kind, {}).values():
            self.trace = eval(expression, {}, {"trace": self.trace, "u": u})

    def enter(self, target, remaining, u):
        path = target
        while inside := self.states[path].get("states"):
            first = next(iter(inside))
            path = (*path, self.history.get(path, first) if self.states[path].get("history") else first)
        for depth in range(len(remaining) + 1, len(path) + 1):
            self.entered[path[:depth]] = self.tick if hasattr(self, "tick") else 0
            self.act(path[:depth], "entry", u)
        for depth in range(1, len(path)):
            self.history[path[:depth]] = path[depth]
        self.active = path

    def step(self, tick, u):
        self.tick = tick
        if tick == 0:  # entered before, without the input
            self.trace = 0.0
            self.enter(next(iter(self.states)), (), u)
        place = {path[-1]: path for path in self.states}
        for origin, target, condition in self.transitions:
            path = place[origin]
            time = (tick - self.entered.get(path, 0)) / RATE
            if self.active[: len(path)] == path and eval(condition, {}, {"u": u, "time_in_state": time}):
                goal, depth = place[target], 0
                while depth < min(len(path), len(goal)) - 1 and path[depth] == goal[depth]:
                    depth += 1
                for length in range(len(self.active), depth, -1):
                    self.act(self.active[:length], "exit", u)
                self.enter(goal, path[:depth], u)
                return


def chart(chance):
    """A chart of up to four levels, whose actions record their order."""
    names = iter("abcdefghijklmnopqrstuvwxyz")
    used = []

    def states(level):
        made = {}
        for _ in range(chance.randint(1, 3) if level else chance.randint(2, 3)):
            name = next(names, None)
            if name is None or len(used) > 12:
                break
            used.append(name)
            action = {kind: {"trace": f"trace * 0.5 + {chance.randint(1, 9)} + u"} for kind in ("entry", "exit")}
            made[name] = {"history": chance.random() < 0.5, **action}
            if level < 3 and chance.random() < 0.5:
                made[name]["states"] = states(level + 1)
        return made

    found = states(0)
    conditions = [
        f"u > {chance.uniform(-1, 1)!r} and time_in_state > {chance.randint(0, 6) * 0.01 + 0.005}" for _ in range(20)
    ]
    return found, tuple((chance.choice(used), chance.choice(used), condition) for condition in conditions)


@pytest.mark.parametrize("seed", range(4))
def test_random_charts_equal_an_interpreter(seed):
    chance = random.Random(seed)
    visited = set()
    for _ in range(8):
        states, transitions = chart(chance)
        inputs = [chance.uniform(-1.5, 1.5) for _ in range(150)]
        with Diagram("chart", rate=RATE) as diagram:
            parameters = {"states": states, "transitions": transitions, "holds": {"trace": ("1", 0.0)}}
            block = StateMachine(takes={"u": "1"}, name="chart", **parameters)
            block(source(inputs, "1"))
        table, oracle = run(diagram, len(inputs)), Chart(states, transitions)
        for tick, u in enumerate(inputs):
            oracle.step(tick, u)
            visited.add(oracle.active)
            assert block.names[int(table["chart.state"][tick])] == ".".join(oracle.active)
            assert table["chart.trace"][tick] == oracle.trace
    assert len(visited) >= 10


def test_a_condition_may_begin_with_a_number():
    with Diagram("early", rate=RATE) as diagram:
        states, transitions = {"before": {}, "after": {}}, (("before", "after", "0.025 < time_in_state"),)
        StateMachine(states=states, transitions=transitions, name="machine")()
    assert list(run(diagram, 5)["machine.state"]) == [0, 0, 0, 1, 1]


REFUSED = {
    "there are two states 'swing'": {"states": {"a": {"states": {"swing": {}}}, "swing": {}}},
    "nested in more than 8 levels": {"states": {"a": {}}},
    "state 'stance' has no value for damping": {"states": {"walking": {"states": {"stance": {"stiffness": 1.0}}}}},
    "state 'seated' has a value for colour, which is not an output": {
        "states": {"seated": {"stiffness": 1.0, "damping": 1.0, "colour": 1.0}}
    },
    "state 'a': history must be True or False, got 'deep'": {"states": {"a": {"history": "deep"}}},
    "entry of state 'a' must be a table in braces, got 'n = 1'": {"states": {"a": {"entry": "n = 1"}}},
    "state 'a' must be a table in braces, got 3.0": {"states": {"a": 3.0}},
    "the states in 'a' must be a table in braces, got ['b']": {"states": {"a": {"states": ["b"]}}},
    "states: expected a table in braces, got ['a', 'b']": {"states": ["a", "b"]},
    "state 'a': y must be a finite number, got None": {"gives": {"y": "1"}, "states": {"a": {"y": None}}},
    "holds: n must be (unit, finite value at the start), got 1.0": {"holds": {"n": 1.0}, "states": {"a": {}}},
    "value at the start), got ('1', nan)": {"holds": {"n": ("1", math.nan)}, "states": {"a": {}}},
    "state 'a': y must be a finite number, got inf": {"gives": {"y": "1"}, "states": {"a": {"y": math.inf}}},
    "must be printable and not begin or end with a space: ''": {"states": {"": {}}},
    "must be printable and not begin or end with a space: 'a\\n'": {"states": {"a\n": {}}},
    "'\u00b5' cannot be the name of a port: Python reads it as '\u03bc'": {
        "takes": {"\u00b5": "1"},
        "states": {"a": {}},
    },
    "'chart' cannot be the name of an output": {"gives": {"chart": "1"}, "states": {"a": {"chart": 1.0}}},
    "'self' cannot be the name of a port": {"takes": {"self": "1"}, "states": {"a": {}}},
    "an action sets 'steps', which `holds` does not have (none)": {
        "gives": {},
        "states": {"walking": {"entry": {"steps": "1"}}},
    },
    "there is no state 'lying'. The states are walking, stance, swing, seated": {
        "gives": LEG["gives"],
        "states": LEG["states"],
        "holds": LEG["holds"],
        "transitions": (("lying", "walking", "time_in_state > 1"),),
    },
}


@pytest.mark.parametrize("words", REFUSED)
def test_a_chart_with_a_mistake_is_refused(words):
    parameters = {"takes": LEG["takes"], "gives": LEG["gives"] if "value" in words else {}, **REFUSED[words]}
    if "levels" in words:
        for level in range(8):
            parameters["states"] = {f"s{level}": {"states": parameters["states"]}}
    assert words in str(refusal(StateMachine, **parameters))


def test_the_drawing_nests_the_states_and_ends_each_arrow_at_the_name_of_its_target():
    chart = chart_of(StateMachine(**LEG))
    assert chart is not None
    states = {state.name.removesuffix(" (history)"): state for state in chart.states}
    assert [(name, state.number, state.initial) for name, state in states.items()] == [
        ("walking", -1, True),
        ("stance", 0, True),
        ("swing", 1, False),
        ("seated", 2, False),
    ]
    outer = states["walking"]
    for inner in (states["stance"], states["swing"]):
        assert outer.x < inner.x and inner.x + inner.width < outer.x + outer.width
        assert outer.y < inner.y and inner.y + inner.height < outer.y + outer.height
    assert states["swing"].y > states["stance"].y + states["stance"].height
    arrows = {arrow.text: arrow for arrow in chart.arrows}
    for origin, target, condition in LEG["transitions"]:
        arrow, goal = arrows[condition], states[target]
        [line] = [y for text, y in states[origin].texts if text == condition]
        assert abs(arrow.start - line) < 4.0 and arrow.left == states[origin].x + states[origin].width
        assert goal.y < arrow.end < goal.y + 17.0 and arrow.right == goal.x + goal.width
        assert max(state.x + state.width for state in chart.states) < arrow.x < chart.width
        low, high = sorted((arrow.start, arrow.end))
        beside = [other for other in chart.arrows if other is not arrow and other.x == arrow.x]
        assert all(max(other.start, other.end) < low or min(other.start, other.end) > high for other in beside)
