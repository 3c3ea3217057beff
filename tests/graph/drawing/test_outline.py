"""What of a diagram is in its drawing."""

from contextlib import ExitStack

import numpy as np
import pytest

from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sources import Sine, StepSource
from graph import Block, Diagram, Input, Output, subsystem
from graph.drawing import draw
from tests.graph.drawing.diagrams import nested


class Gyro(Block):
    """Three axes."""

    rate = Output("rad/s", shape=(3,))

    def step(self):
        return np.zeros(3)


class Norm(Block):
    """Length of a vector."""

    v = Input("rad/s", shape=(3,))
    y = Output("rad/s")

    def step(self, v):
        return float(np.linalg.norm(v))


def box(drawing, path):
    return next(box for box in drawing.boxes if box.path == path)


def test_a_subsystem_shows_its_rate_and_its_condition():
    frames = {frame.path: frame for frame in draw(nested()).frames}
    assert (
        frames["supervisor"].note == "every 10 ticks"
        and frames["left/extra"].note == "while switch.y"
        and frames["left"].note == ""
    )


def test_the_enabling_signal_is_connected_to_the_frame():
    drawing = draw(nested())
    ends = {line.target for line in drawing.lines if line.signal == "switch.y"}
    assert {("left/extra", "enabled", "switch.y"), ("right/extra", "enabled", "switch.y")} <= ends
    frames = {frame.path: frame for frame in drawing.frames}
    [pin] = [pin for pin in frames["left/extra"].pins if pin.side == "enabled"]
    assert pin.x == frames["left/extra"].x and frames["left/extra"].y < pin.y < frames["left/extra"].y + 26


def test_a_slow_block_in_a_fast_subsystem_shows_its_rate():
    with Diagram("d", rate=100) as diagram:
        Gain(every=5)(Sine()())
        CsvRecorder()
    assert "every 5 ticks" in box(draw(diagram), "gain").details


def test_constants_are_drawn_beside_their_port():
    [port] = [
        port
        for port in box(draw(nested()), "left/hip/a_spring_with_a_rather_long_name").ports
        if port.name == "equilibrium"
    ]
    assert port.note == "= 0.25"


def test_a_named_block_shows_its_type_below_and_an_unnamed_one_only_its_type():
    with Diagram("d", rate=100) as diagram:
        Sine(name="wave")
        Sine()
        CsvRecorder()
    drawing = draw(diagram)
    assert (box(drawing, "wave").title, box(drawing, "wave").subtitle) == ("wave", "Sine")
    assert (box(drawing, "sine").title, box(drawing, "sine").subtitle) == ("Sine", "")


def test_parameters_are_shown_where_they_are_not_the_default():
    with Diagram("d", rate=100) as diagram:
        Sine(frequency=2.0, bias=0.0)
        CsvRecorder()
    assert box(draw(diagram), "sine").details == ("frequency 2 Hz",)


def test_the_line_of_a_vector_is_wide():
    with Diagram("d", rate=100) as diagram:
        Gain()(Norm()(Gyro()()))
        CsvRecorder()
    assert {line.signal: line.wide for line in draw(diagram).lines} == {"gyro.rate": True, "norm.y": False}


def test_elements_of_a_signal_are_written_at_its_output_instead_of_blocks_that_select_them():
    with Diagram("d", rate=100) as diagram:
        gyro = Gyro()()
        Gain(name="roll")(gyro[0])
        Gain(name="pitch")(gyro[1])
        Norm()(gyro[[2, 0, 1]])
        gyro[::2]
        CsvRecorder()
    drawing = draw(diagram)
    assert [port.name for port in box(drawing, "gyro").ports] == ["rate[0]", "rate[1]", "rate[[2, 0, 1]]", "rate[::2]"]
    assert {line.source for line in drawing.lines} == {"gyro.rate[0]", "gyro.rate[1]", "gyro.rate[[2, 0, 1]]"}
    assert not any(other.path.startswith("select") for other in drawing.boxes)
    assert set(drawing.elements) == {"select", "select_2", "select_3", "select_4"}


def test_the_second_leg_is_one_box_with_what_differs():
    drawing = draw(nested(), fold=True)
    right = box(drawing, "right")
    assert (right.title, right.subtitle) == ("right", "as left, but for")
    assert right.details == ("hip/drive: can_id 3", "knee/drive: can_id 4")
    assert [port.name for port in right.ports] == ["supervisor/gain.y", "switch.y"]
    assert "right" not in {frame.path for frame in drawing.frames}
    assert {frame.path: frame.like for frame in draw(nested()).frames}["right"]


@pytest.mark.parametrize("other", [{"frequency": 2.0}, {}])
def test_a_subsystem_with_another_wire_is_not_like_its_sibling(other):
    with Diagram("d", rate=100) as diagram:
        for side in ("left", "right"):
            with subsystem(side):
                wave = Sine(name="wave", **(other if side == "right" else {}))()
                first = Gain(name="first")(wave)
                Gain(name="second")(first if other or side == "left" else wave)
        CsvRecorder()
    assert [box.path for box in draw(diagram, fold=True).boxes if box.family == "subsystem"] == ["right"] * bool(other)


def test_a_sink_with_wires_shows_its_labels():
    with Diagram("d", rate=100) as diagram:
        CsvRecorder()(Sine()(), step=StepSource()())
    assert [port.name for port in box(draw(diagram), "csv_recorder").ports] == ["sine.y", "step"]


@pytest.mark.parametrize("depth", [1, 3])
def test_a_signal_crosses_one_pin_in_each_frame_between(depth):
    with Diagram("d", rate=100) as diagram:
        source = Sine()()
        CsvRecorder()
        with ExitStack() as inside:
            for name in "abc"[:depth]:
                inside.enter_context(subsystem(name))
            Gain(name="one")(source)
            Gain(name="two")(source)
    drawing = draw(diagram)
    assert [[pin.signal for pin in frame.pins] for frame in drawing.frames] == [["sine.y"]] * depth
    assert len(drawing.lines) == depth + 2


def test_an_empty_diagram_can_be_drawn():
    with Diagram("empty", rate=100) as diagram:
        pass
    assert draw(diagram).boxes == ()
