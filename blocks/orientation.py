"""Orientation filters from gyroscope, accelerometer and magnetometer, for IMUs without an estimate on board.

Inputs are the outputs of every IMU. The output is a quaternion (w, x, y, z) that rotates vectors from body axes to the
world frame: z up, x towards magnetic north. If `mag` is not connected, the heading starts at 0 and drifts. The first
sample, and the one at arming, is assumed to be at rest. QuaternionToEuler converts to angles, RotateVector rotates the
acceleration to the world frame. NaN passes and is not stored.
"""

from cext.kernels import orientation as kernels
from graph import Block, Input, Memory, Output, Param


class Ahrs:
    """Common ports and memory of the orientation filters."""

    gyro = Input("rad/s", "angular rate", shape=(3,))
    accel = Input("m/s²", "specific force", shape=(3,))
    mag = Input("µT", "magnetic field; zero if not available", shape=(3,), default=(0.0, 0.0, 0.0))
    quaternion = Output("1", "orientation, body to world, w first", shape=(4,), range=(-1.0, 1.0))
    state = Memory((0.0,) * 8, "1 after the first sample, quaternion q, gyroscope bias")


class Madgwick(Ahrs, Block):
    """Orientation by gradient descent: q̇ = ½ q ⊗ ω − gain ∇f / |∇f|.   (Madgwick, Harrison, Vaidyanathan 2011)

    f is the difference between the measured directions of gravity and magnetic field and those predicted by q, and
    ∇f = Jᵀ f with its Jacobian J. The dip of the field is taken from the measurement. Direct feedthrough; NaN passes
    and is not stored.
    """

    gain = Param(0.1, "rad/s", "correction rate: √¾ of the gyroscope error", min=0.0, max=10.0, live=True)

    kernel = kernels.madgwick
    settle_kernel = kernels.madgwick_settle


class Mahony(Ahrs, Block):
    """Complementary filter on rotations: q̇ = ½ q ⊗ (ω − b + kp e), ḃ = −ki e.   (Mahony, Hamel, Pflimlin 2008)

    e is the sum of the cross products of the measured and predicted directions of gravity and the magnetic field; b is
    the gyroscope bias. Direct feedthrough; NaN passes and is not stored.
    """

    bias = Output("rad/s", "estimated gyroscope bias", shape=(3,))
    kp = Param(1.0, "1/s", "gain of the orientation correction", min=0.0, max=100.0, live=True)
    ki = Param(0.02, "1/s²", "gain of the bias estimate; 0 disables it", min=0.0, max=100.0, live=True)

    kernel = kernels.mahony
    settle_kernel = kernels.mahony_settle


class ComplementaryOrientation(Ahrs, Block):
    """Complementary orientation filter: corrects dt / (T + dt) of the error per tick.   (Valenti et al. 2015)

    The gyroscope is integrated and corrected towards gravity and magnetic north, without the adaptive gain of the
    paper. The tilt is corrected about a horizontal axis and the heading about the vertical, so a disturbed magnetic
    field does not affect the tilt. Direct feedthrough; NaN passes and is not stored.
    """

    time_constant = Param(2.0, "s", "time constant T, up to which the gyroscope dominates", above=0.0, max=1000.0)

    kernel = kernels.complementary
    settle_kernel = kernels.complementary_settle
