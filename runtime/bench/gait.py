"""Accuracy of the gait estimators of the library on recorded walking, at changing speed.

The recording is played to the compiled blocks in virtual time. Truth are its contacts: a strike is the first sample
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
from graph import Block, Diagram, Output
from runtime.session.simulate import simulate

LEARNED_STRIKES = 10  # not measured: the estimators learn the wearer
MATCH_SHARE = 0.25  # of a stride, between a strike and its estimate
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
    """One leg as played. Arrays over the ticks; the true phase is NaN outside strides."""

    time: np.ndarray
    moving: np.ndarray
    signals: dict[str, np.ndarray]
    strikes: np.ndarray
    phase: np.ndarray


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
    base, marks = (own, at) if condition == "stops" else (time, strikes)
    stride = np.searchsorted(marks, base, side="right")
    inside = (stride > 0) & (stride < len(marks))
    phase = np.full(count, math.nan)
    begin, end = marks[stride[inside] - 1], marks[stride[inside]]
    phase[inside] = (base[inside] - begin) / (end - begin)
    return Walk(time, speed > 0.5, signals, strikes, phase)


class RecordedLeg(Block):
    """Recorded signals of one leg."""

    thigh = Output("rad", "angle of the thigh")
    thigh_velocity = Output("rad/s", "velocity of the thigh")
    shank = Output("rad", "angle of the shank")
    shank_velocity = Output("rad/s", "velocity of the shank")
    knee = Output("rad", "knee flexion")
    knee_velocity = Output("rad/s", "knee flexion velocity")
    contact = Output("N", "force under the foot")

    rows: list = [(0.0,) * 7]

    def step(self, tick):
        return self.rows[min(tick, len(self.rows) - 1)]


def build(walk: Walk, rate: float) -> tuple[Diagram, dict[str, tuple[str, str]]]:
    """Return the diagram, and {estimator: (path of its strikes or "", path of its phase)}."""
    paths = {}
    with Diagram("gait", rate) as diagram:
        leg = RecordedLeg(name="leg")
        zero = np.zeros(len(walk.time))
        leg.rows = list(zip(*(walk.signals.get(name, zero).tolist() for name in leg.outputs)))
        leg()
        detectors = {}
        if "contact" in walk.signals:
            detectors["contact"] = ContactEvents(name="contact_events")(force=leg.contact)
        if "shank" in walk.signals:
            detectors["shank gyro"] = GyroEvents(name="gyro_events")(velocity=leg.shank_velocity)
        if "thigh" in walk.signals:
            detectors["thigh"] = ThighEvents(name="thigh_events")(angle=leg.thigh)
        if "knee" in walk.signals:
            detectors["knee"] = KneeEvents(name="knee_events")(angle=leg.knee, velocity=leg.knee_velocity)

        def add(title, block, strikes="", **inputs):
            block(**inputs)
            paths[title] = (strikes, f"{block.path}.phase")

        for name, events in detectors.items():
            key = name.replace(" ", "_")
            add(f"{name}: time", StridePhase(name=f"{key}_time"), f"{events.strike.path}", strike=events.strike)
        if "knee" in walk.signals:
            add("knee: GaitPhase", GaitPhase(name="gait_phase"), angle=leg.knee, velocity=leg.knee_velocity)
        if "thigh" in walk.signals:
            for name in ("thigh", "contact"):
                strike, other = detectors[name].strike, "" if name == "thigh" else " + contact"
                thigh = {"angle": leg.thigh, "velocity": leg.thigh_velocity, "strike": strike}
                add(f"thigh{other}: portrait", PhasePortrait(name=f"{name}_portrait"), **thigh)
                add(
                    f"thigh{other}: oscillator",
                    AdaptiveOscillator(name=f"{name}_oscillator"),
                    angle=leg.thigh,
                    strike=strike,
                )
                add(f"thigh{other}: Kalman", PhaseKalmanFilter(name=f"{name}_kalman"), **thigh)
        for name, detector in (("shank", "shank gyro"), ("knee", "knee")):
            if name in walk.signals:
                inputs = {"angle": getattr(leg, name), "velocity": getattr(leg, f"{name}_velocity")}
                kalman = PhaseKalmanFilter(name=f"{name}_kalman")
                add(f"{name}: Kalman", kalman, strike=detectors[detector].strike, **inputs)
    return diagram, paths


def measure(leg: Leg, condition: str, rate: float, noise: float = 0.0) -> dict[str, dict[str, float]]:
    """Return {estimator: row of `errors`} of one leg in one condition."""
    walk = play(leg, condition, rate, noise)
    diagram, paths = build(walk, rate)
    trial = simulate(diagram, len(walk.time) / rate)
    rows = {}
    for name, (strikes, path) in paths.items():
        phase = trial[path]
        if strikes:
            at = walk.time[np.flatnonzero(trial[strikes])]
        else:
            at = walk.time[1:][phase[:-1] - phase[1:] > 0.5]
        rows[name] = errors(walk, at, phase)
    return rows


def errors(walk: Walk, strikes: ArrayLike, phase: np.ndarray) -> dict[str, float]:
    """Compare an estimate with the truth, from the strike after those that are learned.

    strikes : s, estimated

    Returns the number of true strikes, how many are missed and invented, median and 95 % of the absolute timing error
    in ms, and the RMS phase error in % of a stride while the leg moves.
    """
    true = walk.strikes
    learned = min(LEARNED_STRIKES, len(true) // 3)
    if len(true) < 3:
        raise ValueError("fewer than three strikes")
    begin = true[learned] - 0.5 * (true[learned] - true[learned - 1]) if learned else -math.inf
    end = walk.time[-1] - EDGE_TIME
    reach = MATCH_SHARE * float(np.median(np.diff(true)))
    strikes = np.asarray(strikes)
    free = list(strikes[(strikes >= begin - reach) & (strikes <= end + reach)])
    late, missed = [], 0
    for strike in true[(true >= begin) & (true <= end)]:
        nearest = min(free, key=lambda estimate: abs(estimate - strike), default=math.inf)
        if abs(nearest - strike) <= reach:
            free.remove(nearest)
            late.append(abs(nearest - strike))
        else:
            missed += 1
    invented = sum(begin <= estimate <= end for estimate in free)
    chosen = (walk.time >= begin) & (walk.time <= end) & walk.moving & np.isfinite(walk.phase)
    difference = (phase[chosen] - walk.phase[chosen] + 0.5) % 1.0 - 0.5
    return {
        "strikes": len(late) + missed,
        "missed": missed,
        "invented": int(invented),
        "median_ms": round(1e3 * float(np.median(late)), 6) if late else math.nan,
        "p95_ms": 1e3 * float(np.percentile(late, 95)) if late else math.nan,
        "phase_rms_percent": 100.0 * float(np.sqrt(np.mean(difference**2))),
    }
