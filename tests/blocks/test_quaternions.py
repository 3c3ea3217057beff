"""Quaternions and Euler angles against SciPy's rotations: w first, intrinsic z-y-x."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from blocks.quaternions import (
    QuaternionConjugate,
    QuaternionFromEuler,
    QuaternionMultiply,
    QuaternionToEuler,
    RotateVector,
)
from blocks.sources import Constant
from graph import Diagram, DiagramError, Interval, compile
from tests.blocks.proofs import anything, keeps_its_range, sensible

angles = st.floats(-math.pi, math.pi)
elements = st.lists(sensible, min_size=4, max_size=4).map(np.array).filter(lambda q: np.linalg.norm(q) > 1e-3)
vectors = st.lists(sensible, min_size=3, max_size=3).map(np.array)


def scipys(q):
    """SciPy's rotation of a quaternion with w first, whatever the version's own order of elements."""
    return Rotation.from_quat([q[1], q[2], q[3], q[0]])


def w_first(rotation):
    x, y, z, w = rotation.as_quat()
    return np.array([w, x, y, z])


def same_rotation(p, q, within):
    """q and -q turn alike."""
    return min(np.abs(p - q).max(), np.abs(p + q).max()) < within


@given(elements, elements)
def test_a_product_turns_by_the_second_first(p, q):
    unit_p, unit_q = p / np.linalg.norm(p), q / np.linalg.norm(q)
    assert same_rotation(QuaternionMultiply().step(unit_p, unit_q), w_first(scipys(p) * scipys(q)), 1e-14)


def test_quaternion_units_multiply_by_hamiltons_rules():
    one, i, j, k = np.eye(4)
    product = QuaternionMultiply()
    for a, b, wanted in (
        (i, i, -one),
        (j, j, -one),
        (k, k, -one),
        (i, j, k),
        (j, k, i),
        (k, i, j),
        (j, i, -k),
        (one, k, k),
    ):
        assert np.array_equal(product.step(a, b), wanted)


@given(elements)
def test_the_conjugate_is_the_inverse_rotation(q):
    assert np.array_equal(QuaternionConjugate().step(q), q * [1.0, -1.0, -1.0, -1.0])
    unit = q / np.linalg.norm(q)
    assert QuaternionMultiply().step(unit, QuaternionConjugate().step(unit)) == pytest.approx(
        [1.0, 0.0, 0.0, 0.0], abs=1e-15
    )


@given(elements, vectors)
def test_a_vector_is_turned_as_scipy_turns_it_and_keeps_its_length(q, v):
    y = RotateVector().step(q, v)
    assert y == pytest.approx(scipys(q).apply(v), rel=1e-13, abs=1e-13)
    assert np.linalg.norm(y) == pytest.approx(np.linalg.norm(v), rel=1e-14, abs=1e-300)


def test_a_quarter_turn_about_z_takes_x_to_y():
    q = np.array([math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4)])
    assert RotateVector().step(q, np.array([1.0, 0.0, 0.0])) == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)


@pytest.mark.parametrize("scale", [1e-320, 1e-200, 3.0, 1e200, 1e308])
def test_quaternions_are_normalised(scale):
    q, v = np.array([1.0, -0.5, 0.25, 0.75]), np.array([1.0, 2.0, 3.0])
    within = 1e-13 if scale > 1e-300 else 1e-3  # a subnormal number has few digits
    assert RotateVector().step(scale * q, v) == pytest.approx(RotateVector().step(q, v), rel=within)
    assert QuaternionToEuler().step(scale * q) == pytest.approx(QuaternionToEuler().step(q), rel=within)


@given(angles, st.floats(-math.pi / 2, math.pi / 2), angles)
def test_euler_angles_become_the_quaternion_of_scipy(yaw, pitch, roll):
    q = QuaternionFromEuler().step(yaw, pitch, roll)
    assert same_rotation(q, w_first(Rotation.from_euler("ZYX", [yaw, pitch, roll])), 1e-14)
    assert np.linalg.norm(q) == pytest.approx(1.0, rel=1e-15)


@given(angles, st.floats(-1.57, 1.57), angles)
def test_euler_angles_round_trip(yaw, pitch, roll):
    """Within 1e-11 rad up to 1.57 rad of pitch, 0.8 mrad from the gimbal lock."""
    found = QuaternionToEuler().step(QuaternionFromEuler().step(yaw, pitch, roll))
    turned = [math.remainder(a - b, 2.0 * math.pi) for a, b in zip(found, (yaw, pitch, roll))]
    assert turned == pytest.approx([0.0, 0.0, 0.0], abs=1e-11)


@pytest.mark.filterwarnings("ignore:Gimbal lock")
@given(elements)
def test_euler_angles_are_those_of_scipy(q):
    """Within 1e-9 rad, away from the gimbal lock."""
    yaw, pitch, roll = scipys(q).as_euler("ZYX")
    assume(abs(abs(pitch) - math.pi / 2) > 1e-3)
    found = QuaternionToEuler().step(q)
    assert [math.remainder(a - b, 2.0 * math.pi) for a, b in zip(found, (yaw, pitch, roll))] == pytest.approx(
        [0.0, 0.0, 0.0], abs=1e-9
    )


@given(angles, angles, st.sampled_from([-math.pi / 2, math.pi / 2]))
def test_at_gimbal_lock_roll_is_zero_and_the_rotation_is_equal(yaw, roll, pitch):
    """Within 1e-7: where yaw and roll are one turn, the angles still are those of the quaternion."""
    q = QuaternionFromEuler().step(yaw, pitch, roll)
    found = QuaternionToEuler().step(q)
    assert found[1] == pytest.approx(pitch, abs=1e-7) and found[2] == 0.0
    assert same_rotation(QuaternionFromEuler().step(*found), q, 1e-7)


def test_one_angle_at_a_time_turns_about_its_axis():
    for place, axis in ((0, 3), (1, 2), (2, 1)):
        given_angles = [0.0, 0.0, 0.0]
        given_angles[place] = 0.3
        q = QuaternionFromEuler().step(*given_angles)
        wanted = np.zeros(4)
        wanted[[0, axis]] = math.cos(0.15), math.sin(0.15)
        assert q == pytest.approx(wanted, abs=1e-16)
        assert QuaternionToEuler().step(q)[place] == pytest.approx(0.3, abs=1e-15)


@pytest.mark.parametrize("element", range(4))
@pytest.mark.parametrize("broken", [math.nan, math.inf, -math.inf])
def test_nan_or_infinity_in_one_element_is_nan_in_every_output(element, broken):
    q = np.array([1.0, 0.5, 0.25, 0.125])
    q[element] = broken
    assert np.all(np.isnan(RotateVector().step(q, np.array([1.0, 2.0, 3.0]))))
    assert all(map(math.isnan, QuaternionToEuler().step(q)))
    if math.isnan(broken):
        assert np.all(np.isnan(QuaternionMultiply().step(q, np.array([1.0, 1.0, 1.0, 1.0]))))


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("broken", [math.nan, math.inf])
def test_nan_angle_returns_nan_in_every_element(place, broken):
    three = [0.1, 0.2, 0.3]
    three[place] = broken
    assert np.all(np.isnan(QuaternionFromEuler().step(*three)))


def test_a_zero_quaternion_turns_nothing_and_is_nan():
    assert np.all(np.isnan(RotateVector().step(np.zeros(4), np.ones(3)))) and math.isnan(
        QuaternionToEuler().step(np.zeros(4))[0]
    )


def test_angles_in_degrees_do_not_compile():
    with Diagram("d", rate=100) as diagram:
        QuaternionFromEuler()(yaw=Constant(90.0, unit="deg")())
    with pytest.raises(DiagramError, match="expected rad, got deg"):
        compile(diagram)


KINDS = [QuaternionMultiply, QuaternionConjugate, RotateVector, QuaternionFromEuler, QuaternionToEuler]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@given(data=st.data())
def test_no_output_leaves_its_range(kind, data):
    keeps_its_range(data, kind(), nan=True, ticks=3, numbers=anything | sensible | st.floats(-1.0, 1.0))


@given(st.lists(st.sampled_from([0.0, 0.25 * math.pi, 0.5 * math.pi, math.pi, -math.pi, 1e5]), min_size=3, max_size=3))
def test_a_quaternion_of_angles_never_leaves_one_by_rounding(three):
    assert np.abs(QuaternionFromEuler().step(*three)).max() <= 1.0


def test_a_turned_vector_is_bounded_by_its_length():
    """Within 1e-13."""
    found = RotateVector().output_range(Interval(-1.0, 1.0), Interval(-2.0, 1.0))
    assert (found.low, found.high) == pytest.approx((-2.0 * math.sqrt(3.0), 2.0 * math.sqrt(3.0)), rel=1e-13)


def test_a_rotation_that_overflows_has_no_proved_range():
    huge, q = 1e308, np.array([1.0, 1.0, 1.0, 1.0])
    assert not np.all(np.isfinite(RotateVector().step(q, np.array([huge, -huge, huge]))))
    assert RotateVector().output_range(Interval(-1.0, 1.0), Interval(-huge, huge)) == Interval()
