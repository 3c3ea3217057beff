"""States and transitions of a state machine, inside its box: nested states downwards, arrows at the right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from graph.drawing.style import LINE, SMALL, TEXT, fit, text_width

INDENT, GAP, HEAD_ROW, ROW = 7.0, 5.0, 17.0, 12.0  # px
TEXT_LIMIT = 250.0  # width of a condition, px
LANE = 7.0  # between two arrows, px


@dataclass
class ChartState:
    """A state. number : its value of the output `state`, -1 with inner states; texts : (text, y) below its name"""

    name: str
    number: int
    x: float
    y: float
    initial: bool
    texts: list[tuple[str, float]]
    width: float = 0.0
    height: float = 0.0


@dataclass(frozen=True)
class Arrow:
    """A transition. text : its condition; x : of its vertical part; start, end : heights; left, right : of the ends"""

    text: str
    x: float
    start: float
    end: float
    left: float
    right: float


@dataclass(frozen=True)
class Chart:
    """States, each before those in it, and transitions. Positions in px from the top left corner of the chart."""

    states: tuple[ChartState, ...]
    arrows: tuple[Arrow, ...]
    width: float
    height: float


def chart_of(block: Any) -> Chart | None:
    """Return the Chart of a block with a `chart` of states, and `transitions` (from, to, condition). None for others.

    Each state of `block.chart` has name, inner (indices of the states in it), outer, history, entry and exit.
    """
    nodes: Sequence[Any] = getattr(block, "chart", ())
    if not nodes:
        return None
    states: list[ChartState] = []
    rows: list[tuple[int, str, str, float]] = []  # source, target, condition and height of each transition
    leaves = [node for node in nodes if not node.inner]

    def add(index: int, x: float, y: float, initial: bool) -> float:
        node = nodes[index]
        name = f"{node.name} (history)" if node.history else node.name
        state = ChartState(name, leaves.index(node) if node in leaves else -1, x, y, initial, [])
        states.append(state)
        bottom = y + HEAD_ROW
        for kind, actions in (("entry", node.entry), ("exit", node.exit)):
            for held, value in actions.items():
                state.texts.append((fit(f"{kind}: {held} = {value}", SMALL, TEXT_LIMIT), bottom + 8.0))
                bottom += ROW
        for source, target, condition in block.transitions:
            if source == node.name:
                state.texts.append((fit(condition, SMALL, TEXT_LIMIT), bottom + 8.0))
                rows.append((index, target, condition, bottom + ROW / 2))
                bottom += ROW
        bottom += 3.0 * bool(state.texts)
        for place, inner in enumerate(node.inner):
            bottom = add(inner, x + INDENT, bottom + GAP * bool(place), not place)
        bottom += GAP * bool(node.inner)
        state.height = bottom - y
        return bottom

    height, order = 0.0, [index for index, node in enumerate(nodes) if node.outer < 0]
    for place, index in enumerate(order):
        height = add(index, 0.0, height + GAP * bool(place), not place)
    widest = max(
        2 * state.x + max([text_width(state.name, TEXT) + 14.0, *(text_width(text, SMALL) for text, _ in state.texts)])
        for state in states
    )
    for state in states:
        state.width = widest + 2 * INDENT - 2 * state.x
    names = [node.name for node in nodes]
    arrows: list[Arrow] = []
    lanes: list[list[tuple[float, float]]] = []
    ends = [(states[names.index(target)], states[source]) for source, target, _, _ in rows]
    spans = [(y, goal.y + HEAD_ROW / 2) for (_, _, _, y), (goal, _) in zip(rows, ends)]
    for place in sorted(range(len(rows)), key=lambda place: abs(spans[place][1] - spans[place][0])):
        low, high = sorted(spans[place])
        free = (lane for lane in lanes if all(high + 2.0 < a or low - 2.0 > b for a, b in lane))
        lane = next(free, None)
        if lane is None:
            lanes.append(lane := [])
        lane.append((low, high))
        goal, origin = ends[place]
        x = widest + 2 * INDENT + LANE * (lanes.index(lane) + 1)
        arrows.append(Arrow(rows[place][2], x, *spans[place], origin.x + origin.width, goal.x + goal.width))
    width = widest + 2 * INDENT + LANE * (len(lanes) + 0.5)
    return Chart(tuple(states), tuple(arrows), width, height + LINE / 2)
