"""What stands between a controller, a motor and a person: dead zone, power, soft stop, root mean square, temperature,
soft start.
"""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from blocks.limiters import DeadZone, PowerLimiter, RMSTorqueLimiter, SoftStart, SoftStop, TemperatureDerating
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import Block, Diagram, DiagramError, Interval, Live, Output, compile
from tests.blocks.playing import made, play, taker

RATE = 200.0
DT = 1.0 / RATE
finite = st.floats(-1e6, 1e6)
anything = st.floats(allow_nan=True, allow_infinity=True)


def spans(data, count, values=finite):
    return [sorted(data.draw(st.tuples(values, values))) for _ in range(count)]


# Dead zone


def test_dead_zone_passes_only_excess():
    u = np.array([-3.0, -1.0, -0.5, 0.0, 1.9, 2.0, 2.5, math.nan, math.inf])
    y = play(lambda: DeadZone(-1.0, 2.0), u=u)["y"]
    assert np.array_equal(y, [-2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, math.nan, math.nan], equal_nan=True)


@given(data=st.data())
def test_the_range_of_a_dead_zone_is_exact(data):
    (low, high), (lower, upper) = spans(data, 2)
    block = made(DeadZone, lower, upper)
    found = block.output_range(u=Interval(low, high))
    assert found == Interval(block.step(low), block.step(high))
    assert all(block.step(u) in found for u in data.draw(st.lists(st.floats(low, high), max_size=9)))


@given(data=st.data())
def test_dead_zone_with_moving_ends_stays_in_range(data):
    (low, high), lowers, uppers = spans(data, 3, st.floats(-9.0, 9.0))
    if lowers[0] > uppers[0]:
        lowers, uppers = uppers, lowers
    block = made(DeadZone, Live(lowers[0], min=lowers[0], max=lowers[1]), Live(uppers[0], min=uppers[0], max=uppers[1]))
    found = block.output_range(u=Interval(low, high))
    for block.lower in lowers:
        for block.upper in uppers:
            assert block.step(low) in found and block.step(high) in found


# Power


@given(torque=anything, velocity=anything, power=st.floats(0.0, 1e6))
@example(torque=1.0, velocity=137472573440.0, power=2.3929025000862983e-298)
def test_power_is_bounded_to_one_rounding_and_nothing_else_is_touched(torque, velocity, power):
    y = made(PowerLimiter, power).step(torque, velocity)
    assert math.isnan(y) == (not (math.isfinite(torque) and math.isfinite(velocity)))
    if math.isnan(y):
        return
    product = abs(torque) * abs(velocity) if torque and velocity else 0.0
    assert y == torque if product <= power else abs(y) < abs(torque) or abs(y) == power / abs(velocity)
    if y:
        rounding = 4e-16 * power + 5e-324 * max(1.0, abs(velocity))  # of y, of its smallest step where it is subnormal
        assert abs(y) * abs(velocity) <= power + rounding and (y > 0.0) == (torque > 0.0)


def test_the_power_of_each_joint_is_bounded_separately():
    y = play(
        lambda: PowerLimiter(10.0), torque=np.full((2, 3), 6.0), velocity=np.array([[1.0, 2.0, -5.0], [4.0, 0.0, 1.0]])
    )["limited"]
    assert np.array_equal(y, [[6.0, 5.0, 2.0], [2.5, 6.0, 6.0]])


@given(data=st.data())
def test_a_limited_power_stays_in_its_range(data):
    torque, velocity = spans(data, 2)
    power = data.draw(st.floats(0.0, 1e4))
    block = made(PowerLimiter, power)
    found = block.output_range(torque=Interval(*torque), velocity=Interval(*velocity))
    for t in (*torque, data.draw(st.floats(*torque))):
        for v in (*velocity, data.draw(st.floats(*velocity))):
            assert block.step(t, v) in found


def test_the_range_of_power_uses_the_slowest_velocity():
    block = made(PowerLimiter, 10.0)
    found = block.output_range(torque=Interval(-50.0, 50.0), velocity=Interval(-8.0, -2.0))
    assert abs(found.low + 5.0) < 1e-12 and abs(found.high - 5.0) < 1e-12
    assert block.output_range(torque=Interval(1.0, 50.0), velocity=Interval(-1.0, 1.0)) == Interval(0.0, 50.0)
    assert block.step(3.0, 5.0) == 2.0 and block.step(-3.0, -5.0) == -2.0 and block.step(1e9, 0.0) == 1e9


# Soft stop


def stopped(torque, position, velocity, lower=-0.5, upper=1.5, K=80.0, B=2.0):
    """SoftStop in plain Python."""
    if position > upper:
        return torque - K * (position - upper) - (B * velocity if velocity > 0.0 else 0.0)
    if position < lower:
        return torque + K * (lower - position) - (B * velocity if velocity < 0.0 else 0.0)
    return torque


def test_a_soft_stop_damps_outward_motion_only():
    random = np.random.default_rng(19)
    torque, position, velocity = (
        random.normal(0.0, 5.0, 500),
        random.normal(0.5, 1.5, 500),
        random.normal(0.0, 4.0, 500),
    )
    y = play(lambda: SoftStop(-0.5, 1.5, 80.0, 2.0), torque=torque, position=position, velocity=velocity)["stopped"]
    assert np.array_equal(y, [stopped(*values) for values in zip(torque, position, velocity)])


def test_a_soft_stop_is_zero_at_the_end_of_its_range():
    block = made(SoftStop, -0.5, 1.5, 80.0, 2.0)
    assert block.step(3.0, 1.5, 4.0) == block.step(3.0, -0.5, -4.0) == 3.0


def test_soft_stop_bounds_penetration_of_moving_limb():
    """1 kg·m² at 2 rad/s into 100 N·m/rad: without a damper √(I/K) ω = 0.2 rad; with one less."""
    block = made(SoftStop, -1.0, 1.0, 100.0, 5.0, rate=10000.0)
    position, velocity, farthest = 0.9, 2.0, 0.0
    for _ in range(10000):
        velocity += block.step(0.0, position, velocity) / 10000.0
        position += velocity / 10000.0
        farthest = max(farthest, position)
    assert 1.1 < farthest < 1.2 and position < 1.0 and -2.0 < velocity < 0.0


@given(data=st.data())
def test_a_soft_stop_stays_in_its_range(data):
    torque, position, velocity = spans(data, 3, st.floats(-20.0, 20.0))
    lower, upper = sorted(data.draw(st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))))
    block = made(SoftStop, lower - 0.1, upper, 80.0, 2.0)
    found = block.output_range(torque=Interval(*torque), position=Interval(*position), velocity=Interval(*velocity))
    for values in ((t, p, v) for t in torque for p in position for v in velocity):
        assert block.step(*values) in found


def test_the_range_of_a_soft_stop_is_the_torque_where_the_joint_cannot_leave():
    block = made(SoftStop, -1.0, 1.0)
    inside = Interval(-1.0, 1.0)
    assert block.output_range(torque=Interval(-3.0, 4.0), position=inside, velocity=Interval()) == Interval(-3.0, 4.0)
    assert (
        made(SoftStop, -math.inf, 1.0).output_range(torque=inside, position=Interval(-9.0, 1.0), velocity=Interval())
        == inside
    )
    found = block.output_range(torque=Interval(-3.0, 4.0), position=Interval(0.0, 1.5), velocity=Interval(-9.0, 2.0))
    assert abs(found.low - (-3.0 - 50.0 - 2.0)) < 1e-9 and found.high == 4.0


@pytest.mark.parametrize(
    "values",
    [
        (math.nan, 0.0, 0.0),
        (0.0, math.nan, 0.0),
        (0.0, 0.0, math.nan),
        (0.0, math.inf, 0.0),
        (0.0, -math.inf, 0.0),
        (0.0, 0.0, math.inf),
        (0.0, 2.0, -math.inf),
    ],
)
def test_soft_stop_maps_non_finite_input_to_nan(values):
    block = made(SoftStop)
    assert math.isnan(block.step(*values)) and block.step(2.0, 0.0, 0.0) == 2.0


# Root mean square


def rms_over_windows(y, length):
    """Largest root mean square of any `length` outputs in a row, zeros before the start."""
    squares = np.r_[np.zeros(length), np.asarray(y) ** 2]
    return max(math.sqrt(math.fsum(squares[k : k + length]) / length) for k in range(len(squares) - length + 1))


def test_rms_limit_saturates_after_window_fills():
    """18 N·m asked of a drive rated for 9: the whole torque at first, then less, and the mean square over 20 s is that
    of the rating.
    """
    y = play(lambda: RMSTorqueLimiter(9.0), torque=np.full(12000, 18.0))["limited"]
    squares = np.cumsum(np.r_[0.0, y**2])
    rms = np.sqrt((squares[4000:] - squares[:-4000]) / 4000)
    assert np.all(y[:700] == 18.0) and rms.max() <= 9.0 and rms.max() > 8.99 and abs(rms[-1] - 9.0) < 0.05
    assert np.abs(np.diff(y[:4000])).max() < 0.1, "torque is taken back, not cut"


def test_without_a_fade_the_rms_limiter_uses_the_whole_budget_at_once():
    y = play(lambda: RMSTorqueLimiter(3.0, window=0.1, fade=0.0), torque=np.full(60, 100.0))["limited"]
    assert abs(y[0] - 3.0 * math.sqrt(20.0)) < 1e-9 and np.abs(y[1:20]).max() < 1e-4 and abs(y[20] - y[0]) < 1e-9


def test_a_limit_of_a_few_millinewton_metres_is_accepted():
    y = play(lambda: RMSTorqueLimiter(0.05, window=0.1, fade=0.0), torque=np.full(21, 0.2))["limited"]
    assert (
        y[0] == 0.2
        and abs(y[1] - math.sqrt(20.0 * 0.05**2 - 0.2**2)) < 1e-9
        and np.abs(y[2:20]).max() < 1e-6
        and y[20] == 0.2
    )


def test_nan_passes_an_rms_limiter_and_is_not_stored():
    y = play(lambda: RMSTorqueLimiter(0.5, window=0.05, fade=0.0), torque=np.array([0.3, math.nan, math.nan, 9.0]))[
        "limited"
    ]
    assert y[0] == 0.3 and np.isnan(y[1:3]).all() and abs(y[3] - math.sqrt(10.0 * 0.25 - 0.09)) < 1e-9


def test_rounding_does_not_reduce_the_budget_of_a_long_rms_window():
    """1999 torques that leave 1e-9 of 2000 N²·m²: a sum that forgets its roundings is off by a hundredth of that."""
    length = 2000
    torque = np.random.default_rng(21).uniform(0.2, 1.7, length)
    torque *= math.sqrt((length - 100.0) / math.fsum(torque[:-2] ** 2))
    torque[-2] = math.sqrt(length * (1.0 - 1e-12) - math.fsum(torque[:-2] ** 2) - 1e-9)
    torque[-1] = 5.0
    y = play(lambda: RMSTorqueLimiter(1.0, window=length * DT, fade=0.0), torque=torque)["limited"]
    assert np.array_equal(y[:-1], torque[:-1])
    left = length * (1.0 - 1e-12) - math.fsum(y[:-1] ** 2)
    assert 0.9e-9 < left < 1.1e-9 and abs(y[-1] ** 2 - left) < 2e-12


@given(
    u=st.lists(
        st.one_of(finite, st.sampled_from([math.inf, -math.inf, math.nan, 5.0, -5.0, 0.0])), min_size=1, max_size=80
    ),
    limit=st.one_of(st.just(0.0), st.floats(1e-6, 50.0)),
    length=st.integers(1, 12),
    fade=st.floats(0.0, 1.0),
)
def test_rms_never_exceeds_limit_for_any_command(u, limit, length, fade):
    block = made(RMSTorqueLimiter, limit, window=length * DT, fade=fade * length * DT)
    found = block.output_range(torque=Interval())
    out = []
    for x in u:
        y = block.step(x)
        assert math.isnan(y) == (not math.isfinite(x))
        out.append(0.0 if math.isnan(y) else y)
        assert math.isnan(y) or (y in found and abs(y) <= abs(x) and (y == 0.0 or (y > 0.0) == (x > 0.0)))
    assert rms_over_windows(out, length) <= limit


@pytest.mark.soak
def test_the_rms_bound_holds_over_a_million_ticks_of_bursts():
    random = np.random.default_rng(20)
    torque = np.repeat(random.normal(0.0, 12.0, 5000), 200) * np.repeat(random.random(100) < 0.6, 10000)
    y = play(lambda: RMSTorqueLimiter(9.0, window=5.0, fade=0.2), torque=torque)["limited"]
    squares = y**2
    for k in np.linspace(1000, len(y), 1000).astype(int):
        assert math.sqrt(math.fsum(squares[k - 1000 : k].tolist()) / 1000) <= 9.0
    assert np.array_equal(y[:1000], torque[:1000]) and y.max() > 18.0


def test_range_is_allowance_of_empty_window_within_command():
    block = made(RMSTorqueLimiter, 9.0, window=20.0, fade=1.0)
    assert abs(block.output_range(torque=Interval()).high - 9.0 * math.sqrt(20.0)) < 1e-12
    assert block.output_range(torque=Interval(2.0, 12.0)) == Interval(0.0, 12.0)
    live = made(RMSTorqueLimiter, Live(2.0, max=9.0), window=20.0, fade=1.0)
    assert live.output_range(torque=Interval()) == block.output_range(torque=Interval())


def test_a_lowered_rms_limit_reduces_torque_until_the_window_has_passed():
    block = made(RMSTorqueLimiter, 9.0, window=1.0, fade=0.05)
    for _ in range(400):
        block.step(9.0)
    block.limit = 3.0
    out = [block.step(9.0) for _ in range(600)]
    assert out[0] == 0.0 and rms_over_windows(out[200:], 200) <= 3.0


def test_during_missed_ticks_the_last_torque_counts():
    block = made(RMSTorqueLimiter, 3.0, window=0.1, fade=0.0)
    steady = made(RMSTorqueLimiter, 3.0, window=0.1, fade=0.0)
    block.step(4.0)
    for _ in range(11):
        steady.step(4.0)
    block.scratch.arena[2] = 11.0 * DT  # this tick comes 11 periods after the one before
    assert block.step(100.0) == steady.step(100.0) < 6.0
    block.scratch.arena[2] = 1e9
    assert abs(block.step(100.0)) <= 3.0 * math.sqrt(20.0)
    block, steady = (made(RMSTorqueLimiter, 3.0, window=0.1, fade=0.0) for _ in range(2))
    for torque in [1.0] * 18 + [2.0, 2.0]:
        block.step(torque)  # a window to its end: the newest square stands in its last place
        steady.step(torque)
    for _ in range(5):
        steady.step(2.0)
    block.scratch.arena[2] = 6.0 * DT
    assert block.step(100.0) == steady.step(100.0)


def test_invalid_rms_limits_are_rejected():
    for parameters, said in (
        ({"limit": 9.0, "window": 1.0, "fade": 2.0}, r"fade must be at most window \(1 s\), got 2 s"),
        ({}, "limit is missing"),
        ({"limit": -1.0}, "limit: must be at least 0"),
    ):
        with pytest.raises(DiagramError, match=said):
            RMSTorqueLimiter(**parameters)


# Temperature


def test_torque_decreases_linearly_with_motor_temperature():
    temperature = np.array([20.0, 80.0, 85.0, 90.0, 99.0, 100.0, 150.0, math.nan, -math.inf, math.inf])
    y = play(lambda: TemperatureDerating(80.0, 100.0), torque=np.full(10, -8.0), temperature=temperature)["derated"]
    assert np.allclose(
        y, [-8.0, -8.0, -6.0, -4.0, -0.4, 0.0, 0.0, math.nan, math.nan, math.nan], atol=1e-15, equal_nan=True
    )


@given(torque=anything, temperature=anything, ends=st.tuples(st.floats(-50.0, 200.0), st.floats(0.001, 100.0)))
def test_derated_torque_is_between_zero_and_command(torque, temperature, ends):
    block = made(TemperatureDerating, ends[0], ends[0] + ends[1])
    y = block.step(torque, temperature)
    if math.isnan(torque) or not math.isfinite(temperature):
        assert math.isnan(y)
    elif math.isfinite(torque):
        assert y in block.output_range(torque=Interval(torque, torque), temperature=Interval()) and abs(y) <= abs(
            torque
        )


def test_one_temperature_derates_every_element():
    y = play(
        lambda: TemperatureDerating(80.0, 100.0), torque=np.array([[8.0, -4.0, 2.0]]), temperature=np.array([90.0])
    )["derated"]
    assert y.tolist() == [[4.0, -2.0, 1.0]]


# Soft start


def test_a_soft_start_fades_in_every_element():
    u = np.tile([4.0, -2.0, 1.0], (3, 1))
    y = play(lambda: SoftStart(2.0 * DT), u=u, enable=np.ones(3, dtype=bool))["y"]
    assert y.tolist() == [[0.0, 0.0, 0.0], [2.0, -1.0, 0.5], [4.0, -2.0, 1.0]]


def test_a_soft_start_fades_in_over_its_duration_and_again_when_enabled_again():
    enable = np.r_[np.ones(60), np.zeros(5), np.ones(30)].astype(bool)
    y = play(lambda: SoftStart(0.2), u=np.full(95, 4.0), enable=enable)["y"]
    assert y[0] == 0.0 and abs(y[20] - 2.0) < 1e-12 and np.all(y[41:60] == 4.0) and np.all(y[60:65] == 0.0)
    assert np.array_equal(y[65:95], y[:30]) and np.all(np.diff(y[:41]) >= 0.0)


@given(
    u=st.lists(anything, min_size=1, max_size=30),
    enable=st.lists(st.sampled_from([True, False, math.nan]), min_size=30, max_size=30),
)
def test_soft_start_output_is_between_zero_and_input_and_passes_nan(u, enable):
    block = made(SoftStart, 0.05)
    for x, may in zip(u, enable):
        y = block.step(x, may)
        if math.isnan(x) or math.isnan(may):
            assert math.isnan(y)
        elif math.isfinite(x):
            assert y in block.output_range(u=Interval(x, x), enable=Interval(0.0, 1.0))


def test_soft_start_accounts_for_missed_ticks():
    block = made(SoftStart, 1.0)
    block.step(1.0)
    block.scratch.arena[2] = 0.5
    assert abs(block.step(1.0) - 0.5) < 1e-12


@pytest.mark.parametrize(
    "make, said",
    [
        (lambda: DeadZone(2.0, 1.0), r"lower must be at most upper \(1\), got 2"),
        (lambda: SoftStop(1.0, 1.0), r"lower must be below upper \(1 rad\), got 1 rad"),
        (lambda: TemperatureDerating(100.0, 80.0), r"full must be below none \(80 °C\), got 100 °C"),
        (lambda: SoftStart(0.0), "duration: must be above 0"),
        (lambda: PowerLimiter(-1.0), "power: must be at least 0"),
        (lambda: SoftStop(stiffness=-1.0), "stiffness: must be at least 0"),
    ],
)
def test_inconsistent_parameters_are_refused(make, said):
    with pytest.raises(DiagramError, match=said):
        make()


def test_a_chain_of_limiters_runs_in_a_diagram_at_a_slower_rate():
    """Every other tick: the window then has half as many samples, and the bound is the same."""

    class Burst(Block):
        """12 N·m, on and off."""

        y = Output("N·m", "the torque")

        def step(self, tick):
            return 12.0 if tick % 1000 < 600 else -3.0

    with Diagram("slow", rate=RATE) as diagram:
        limited = RMSTorqueLimiter(4.0, window=1.0, fade=0.1, every=2)(Burst(every=2)())
        y = taker(limited, (), 4000)
    Executor(Program(compile(diagram)), RATE).spin(4000)
    assert rms_over_windows(y[::2], 100) <= 4.0 and np.array_equal(y[::2], y[1::2]) and y.max() == 12.0
