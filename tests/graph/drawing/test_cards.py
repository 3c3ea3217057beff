"""What blocks say of themselves comes from their declarations, and from the compiler."""

import math

import pytest

from blocks.actuators import CubeMars
from blocks.controllers import GaitPhase, Impedance
from blocks.limiters import Saturation, TorqueLimiter
from blocks.mathematics import Sum
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Block, Device, Diagram, Input, Interval, Live, Output, Param
from graph.drawing import draw
from graph.drawing.cards import bounds_text, class_card, documentation, family, interval_text, quantity, summary
from tests.graph.drawing.diagrams import leg


class Undocumented(Block):
    y = Output("1")

    def step(self):
        return 0.0


def test_the_summary_is_the_first_sentence():
    class Two(Block):
        """Holds e.g. 1.5 s
        of it. And more.   (Somebody 1999)

            an = "example"
        """

    assert summary(Two) == "Holds e.g. 1.5 s of it."
    assert documentation(Two) == ("Holds e.g. 1.5 s of it. And more. (Somebody 1999)", '    an = "example"')
    assert summary(Undocumented) == "" and documentation(Undocumented) == ()


@pytest.mark.parametrize(
    "kind, name",
    [
        (CubeMars, "actuator"),
        (CsvRecorder, "sink"),
        (TorqueLimiter, "limiter"),
        (Impedance, "controller"),
        (Sine, "source"),
        (Sum, "other"),
        (type("Imu", (Device,), {}), "sensor"),
    ],
)
def test_the_family_of_a_block_follows_from_its_class_and_module(kind, name):
    assert family(kind) == name


@pytest.mark.parametrize(
    "param, words",
    [
        (Param(1.0, min=0.0, max=2.5), "0 to 2.5"),
        (Param(1.0, above=0.0), "above 0"),
        (Param(1.0, min=0.0, below=1.5), "at least 0 and below 1.5"),
        (Param("a", choices=("a", "b")), "one of a, b"),
        (Param(",", choices=(",", "\t")), "one of ',', '\\t'"),
        (Param("", choices=("", "a")), "one of '', a"),
        (Param("a, b", choices=("a, b", "b, a")), "one of 'a, b', 'b, a'"),
        (Param(2.5, choices=(2.5, 100.0)), "one of 2.5, 100"),
        (Param(False, min=0, max=1, live=True), ""),
        (Param(0, min=0, max=9007199254740992), "0 to 9007199254740992"),
        (Param(1.0), ""),
    ],
)
def test_bounds_are_formatted(param, words):
    assert bounds_text(param) == words


@pytest.mark.parametrize(
    "value, unit, words",
    [
        (12.0, "N·m", "12 N·m"),
        (0.5, "1", "0.5"),
        (math.inf, "N·m/s", "inf N·m/s"),
        (True, "1", "true"),
        ((), "1", "()"),
        ({}, "1", "{}"),
        (None, "s", "none"),
        ("rated", "1", "rated"),
        ("\t", "1", "\\t"),
        ("", "1", "none"),
        ((1, 2), "1", "1, 2"),
        ({"u": "1"}, "1", "u"),
        (tuple((i / 7, i) for i in range(8)), "1", "8 entries"),
        ((tuple(i / 7 for i in range(8)),), "1", "1 entry"),
    ],
)
def test_values_are_formatted(value, unit, words):
    assert quantity(value, unit) == words


@pytest.mark.parametrize(
    "interval, words",
    [
        (Interval(-12.0, 12.0), "-12 to 12 N·m"),
        (Interval(0.0), "at least 0 N·m"),
        (Interval(high=3.0), "at most 3 N·m"),
        (Interval.point(2.0), "2 N·m"),
        (Interval(), ""),
        (None, ""),
    ],
)
def test_intervals_are_formatted(interval, words):
    assert interval_text(interval, "N·m") == words


def test_a_class_shows_the_ports_that_its_parameters_make_by_an_example():
    card = class_card(Sum)
    assert [port["name"] for port in card["inputs"]] == ["u1", "u2"] and card["made"]
    assert [port["name"] for port in class_card(GaitPhase)["inputs"]] == ["angle", "velocity"] and not class_card(
        GaitPhase
    )["made"]


def test_a_class_without_an_example_shows_its_declarations():
    assert [port["name"] for port in class_card(TorqueLimiter)["inputs"]] == ["torque"]
    assert class_card(TorqueLimiter)["parameters"][0]["default"] == "required"


def test_the_card_of_a_block_shows_wires_values_proof_and_line():
    cards = draw(leg()).cards
    limiter, knee = cards["left/torque_limiter"], cards["left/knee"]
    assert limiter["inputs"][0]["source"] == "left/impedance.torque"
    assert (
        limiter["outputs"][0]["targets"] == ["left/knee.torque_command"]
        and limiter["outputs"][0]["range"] == "-12 to 12 N·m"
    )
    assert {p["name"]: (p["value"], p["own"]) for p in limiter["parameters"]} == {
        "limit": ("12 N·m", True),
        "slew": ("200 N·m/s", True),
    }
    assert limiter["bounds"] == ["left/knee.torque_command"] and limiter["made"].partition(":")[0].endswith(
        "diagrams.py"
    )
    assert knee["proofs"][0] == "torque_command: -12 to 12 N·m, inside -18 to 18 N·m; bounded by left/torque_limiter"
    assert knee["proofs"][1].startswith("constant: position_command 0 rad, ")
    assert knee["runs"] == "native, on a bus" and cards["csv_recorder"]["runs"] == "in the recorder process"


def test_a_file_is_shown_without_its_folder(tmp_path):
    class Played(Block):
        """Play a file."""

        file = Param("", "1", "path of the file", file=True)

    with Diagram("d", rate=100) as diagram:
        (tmp_path / "walk.csv").touch()
        Played(str(tmp_path / "walk.csv"), name="played")
    (parameter,) = draw(diagram).cards["played"]["parameters"]
    assert parameter["value"] == "walk.csv"


def test_units_and_shapes_follow_from_connections():
    with Diagram("d", rate=100) as diagram:
        Saturation(-1.0, 1.0)(Impedance()(position=0.0, velocity=0.0))
    card = draw(diagram).cards["saturation"]
    assert card["inputs"][0]["unit"] == card["outputs"][0]["unit"] == "N·m"


def test_a_live_parameter_shows_its_narrowed_bounds():
    with Diagram("d", rate=100) as diagram:
        TorqueLimiter(limit=Live(3.0, max=5.0))(1.0)
    limit = draw(diagram).cards["torque_limiter"]["parameters"][0]
    assert limit["live"] and limit["bounds"] == "0 to 5"


def test_a_python_block_is_distinguished_from_a_native_one():
    with Diagram("d", rate=100) as diagram:
        Undocumented()
        Sine()
    cards = draw(diagram).cards
    assert cards["undocumented"]["runs"] == "Python" and cards["sine"]["runs"] == "native"


def test_inputs_show_their_constant_or_their_default():
    class Two(Block):
        """Two inputs."""

        a = Input("rad", "first", default=0.5)
        b = Input("rad", "second")
        y = Output("rad")

        def step(self, a, b):
            return a + b

    with Diagram("d", rate=100) as diagram:
        Two()(b=2.0)
    a, b = draw(diagram).cards["two"]["inputs"]
    assert a["default"] == "0.5 rad" and "constant" not in a and b["constant"] == "2 rad"


def test_the_card_of_an_actuator_that_closes_its_own_law_states_the_assumption_of_its_limit():
    with Diagram("leg", rate=200) as diagram:
        CubeMars("AK80-9", name="knee", max_acceleration=300.0)(stiffness_command=5.0)
    assert draw(diagram).cards["knee"]["proofs"][-1] == "torque, not proved: while |α| <= 300 rad/s²"
