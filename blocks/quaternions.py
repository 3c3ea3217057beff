"""Quaternions and Euler angles: w first, q = (w, x, y, z), Hamilton's product, right-handed.

Euler angles are yaw, pitch and roll in rad: rotation about z by yaw, then about the new y by pitch, then about the new
x by roll (intrinsic z-y-x; "ZYX" in scipy.spatial.transform.Rotation). All blocks have direct feedthrough and no state;
NaN passes. (Diebel, Representing Attitude: Euler Angles, Unit Quaternions, and Rotation Vectors, 2006.)
"""

from __future__ import annotations

import math

from blocks._plumbing.ranges import total
from cext.kernels import quaternions as kernels
from graph import Block, Input, Interval, Output
from graph.interval import EVERYTHING

HALF_TURN = (math.nextafter(-math.pi, -4.0), math.nextafter(math.pi, 4.0))
QUARTER_TURN = (math.nextafter(-math.pi / 2, -2.0), math.nextafter(math.pi / 2, 2.0))


class QuaternionMultiply(Block):
    """Product of two quaternions: y = p ⊗ q, the rotation by q followed by the rotation by p."""

    p = Input("1", "left factor", shape=(4,))
    q = Input("1", "right factor", shape=(4,))
    y = Output("1", "product p ⊗ q", shape=(4,))

    kernel = kernels.multiply

    def output_range(self, p: Interval, q: Interval) -> Interval:
        product = p * q
        return total([product, -product, -product, -product]) | total([product, product, product, -product])


class QuaternionConjugate(Block):
    """Conjugate of a quaternion: y = (w, −x, −y, −z), for a unit quaternion the inverse rotation."""

    q = Input("1", "quaternion", shape=(4,))
    y = Output("1", "conjugate", shape=(4,))

    kernel = kernels.conjugate

    def output_range(self, q: Interval) -> Interval:
        return q | -q


class RotateVector(Block):
    """Rotation of a vector by a quaternion: y = q ⊗ v ⊗ q⁻¹.

    q is normalised first, as in SciPy; NaN for a zero quaternion. If q is the attitude of a body in the world frame, v
    is in body axes and y in world axes; with the conjugate of q, vice versa.
    """

    q = Input("1", "quaternion", shape=(4,))
    v = Input("any", "vector", shape=(3,))
    y = Output("any", "rotated vector", shape=(3,))

    kernel = kernels.rotate

    def output_range(self, q: Interval, v: Interval) -> Interval:
        farthest = (
            math.sqrt(3.0) * abs(v).high * (1.0 + 1e-14) + 1e-320
        )  # rotation keeps the length, and no element exceeds it
        return Interval(-farthest, farthest) if farthest < 1e307 else EVERYTHING


class QuaternionFromEuler(Block):
    """Unit quaternion of yaw, pitch and roll: intrinsic z-y-x, w first."""

    yaw = Input("rad", "rotation about z, applied first", default=0.0)
    pitch = Input("rad", "rotation about the new y, applied second", default=0.0)
    roll = Input("rad", "rotation about the new x, applied last", default=0.0)
    q = Output("1", "unit quaternion (w, x, y, z)", shape=(4,), range=(-1.0, 1.0))

    kernel = kernels.from_euler


class QuaternionToEuler(Block):
    """Yaw, pitch and roll of a quaternion: intrinsic z-y-x.

    q is normalised first; NaN for a zero quaternion. Within 2e-7 rad of a pitch of ± π/2, where yaw and roll share an
    axis (gimbal lock), roll is 0 and yaw contains both.
    """

    q = Input("1", "quaternion (w, x, y, z)", shape=(4,))
    yaw = Output("rad", "rotation about z, applied first", range=HALF_TURN, circle=(-math.pi, math.pi))
    pitch = Output("rad", "rotation about the new y, applied second", range=QUARTER_TURN)
    roll = Output("rad", "rotation about the new x, applied last", range=HALF_TURN, circle=(-math.pi, math.pi))

    kernel = kernels.to_euler
