"""The range proof: what may reach an actuator is known before anything moves."""

import math
import re

import pytest

from blocks.actuators import CubeMars
from blocks.controllers import Impedance
from blocks.discrete import UnitDelay
from blocks.limiters import Saturation, SlewRate, TorqueLimiter
from blocks.linear import TransferFunction
from blocks.mathematics import Gain, Product, Sum
from blocks.sources import Constant
from cext.kernels import mathematics as kernels
from graph import Block, Diagram, Input, Interval, Output, Param, compile
from tests.graph.complaints import complaint, complaints, here

RATED = 18.0  # N·m, AK10-9 V2.0


def drive(**parameters):
    return CubeMars("AK10-9-V2.0", name="knee", **parameters)


def proof(diagram, port="torque_command"):
    (found,) = [p for p in compile(diagram).proofs if p.port == port]
    return found


def test_a_limiter_at_the_end_proves_the_command():
    with Diagram("d", rate=200) as diagram:
        knee = drive()
        knee(torque_command=TorqueLimiter(limit=12.0)(Impedance()(knee.position, knee.velocity)))
    found = proof(diagram)
    assert found.holds and found.interval == Interval(-12.0, 12.0) and found.limit == Interval(-RATED, RATED)
    assert (found.path, found.unit, found.bounded_by) == ("knee", "N·m", "torque_limiter")


def test_a_limiter_exactly_at_the_rating_passes_and_just_beyond_it_fails():
    def with_limit(limit):
        with Diagram("d", rate=200) as diagram:
            knee = drive()
            knee(torque_command=TorqueLimiter(limit=limit)(knee.torque))
        return diagram

    assert proof(with_limit(RATED)).holds
    assert complaint(with_limit(math.nextafter(RATED, math.inf))).code == "TW007"


@pytest.mark.hazard("H1a")
def test_a_gain_behind_the_limiter_fails():
    with Diagram("d", rate=200) as diagram:
        knee = drive()
        signal = Gain(2.0)(TorqueLimiter(limit=12.0)(knee.torque))
        knee(torque_command=signal)
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.path, found.port, found.where) == ("TW007", "knee", "torque_command", at)
    assert found.message == (
        "gain.y can reach [-24, 24] N·m, and the limit is [-18, 18] N·m "
        "(rated torque and encoded ranges of AK10-9-V2.0)"
    )
    assert found.hint == "put a limiter last, as in knee(torque_command=TorqueLimiter(limit=18)(...))"


def test_a_gain_below_one_after_the_limiter_passes():
    with Diagram("d", rate=200) as diagram:
        knee = drive()
        knee(torque_command=Gain(-0.5)(TorqueLimiter(limit=30.0)(knee.torque)))
    assert proof(diagram).holds


def test_a_sum_of_two_limited_signals_beyond_the_rating_fails():
    def with_limits(first, second):
        with Diagram("d", rate=200) as diagram:
            knee = drive()
            knee(
                torque_command=Sum("+-")(
                    TorqueLimiter(limit=first)(knee.torque), TorqueLimiter(limit=second)(knee.torque)
                )
            )
        return diagram

    assert complaint(with_limits(12.0, 12.0)).code == "TW007"
    assert proof(with_limits(8.0, 8.0)).holds


def test_an_impedance_alone_fails_because_a_live_stiffness_may_become_its_maximum():
    with Diagram("d", rate=200) as diagram:
        knee = drive()
        knee(torque_command=Impedance(stiffness=0.001, damping=0.0)(knee.position, knee.velocity))
    found = complaint(diagram)
    # 150 · 12.5 + 10 · 50
    assert found.code == "TW007" and "impedance.torque can reach [-2375, 2375] N·m" in found.message


@pytest.mark.hazard("H1g")
def test_the_proof_uses_the_whole_range_of_a_live_parameter():
    class LiveGain(Gain):
        """A gain that may be turned while running."""

        gain = Param(1.0, "any", min=-1.0, max=2.0, live=True)

    def with_limit(limit):
        with Diagram("d", rate=200) as diagram:
            knee = drive()
            knee(torque_command=LiveGain(0.5)(TorqueLimiter(limit=limit)(knee.torque)))
        return diagram

    assert "can reach [-24, 24]" in complaint(with_limit(12.0)).message
    assert proof(with_limit(8.5)).holds


@pytest.mark.parametrize("constant", [math.nan, math.inf, -math.inf, 18.1, -18.1, 1e308])
def test_an_invalid_constant_torque_fails(constant):
    with Diagram("d", rate=200) as diagram:
        knee = drive()
        knee(torque_command=constant)
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.path, found.port, found.where) == ("TW007", "knee", "torque_command", at)


def test_a_constant_command_inside_the_limit_passes():
    with Diagram("d", rate=200) as diagram:
        drive()(torque_command=-18.0)
    assert proof(diagram).bounded_by == "a constant"


@pytest.mark.parametrize(
    "port, just_too_much",
    [
        ("position_command", 12.51),
        ("velocity_command", -50.1),
        ("stiffness_command", 500.1),
        ("stiffness_command", -0.1),
        ("damping_command", 5.1),
        ("damping_command", -0.1),
    ],
)
def test_every_command_has_a_limit(port, just_too_much):
    with Diagram("d", rate=200) as diagram:
        drive()(**{port: just_too_much})
    found = complaint(diagram)
    assert (found.code, found.port) == ("TW007", port) and re.match(
        "command a value from|.* did you mean deg", found.hint
    )


def test_an_unbounded_command_is_reported_as_unbounded():
    with Diagram("d", rate=200) as diagram:
        knee = drive()
        knee(torque_command=TransferFunction((1.0,), (1.0, -1.0))(TorqueLimiter(limit=5.0)(knee.torque)))
    assert complaint(diagram).message.startswith("transfer_function.y is unbounded, and the limit is [-18, 18] N·m")


def test_infinities_wired_as_numbers_do_not_stop_the_proof():
    with Diagram("d", rate=200) as diagram:
        knee = drive()
        knee(torque_command=Sum("+-")(Product()(math.inf, 0.0), Sum("+-")(math.inf, math.inf)))
    assert complaint(diagram).code == "TW007"


def test_the_range_of_a_saturation_outside_its_input_is_its_limit():
    with Diagram("d", rate=200) as diagram:
        knee = drive()
        knee(torque_command=Saturation(20.0, 30.0)(Saturation(5.0, 6.0)(knee.torque)))
    assert "can reach [20, 20]" in complaint(diagram).message


def test_a_delay_in_a_loop_has_the_bounds_of_its_input():
    with Diagram("d", rate=200) as diagram:
        knee, delay = drive(), UnitDelay(name="delay")
        delay(TorqueLimiter(limit=6.0)(Sum("++")(delay.y, knee.torque)))
        knee(torque_command=Sum("++")(delay.y, delay.y))
    found = proof(diagram)
    assert found.holds and found.interval.high == pytest.approx(12.0)


def test_the_range_of_a_delay_includes_its_initial_value():
    with Diagram("d", rate=200) as diagram:
        knee = drive()
        knee(torque_command=UnitDelay(initial=40.0)(TorqueLimiter(limit=6.0)(knee.torque)))
    assert "can reach [-6, 40]" in complaint(diagram).message


def test_an_accumulating_loop_is_never_bounded():
    with Diagram("d", rate=200) as diagram:
        knee, delay = drive(), UnitDelay()
        total = Sum("++")(delay.y, TorqueLimiter(limit=0.001)(knee.torque))
        delay(total)
        knee(torque_command=total)
    assert complaint(diagram).code == "TW007"


def test_the_range_of_a_slew_rate_contains_its_input_and_zero():
    with Diagram("d", rate=200) as diagram:
        knee = drive()
        knee(torque_command=SlewRate(5.0)(Saturation(3.0, 6.0)(knee.torque)))
    assert proof(diagram).interval == Interval(0.0, 6.0)


def test_a_python_block_has_the_declared_range_of_its_output():
    class Feedforward(Block):
        """Promises a range."""

        position = Input("rad")
        torque = Output("N·m", range=(-4.0, 4.0))

        def step(self, position):
            return 4.0 * math.sin(position)

    class Unbounded(Feedforward):
        """Promises nothing."""

        torque = Output("N·m")

    def with_block(block):
        with Diagram("d", rate=200) as diagram:
            knee = drive()
            knee(torque_command=block()(knee.position))
        return diagram

    assert proof(with_block(Feedforward)).interval == Interval(-4.0, 4.0)
    assert complaint(with_block(Unbounded)).message.startswith("unbounded.torque is unbounded")


def test_a_computed_range_narrows_the_declared_one():
    class Narrow(Block):
        """A native block with a promise of both kinds."""

        gain = Param(1.0, "any")
        u = Input("any")
        y = Output("any", range=(-10.0, 3.0))
        kernel = kernels.gain

        def output_range(self, u):
            return self.span("gain") * u

    with Diagram("d", rate=200) as diagram:
        knee = drive()
        knee(torque_command=Narrow()(TorqueLimiter(limit=7.0)(knee.torque)))
    assert proof(diagram).interval == Interval(-7.0, 3.0)


def test_output_range_is_called_with_width_and_sampling_period_set():
    class Total(Block):
        """The sum of a vector, once a second."""

        u = Input("any", shape=...)
        y = Output("any")

        def prepare(self, dt):
            self.share = dt

        def output_range(self, u):
            return Interval(self.width * self.share * u.low, self.width * self.share * u.high)

        def step(self, u):
            return self.share * float(sum(u))

    with Diagram("d", rate=2) as diagram:
        knee = drive(timeout=10.0)
        knee(torque_command=Total()([3.0, 4.0, 5.0]))
    assert proof(diagram).interval == Interval(4.5, 7.5)


def test_peak_torque_is_the_limit_on_request():
    with Diagram("d", rate=200) as diagram:
        knee = drive(limit="peak")
        knee(torque_command=TorqueLimiter(limit=48.0)(knee.torque))
    assert proof(diagram).limit == Interval(-48.0, 48.0)


def test_a_limit_that_is_assigned_to_an_actuator_counts():
    with Diagram("robot", rate=200) as diagram:
        knee = CubeMars("AK80-9")
        knee(torque_command=TorqueLimiter(limit=9.0)(Constant(5.0)()))
    knee.limit, knee.safe_stop = 3.0, "damp"
    assert "can reach [-9, 9] N·m, and the limit is [-3, 3] N·m" in complaint(diagram).message
    knee.limit = "peak"
    [device] = compile(diagram).devices
    assert device.watch.watch.limit == 18.0 and device.damp is not None


@pytest.mark.parametrize(("name", "value"), [("torque_limit", 300.0), ("limits", (12.5,) * 7)])
def test_a_limit_that_the_parameters_determine_cannot_be_assigned(name, value):
    with Diagram("robot", rate=200) as diagram:
        knee = CubeMars("AK80-9")
        knee(torque_command=TorqueLimiter(limit=9.0)(Constant(5.0)()))
    for _ in range(2):
        assert proof(diagram).limit == Interval(-9.0, 9.0)
    setattr(knee, name, value)
    assert f"{name} = {value} was assigned, but the parameters determine it" in complaint(diagram).message


@pytest.mark.parametrize(
    ("parameter", "value", "message"),
    [
        ("safe_stop", "brake", "safe_stop: must be one of disable, damp, got 'brake'"),
        ("limit", 100.0, "limit must be above 0 and at most the peak torque of AK80-9, 18 N·m, got 100 N·m"),
        ("range", (0.0, 90.0), "if these are degrees, write [0, 1.571]"),
    ],
)
def test_an_assigned_parameter_is_checked_like_a_passed_one(parameter, value, message):
    with Diagram("robot", rate=200) as diagram:
        knee = CubeMars("AK80-9")
        knee(torque_command=0.0)
    setattr(knee, parameter, value)
    assert message in complaint(diagram).message


def test_every_command_of_every_actuator_is_reported():
    with Diagram("d", rate=200) as diagram:
        for can_id in (1, 2, 3):
            knee = CubeMars("AK10-9-V2.0", can_id=can_id, name=f"joint{can_id}")
            knee(torque_command=knee.torque, damping_command=9.0)
    assert [(d.code, d.path, d.port) for d in complaints(diagram)] == [
        ("TW007", f"joint{n}", port) for n in (1, 2, 3) for port in ("torque_command", "damping_command")
    ]


def test_inputs_of_a_block_may_have_any_name():
    class Names(Block):
        hook = Input("m")
        block = Input("m")
        y = Output("m")

        def output_range(self, hook, block):
            return Interval(hook.low + block.low, hook.high + block.high)

        def step(self, hook, block):
            return hook + block

    with Diagram("names", rate=200) as diagram:
        Names()(hook=1.0, block=2.0)
    compile(diagram)
