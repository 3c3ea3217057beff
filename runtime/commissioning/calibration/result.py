"""What was found of one IMU: its Calibration, and the figures of before and after."""

from dataclasses import dataclass, replace

import numpy as np

from blocks.imus.calibration import PARTS, Calibration
from runtime.commissioning.calibration import fits, stillness


@dataclass
class Found:
    """
    calibration : with the parts that were found; parts : their names
    missing : {part: why it was not found}
    rates, gravity, field : before, rad/s of each rest, m/s² of each rest, µT; the same `_after`, None where it was not
        found
    """

    calibration: Calibration
    parts: list
    missing: dict
    faces: list
    rates: np.ndarray
    gravity: np.ndarray
    field: np.ndarray
    rates_after: np.ndarray | None = None
    gravity_after: np.ndarray | None = None
    field_after: np.ndarray | None = None
    standard_gravity: float = fits.G

    @property
    def strength(self):
        """µT of the field, after."""
        assert self.field_after is not None
        return float(np.linalg.norm(self.field_after, axis=1).mean())

    def lines(self):
        """In words and numbers."""
        said = []
        if self.rates_after is not None:
            bias = ", ".join(f"{value:+.3f}" for value in np.degrees(self.calibration.gyro_bias))
            before, after = worst_rate(self.rates), worst_rate(self.rates_after)
            said.append(f"  gyroscope      bias {bias} deg/s; at rest {before:.3f} before, {after:.3f} deg/s after")
        if self.gravity_after is not None:
            before, after = (np.abs(gravity - fits.G).max() for gravity in (self.gravity, self.gravity_after))
            said.append(
                f"  accelerometer  {len(self.gravity)} positions; |a| off by up to {before:.3f} before, "
                f"{after:.4f} m/s² after"
            )
        if self.field_after is not None:
            before, after = (spread(field) for field in (self.field, self.field_after))
            offset = ", ".join(f"{value:+.1f}" for value in self.calibration.mag_offset)
            strength = f"strength {self.strength:.1f} µT, varying by {before:.0%} before, {after:.1%} after"
            said.append(f"  magnetometer   offset {offset} µT; {strength}")
        return said + [f"  {part:<14} not calibrated: {why}" for part, why in self.missing.items()]


def worst_rate(rates):
    return float(np.degrees(np.abs(rates).max()))


def spread(field):
    """Standard deviation of the strength, as a share of it."""
    strength = np.linalg.norm(field, axis=1)
    return float(strength.std() / strength.mean())


def find(readings, wanted=tuple(PARTS)):
    """The Found of runtime.commissioning.calibration.measuring.Readings. wanted : parts that shall be calibrated"""
    rests = stillness.rests(readings.time, readings.accel, readings.gyro)
    rates = np.array([rest.gyro for rest in rests]).reshape(-1, 3)
    positions = np.array([rest.accel for rest in rests]).reshape(-1, 3)
    found = Found(Calibration(), [], {}, stillness.faces(rests), rates, np.linalg.norm(positions, axis=1), readings.mag)

    def attempt(part, fit):
        if part in wanted:
            try:
                fit()
                found.parts.append(part)
            except fits.Unfit as error:
                found.missing[part] = str(error)

    def gyroscope():
        bias = fits.gyroscope(rests)
        found.calibration = replace(found.calibration, gyro_bias=tuple(bias.tolist()))
        found.rates_after = rates - bias

    def accelerometer():
        offset, matrix = fits.accelerometer(rests)
        found.calibration = replace(found.calibration, accel_offset=tuple(offset.tolist()), accel_matrix=tuples(matrix))
        found.gravity_after = np.linalg.norm((positions - offset) @ matrix.T, axis=1)

    def magnetometer():
        offset, matrix = fits.magnetometer(readings.mag)
        found.calibration = replace(found.calibration, mag_offset=tuple(offset.tolist()), mag_matrix=tuples(matrix))
        found.field_after = (readings.mag - offset) @ matrix.T

    for part, fit in (("gyroscope", gyroscope), ("accelerometer", accelerometer), ("magnetometer", magnetometer)):
        attempt(part, fit)
    return found


def tuples(matrix):
    return tuple(tuple(row) for row in matrix.tolist())
