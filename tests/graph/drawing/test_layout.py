"""Where things lie: nothing covers anything, and every line ends where it should."""

import re
from itertools import combinations, pairwise

import pytest

from blocks.discrete import UnitDelay
from blocks.mathematics import Gain, Sum
from blocks.sources import Sine
from graph import Diagram, Signal, subsystem
from graph.drawing import draw
from graph.drawing.channels import NEAR
from tests.graph.drawing.diagrams import by_chance, leg, walk
from tests.soaking import soaked

SEEDS = soaked(range(40), but=range(12))


@pytest.fixture(scope="module", params=SEEDS, ids=lambda seed: f"seed {seed}")
def case(request):
    diagram = by_chance(request.param)
    return diagram, draw(diagram)


def overlap(a, b):
    return a.x < b.x + b.width and b.x < a.x + a.width and a.y < b.y + b.height and b.y < a.y + a.height


def holds(outer, inner):
    beside = outer.x <= inner.x and inner.x + inner.width <= outer.x + outer.width
    return beside and outer.y <= inner.y and inner.y + inner.height <= outer.y + outer.height


def segments(line):
    for (a, b), (c, d) in pairwise(line.points):
        yield min(a, c), min(b, d), max(a, c), max(b, d)


def test_every_block_is_drawn_once_and_every_subsystem_has_a_frame(case):
    diagram, drawing = case
    assert sorted(box.path for box in drawing.boxes if not box.path.endswith("=command")) == sorted(diagram.blocks)
    subsystems = {
        "/".join(path.split("/")[:depth]) for path in diagram.blocks for depth in range(1, path.count("/") + 1)
    }
    assert len({frame.path for frame in drawing.frames}) == len(drawing.frames)
    assert {re.sub(r"=\d+", "", frame.path) for frame in drawing.frames} == subsystems


def test_no_two_boxes_cover_each_other(case):
    _, drawing = case
    for a, b in combinations(drawing.boxes, 2):
        assert not overlap(a, b), f"{a.path} and {b.path}"


def test_frames_contain_their_blocks_only(case):
    _, drawing = case
    frames = {frame.path: frame for frame in drawing.frames}
    for thing in drawing.boxes + drawing.frames:
        for path, frame in frames.items():
            if thing.subsystem == path or thing.subsystem.startswith(f"{path}/"):
                assert holds(frame, thing), f"{path} and {thing.path}"
            elif thing is not frame:
                assert not overlap(frame, thing) or holds(thing, frame), f"{path} and {thing.path}"


def test_all_elements_are_inside_the_page(case):
    _, drawing = case
    for thing in drawing.boxes + drawing.frames:
        assert (
            thing.x >= 0
            and thing.y >= 0
            and thing.x + thing.width <= drawing.width
            and thing.y + thing.height <= drawing.height
        )
    for line in drawing.lines:
        assert all(0 <= x <= drawing.width and 0 <= y <= drawing.height for x, y in line.points)


def test_lines_are_horizontal_or_vertical_and_avoid_boxes(case):
    _, drawing = case
    for line in drawing.lines:
        for left, top, right, bottom in segments(line):
            assert left == right or top == bottom
            for thing in drawing.boxes:
                inside = (
                    left < thing.x + thing.width
                    and thing.x < right
                    and top < thing.y + thing.height
                    and thing.y < bottom
                )
                assert not inside, f"{line.signal} runs through {thing.path}"


def test_lines_stay_inside_their_frame_and_outside_others(case):
    _, drawing = case
    frames = {frame.path: frame for frame in drawing.frames}
    for line in drawing.lines:
        for left, top, right, bottom in segments(line):
            for path, frame in frames.items():
                if line.subsystem == path or line.subsystem.startswith(f"{path}/"):
                    assert (
                        frame.x <= left
                        and right <= frame.x + frame.width
                        and frame.y <= top
                        and bottom <= frame.y + frame.height
                    )
                else:
                    through = (
                        left < frame.x + frame.width
                        and frame.x < right
                        and top < frame.y + frame.height
                        and frame.y < bottom
                    )
                    assert not through, f"{line.signal} runs through {path}"


def test_lines_of_two_signals_never_lie_on_each_other(case):
    _, drawing = case
    pieces = [(line, piece) for line in drawing.lines for piece in segments(line)]
    for (one, a), (other, b) in combinations(pieces, 2):
        if one.signal == other.signal:
            continue
        level = a[1] == a[3] and b[1] == b[3] and abs(a[1] - b[1]) < NEAR and min(a[2], b[2]) - max(a[0], b[0]) > 0
        upright = a[0] == a[2] and b[0] == b[2] and abs(a[0] - b[0]) < NEAR and min(a[3], b[3]) - max(a[1], b[1]) > 0
        assert not level and not upright, f"{one.signal} and {other.signal} at {a}, {b}"


def test_every_connection_is_drawn_from_port_to_port_through_the_pins_of_frames(case):
    diagram, drawing = case
    places = {
        f"{box.path.removesuffix('=command')}.{port.name}": (port.x, port.y)
        for box in drawing.boxes
        for port in box.ports
    }
    pins = {(frame.path, pin.side, pin.signal): (pin.x, pin.y) for frame in drawing.frames for pin in frame.pins}
    ends = places | pins
    after = {}
    for line in drawing.lines:
        assert line.points[0] == ends[line.source] and line.points[-1] == ends[line.target], (
            f"{line.source} to {line.target}"
        )
        after.setdefault((line.signal, line.source), set()).add(line.target)
    for wire in diagram.wires:
        if isinstance(wire.source, Signal):
            reached, waiting = set(), [wire.source.path]
            while waiting:
                end = waiting.pop()
                reached.add(end)
                waiting += after.get((wire.source.path, end), set()) - reached
            assert f"{wire.block.path}.{wire.port}" in reached


def test_lines_go_to_the_right_but_for_feedback(case):
    _, drawing = case
    for line in drawing.lines:
        assert line.points[0][0] < line.points[-1][0] or line.back


@pytest.mark.parametrize("seed", soaked(range(8), but=range(3)))
def test_the_same_diagram_is_drawn_the_same(seed):
    diagram = by_chance(seed)
    drawing = draw(diagram)
    assert draw(diagram) == drawing == draw(by_chance(seed))


def test_an_actuator_in_a_loop_is_its_feedback_on_the_left_and_its_command_on_the_right():
    drawing = draw(leg())
    order = sorted((box for box in drawing.boxes if box.subsystem == "left"), key=lambda box: box.x)
    names = ["knee", "butterworth", "impedance", "torque_limiter", "knee=command"]
    assert [box.path for box in order] == [f"left/{name}" for name in names]
    assert [port.name for port in order[-1].ports] == ["torque_command"]
    assert not any(line.back for line in drawing.lines)


def test_a_subsystem_that_senses_and_acts_is_split_where_a_signal_returns_to_it():
    drawing = draw(walk())
    assert sorted((frame.path, frame.note) for frame in drawing.frames) == [
        ("left", "1 of 2"),
        ("left=2", "2 of 2"),
        ("right", "1 of 2"),
        ("right=2", "2 of 2, as left"),
    ]
    at = {box.path: (box.subsystem, box.x) for box in drawing.boxes}
    assert at["left/knee"][0] == "left" and at["left/knee=command"][0] == at["left/limiter"][0] == "left=2"
    assert at["left/knee"][1] < at["both"][1] < at["left/limiter"][1] < at["left/knee=command"][1]
    assert not any(line.back or line.loop for line in drawing.lines)


def test_only_a_loop_of_blocks_is_dashed():
    with Diagram("loop", rate=100) as diagram:
        delay = UnitDelay(name="delay")
        total = Sum("++", name="total")(Sine()(), delay.y)
        delay(total)
        with subsystem("beside"):  # each feeds the other, but no signal returns to its block
            first = Gain(2.0, name="first")(total)
        with subsystem("other"):
            far = Gain(2.0, name="far")(first)
            near = Gain(2.0, name="near")(total)
        with subsystem("beside"):
            Gain(2.0, name="second")(near)
        Gain(name="end")(far)
    looping = {line.signal for line in draw(diagram).lines if line.loop}
    assert looping == {"total.y"} or looping == {"delay.y"}
    back = {line.signal for line in draw(diagram).lines if line.back}
    assert back == looping


def test_a_chain_runs_straight():
    drawing = draw(leg())
    [line] = [line for line in drawing.lines if line.target == "left/torque_limiter.torque"]
    assert len(line.points) == 2
