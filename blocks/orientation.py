"""Orientation of a body from gyroscope, accelerometer and magnetometer, for IMUs that have none on board.

All take what every IMU gives, and give a quaternion (w, x, y, z) that turns what is in the body's axes into the
world's: z up, x to the magnetic north. Without `mag` the heading begins at 0 and drifts. The first sample, and the one
at arming, is taken for one at rest. QuaternionToEuler makes angles of it, RotateVector takes the acceleration into the
world. NaN shows, and is not remembered.
"""

from cext.kernels import orientation as kernels
from graph import Block, Input, Memory, Output, Param


class Ahrs:
    """Ports and memory that they share."""

    gyro = Input("rad/s", "angular rate", shape=(3,))
    accel = Input("m/s²", "specific force", shape=(3,))
    mag = Input("µT", "magnetic field; of length 0 where there is none", shape=(3,), default=(0.0, 0.0, 0.0))
    quaternion = Output("1", "w first, body to world", shape=(4,), range=(-1.0, 1.0))
    state = Memory((0.0,) * 8, "whether it has begun, q, bias of the gyroscope")


class Madgwick(Ahrs, Block):
    """Orientation by gradient descent: q̇ = ½ q ⊗ ω − gain ∇f / |∇f|.   (Madgwick, Harrison, Vaidyanathan 2011)

    f is how far gravity and the magnetic field are from where q says they are; the field's own dip is taken from the
    measurement.
    """

    gain = Param(
        0.1, "rad/s", "at which errors are corrected: √¾ of the gyroscope's error", min=0.0, max=10.0, live=True
    )

    kernel = kernels.madgwick
    settle_kernel = kernels.madgwick_settle


class Mahony(Ahrs, Block):
    """Orientation by a complementary filter on rotations: q̇ = ½ q ⊗ (ω − b + kp e), ḃ = −ki e.   (Mahony, Hamel,
    Pflimlin 2008)

    e is the sum of the cross products of measured and expected directions, of gravity and of the magnetic field; b the
    gyroscope's bias.
    """

    bias = Output("rad/s", "of the gyroscope, estimated", shape=(3,))
    kp = Param(1.0, "1/s", "of errors of orientation", min=0.0, max=100.0, live=True)
    ki = Param(0.02, "1/s²", "of the bias; 0 for none", min=0.0, max=100.0, live=True)

    kernel = kernels.mahony
    settle_kernel = kernels.mahony_settle


class ComplementaryOrientation(Ahrs, Block):
    """Orientation from the gyroscope, drawn to gravity and the magnetic north with one time constant T: a share dt / (T
    + dt) a tick.

    The tilt is corrected about a level axis and the heading about the vertical, so that a disturbed field leaves the
    tilt alone. (Valenti, Dryanovski, Xiao 2015, without their adaptive gain)
    """

    time_constant = Param(2.0, "s", "T: the gyroscope is believed for about as long", above=0.0, max=1000.0)

    kernel = kernels.complementary
    settle_kernel = kernels.complementary_settle
