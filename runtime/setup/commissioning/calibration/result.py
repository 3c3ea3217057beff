"""Result of a calibration of one IMU, with its figures before and after."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from blocks.imus.calibration import PARTS, Calibration
from runtime.setup.commissioning.calibration import fits, stillness

if TYPE_CHECKING:
    from runtime.setup.commissioning.calibration.measuring import Readings


@dataclass
class Result:
    """Calibration and its residuals.

    calibration : Calibration with the fitted parts
    parts : names of the fitted parts
    missing : {name of another part: reason}
    faces : positions with a rest, such as "+x"
    rates, gravity : (n, 3) rad/s and (n,) m/s² of each rest, before calibration
    field : (m, 3) µT, before calibration
    rates_after, gravity_after, field_after : the same after calibration, None for a part that was not fitted
    """

    calibration: Calibration
    parts: list[str]
    missing: dict[str, str]
    faces: list[str]
    rates: np.ndarray
    gravity: np.ndarray
    field: np.ndarray
    rates_after: np.ndarray | None = None
    gravity_after: np.ndarray | None = None
    field_after: np.ndarray | None = None
    standard_gravity: float = fits.G

    @property
    def strength(self) -> float:
        """Mean strength of the calibrated field, µT."""
        assert self.field_after is not None
        return float(np.linalg.norm(self.field_after, axis=1).mean())

    def lines(self) -> list[str]:
        """Return the lines of the report."""
        lines = []
        if self.rates_after is not None:
            bias = ", ".join(f"{value:+.3f}" for value in np.degrees(self.calibration.gyro_bias))
            before, after = _worst_rate(self.rates), _worst_rate(self.rates_after)
            lines.append(f"  gyroscope      bias {bias} deg/s; at rest {before:.3f} before, {after:.3f} deg/s after")
        if self.gravity_after is not None:
            before, after = (np.abs(gravity - fits.G).max() for gravity in (self.gravity, self.gravity_after))
            lines.append(
                f"  accelerometer  {len(self.gravity)} positions; |a| off by up to {before:.3f} before, "
                f"{after:.4f} m/s² after"
            )
        if self.field_after is not None:
            before, after = (spread(field) for field in (self.field, self.field_after))
            offset = ", ".join(f"{value:+.1f}" for value in self.calibration.mag_offset)
            strength = f"strength {self.strength:.1f} µT, varying by {before:.0%} before, {after:.1%} after"
            lines.append(f"  magnetometer   offset {offset} µT; {strength}")
        return lines + [f"  {part:<14} not calibrated: {why}" for part, why in self.missing.items()]


def _worst_rate(rates: np.ndarray) -> float:
    return float(np.degrees(np.abs(rates).max()))


def spread(field: np.ndarray) -> float:
    """Return the standard deviation of the field strength divided by its mean."""
    strength = np.linalg.norm(field, axis=1)
    return float(strength.std() / strength.mean())


def find(readings: Readings, parts: tuple[str, ...] = tuple(PARTS)) -> Result:
    """Return the Result of calibration.measuring.Readings. parts : names of the parts to calibrate"""
    rests = stillness.rests(readings.time, readings.accel, readings.gyro)
    rates = np.array([rest.gyro for rest in rests]).reshape(-1, 3)
    positions = np.array([rest.accel for rest in rests]).reshape(-1, 3)
    result = Result(
        Calibration(), [], {}, stillness.faces(rests), rates, np.linalg.norm(positions, axis=1), readings.mag
    )

    def attempt(part, fit):
        if part in parts:
            try:
                fit()
                result.parts.append(part)
            except fits.Unfit as error:
                result.missing[part] = str(error)

    def gyroscope():
        bias = fits.gyroscope(rests)
        result.calibration = replace(result.calibration, gyro_bias=tuple(bias.tolist()))
        result.rates_after = rates - bias

    def accelerometer():
        offset, matrix = fits.accelerometer(rests)
        result.calibration = replace(
            result.calibration, accel_offset=tuple(offset.tolist()), accel_matrix=_tuples(matrix)
        )
        result.gravity_after = np.linalg.norm((positions - offset) @ matrix.T, axis=1)

    def magnetometer():
        offset, matrix = fits.magnetometer(readings.mag)
        result.calibration = replace(result.calibration, mag_offset=tuple(offset.tolist()), mag_matrix=_tuples(matrix))
        result.field_after = (readings.mag - offset) @ matrix.T

    for part, fit in (("gyroscope", gyroscope), ("accelerometer", accelerometer), ("magnetometer", magnetometer)):
        attempt(part, fit)
    return result


def _tuples(matrix: np.ndarray):
    return tuple(tuple(row) for row in matrix.tolist())
