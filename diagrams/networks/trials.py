"""Simulated trials that the networks are trained on: adults with inertial sensors who walk at changing speeds."""

from __future__ import annotations

import numpy as np

from blocks.wearer import SegmentIMU, Walker
from graph import Diagram
from runtime.record.analysis.trial import Trial
from runtime.session.simulate import simulate

RATE = 100.0  # Hz
SIDES, SEGMENTS, JOINTS = ("left", "right"), ("thigh", "shank"), ("hip", "knee", "ankle")
# Differences between the legs of an adult, and between fittings of the sensors, standard deviations:
RANGE_DEVIATION = 0.12  # of the logarithm of the range of motion
SHAPE_DEVIATION = 0.025  # rad, of a harmonic of the angle of a segment
ZERO_DEVIATION = 0.06  # rad, of the zero of an angle
MOUNTING_DEVIATION = 0.12  # rad, of roll, pitch and yaw
GYRO_BIAS, GYRO_NOISE, ANGLE_NOISE = 0.01, 0.02, 0.003  # rad/s, rad/s, rad
HARMONICS = np.arange(1, 5)
SLOWEST, FASTEST = 0.4, 1.13  # m/s; m/s per m of body height
STOP_SHARE = 0.2  # of the changes of speed
SLOWEST_TEMPO, FASTEST_TEMPO = 0.8, 1.8  # times the cadence of the Walker at the same speed: strides of 0.55 to 2.2 s
LAG_DEVIATION = 0.025  # s, by which one leg is late in every stride
TURN_EVERY, TURN_LENGTH = 12.0, (1.5, 4.0)  # s
TURN_RANGE, TURN_LAG = (0.5, 1.1), 0.06  # of the motion of a leg in a turn; largest lag of a leg, s
STANDING_SPEED, WALKING_SPEED = 0.1, 0.3  # m/s: without a phase below the first, with one above the second


def trial(seed: int, duration: float) -> list[dict[str, np.ndarray]]:
    """Return the signals of the left and of the right leg of one adult, {name: samples at RATE}.

    Signals are the channels of the networks (rad, rad/s; 0 in a straight stand) and what they estimate: phase_sin and
    phase_cos, which are 0 in standing, and biological torques in N·m/kg, positive in flexion and dorsiflexion.
    duration : s
    """
    random = np.random.default_rng(seed)
    mass = random.uniform(50.0, 110.0)
    run = simulate(adult(random, seed, mass, duration), duration)
    walking = np.clip((run["walker.walking_speed"] - STANDING_SPEED) / (WALKING_SPEED - STANDING_SPEED), 0.0, 1.0)
    legs = []
    for side in SIDES:
        turns = 2.0 * np.pi * run[f"walker.{side}_phase"]
        (thigh, thigh_velocity), (shank, shank_velocity) = (
            measured(random, run, f"{side}_{segment}", walking, turns) for segment in SEGMENTS
        )
        leg = {"hip_angle": thigh, "hip_velocity": thigh_velocity}
        leg |= {"knee_angle": thigh - shank, "knee_velocity": thigh_velocity - shank_velocity}
        leg |= {"phase_sin": walking * np.sin(turns), "phase_cos": walking * np.cos(turns)}
        leg |= {f"{joint}_torque": run[f"walker.{side}_{joint}_torque"] / mass for joint in JOINTS}
        legs.append(leg)
    for leg, other in zip(legs, reversed(legs)):
        leg |= {f"opposite_hip_{name}": other[f"hip_{name}"] for name in ("angle", "velocity")}
    return legs


def varied(seed: int, duration: float) -> list[dict[str, np.ndarray]]:
    """Return a trial at another cadence, with legs that differ in time and turns, without torques.

    In a turn the legs move over other ranges, and one is late. duration : s
    """
    random = np.random.default_rng((seed, 1))
    tempo = float(np.exp(random.uniform(np.log(SLOWEST_TEMPO), np.log(FASTEST_TEMPO))))
    time = np.arange(round(duration * RATE)) / RATE
    legs = trial(seed, tempo * duration + 1.0)
    begins = np.arange(random.uniform(2.0, 8.0), duration, TURN_EVERY)
    turns = [(begin, random.uniform(*TURN_LENGTH)) for begin in begins]
    channels = []
    for leg in legs:
        lag, gain = np.full(len(time), random.normal(0.0, LAG_DEVIATION)), np.ones(len(time))
        for begin, length in turns:
            share = np.sin(np.pi * np.clip((time - begin) / length, 0.0, 1.0)) ** 2
            lag += share * random.uniform(-TURN_LAG, TURN_LAG)
            gain += share * (random.uniform(*TURN_RANGE) - 1.0)
        own = RATE * np.clip(tempo * (time + 0.15 - lag), 0.0, None)
        ticks = np.arange(len(leg["hip_angle"]))
        angle, velocity, sine, cosine = (
            np.interp(own, ticks, leg[name]) for name in ("hip_angle", "hip_velocity", "phase_sin", "phase_cos")
        )
        velocity = gain * velocity * np.gradient(own) + RATE * np.gradient(gain) * angle
        channels.append({"hip_angle": gain * angle, "hip_velocity": velocity, "phase_sin": sine, "phase_cos": cosine})
    for leg, other in zip(channels, reversed(channels)):
        leg |= {f"opposite_hip_{name}": other[f"hip_{name}"] for name in ("angle", "velocity")}
    return channels


def adult(random: np.random.Generator, seed: int, mass: float, duration: float) -> Diagram:
    """Return the adult of a seed and of a mass in kg, with a sensor on thigh and shank of both legs."""
    height = 1.70 * (mass / 72.0) ** 0.2 * random.uniform(0.94, 1.06)
    with Diagram("trial", RATE) as diagram:
        walker = Walker(
            speeds(random, duration, FASTEST * height),
            mass=mass,
            height=height,
            start=random.uniform(),
            variability=random.uniform(0.5, 2.5),
            seed=seed,
            person=1 + seed,
            name="walker",
        )()
        for part in [f"{side}_{segment}" for side in SIDES for segment in SEGMENTS]:
            sensor = SegmentIMU(
                mounting=tuple(random.normal(0.0, MOUNTING_DEVIATION, 3)),
                gyro_bias=tuple(random.normal(0.0, GYRO_BIAS, 3)),
                gyro_noise=GYRO_NOISE,
                seed=int(random.integers(2**31)),
                name=part,
            )
            sensor(getattr(walker, f"{part}_motion"))
    return diagram


def speeds(random: np.random.Generator, duration: float, fastest: float) -> str:
    """Return a schedule of walking speeds up to `fastest`, m/s, with stops."""
    time, points = 0.0, []
    while time < duration:
        speed = 0.0 if random.uniform() < STOP_SHARE else random.uniform(SLOWEST, fastest)
        points.append((time, speed))
        time += random.uniform(3.0, 12.0) if speed else random.uniform(2.0, 4.0)
        points.append((time, speed))
        time += random.uniform(1.0, 5.0)
    return " ".join(f"{at:.2f}:{speed:.2f}" for at, speed in points)


def measured(
    random: np.random.Generator, run: Trial, part: str, walking: np.ndarray, turns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pitch of a segment in rad as its sensor measures it, and the pitch rate in rad/s.

    walking : 0 in standing, 1 in walking
    turns : 2π · gait phase
    """
    gain = np.exp(random.normal(0.0, RANGE_DEVIATION))
    cosine, sine = random.normal(0.0, SHAPE_DEVIATION, (2, len(HARMONICS)))
    angles = np.outer(HARMONICS, turns)
    difference = walking * (cosine @ np.cos(angles) + sine @ np.sin(angles))
    w, x, y, z = run[f"{part}.quaternion"].T
    pitch = gain * np.arcsin(2.0 * (w * y - z * x)) + difference + random.normal(0.0, ZERO_DEVIATION)
    rate = gain * run[f"{part}.gyro"][:, 1] + RATE * np.gradient(difference)
    return pitch + random.normal(0.0, ANGLE_NOISE, len(pitch)), rate
