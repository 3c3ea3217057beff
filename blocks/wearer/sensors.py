"""Sensors on a walking adult."""

from __future__ import annotations

import math

import numpy as np

from blocks._plumbing.ports import finite_numbers
from cext.kernels.wearer import sensors as kernels
from cext.kernels.wearer import soles
from graph import Block, Input, Memory, Output, Param


class SegmentIMU(Block):
    """Inertial sensor on a segment of a Walker: specific force, angular velocity and attitude.

    f = Rᵀ (a + α × r + ω × (ω × r) − g) + bias + noise, with the acceleration a of the proximal joint and the position
    r of the sensor. Bias and noise are also added to the angular velocity ω. Axes before the mounting error: x forward,
    y right, z down in a straight stand. At rest and upright f is (0, 0, -9.81) m/s². The noise is white, a function of
    seed and tick (Philox 4x64-10); the bias of the gyroscope drifts as a random walk. The attitude is the true one of
    the sensor, relative to north, east, down, with north ahead. Example:
    `SegmentIMU(along=0.2, forward=0.08)(walker.left_thigh_motion)`.
    """

    along = Param(0.0, "m", "distance of the sensor from the proximal joint along the segment")
    forward = Param(0.0, "m", "distance of the sensor in front of the line between the joints")
    mounting = Param((0.0, 0.0, 0.0), "rad", "roll, pitch and yaw of the sensor relative to the segment")
    accel_bias = Param((0.0, 0.0, 0.0), "m/s²", "bias of the accelerometer")
    gyro_bias = Param((0.0, 0.0, 0.0), "rad/s", "bias of the gyroscope at t = 0")
    accel_noise = Param(0.0, "m/s²", "standard deviation of a sample of the accelerometer", min=0.0)
    gyro_noise = Param(0.0, "rad/s", "standard deviation of a sample of the gyroscope", min=0.0)
    gyro_drift = Param(0.0, "rad/s", "standard deviation of the gyroscope's bias drift after one second", min=0.0)
    seed = Param(0, "1", "seed of noise and drift", min=0, max=2**53, fixed=True)

    motion = Input("any", "motion of the segment, an output of a Walker such as `left_thigh_motion`", shape=(9,))
    accel = Output("m/s²", "specific force", shape=(3,))
    gyro = Output("rad/s", "angular velocity", shape=(3,))
    quaternion = Output("1", "attitude relative to north, east, down, w first", shape=(4,))
    rotation = Memory((0.0,) * 13, "rotation of the sensor in the segment, as matrix and quaternion")
    accel_offset = Memory((0.0,) * 3, "zero of the accelerometer")
    gyro_offset = Memory((0.0,) * 3, "zero of the gyroscope")
    drift = Memory((0.0,) * 3, "drift of the gyroscope")

    kernel = kernels.segment_imu

    def configure(self) -> None:
        for name in ("mounting", "accel_bias", "gyro_bias"):
            if len(finite_numbers(name, getattr(self, name))) != 3:
                raise ValueError(f"{name} must have three numbers, got {getattr(self, name)!r}")
        w, x, y, z = q = from_roll_pitch_yaw(*self.mounting)
        matrix = (
            (w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
            (2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)),
            (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z),
        )
        self.rotation = np.array([*np.ravel(matrix), *q])
        self.accel_offset, self.gyro_offset = self.accel_bias, self.gyro_bias


class SoleForce(Block):
    """Force sensors under a foot of a Walker: total, heel and forefoot force and the centre of pressure.

    The vertical force is divided between heel and forefoot so that its centre is the Walker's centre of pressure, as
    far as that lies between the two sensors. The forces have an offset, drift and white noise, a function of seed
    and tick. During a drop-out all read no load; the duration of drop-outs has a geometric distribution. Connect
    `force` and `centre` to an EmulatedInsole, `heel` and `forefoot` to single sensors such as an EmulatedFSR.
    """

    length = Param(0.258, "m", "length of the foot, 0.152 of the body height", above=0.0)
    heel_at = Param(0.15, "1", "distance of the heel sensor from the heel, in lengths of the foot", min=0.0, max=0.4)
    forefoot_at = Param(0.75, "1", "distance of the forefoot sensor, in the same unit", min=0.5, max=1.0)
    forefoot_strike = Param(0.0, "1", "1 for a wearer who lands on the forefoot, 0 on the heel", min=0.0, max=1.0)
    gain = Param(1.0, "1", "ratio of measured to true force", min=0.0)
    zero = Param(0.0, "N", "total force that is measured without a load")
    zero_drift = Param(0.0, "N/s", "drift of the zero", fixed=True)
    noise = Param(0.0, "N", "standard deviation of a sample of the total force", min=0.0)
    dropped = Param(0.0, "1", "share of time in drop-outs", min=0.0, max=1.0)
    dropout = Param(0.0, "s", "mean duration of a drop-out; 0 for single samples", min=0.0)
    seed = Param(0, "1", "seed of noise and drop-outs", min=0, max=2**53, fixed=True)

    ground_force = Input("N", "ground force, forward and up, such as `left_ground_force` of a Walker", shape=(2,))
    centre_of_pressure = Input("m", "centre of pressure from the heel, such as `left_centre_of_pressure`")
    phase = Input("1", "gait phase of the leg, such as `left_phase`", default=0.5)
    force = Output("N", "vertical force")
    centre = Output("m", "centre of pressure from the heel")
    heel = Output("N", "force under the heel")
    forefoot = Output("N", "force under the forefoot")
    drift = Memory(0.0, "drift of the zero")
    lost = Memory(0.0, "1 during a drop-out")

    kernel = soles.sole_force


def from_roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion, w first, of intrinsic rotations about z, y and x, in rad."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(0.5 * each), math.sin(0.5 * each)) for each in (roll, pitch, yaw))
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
