"""Recorders and viewers as blocks: what they take, and what they refuse. What they write is the recorder process's."""

import pytest

from blocks.recorders import CsvRecorder, StrideReport
from blocks.sinks import Panel, PlotJuggler
from blocks.sources import Sine
from graph import Diagram, DiagramError, compile
from tests.blocks.running import player


def columns(sink):
    """Paths of the columns that the only sink of a diagram with two sources takes; sink: called with them, inside the
    diagram.
    """
    with Diagram("recorded", rate=100) as diagram:
        sink(Sine(name="a"), player([[1.0, 2.0]], "rad"))
    (found,) = compile(diagram).sinks
    return [column.path for column in found.columns]


@pytest.mark.parametrize("kind", [CsvRecorder, PlotJuggler])
def test_without_connections_a_sink_receives_every_port(kind):
    assert columns(lambda a, b: kind()) == ["a.y", "player.y[0]", "player.y[1]"]


@pytest.mark.parametrize("kind", [CsvRecorder, PlotJuggler])
def test_sink_records_connected_signals_in_order_with_given_names(kind):
    assert columns(lambda a, b: kind()(b, a.y)) == ["player.y[0]", "player.y[1]", "a.y"]
    assert columns(lambda a, b: kind()(angle=a.y)) == ["angle"]


def test_stride_report_requires_all_its_signals():
    with Diagram("report", rate=100) as diagram:
        StrideReport()(phase=player([0.0], "1"), torque=player([0.0], "N·m"))
    with pytest.raises(DiagramError) as refused:
        compile(diagram)
    assert {d.port for d in refused.value.diagnostics} == {"walking", "angle", "velocity"}


def test_stride_report_distinguishes_torque_and_angle():
    with Diagram("report", rate=100) as diagram:
        StrideReport()(
            phase=player([0.0], "1"),
            walking=player([True], "1", bool),
            angle=player([0.0], "N·m"),
            velocity=player([0.0], "rad/s"),
            torque=player([0.0], "N·m"),
        )
    with pytest.raises(DiagramError, match="stride_report.angle: expected rad, got N·m"):
        compile(diagram)


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: CsvRecorder(flush_rows=0), "flush_rows: must be at least 1, got 0"),
        (lambda: CsvRecorder(delimiter="."), "delimiter must be comma, .* in no number and no quote, got '.'"),
        (lambda: Panel(marks=("start", 2)), "marks must be text of 1 to 200 characters in one line, got 2"),
        (lambda: Panel(target=(2.0, 1.0)), r"target must be \(lowest, highest\), got \(2.0, 1.0\)"),
        (lambda: Panel(target=(2.0, None)), "target must be"),
        (lambda: CsvRecorder(delimiter="e"), "delimiter must be comma, .*, got 'e'"),
        (lambda: CsvRecorder(delimiter="||"), "delimiter must be comma, .*, got '||'"),
        (lambda: CsvRecorder(names={"knee.position": 1}), "names must be {signal: name}, both text, got 'knee"),
        (lambda: PlotJuggler(port=0), "port: must be at least 1, got 0"),
        (lambda: PlotJuggler(port=70000), "port: must be at most 65535, got 70000"),
        (lambda: PlotJuggler(port=9870.5), "port: expected a whole number"),
        (lambda: PlotJuggler(host=127), "host: expected text"),
    ],
)
def test_parameters_out_of_bounds_are_refused(make, said):
    with pytest.raises(DiagramError, match=said):
        make()


def test_panel_takes_marks_from_the_diagram_and_from_a_file(tmp_path):
    file = tmp_path / "protocol.txt"
    file.write_text("level walking\n\n uphill \nstart\n")
    panel = Panel(marks=("start",), marks_file=str(file))
    assert panel.marks == ("start", "level walking", "uphill")
    panel.reconfigure()
    assert panel.marks == ("start", "level walking", "uphill")
    with pytest.raises(DiagramError, match="nowhere.txt"):
        Panel(marks_file="nowhere.txt")
