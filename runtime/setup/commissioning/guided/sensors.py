"""Steps of inertial sensors: rate and noise at rest, then place, axes and mounting while the operator bends a segment.

They need no convention of the sensor's axes: gravity is fixed in space, so the angular rate must carry the specific
force from one pose to the next, and back to where it was.
"""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from graph import Block, Diagram, Input, subsystem
from runtime.setup.commissioning.guided.bench import Bench, Given, Result, ask
from runtime.setup.commissioning.guided.driven import raise_if_of_computer, run_on_rig

GRAVITY, GRAVITY_TOLERANCE = 9.81, 0.5  # m/s²
STILL_ACCEL, STILL_GYRO = 0.3, 0.05  # m/s² and rad/s, standard deviation of a sensor at rest
BIAS = 0.05  # rad/s
RECEIVED_SHARE, MORE_SHARE = 0.9, 1.5  # of the samples at the declared rate: fewest and most
SLOW_SHARE = 1.3  # of the declared period, median time between samples of a sensor with another rate
REST_TIME, BEND_TIME, RETURN_TIME = 2.0, 6.0, 8.0  # s
POSE_TIME = 0.5  # s at the beginning and the end of a motion, in which the segment is held
BENT = 0.35  # rad, smallest turn of a segment that was bent
AXES_TOLERANCE = 0.25  # rad, between the specific force and where the angular rate has carried it
SCALES = (0.5, 2.0, 0.25, 4.0, 0.125, 8.0)  # between full scales of one sensor
UNITS = {math.radians(1.0): "degrees per second", math.degrees(1.0): "radians per second, converted once more"}
BY_HAND = 0.3, 15.0  # rad/s, largest angular rate of a segment that is bent by hand
NO_RATE = 0.1  # of the turn, below which the angular rate does not show it
RINGING, RINGING_SHARE = 0.4, 0.5  # rad/s, and share of the slow part: oscillation of a sensor on its segment
RINGING_TIME, SMOOTH_TIME = 0.5, 0.1  # s over which it is measured, and within which a hand does not turn to and fro
DRIFT = 0.01  # of a clock, beyond which it jumps: crystals stay below 0.0001, and late samples shift it a little
LOOSE = 0.07  # rad, between the specific force before and after a segment was bent and returned
SENSOR_TIMEOUT = 1.0  # s without a sample that ends a reading


@dataclass(frozen=True)
class Motion:
    """Samples of a sensor, one row per tick. time, age : (n,) s; accel, gyro : (n, 3) m/s² and rad/s"""

    time: np.ndarray
    accel: np.ndarray
    gyro: np.ndarray
    age: np.ndarray
    rate: float = math.nan  # Hz, of a sensor that counts its samples
    drift: np.ndarray | None = None  # (n,), relative slowness of its clock; None without time stamps


class Samples(Block):
    """Keeps the samples of a sensor."""

    accel = Input("m/s²", "specific force", shape=(3,))
    gyro = Input("rad/s", "angular rate", shape=(3,))
    age = Input("s", "time since the newest sample arrived")
    rate = Input("Hz", "number of samples in the previous second", default=math.nan)
    drift = Input("1", "relative slowness of the sensor's clock", default=math.nan)

    def reset(self):
        self.rows = []

    def step(self, accel, gyro, age, rate, drift, t):
        self.rows.append((t, *accel, *gyro, age, rate, drift))

    def motion(self) -> Motion:
        """Return the samples as a Motion."""
        rows = np.array(self.rows).reshape(-1, 10)
        rate, drift = (rows[-1, 8], rows[:, 9]) if len(rows) else (math.nan, rows[:, 9])
        stamped = None if np.isnan(drift).any() else drift
        return Motion(rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7], float(rate), stamped)


def read(bench: Bench, seconds: float) -> dict[str, Motion]:
    """Return {path: Motion} of every inertial sensor that responds. Nothing is armed but the sensors."""
    sensors = list(bench.sensors)
    while sensors:
        moved, missing = read_those(bench, sensors, seconds)
        if not missing:
            return moved
        sensors = [block for block in sensors if block.path not in missing]
    return {}


def read_those(bench: Bench, sensors: list[Any], seconds: float) -> tuple[dict[str, Motion], set[str]]:
    """Return (Motion of each sensor, paths of those that do not respond, in which case there are no Motions)."""
    kept = {}
    with Diagram("sensors", rate=max(bench.diagram.rate, 2.0 * max(block.rate for block in sensors))) as diagram:
        for block in sensors:
            sensor = copied(block, timeout=SENSOR_TIMEOUT)
            kept[block.path] = Samples(name=f"samples_of_{block.path.replace('/', '_')}")
            kept[block.path](accel=sensor.accel, gyro=sensor.gyro, age=sensor.age)
            for name, port in (("rate", "measured_rate"), ("drift", "clock_drift")):
                if port in sensor.outputs:
                    kept[block.path](**{name: getattr(sensor, port)})
    run = run_on_rig(bench, diagram, math.ceil(seconds * diagram.rate))
    raise_if_of_computer(run)
    if (outcome := run.outcome).faulted:
        return {}, {*outcome.unanswered} or {outcome.culprit or sensors[0].path}
    return {path: each.motion() for path, each in kept.items()}, set()


def copied(block: Any, **changed: Any) -> Any:
    """Return a block with the parameters and the path of another one, in the Diagram that is being made."""
    *folders, name = block.path.split("/")
    with ExitStack() as inside:
        for each in folders:
            inside.enter_context(subsystem(each))
        return type(block)(**{each: getattr(block, each) for each in block.parameters} | changed, name=name)


def rest(bench: Bench, block: Any, given: Given) -> Result:
    """Measure rate, drop-outs, noise and bias of a sensor at rest."""
    ask("Put the robot down or stand still, then press Enter")
    motion = read(bench, REST_TIME).get(block.path)
    silent = Result([], findings=[("silent", "the sensor does not respond")])
    return silent if motion is None else rest_of(block, motion)


def rest_of(block: Any, motion: Motion) -> Result:
    """Compare the Motion of a sensor at rest with what it declares."""
    result = Result()
    arrivals = motion.time[1:][np.diff(motion.age) < 0.0]
    expected = block.rate * (motion.time[-1] - motion.time[0])
    share = len(arrivals) / expected if math.isnan(motion.rate) else motion.rate / block.rate
    strength = float(np.linalg.norm(motion.accel.mean(axis=0)))
    shake, spin = float(motion.accel.std(axis=0).max()), float(motion.gyro.std(axis=0).max())
    bias = float(np.abs(motion.gyro.mean(axis=0)).max())
    result.measured = {"received": share, "gravity": strength, "noise_accel": shake, "noise_gyro": spin, "bias": bias}
    result.says.append(
        f"{share:.0%} of the samples at {block.rate:g} Hz; {strength:.2f} m/s² at rest; noise {shake:.3f} m/s² and "
        f"{spin:.4f} rad/s; bias {bias:.4f} rad/s"
    )
    stamps = motion.time - motion.age
    most = max(share, float((np.diff(stamps) > 0.3 / block.rate).sum()) / expected)  # also with one in each tick
    if most > MORE_SHARE:
        result.find(
            "sample rate",
            f"{most:.0%} of the samples at {block.rate:g} Hz arrived: it has another rate, or a second sensor has its "
            "address",
        )
    elif share < RECEIVED_SHARE:
        slow = len(arrivals) > 2 and float(np.median(np.diff(arrivals))) > SLOW_SHARE / block.rate
        name = "sample rate" if slow else "drop-outs"
        result.find(name, f"{share:.0%} of the samples at {block.rate:g} Hz arrived: check its rate, plug and cable")
    if shake > STILL_ACCEL and alternates(motion.accel):
        result.find("two sensors with one address", "its values at rest alternate between two: give each its own")
    elif shake > STILL_ACCEL or spin > STILL_GYRO:
        result.find("noisy sensor", f"noise of {shake:.2f} m/s² and {spin:.3f} rad/s at rest: check that it is tight")
    elif abs(strength - GRAVITY) > GRAVITY_TOLERANCE:
        result.find("scale of the sensor", f"{strength:.2f} m/s² at rest instead of {GRAVITY:g}: check its full scale")
    elif bias > BIAS:
        result.find("bias of the sensor", f"an angular rate of {bias:.3f} rad/s at rest: tare or calibrate it")
    return result


def alternates(values: np.ndarray) -> bool:
    """Return whether samples at rest are those of two sensors in turn. values : (n, 3)"""
    new = values[np.append(True, np.any(np.diff(values, axis=0), axis=1))]
    along = new @ max(new - new[0], key=np.linalg.norm)
    first = along <= 0.5 * (along.min() + along.max())
    apart = along[~first].mean() - along[first].mean() > 10.0 * max(along[first].std(), along[~first].std())
    often = (first[1:] != first[:-1]).mean() > 0.2
    return bool(len(new) >= 20 and apart and often and 0.2 < first.mean() < 0.8)


def bend(bench: Bench, block: Any, given: Given) -> Result:
    """Compare which sensor turns, its axes and its mounting while the operator bends a segment and returns it."""
    ask(
        f"Stand upright, then press Enter. Once it is running, wait a second, bend only the segment of {block.path} by "
        "45° within 3 s, and hold it"
    )
    out = read(bench, BEND_TIME)
    ask(
        "Press Enter. Once it is running, shake the segment to and fro three times, stand upright again within 6 s, "
        "and stand still"
    )
    return bend_of(block.path, out, read(bench, RETURN_TIME))


def bend_of(path: str, out: dict[str, Motion], back: dict[str, Motion]) -> Result:
    """Compare the Motions of all sensors while one segment was bent, and returned."""
    result = Result()
    if path not in out or path not in back:
        result.find("silent", "the sensor does not respond")
        return result
    if jumps := jumps_of(out[path].drift) or jumps_of(back[path].drift):
        result.find("time stamps", f"{jumps}: update its firmware, or check its clock and its supply")
    turned = {name: between(pose(motion, 0), pose(motion, -1)) for name, motion in out.items()}
    result.measured["turned"] = turned[path]
    result.says.append(f"turned by {math.degrees(turned[path]):.0f}°")
    if turned[path] < BENT:
        others = [name for name, angle in turned.items() if angle > BENT]
        if not others:
            return Result(["no sensor has turned: repeat this step with --again bend"], result.measured, done=False)
        result.find("exchanged", f"{' and '.join(others)} turned instead: exchange the serial numbers or addresses")
        return result
    last = pose(out[path], -1)
    error = between(carried(out[path]), last)
    shift = between(pose(out[path], 0), pose(back[path], -1))
    result.measured |= {"axes_error": error, "shift": shift}
    result.says.append(
        f"the angular rate explains the turn within {math.degrees(error):.1f}°; {math.degrees(shift):.1f}° away after "
        "the return"
    )
    factors = [factor for factor in plausible(out[path]) if between(carried(out[path], factor), last) < AXES_TOLERANCE]
    if error > AXES_TOLERANCE and factors:
        why = f"it is in {UNITS[factors[0]]}" if factors[0] in UNITS else "check its full scale"
        result.find(
            "scale of the sensor",
            f"the angular rate agrees with the specific force only if it is multiplied by {factors[0]:.4g}: {why}",
        )
    elif error > AXES_TOLERANCE and turned_by_rate(out[path]) < NO_RATE * turned[path]:
        result.find("no angular rate", "the angular rate stays at zero while the sensor turns")
    elif error > AXES_TOLERANCE:
        result.find(
            "axes",
            f"the angular rate and the specific force differ by {math.degrees(error):.0f}° after the turn: exchanged "
            "or negated axes, or a loose sensor",
        )
    elif (ringing := max(ringing_of(out[path]), ringing_of(back[path]))) > RINGING:
        result.measured["ringing"] = ringing
        result.find(
            "loose sensor",
            f"the sensor oscillates with {ringing:.1f} rad/s faster than a segment is moved by hand: check its strap "
            "and its housing",
        )
    elif shift > LOOSE:
        result.find(
            "loose sensor",
            f"in the same pose as before, the sensor is turned by {math.degrees(shift):.1f}°: check its strap, and "
            "repeat with --again bend",
        )
    return result


def jumps_of(drift: np.ndarray | None) -> str:
    """Return what shows that the time stamps of a device jump, "" if nothing does.

    drift : (n,), output clock_drift over 5.5 s or more; None without time stamps. A stamp before the newest one begins
        the map of the clock again, which has no drift for 4 s; one ahead of its arrival bends it
    """
    if drift is None:
        return ""
    known = drift != 0.0
    restarts = int(np.sum(known[:-1] & ~known[1:]))
    if restarts or not known[-1]:
        return "its time stamps jump backwards"
    most = float(np.abs(drift).max())
    return f"its time stamps and their arrival drift apart by {most:.1%}, or jump" if most > DRIFT else ""


def pose(motion: Motion, end: int) -> np.ndarray:
    """Return the mean specific force, (3,), at the beginning (0) or the end (-1) of a Motion."""
    held = motion.time <= motion.time[0] + POSE_TIME if end == 0 else motion.time >= motion.time[-1] - POSE_TIME
    return motion.accel[held].mean(axis=0)


def ringing_of(motion: Motion) -> float:
    """Return the angular rate in rad/s (RMS) of an oscillation of the sensor on its segment, 0.0 without one."""
    step = motion.time[1] - motion.time[0]
    smooth, window = (np.ones(n) / n for n in (round(SMOOTH_TIME / step), round(RINGING_TIME / step)))
    slow = np.array([np.convolve(axis, smooth, "same") for axis in motion.gyro.T]).T
    fast, slow = (np.sqrt(np.convolve((rate**2).sum(axis=1), window, "valid")) for rate in (motion.gyro - slow, slow))
    return float(np.where(fast > RINGING_SHARE * slow, fast, 0.0).max())


def plausible(motion: Motion) -> list[float]:
    """Return the factors between scales and units with which a hand could have caused the angular rate."""
    most = float(np.linalg.norm(motion.gyro, axis=1).max())
    return [factor for factor in (*SCALES, *UNITS) if BY_HAND[0] < factor * most < BY_HAND[1]]


def turned_by_rate(motion: Motion) -> float:
    """Return the integral of the angular rate in rad, without its mean in the first pose."""
    bias = motion.gyro[motion.time <= motion.time[0] + POSE_TIME].mean(axis=0)
    return float(np.linalg.norm(np.diff(motion.time) @ (motion.gyro[1:] - bias)))


def between(first: np.ndarray, second: np.ndarray) -> float:
    """Return the angle between two vectors in rad."""
    lengths = float(np.linalg.norm(first) * np.linalg.norm(second))
    return math.acos(max(-1.0, min(1.0, float(first @ second) / lengths))) if lengths else 0.0


def carried(motion: Motion, factor: float = 1.0) -> np.ndarray:
    """Return the first specific force, carried by the angular rate to the last pose: f' = -ω × f. factor : of ω"""
    force, bias = pose(motion, 0), motion.gyro[motion.time <= motion.time[0] + POSE_TIME].mean(axis=0)
    for step, rate in zip(np.diff(motion.time), motion.gyro[1:] - bias):
        turn = -factor * rate * step
        angle = float(np.linalg.norm(turn))
        if angle > 0.0:
            axis = turn / angle
            force = (
                force * math.cos(angle)
                + np.cross(axis, force) * math.sin(angle)
                + axis * float(axis @ force) * (1.0 - math.cos(angle))
            )
    return force
