"""Accuracy of the gait estimators of the library on recorded walking, at changing speed.

The recording is played to the compiled blocks in virtual time. The contacts are the truth: a strike is the first sample
with contact, and the phase rises linearly from one strike to the next, in the recording's own time where it stops.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from blocks.controllers import GaitPhase
from blocks.gait import (
    AdaptiveOscillator,
    ContactEvents,
    GyroEvents,
    KneeEvents,
    PhaseKalmanFilter,
    PhasePortrait,
    StridePhase,
    ThighEvents,
)
from blocks.sources import TimeTable
from graph import Diagram
from runtime.session.simulate import simulate

LEARNED_STRIKES = 10  # not measured: the estimators learn the wearer
MATCH_SHARE = 0.25  # of a stride, between a strike and its estimate
KNOWN_PHASE = 0.05  # below it an estimator that has found its phase has found a strike
EDGE_TIME = 1.0  # s at the end that are not measured
STEP_TIME = 5.0  # s
STEP_SPEEDS = (1.0, 0.8, 1.2, 1.4, 0.9, 1.1)  # times the recorded speed
STOP_EVERY, STOP_LENGTH, STOP_RAMP = 10.0, 2.0, 0.4  # s
CONTACT_FORCE = 500.0  # N, of the contact signal that is played


@dataclass
class Leg:
    """Signals of one leg.

    time : s, evenly spaced
    angles : {"thigh", "shank" or "knee": rad}
    contact : 0 or 1
    """

    name: str
    time: np.ndarray
    angles: dict[str, np.ndarray]
    contact: np.ndarray


@dataclass
class Walk:
    """One leg as played. Arrays over the ticks; the true phase is NaN outside strides.

    clock : s, in which errors are measured: the recording's own time where it stops
    """

    time: np.ndarray
    moving: np.ndarray
    signals: dict[str, np.ndarray]
    strikes: np.ndarray
    phase: np.ndarray
    clock: np.ndarray


def steady(time: np.ndarray) -> np.ndarray:
    """Return the speed relative to the recording: constant. time : s"""
    return np.ones_like(time)


def sine(time: np.ndarray) -> np.ndarray:
    """Return the speed relative to the recording: a sine of 0.8 to 1.4 over 15 s. time : s"""
    return 1.1 + 0.3 * np.sin(2.0 * np.pi * time / 15.0)


def steps(time: np.ndarray) -> np.ndarray:
    """Return the speed relative to the recording: a new one of STEP_SPEEDS every STEP_TIME. time : s"""
    return np.array(STEP_SPEEDS)[(time // STEP_TIME).astype(int) % len(STEP_SPEEDS)]


def stops(time: np.ndarray) -> np.ndarray:
    """Stop for STOP_LENGTH once in STOP_EVERY, with smooth transitions of STOP_RAMP."""
    begin = STOP_EVERY - STOP_LENGTH - 2.0 * STOP_RAMP
    knots = (0.0, begin, begin + STOP_RAMP, STOP_EVERY - STOP_RAMP, STOP_EVERY)
    share = np.interp(np.mod(time, STOP_EVERY), knots, (1.0, 1.0, 0.0, 0.0, 1.0))
    return share * share * (3.0 - 2.0 * share)


CONDITIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "steady": steady,
    "sine": sine,
    "steps": steps,
    "stops": stops,
}


def play(leg: Leg, condition: str, rate: float, noise: float = 0.0) -> Walk:
    """Warp the time of a recording by the speed of a condition.

    rate : Hz; noise : standard deviation, rad, of each angle; ten times as much, rad/s, of each velocity
    """
    length = leg.time[-1] - leg.time[0]
    time = np.arange(0.0, 4.0 * length, 1.0 / rate)
    speed = CONDITIONS[condition](time)
    own = leg.time[0] + np.concatenate(([0.0], np.cumsum(speed[:-1]))) / rate
    count = int(np.searchsorted(own, leg.time[-1], side="right"))
    time, speed, own = time[:count], speed[:count], own[:count]
    random = np.random.default_rng(0)
    signals = {}
    for name, angle in leg.angles.items():
        velocity = np.gradient(angle, leg.time)
        signals[name] = np.interp(own, leg.time, angle) + noise * random.normal(size=count)
        signals[f"{name}_velocity"] = speed * np.interp(own, leg.time, velocity) + 10.0 * noise * random.normal(
            size=count
        )
    index = np.clip(np.searchsorted(leg.time, own + 1e-9, side="right") - 1, 0, len(leg.time) - 1)
    signals["contact"] = CONTACT_FORCE * leg.contact[index]
    at = leg.time[np.flatnonzero((leg.contact[1:] > 0.5) & (leg.contact[:-1] < 0.5)) + 1]
    at = at[at <= own[-1]]
    strikes = time[np.minimum(np.searchsorted(own, at - 1e-9), count - 1)]
    clock, marks = (own, at) if condition == "stops" else (time, strikes)
    stride = np.searchsorted(marks, clock, side="right")
    inside = (stride > 0) & (stride < len(marks))
    phase = np.full(count, math.nan)
    begin, end = marks[stride[inside] - 1], marks[stride[inside]]
    phase[inside] = (clock[inside] - begin) / (end - begin)
    return Walk(time, speed > 0.5, signals, strikes, phase, clock)


def build(walk: Walk, rate: float) -> tuple[Diagram, dict[str, tuple[str, str]]]:
    """Return the diagram, and {estimator: (path of its strikes or "", path of its phase)}."""
    paths = {}
    with Diagram("gait", rate) as diagram:
        leg = {name: TimeTable(walk.time, values, name=name)() for name, values in walk.signals.items()}
        detectors = {}
        if "contact" in leg:
            detectors["contact"] = ContactEvents(name="contact_events")(force=leg["contact"])
        if "shank" in leg:
            detectors["shank gyro"] = GyroEvents(name="gyro_events")(velocity=leg["shank_velocity"])
        if "thigh" in leg:
            detectors["thigh"] = ThighEvents(name="thigh_events")(angle=leg["thigh"])
        if "knee" in leg:
            detectors["knee"] = KneeEvents(name="knee_events")(angle=leg["knee"], velocity=leg["knee_velocity"])

        def add(title, block, strikes="", **inputs):
            block(**inputs)
            paths[title] = (strikes, f"{block.path}.phase")

        def signals_of(segment, detector):
            return {"angle": leg[segment], "velocity": leg[f"{segment}_velocity"], "strike": detectors[detector].strike}

        for name, events in detectors.items():
            key = name.replace(" ", "_")
            add(f"{name}: time", StridePhase(name=f"{key}_time"), f"{events.strike.path}", strike=events.strike)
        if "knee" in leg:
            add("knee: GaitPhase", GaitPhase(name="gait_phase"), angle=leg["knee"], velocity=leg["knee_velocity"])
        for name in ("thigh", "contact") if "thigh" in leg else ():
            thigh, other = signals_of("thigh", name), "" if name == "thigh" else " + contact"
            add(f"thigh{other}: portrait", PhasePortrait(name=f"{name}_portrait"), **thigh)
            oscillator = AdaptiveOscillator(name=f"{name}_oscillator")
            add(f"thigh{other}: oscillator", oscillator, angle=thigh["angle"], strike=thigh["strike"])
            add(f"thigh{other}: Kalman", PhaseKalmanFilter(name=f"{name}_kalman"), **thigh)
        for name, detector in (("shank", "shank gyro"), ("knee", "knee")):
            if name in leg:
                add(f"{name}: Kalman", PhaseKalmanFilter(name=f"{name}_kalman"), **signals_of(name, detector))
    return diagram, paths


def measure(leg: Leg, condition: str, rate: float, noise: float = 0.0) -> dict[str, dict[str, float]]:
    """Return {estimator: row of `errors`} of one leg in one condition."""
    walk = play(leg, condition, rate, noise)
    diagram, paths = build(walk, rate)
    trial = simulate(diagram, len(walk.time) / rate)
    rows = {}
    for name, (strikes, path) in paths.items():
        if strikes:
            at = trial[strikes] > 0.0
        else:
            at = begins(trial[path], trial[path.removesuffix("phase") + "walking"])
        rows[name] = errors(walk, walk.time[at], trial[path])
    return rows


def begins(phase: np.ndarray, walking: np.ndarray) -> np.ndarray:
    """Return for each tick whether a stride begins: the known phase wraps, or becomes known at about 0."""
    known = (walking[1:] > walking[:-1]) & (phase[1:] < KNOWN_PHASE)
    return np.concatenate(([False], known | ((walking[:-1] > 0.0) & (phase[:-1] - phase[1:] > 0.5))))


def errors(walk: Walk, strikes: ArrayLike, phase: np.ndarray) -> dict[str, float]:
    """Compare an estimate with the truth, from the strike after those that are learned, on the clock of the walk.

    strikes : s, estimated; of several within MATCH_SHARE of a stride, the first counts

    Returns the number of true strikes, how many are missed and invented, median and 95 % of the absolute timing error
    in ms, and the RMS phase error in % of a stride while the leg moves.
    """
    clock = walk.clock
    true = np.interp(walk.strikes, walk.time, clock)
    learned = min(LEARNED_STRIKES, len(true) // 3)
    if len(true) < 3:
        raise ValueError("fewer than three strikes")
    begin = true[learned] - 0.5 * (true[learned] - true[learned - 1]) if learned else -math.inf
    end = clock[-1] - EDGE_TIME
    reach = MATCH_SHARE * float(np.median(np.diff(true)))
    estimates = np.sort(np.interp(np.asarray(strikes, dtype=float), walk.time, clock))
    estimates = estimates[np.diff(estimates, prepend=-math.inf) > reach]
    free = list(estimates)
    late, missed = [], 0
    for strike in true:
        nearest = min(free, key=lambda estimate: abs(estimate - strike), default=math.inf)
        matched = abs(nearest - strike) <= reach
        if matched:
            free.remove(nearest)
        if begin <= strike <= end:
            late += [abs(nearest - strike)] if matched else []
            missed += not matched
    invented = sum(begin <= estimate <= end for estimate in free)
    chosen = (clock >= begin) & (clock <= end) & walk.moving & np.isfinite(walk.phase)
    difference = (phase[chosen] - walk.phase[chosen] + 0.5) % 1.0 - 0.5
    return {
        "strikes": len(late) + missed,
        "missed": missed,
        "invented": int(invented),
        "median_ms": round(1e3 * float(np.median(late)), 6) if late else math.nan,
        "p95_ms": 1e3 * float(np.percentile(late, 95)) if late else math.nan,
        "phase_rms_percent": 100.0 * float(np.sqrt(np.mean(difference**2))),
    }
