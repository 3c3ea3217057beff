"""The picture as text."""

import xml.etree.ElementTree as ElementTree

from blocks.discrete import UnitDelay
from blocks.limiters import Saturation
from blocks.mathematics import Sum
from blocks.sources import Sine
from graph import Diagram
from graph.drawing import draw, svg
from graph.drawing.style import FAMILIES, fit, text_width
from graph.drawing.svg import branches, common_length, rest, way
from tests.graph.drawing.diagrams import leg, nested, wrong

SPACE = "{http://www.w3.org/2000/svg}"


def parse(diagram, **options):
    return ElementTree.fromstring(svg(draw(diagram, **options)))


def texts(root):
    return ["".join(element.itertext()) for element in root.iter(f"{SPACE}text")]


def test_svg_is_xml_with_a_size_and_a_title():
    root = parse(leg())
    assert root.tag == f"{SPACE}svg" and float(root.get("width")) > 400
    assert root.get("viewBox") == f"0 0 {root.get('width')} {root.get('height')}"
    found = texts(root)
    for words in (
        "left",
        "knee",
        "CubeMars",
        "Butterworth",
        "TorqueLimiter",
        "torque_command",
        "position",
        "limit 12 N·m",
        "leg, 200 Hz",
        "takes every port",
    ):
        assert words in found


def test_svg_refers_to_no_external_file():
    text = svg(draw(nested()))
    # the name space
    assert "<script" not in text and "href" not in text and "url(" not in text and text.count("http") == 1


def test_names_are_escaped():
    name = '<b> & "c"'
    root = parse(leg(name))
    assert root.find(f"{SPACE}title").text == name and f"{name}, 200 Hz" in texts(root)


def test_feedback_is_dashed_and_units_and_ranges_are_shown_on_hover():
    with Diagram("loop", rate=200) as diagram:
        delay = UnitDelay()
        delay(Saturation(-12.0, 12.0)(Sum("++")(delay.y, Sine()())))
    root = parse(diagram)
    [back] = [
        path for path in root.iter(f"{SPACE}path") if path.get("class") == "line back" and path.get("data-signal")
    ]
    assert back.find(f"{SPACE}title").text == "saturation.y   -12 to 12"
    assert "feedback" in texts(root) and "feedback" not in texts(parse(leg()))
    assert ".back { stroke: #a8480f; stroke-dasharray: 7 4;" in root.find(f"{SPACE}style").text


def test_the_legend_lists_exactly_the_families_in_the_drawing():
    found = texts(parse(leg()))
    titles = {family.title for family in FAMILIES.values()}
    assert titles & set(found) == {"actuator", "filter", "controller", "limiter", "recorder or viewer"}


def test_every_kind_of_block_has_its_own_colour():
    assert (
        len({family.edge for family in FAMILIES.values()})
        == len({family.head for family in FAMILIES.values()})
        == len(FAMILIES)
    )


def test_unconnected_ports_are_hidden_by_default():
    assert "temperature" not in texts(parse(leg())) and "temperature" in texts(parse(leg(), all_ports=True))


def test_errors_are_marked():
    root = parse(wrong())
    marked = {
        group.get("data-path") for group in root.iter(f"{SPACE}g") if "wrong" in (group.get("class") or "").split()
    }
    assert marked == {"knee=command", "lonely"}
    [command] = [path for path in root.iter(f"{SPACE}path") if {"line", "wrong"} <= set(path.get("class").split())]
    assert command.get("data-signal") == "gain.y"
    assert sum(circle.get("class") == "dot wrong" for circle in root.iter(f"{SPACE}circle")) == 2


def test_corners_are_rounded_except_at_junctions():
    points = ((0, 0), (50, 0), (50, 40), (90, 40))
    assert way(points) == "M0 0L44 0Q50 0 50 6L50 34Q50 40 56 40L90 40"
    assert way(points, joints=((50, 0),)) == "M0 0L50 0L50 34Q50 40 56 40L90 40"


def test_a_shared_segment_of_two_lines_is_drawn_once():
    one, other = ((0, 0), (50, 0), (50, 40), (90, 40)), ((0, 0), (50, 0), (50, 80), (90, 80))
    assert common_length(one, other) == 90 and rest(other, 90) == [(50, 40), (50, 80), (90, 80)]
    assert (
        common_length(one, ((0, 0), (90, 0))) == 50
        and common_length(one, ((0, 0), (50, 0), (50, -40), (90, -40))) == 50
    )
    drawing = draw(nested())
    lines = [line for line in drawing.lines if line.signal == "supervisor/gain.y" and line.subsystem == ""]
    assert len(lines) == 2 and branches(lines)[0] == 0.0 and branches(lines)[1] > 0.0


def test_a_text_that_is_too_long_ends_in_an_ellipsis():
    assert fit("abcdef", 10.0, 1000.0) == "abcdef"
    cut = fit("abcdefghij", 10.0, 40.0)
    assert cut.endswith("…") and text_width(cut, 10.0) <= 40.0
