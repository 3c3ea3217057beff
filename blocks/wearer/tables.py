"""Tables of the walking adult over its speed, from the series of the measured speeds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from blocks.wearer.adults import family
from blocks.wearer.body import GRAVITY
from blocks.wearer.norms import BODY_HEIGHT, MOTIONS
from blocks.wearer.stride import FORCE_SINES, HARMONICS, balanced, sines

# Standing: thigh and foot level with the ground's vertical, knee bent by 2°, weight 5 cm in front of the ankles.
STANDING_KNEE = np.radians(2.0)
STANDING_CENTRE = 0.25 + 0.05 / 0.26  # foot lengths from the heel
STANDING_ANKLE_MOMENT = -0.5 * GRAVITY * 0.05  # N·m/kg of one ankle
SLOWER = (1.0 / 3.0, 2.0 / 3.0)  # of the slowest measured speed, where the walk is scaled towards standing
GRIP = 0.6 * GRAVITY  # m/s²: the friction of a sole in cext/kernels/wearer/walker.pyx accelerates the body by no more


def row(entry: dict[str, Any]) -> np.ndarray:
    """Return the numbers of one speed in the order of the kernels' enum."""
    return np.concatenate(
        [
            [1.0 / entry["stride_time"], entry["pelvis_pitch"]],
            *harmonics(entry["angles"]),
            entry["pelvis_height"],
            entry["pelvis_forward"],
            [entry["foot_off"]],
            *harmonics(entry["moments"]),
            entry["vertical"],
            entry["forward"],
            entry["centre"],
        ]
    )


def harmonics(curves: Sequence[Sequence[float]]) -> tuple[np.ndarray, np.ndarray]:
    """Return the means of three curves, and of each harmonic the cosine and sine coefficients of the three."""
    table = np.array(curves)
    return table[:, 0], table[:, 1:].reshape(3, 2, HARMONICS).transpose(2, 0, 1).ravel()


def slower(entry: dict[str, Any], speed: float) -> dict[str, Any]:
    """Return an extrapolation from the slowest speed to `speed`, 0 for standing.

    With u = speed / slowest speed the cadence is (1 + u) / 2 of that of the slowest speed, close to u to the power of
    0.42 (Grieve and Gear 1966, Ergonomics 9:379-399), and the amplitude of the motion is u over that. The vertical
    forces of both feet deviate from the body weight as the acceleration of the body, by amplitude times cadence
    squared; the forward forces change with the length of the step.
    """
    u = speed / entry["speed"]
    cadence = 0.5 + 0.5 * u
    amplitude = u / cadence
    pitch = entry["pelvis_pitch"]
    stand: dict[str, Any] = {
        "angles": (-pitch, STANDING_KNEE, STANDING_KNEE),
        "moments": (0.0, 0.0, STANDING_ANKLE_MOMENT),
        "centre": (STANDING_CENTRE,),
        "pelvis_height": (entry["pelvis_height"][0] + 0.004,),
        "pelvis_forward": (),
    }

    def towards(target: Sequence[float], curve: Sequence[float]) -> np.ndarray:
        still = np.zeros(len(curve))
        still[: len(target)] = target
        return still + amplitude * (np.array(curve) - still)

    scaled: dict[str, Any] = {}
    for name, target in stand.items():
        curves = entry[name]
        three = name in ("angles", "moments")
        scaled[name] = [towards((a,), b) for a, b in zip(target, curves)] if three else towards(target, curves)
    foot_off = entry["foot_off"] + 0.6 * (1.0 - u) ** 2 * (1.0 - entry["foot_off"])
    vertical = shared(entry, foot_off, u * cadence)
    scaled["vertical"], scaled["forward"] = balanced(vertical, amplitude * np.array(entry["forward"]), foot_off)
    return entry | scaled | {"speed": speed, "stride_time": entry["stride_time"] / cadence, "foot_off": foot_off}


def shared(entry: dict[str, Any], foot_off: float, scale: float) -> np.ndarray:
    """Return the series of the vertical force of a foot with another foot-off, whose two stances overlap for longer.

    scale : factor of the deviation from the body weight of the sum of both feet
    """
    stance = np.linspace(0.0, 1.0, 101)
    waves = sines(stance, FORCE_SINES)

    def both(foot_off: float, phases: np.ndarray) -> np.ndarray:
        left, right = (sines(leg % 1.0 / foot_off, FORCE_SINES) for leg in (phases, phases + 0.5))
        return (left + right) @ entry["vertical"]

    total = 1.0 + scale * (both(entry["foot_off"], stance * foot_off) - 1.0)
    return np.linalg.pinv(waves) @ (waves @ entry["vertical"] * total / both(foot_off, stance * foot_off))


def entry_of(stride_time: float) -> dict[str, Any]:
    """Return the series of the average walk with a stride time in s, within the measured times."""
    entries = MOTIONS["walk"]
    times = [-entry["stride_time"] for entry in entries]
    place = float(np.interp(-stride_time, times, np.arange(len(times))))
    first, second = entries[int(place)], entries[min(int(place) + 1, len(entries) - 1)]
    share = place - int(place)
    return {name: (1.0 - share) * np.array(first[name]) + share * np.array(second[name]) for name in first}


def over_speed(motion: str, height: float, person: Any = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return (speeds, coefficients of the cubics between them) of a motion.

    height : height of the body, m; person : as in Walker. The coefficients are of shape (pieces, 4, numbers), a natural
    cubic spline. ValueError
    """
    if person != 0 and motion != "walk":
        raise ValueError(f"motion {motion!r} is that of the average adult only: leave person at 0, got {person!r}")
    entries = family(MOTIONS[motion], person)
    below = [slower(entries[0], share * entries[0]["speed"]) for share in (0.0, *SLOWER)]
    knots = [*below, *entries]
    speeds = np.array([entry["speed"] for entry in knots]) * (height / BODY_HEIGHT)
    return speeds, natural_spline(speeds, np.array([row(entry) for entry in knots]))


def speed_of(stride_time: float, speeds: np.ndarray, cubics: np.ndarray) -> float:
    """Return the speed in m/s of strides of a duration in s, within the range of the table."""
    steps: list[np.ndarray] = [np.linspace(0.0, length, 100) for length in np.diff(speeds)]
    at = np.concatenate([begin + x for begin, x in zip(speeds, steps)])
    values: list[np.ndarray] = [np.polyval(piece[::-1, 0], x) for piece, x in zip(cubics, steps)]
    frequencies = np.concatenate(values)
    return float(np.interp(1.0 / stride_time, frequencies, at))


def walking_speed(stride_time: float, height: float = BODY_HEIGHT, person: Any = 0) -> float:
    """Return the speed in m/s at which an adult has strides of a duration in s. height : m; person : as in Walker"""
    return speed_of(stride_time, *over_speed("walk", height, person))


def natural_spline(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the coefficients, power by power, of the natural cubic spline through y at x."""
    h = np.diff(x)
    slopes = np.diff(y, axis=0) / h[:, None]
    matrix = np.eye(len(x))
    right = np.zeros_like(y)
    for i in range(1, len(x) - 1):
        matrix[i, i - 1 : i + 2] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
        right[i] = 6.0 * (slopes[i] - slopes[i - 1])
    second = np.linalg.solve(matrix, right)
    linear = slopes - h[:, None] * (2.0 * second[:-1] + second[1:]) / 6.0
    return np.stack([y[:-1], linear, 0.5 * second[:-1], np.diff(second, axis=0) / (6.0 * h[:, None])], axis=1)


def schedule(speed: Any, fastest: float) -> np.ndarray:
    """Return the pieces of a speed: start, end and six coefficients each of a quintic in the time since its start.

    speed : m/s, or text as in "0:0 2:1.2 20:1.2", pairs of time in s and speed; fastest : m/s
    """
    times, speeds = np.array(pairs(speed)).T
    if np.any(np.diff(times) <= 0.0):
        raise ValueError(f"the times of `speed` must increase, got {speed!r}")
    if not np.all((speeds >= 0.0) & (speeds <= fastest)):
        raise ValueError(f"the speed must be from 0 to {fastest:.2f} m/s for this body and motion: got {speed!r}")
    if len(times) == 1:
        return np.array([[times[0], times[0], speeds[0], 0.0, 0.0, 0.0, 0.0, 0.0]])
    h = np.diff(times)
    means = np.diff(speeds) / h
    slopes = np.zeros(len(times))  # none at an end of the schedule or of a constant speed, and at a highest or lowest
    rising = means[1:] * means[:-1] > 0.0
    slopes[1:-1][rising] = 2.0 / (1.0 / means[1:][rising] + 1.0 / means[:-1][rising])
    a, b, step = slopes[:-1] * h, slopes[1:] * h, np.diff(speeds)
    zero = np.zeros_like(h)
    unit = [speeds[:-1], a, zero, 10 * step - 6 * a - 4 * b, -15 * step + 8 * a + 7 * b, 6 * step - 3 * (a + b)]
    x = np.linspace(0.0, 1.0, 201)[:, None]
    rates = np.abs(sum(k * c * x ** (k - 1) for k, c in enumerate(unit) if k)).max(axis=0) / h
    k = int(rates.argmax())
    if rates[k] > GRIP:
        raise ValueError(
            f"the speed changes from {speeds[k]:g} to {speeds[k + 1]:g} m/s in {h[k]:.2g} s, an acceleration of up to "
            f"{rates[k]:.2g} m/s²: the friction of a foot allows {GRIP:.1f} m/s². Allow at least "
            f"{math.ceil(1e2 * h[k] * rates[k] / GRIP) / 1e2:.2f} s"
        )
    return np.column_stack([times[:-1], times[1:], *(c / h**k for k, c in enumerate(unit))])


def pairs(speed: Any) -> list[tuple[float, float]]:
    """Return (time, speed) of each point of a schedule. ValueError"""
    if not isinstance(speed, str):
        return [(0.0, float(speed))]
    text = speed if ":" in speed else f"0:{speed}"
    try:
        points = [tuple(float(number) for number in pair.split(":")) for pair in text.split()]
        if not points or any(len(pair) != 2 or not np.all(np.isfinite(pair)) for pair in points):
            raise ValueError
    except ValueError:
        raise ValueError(
            f'the speed must be a number in m/s or times and speeds as in "0:0 2:1.2", got {speed!r}'
        ) from None
    return [(pair[0], pair[1]) for pair in points]
