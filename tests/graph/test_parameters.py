"""Parameters that may change: live ones with their bounds, and those that the command line sets before the compile."""

import math
from pathlib import Path

import pytest

from blocks.actuators import CubeMars
from blocks.controllers import Impedance
from blocks.filters import Butterworth, Notch
from blocks.limiters import Saturation, TorqueLimiter
from blocks.mathematics import Gain
from blocks.sources import Playback
from blocks.windows import MovingRMS
from graph import Block, Diagram, DiagramError, Interval, Live, Param, compile
from tests.graph.complaints import complaint, here, refusal


def test_a_live_parameter_is_narrowed_where_a_proof_rests_on_it():
    with Diagram("d", rate=200) as diagram:
        knee = CubeMars("AK10-9-V2.0", name="knee")
        knee(torque_command=TorqueLimiter(limit=Live(12.0, max=15.0))(knee.torque))
    (proof,) = [proof for proof in compile(diagram).proofs if proof.port == "torque_command"]
    assert diagram["torque_limiter"].limit == 12.0 and diagram["torque_limiter"].live("limit") == (0.0, 15.0, 15.0)
    assert proof.interval == Interval(-15.0, 15.0)


def test_the_proof_uses_the_largest_value_of_a_live_parameter():
    with Diagram("d", rate=200) as diagram:
        knee = CubeMars("AK10-9-V2.0", name="knee")
        knee(torque_command=TorqueLimiter(limit=Live(12.0, max=18.5))(knee.torque))
    assert "can reach [-18.5, 18.5]" in complaint(diagram).message


def test_a_live_parameter_has_a_slew():
    class Assist(Block):
        """A share of a torque."""

        scale = Param(0.5, "1", "share", min=0.0, max=1.0, live=True, slew=0.1)
        offset = Param(0.0, "N·m", "offset", min=-5.0, max=5.0)

    assist = Assist(offset=Live(1.0, max=2.0, slew=3))
    assert assist.live("scale") == (0.0, 1.0, 0.1) and assist.live("offset") == (-5.0, 2.0, 3.0)
    assert Assist(scale=Live(0.5, max=0.75)).live("scale") == (0.0, 0.75, 0.1), (
        "what is left out is the parameter's own"
    )
    assert Assist(scale=Live(0.5, slew=math.inf)).live("scale").slew == math.inf and Assist().live("offset") is None
    for slew in (0.0, -1.0, math.nan):
        with pytest.raises(TypeError, match="slew must be above 0"):
            Param(0.5, min=0.0, max=1.0, live=True, slew=slew)


@pytest.mark.parametrize(
    "value, message",
    [
        (
            Live(12.0, max=15.0, slew=0.0),
            "limit: a live parameter's slew must be above 0, in its unit per second, got 0.0",
        ),
        (
            Live(12.0, max=15.0, slew="1"),
            "limit: a live parameter's slew must be above 0, in its unit per second, got '1'",
        ),
        (Live(12.0), "limit: a live parameter needs both bounds: write Live(value, min=..., max=...)"),
        (Live(12.0, max=math.inf), "limit: live bounds must be finite and in order, got 0 to inf"),
        (Live(12.0, min=15.0, max=13.0), "limit: live bounds must be finite and in order, got 15 to 13"),
        (Live(12.0, min=-1.0, max=15.0), "limit: must be at least 0.0 N·m, got -1.0"),
        (Live(16.0, max=15.0), "limit: must be between its live bounds 0 and 15, got 16.0"),
        (Live(1.0, min=2.0, max=15.0), "limit: must be between its live bounds 2 and 15, got 1.0"),
        (Live(math.nan, max=15.0), "limit: NaN is not allowed"),
        (Live("12", max=15.0), "limit: expected a number, got '12': omit the quotes"),
        (Live(None, max=15.0), "limit: expected a value, got None"),
        (Live(12.0, max="15"), "limit: expected a number, got '15': omit the quotes"),
    ],
)
def test_live_bounds_are_finite_in_order_and_hold_the_value(value, message):
    with Diagram("d", rate=200):
        found = refusal(TorqueLimiter, limit=value)
    assert (found.code, found.message) == ("TW010", message)


@pytest.mark.parametrize(
    "kind, parameters, name",
    [
        (Notch, {"frequency": Live(50.0, min=45.0, max=65.0)}, "frequency"),
        (MovingRMS, {"window": Live(1.0, min=0.5, max=2.0)}, "window"),
        (Butterworth, {"cutoff": Live(10.0, min=5.0, max=20.0)}, "cutoff"),
        (CubeMars, {"model": Live("AK80-9")}, "model"),
        (CubeMars, {"model": "AK80-9", "can_id": Live(1, min=1, max=8)}, "can_id"),
    ],
)
def test_a_parameter_that_is_read_before_the_run_alone_cannot_be_live(kind, parameters, name):
    with Diagram("d", rate=200):
        found = refusal(kind, **parameters)
    assert (found.code, found.path) == ("TW010", kind.__name__) and found.message == (
        f"{name}: cannot be Live: it is read before the run only. Pass a plain value, and change it for the next run "
        "with --set"
    )


@pytest.mark.parametrize(
    "declared",
    [
        lambda: Param(1.0, min=0.0, max=2.0, live=True, fixed=True),
        lambda: Param(1.0, fixed=True, slew=1.0),
        lambda: Param("text", slew=1.0),
        lambda: Param("text", min=0, max=1, live=True),
    ],
)
def test_a_fixed_parameter_is_not_declared_live(declared):
    with pytest.raises(TypeError, match="a fixed parameter cannot be live"):
        declared()


def test_the_command_line_sets_parameters_by_text():
    with Diagram("d", rate=200) as diagram:
        limiter, drive = TorqueLimiter(limit=5.0, name="limiter"), CubeMars("AK80-9", name="drive")
    limiter.set("limit", "7")
    limiter.set("slew", "250 N*m/s")
    drive.set("limit", "peak"), drive.set("can_id", "4"), drive.set("invert", "yes")
    assert (limiter.limit, limiter.slew, drive.can_id, drive.invert) == (7.0, 250.0, 4, True)
    assert drive.command_limits()["torque_command"] == Interval(-18.0, 18.0)  # configured anew
    drive.set("limit", "6.5")
    assert drive.command_limits()["torque_command"] == Interval(-6.5, 6.5)
    assert diagram["limiter"] is limiter


@pytest.mark.parametrize(
    "name, text, message, hint",
    [
        ("limt", "7", "has no parameter 'limt'", "did you mean 'limit'?"),
        ("wavelength", "7", "has no parameter 'wavelength'", "it has limit, slew"),
        ("limit", "seven", "limit: 'seven' is not a number", "largest magnitude of the torque"),
        ("limit", "7 rad", "limit: rad does not convert to N·m", "largest magnitude of the torque"),
        (
            "limit",
            "7 furlongs",
            "limit: 'furlongs' is not a unit; write symbols, as in N·m, rad/s or m/s²; '1' is a number without a unit",
            "largest magnitude of the torque",
        ),
        ("limit", "-7", "limit: must be at least 0.0 N·m, got -7.0", "largest magnitude of the torque"),
        ("limit", "20", "limit: must be between its live bounds 0 and 15, got 20.0", "largest magnitude of the torque"),
    ],
)
def test_a_parameter_that_text_cannot_set_is_reported_with_a_hint(name, text, message, hint):
    limiter = TorqueLimiter(limit=Live(12.0, max=15.0), name="limiter")
    found = refusal(limiter.set, name, text)
    assert (found.code, found.path, found.message, found.hint) == (
        "TW010",
        "limiter",
        message,
        hint,
    ) and limiter.limit == 12.0


def test_python_accepts_quantities_with_their_unit():
    knee = CubeMars("AK80-9", offset="10 deg", range=("-10 deg", 1.9), can_id=1)
    assert knee.offset == math.radians(10.0) and knee.range == (math.radians(-10.0), 1.9)
    assert Impedance(stiffness=Live("0.5 N·m/deg", max="1 N·m/deg")).stiffness == pytest.approx(28.6479, abs=1e-4)


@pytest.mark.parametrize(
    "offset, message",
    [
        ("10 kg", "offset: kg does not convert to rad"),
        ("10 deg/s", "offset: deg/s does not convert to rad"),
        ("ten deg", "offset: expected a number, got 'ten deg'"),
        ("10", "offset: expected a number, got '10'"),
        ("2,5 deg", "offset: '2,5 deg' is not a number: write a decimal point"),
    ],
)
def test_quantity_in_another_unit_is_reported(offset, message):
    with pytest.raises(DiagramError) as error:
        CubeMars("AK80-9", offset=offset, can_id=1)
    assert message in str(error.value)


def test_a_parameter_in_the_unit_of_its_signals_accepts_no_other_unit():
    saturation = Saturation(-1.0, 1.0, name="s")
    found = refusal(saturation.set, "upper", "60 deg")
    assert found.message == (
        "upper: takes a number without a unit, got '60 deg': its unit is that of the signal wired to its block"
    )
    assert saturation.upper == 1.0


def test_a_value_that_a_block_cannot_be_configured_with_is_reported_at_the_blocks_line():
    saturation = Saturation(-1.0, 1.0, name="s")
    at = here(-1)
    found = refusal(saturation.set, "lower", "2")
    assert (found.message, found.where) == ("lower must be at most upper (1), got 2", at)


def test_a_value_invalid_at_the_rate_is_reported_at_compile():
    with Diagram("d", rate=100) as diagram:
        Butterworth(cutoff=10.0, name="f")(1.0)
    diagram["f"].set("cutoff", "60 Hz")
    assert complaint(diagram).message == "a cutoff of 60 Hz requires a rate above 120 Hz, got 100 Hz"


def test_another_rate_applies_at_compile():
    with Diagram("d", rate=100) as diagram:
        Butterworth(cutoff=10.0, name="f")(1.0)
    slow = compile(diagram)
    diagram.rate = 400
    fast = compile(diagram)
    assert (slow.rate, fast.rate) == (100, 400) and diagram["f"].dt == 1 / 400 and (slow.arena != fast.arena).any()


def test_a_block_has_a_repr():
    with Diagram("knee", rate=100) as diagram:
        gain = Gain(2.0, name="g")
    assert (
        repr(gain) == "<Gain g>"
        and repr(gain.y) == "<Signal g.y [any]>"
        and repr(diagram) == "<Diagram knee: 1 block at 100 Hz>"
    )
    assert repr(Gain.inputs["u"]) == "Input('u', 'any')"


def test_a_file_that_does_not_exist_is_reported_at_the_blocks_line():
    with pytest.raises(DiagramError) as caught:
        at = here(1)
        Playback("no_such_file.csv", "knee")
    (found,) = caught.value.diagnostics
    assert (found.code, found.where) == ("TW010", at) and found.message == (
        f"file: there is no no_such_file.csv in {Path(__file__).parent} or in the working folder: copy it there, or "
        "write its absolute path"
    )


def test_an_angle_that_may_be_in_degrees_is_answered_with_its_unit():
    with pytest.raises(ValueError, match=r'must be at most 3\.0 rad, got 45\.0: if it is in degrees, write "45 deg"$'):
        Param(0.0, "rad", max=3.0).check(45)
    with pytest.raises(ValueError, match=r"must be at most 3\.0 rad, got 4\.0$"):
        Param(0.0, "rad", max=3.0).check(4)
