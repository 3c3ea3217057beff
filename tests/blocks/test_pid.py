"""P, PI, PD and PID: against SciPy and plain Python, at their limits, by hand and back."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from blocks.controllers import PD, PI, PID, P
from blocks.linear import TransferFunction
from blocks.mathematics import Min
from blocks.sources import Sine
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Diagram, DiagramError, Interval, Live, compile
from tests.blocks.playing import made, play, source, taker

RATE = 200.0
DT = 1.0 / RATE
RANDOM = np.random.default_rng(17)
REFERENCE, MEASUREMENT = (np.r_[0.0, RANDOM.normal(0.0, 1.0, 400)] for _ in range(2))


def law(r, y, kp=0.0, ki=0.0, kd=0.0, tf=0.0, b=1.0, c=0.0):
    """The three parts by SciPy's lfilter: gain, integral and filtered derivative, by backward differences."""
    slope = signal.lfilter([1.0, -1.0], [tf + DT, -tf], c * r - y)
    return kp * (b * r - y) + signal.lfilter([ki * DT], [1.0, -1.0], r - y) + kd * slope


@pytest.mark.parametrize(
    "make, gains",
    [
        (lambda: P(3.0), {"kp": 3.0}),
        (lambda: PD(3.0, 0.2), {"kp": 3.0, "kd": 0.2}),
        (lambda: PD(3.0, 0.2, 0.02, b=0.5, c=1.0), {"kp": 3.0, "kd": 0.2, "tf": 0.02, "b": 0.5, "c": 1.0}),
        (lambda: PI(3.0, 8.0), {"kp": 3.0, "ki": 8.0}),
        (lambda: PI(3.0, 8.0, b=0.0), {"kp": 3.0, "ki": 8.0, "b": 0.0}),
        (lambda: PID(3.0, 8.0, 0.2), {"kp": 3.0, "ki": 8.0, "kd": 0.2}),
        (
            lambda: PID(-3.0, -8.0, -0.2, 0.03, b=0.7, c=0.3),
            {"kp": -3.0, "ki": -8.0, "kd": -0.2, "tf": 0.03, "b": 0.7, "c": 0.3},
        ),
    ],
)
def test_between_its_limits_each_controller_is_a_sum_of_filters(make, gains):
    """Within 1e-11 of the largest command."""
    u = play(make, RATE, reference=REFERENCE, measurement=MEASUREMENT)["command"]
    wanted = law(REFERENCE, MEASUREMENT, **gains)
    assert np.abs(u - wanted).max() < 1e-11 * np.abs(wanted).max()


def oracle(r, y, manual, by_hand, kp, ki, kd, tf, b, c, lower, upper, tracking):
    """PID in plain Python; tracking: None clamps, else the time constant of the back-calculation."""
    integral, follower, out = 0.0, None, []
    for k in range(len(r)):
        w = c * r[k] - y[k]
        follower = w if follower is None else follower
        slope = (w - follower) / (tf + DT)
        follower += DT * slope
        others = kp * (b * r[k] - y[k]) + kd * slope
        if manual[k]:
            u = min(max(by_hand[k], lower), upper)
            integral = u - others
        else:
            step = DT * ki * (r[k] - y[k])
            raw = others + (integral + step)
            u = min(max(raw, lower), upper)
            if u == raw:
                integral += step
            elif tracking is not None:
                integral = integral + step + min(DT / tracking, 1.0) * (u - raw)
            elif (raw > u) == (integral + step > integral):
                u = min(max(others + integral, lower), upper)
            else:
                integral += step
        out.append(u)
    return np.array(out)


@pytest.mark.parametrize(
    "anti_windup, tracking_time, tracking",
    [
        ("clamping", None, None),
        ("back-calculation", 0.3, 0.3),
        ("back-calculation", None, math.sqrt(0.1 / 20.0)),
        ("back-calculation", 1e-4, 1e-4),
    ],
)
def test_at_its_limits_and_in_manual_mode_pid_equals_the_oracle_bit_for_bit(anti_windup, tracking_time, tracking):
    manual = np.arange(401) % 90 > 70
    by_hand = 3.0 * np.sin(0.1 * np.arange(401))
    u = play(
        lambda: PID(3.0, 20.0, 0.1, 0.02, 0.8, 0.2, -2.0, 2.5, anti_windup, tracking_time),
        RATE,
        reference=REFERENCE,
        measurement=MEASUREMENT,
        manual=manual,
        manual_command=by_hand,
    )["command"]
    assert np.array_equal(
        u, oracle(REFERENCE, MEASUREMENT, manual, by_hand, 3.0, 20.0, 0.1, 0.02, 0.8, 0.2, -2.0, 2.5, tracking)
    )
    assert u.min() == -2.0 and u.max() == 2.5 and len(np.unique(u)) > 50


def step_response(controller, ticks=2000):
    """A first-order plant, 1 / (0.5 s + 1), asked to go from 0 to 1 by a controller that can give 1.2 at most."""
    with Diagram("loop", rate=RATE) as diagram:
        control = controller()
        plant = TransferFunction((1.0 - math.exp(-2.0 * DT),), (1.0, -math.exp(-2.0 * DT)))
        control(reference=1.0, measurement=plant(control.command))
        y = taker(plant.y, (), ticks)
    Executor(Program(compile(diagram)), RATE).spin(ticks)
    return y


def test_without_limits_a_loop_reaches_its_set_point_and_with_anti_windup_it_barely_overshoots():
    for anti_windup in ("clamping", "back-calculation"):
        y = step_response(
            lambda: PI(kp=2.0, ki=30.0, lower=-1.2, upper=1.2, anti_windup=anti_windup, tracking_time=0.05)
        )
        assert abs(y[-1] - 1.0) < 1e-6 and y.max() < 1.1
    wound_up = step_response(
        lambda: PI(kp=2.0, ki=30.0, lower=-1.2, upper=1.2, anti_windup="back-calculation", tracking_time=1e9)
    )
    assert wound_up.max() > 1.15


def test_with_the_limited_command_a_loop_does_not_wind_up_at_a_limit_that_changes():
    """The limit behind the controller falls from 3 to 1.2: without `applied` the loop overshoots by more than 15 %."""

    def response(kind, tracks):
        with Diagram("loop", rate=RATE) as diagram:
            control = kind(kp=2.0, ki=30.0, tracking_time=0.05)
            limiter, limit = Min(), source([3.0] * 20 + [1.2] * 1980)
            plant = TransferFunction((1.0 - math.exp(-2.0 * DT),), (1.0, -math.exp(-2.0 * DT)))
            applied = {"applied": limiter.y} if tracks else {}
            limiter(control(reference=1.0, measurement=plant(limiter.y), **applied), limit)
            y = taker(plant.y, (), 2000)
        Executor(Program(compile(diagram)), RATE).spin(2000)
        return y

    for kind in (PI, PID):
        tracked = response(kind, True)
        assert abs(tracked[-1] - 1.0) < 1e-6 and tracked.max() < 1.1 and response(kind, False).max() > 1.15


def test_the_integral_follows_the_applied_command_where_it_is_known():
    applied = np.where(np.arange(401) % 7 == 3, math.nan, 0.5 * REFERENCE)
    u = play(
        lambda: PI(3.0, 8.0, tracking_time=0.2), RATE, reference=REFERENCE, measurement=MEASUREMENT, applied=applied
    )["command"]
    integral = 0.0
    for k, command in enumerate(u):
        integral += DT * 8.0 * (REFERENCE[k] - MEASUREMENT[k])
        assert command == pytest.approx(3.0 * (REFERENCE[k] - MEASUREMENT[k]) + integral, rel=1e-12)
        integral += DT / 0.2 * (applied[k] - command) if applied[k] == applied[k] else 0.0


def test_an_infinite_applied_command_is_one_command_of_nan():
    applied = np.full(20, math.nan)
    applied[[5, 9]] = math.inf, -math.inf
    u = play(lambda: PID(3.0, 8.0), RATE, reference=np.ones(20), measurement=np.zeros(20), applied=applied)["command"]
    assert np.flatnonzero(np.isnan(u)).tolist() == [6, 10] and u[-1] == pytest.approx(3.0 + 18 * DT * 8.0)


def test_the_transfer_from_manual_mode_is_bumpless():
    """The first command of the controller differs from the last by hand by one step of the integral, and no more."""
    ticks = 100
    manual = np.arange(ticks) < 60
    u = play(
        lambda: PID(5.0, 10.0, 0.3, 0.05, lower=-10.0, upper=10.0),
        RATE,
        reference=np.full(ticks, 1.0),
        measurement=np.full(ticks, 0.4),
        manual=manual,
        manual_command=np.full(ticks, 4.25),
    )["command"]
    assert np.all(u[:60] == 4.25) and abs(u[60] - 4.25 - 10.0 * DT * 0.6) < 1e-12


def test_a_manual_command_is_clipped_without_integral_windup():
    u = play(
        lambda: PI(0.0, 10.0, lower=-1.0, upper=1.0),
        RATE,
        reference=np.full(50, 1.0),
        measurement=np.zeros(50),
        manual=np.arange(50) < 40,
        manual_command=np.full(50, -9.0),
    )["command"]
    assert np.all(u[:40] == -1.0) and np.abs(u[40:] - (-1.0 + 10.0 * DT * np.arange(1, 11))).max() < 1e-12


def test_a_step_of_the_reference_does_not_kick_the_derivative_but_one_of_the_measurement_does():
    r = np.r_[np.zeros(5), np.ones(5)]
    steady = play(lambda: PD(0.0, 1.0), RATE, reference=r, measurement=np.zeros(10))["command"]
    kicked = play(lambda: PD(0.0, 1.0), RATE, reference=np.zeros(10), measurement=r)["command"]
    assert np.all(steady == 0.0) and kicked[5] == -RATE and kicked[0] == 0.0
    assert (
        play(lambda: PD(0.0, 1.0), RATE, reference=np.full(4, 3.0), measurement=np.full(4, -2.0))["command"].tolist()
        == [0.0] * 4
    )


@pytest.mark.parametrize("kind", [P, PI, PD, PID])
def test_nan_passes_and_is_not_held(kind):
    """The reference and the measurement of a tick with a NaN count for nothing."""
    gains = (
        {"kp": 2.0}
        | ({"ki": 5.0} if "ki" in kind.parameters else {})
        | ({"kd": 0.1} if "kd" in kind.parameters else {})
    )
    clean, dirty = made(kind, **gains), made(kind, **gains)
    for k in range(20):
        r, y = math.sin(k), math.cos(k)
        assert clean.step(r, y) == dirty.step(r, y)
        assert math.isnan(dirty.step(math.nan, y)) and math.isnan(dirty.step(r, math.nan))
    if kind in (PI, PID):
        assert math.isnan(dirty.step(1.0, 1.0, math.nan)) and clean.step(1.0, 1.0) == dirty.step(1.0, 1.0)
        assert math.isnan(dirty.step(1.0, 1.0, True, math.nan)) and not math.isnan(dirty.step(1.0, 1.0))


@given(data=st.data(), anti_windup=st.sampled_from(["clamping", "back-calculation"]))
def test_no_input_drives_a_command_beyond_its_limits_or_stores_nan(data, anti_windup):
    wild = st.one_of(st.floats(-1e308, 1e308), st.sampled_from([math.inf, -math.inf, math.nan, 0.0, 1e-308]))
    lower, upper = sorted(data.draw(st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))))
    block = made(PID, 2.0, 3.0, 0.1, 0.01, lower=lower, upper=upper, anti_windup=anti_windup)
    assert block.output_range(**{name: Interval() for name in block.inputs}) == Interval(lower, upper)
    for _ in range(20):
        u = block.step(data.draw(wild), data.draw(wild), data.draw(st.booleans()), data.draw(wild))
        assert math.isnan(u) or lower <= u <= upper
    block.step(0.0, 0.0)
    assert not math.isnan(block.step(0.0, 0.0)), "the slope after an infinite input is not known for one tick"


@given(
    data=st.data(), tf=st.sampled_from([0.0, 0.003, 0.4]), weights=st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 2.0))
)
def test_pd_and_p_stay_inside_their_ranges(data, tf, weights):
    spans = [sorted(data.draw(st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)))) for _ in range(2)]
    blocks = [made(PD, -4.0, 0.7, tf, *weights), made(P, 7.3)]
    ranges = [block.output_range(reference=Interval(*spans[0]), measurement=Interval(*spans[1])) for block in blocks]
    for _ in range(20):
        r, y = (data.draw(st.sampled_from(span)) for span in spans)
        for block, found in zip(blocks, ranges):
            assert block.step(r, y) in found


def test_the_worst_input_comes_near_the_range_of_pd():
    found = made(PD, 2.0, 0.5, 0.1).output_range(reference=Interval(0.0, 1.0), measurement=Interval(-1.0, 3.0))
    u = play(lambda: PD(2.0, 0.5, 0.1), RATE, reference=np.ones(2000), measurement=np.r_[np.full(1999, 3.0), -1.0])[
        "command"
    ]
    assert found.high - 1e-6 < u[-1] <= found.high


def test_the_proof_uses_the_whole_range_of_live_limits():
    block = made(PI, 1.0, 1.0, lower=Live(-1.0, min=-4.0, max=0.0), upper=Live(1.0, min=-1.0, max=3.0))
    assert block.output_range() == Interval(-4.0, 3.0)


def test_each_element_of_a_vector_is_controlled_separately():
    r, y = REFERENCE[:399].reshape(133, 3), MEASUREMENT[:399].reshape(133, 3)
    together = play(lambda: PID(3.0, 20.0, 0.1, lower=-2.0, upper=2.0), RATE, reference=r, measurement=y)["command"]
    for column in range(3):
        alone = play(
            lambda: PID(3.0, 20.0, 0.1, lower=-2.0, upper=2.0), RATE, reference=r[:, column], measurement=y[:, column]
        )["command"]
        assert np.array_equal(together[:, column], alone)


def test_command_unit_is_free_and_reference_and_measurement_share_one():
    def diagram(unit_of_measurement, unit_of_command):
        with Diagram("units", rate=RATE) as found:
            by_hand = source([0.0], unit_of_command)
            torque = PID(30.0, unit="N*m")(
                source([0.0], "rad"), source([0.0], unit_of_measurement), manual_command=by_hand
            )
            assert torque.declaration.unit == "N·m"
            P()(torque, Sine()())
        return found

    compile(diagram("rad", "N·m"))
    for wrong in (("deg", "N·m"), ("rad", "A")):
        with pytest.raises(DiagramError) as complaint:
            compile(diagram(*wrong))
        assert [d.code for d in complaint.value.diagnostics] == ["TW002"]


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: PI(lower=2.0, upper=1.0), r"lower must be at most upper \(1\), got 2"),
        (lambda: PID(anti_windup="none"), "anti_windup: must be one of clamping"),
        (lambda: PID(filter_time=-1.0), "filter_time: must be at least 0"),
        (lambda: PI(tracking_time=0.0), "tracking_time: must be above 0"),
        (lambda: PD(unit="furlong"), "'furlong' is not a unit"),
    ],
)
def test_inconsistent_parameters_are_refused(make, said):
    with pytest.raises(DiagramError, match=said):
        make()
