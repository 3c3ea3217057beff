"""The picture of the gait cycle for a paper, in files that `plot` writes: text, size, bands, toe-off and formats."""

import math
import re
from xml.etree import ElementTree

import pytest

import runtime
from runtime.host.errors import OK
from runtime.record.analysis.legs import legs
from runtime.record.analysis.stride_signals import contact_of
from tests.runtime.record.analysis.test_plots import drawn
from tests.runtime.record.recorder.running import CSV, columns, plan, record, row, sink
from tests.soaking import soaked

SIDES = ("left", "right")
SIGNALS = (
    "gait.phase 1",
    "gait.walking 1 bool",
    "foot.contact 1 bool",
    "knee.position rad",
    "knee.velocity rad/s",
    "knee.torque N·m",
)
TOE_OFF = 0.62


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """{name: recording of both legs} whose torque alternates from stride to stride: by nothing, or by a quarter."""
    folder = tmp_path_factory.mktemp("legs")

    def leg(tick, spread):
        stride, within = divmod(tick, 200)
        turn = 2.0 * math.pi * within / 200
        torque = (4.0 + spread * (-1) ** stride) * math.cos(turn)
        return within / 200, 1, within < 200 * TOE_OFF, math.sin(turn), math.cos(turn), torque

    for name, spread in (("same_2026-11-27_10-00-00", 0.0), ("wide_2026-11-27_11-00-00", 1.0)):
        rows = [row(tick, *leg(tick, spread), *leg(tick + 100, spread)) for tick in range(1600)]
        signals = columns(*(f"{side}/{text}" for side in SIDES for text in SIGNALS))
        record(plan(folder, sink(CSV, "csv", signals), stem=name), rows)
    return {path.stem[:4]: path for path in folder.glob("*.mcap")}


def millimetres(path):
    """Width and height of an SVG."""
    root = ElementTree.parse(path).getroot()
    return [float(root.get(name).removesuffix("pt")) / 72.0 * 25.4 for name in ("width", "height")]


@pytest.mark.parametrize(
    ("options", "width"),
    soaked([((), 85.0), (("--width", "85mm"), 85.0), (("--width", "12 cm"), 120.0), (("--width", "3.5in"), 88.9)], [3]),
)
def test_a_picture_has_the_width_of_a_column_and_the_names_of_the_field(command_line, recorded, options, width):
    assert command_line("plot", recorded["wide"], "--strides", *options, "-o", "a.svg") == (OK, "a.svg\n", "")
    assert millimetres("a.svg")[0] == pytest.approx(width, abs=0.1) and 70 < millimetres("a.svg")[1] < 170
    texts = drawn("a.svg")
    numbers = {text for text in texts if re.fullmatch(r"−?[\d.]+", text)}
    assert texts - numbers == {
        *("knee angle (°)", "knee torque (N·m)", "knee power (W)", "gait cycle (%)"),
        *("left, N = 6 strides", "right, N = 7 strides", "± 1 SD", "toe-off"),
    }
    sizes = {float(size) for size in re.findall(r"font: (?:\w+ )?([\d.]+)px", open("a.svg").read())}
    assert sizes <= {7.0, 8.0}  # points
    colours = re.findall(r"stroke: (#0072b2|#d55e00)(; stroke-width: 1.2)?", open("a.svg").read())
    assert {colour for colour, _ in colours} == {"#0072b2", "#d55e00"}


@pytest.mark.soak
def test_a_band_that_the_line_hides_is_neither_drawn_nor_in_the_legend(command_line, recorded):
    for name, shown in (("same", False), ("wide", True)):
        assert command_line("plot", recorded[name], "--strides", "-o", f"{name}.svg")[0] == OK
        assert ("± 1 SD" in drawn(f"{name}.svg")) is shown
        assert ("FillBetweenPolyCollection" in open(f"{name}.svg").read()) is shown


def test_toe_off_is_the_end_of_ground_contact(recorded):
    for leg in legs(runtime.load(recorded["wide"])):
        assert leg["toe_off"] == pytest.approx(TOE_OFF, abs=0.006)
        assert leg["signals"]["contact"] == f"{leg['title']}/foot.contact"


def test_toe_off_comes_from_no_other_leg_and_no_heel():
    assert contact_of(["left/a.contact", "right/a.contact", "left/x.load"], "left/knee.position") == "left/a.contact"
    assert contact_of(["left/heel_events.contact", "right/a.contact"], "left/knee.position") is None
    assert contact_of(["left/a.contact", "left/b.contact"], "left/knee.position") is None


@pytest.mark.soak
def test_conditions_are_named_by_labels_or_by_files_without_their_times(command_line, recorded):
    words = ["plot", recorded["same"], recorded["wide"], "--strides", "-o", "a.svg"]
    assert command_line(*words)[0] == OK
    assert {"same, N = 6 (left), 7 (right) strides", "left", "right", "toe-off"} <= drawn("a.svg")
    assert command_line(*words, "--label", "before", "--label", "with the exoskeleton")[0] == OK
    assert {"before, N = 6 (left), 7 (right) strides", "with th…, N = 6 (left), 7 (right) strides"} & drawn("a.svg")
    assert command_line.refused(*words, "--label", "x") == "1 labels for 2 conditions: pass a label for each, or none"


@pytest.mark.soak
def test_a_pdf_contains_its_text_as_text(command_line, recorded):
    assert command_line("plot", recorded["wide"], "--strides", "-o", "a.pdf")[0] == OK
    data = open("a.pdf", "rb").read()
    assert data.startswith(b"%PDF") and b"/CIDFontType2" in data and b"/Type3" not in data  # TrueType, no outlines
    assert b"CreationDate" not in data


def test_a_wrong_width_is_refused(command_line, recorded):
    for text in ("85", "9mm", "3 feet"):
        assert command_line.refused("plot", recorded["same"], "--strides", "--width", text) == (
            f"--width {text}: expected 40mm to 500mm, as in 85mm, 8.5cm or 3.35in"
        )
    assert command_line.refused("plot", recorded["same"], "--width", "85mm") == "--width needs --strides"
