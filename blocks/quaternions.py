"""Quaternions and Euler angles: w first, q = (w, x, y, z), Hamilton's product, right-handed.

Euler angles are yaw, pitch and roll in rad: turn about z by yaw, then about the new y by pitch, then about the newest x
by roll (intrinsic z-y-x; "ZYX" in scipy.spatial.transform.Rotation). All blocks have direct feedthrough and no state;
NaN passes. (Diebel, Representing Attitude: Euler Angles, Unit Quaternions, and Rotation Vectors, 2006.)
"""

import math

from blocks._plumbing.ranges import total
from cext.kernels import quaternions as kernels
from graph import Block, Input, Interval, Output
from graph.interval import EVERYTHING

HALF_TURN = (math.nextafter(-math.pi, -4.0), math.nextafter(math.pi, 4.0))
QUARTER_TURN = (math.nextafter(-math.pi / 2, -2.0), math.nextafter(math.pi / 2, 2.0))


class QuaternionMultiply(Block):
    """Product of two quaternions: y = p ⊗ q, which turns by q first and by p then."""

    p = Input("1", "left factor", shape=(4,))
    q = Input("1", "right factor", shape=(4,))
    y = Output("1", "p ⊗ q", shape=(4,))

    kernel = kernels.multiply

    def output_range(self, p, q):
        product = p * q
        return total([product, -product, -product, -product]) | total([product, product, product, -product])


class QuaternionConjugate(Block):
    """Conjugate of a quaternion: y = (w, −x, −y, −z), for a unit quaternion the inverse rotation."""

    q = Input("1", "quaternion", shape=(4,))
    y = Output("1", "its conjugate", shape=(4,))

    kernel = kernels.conjugate

    def output_range(self, q):
        return q | -q


class RotateVector(Block):
    """Turns a vector by a quaternion: y = q ⊗ v ⊗ q⁻¹. q is normalised first, as SciPy does; NaN for a zero quaternion.

    Where q is the attitude of a body in the world, v in the body's axes becomes y in the world's; with the conjugate,
    the other way round.
    """

    q = Input("1", "quaternion", shape=(4,))
    v = Input("any", "vector", shape=(3,))
    y = Output("any", "the vector, turned", shape=(3,))

    kernel = kernels.rotate

    def output_range(self, q, v):
        farthest = math.sqrt(3.0) * abs(v).high * (1.0 + 1e-14) + 1e-320  # the length is kept, and no element is longer
        return Interval(-farthest, farthest) if farthest < 1e307 else EVERYTHING


class QuaternionFromEuler(Block):
    """Unit quaternion of yaw, pitch and roll: intrinsic z-y-x, w first."""

    yaw = Input("rad", "about z, first", default=0.0)
    pitch = Input("rad", "about the new y, second", default=0.0)
    roll = Input("rad", "about the newest x, last", default=0.0)
    q = Output("1", "unit quaternion (w, x, y, z)", shape=(4,), range=(-1.0, 1.0))

    kernel = kernels.from_euler


class QuaternionToEuler(Block):
    """Yaw, pitch and roll of a quaternion: intrinsic z-y-x. q is normalised first; NaN for a zero quaternion.

    Within 1e-7 of a pitch of ± π/2, where yaw and roll turn about one axis (gimbal lock), roll is 0 and yaw holds both.
    """

    q = Input("1", "quaternion (w, x, y, z)", shape=(4,))
    yaw = Output("rad", "about z, first: -π to π", range=HALF_TURN, circle=(-math.pi, math.pi))
    pitch = Output("rad", "about the new y, second: -π/2 to π/2", range=QUARTER_TURN)
    roll = Output("rad", "about the newest x, last: -π to π", range=HALF_TURN, circle=(-math.pi, math.pi))

    kernel = kernels.to_euler
