import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from messages import Quaternion, Vec3
from perception import so3

components = st.floats(-1.0, 1.0)
vectors = st.tuples(components, components, components)
angles = st.one_of(st.floats(0.0, math.pi - 1e-6), st.floats(0.0, 1e-3), st.floats(3.1, math.pi - 1e-6))


@st.composite
def rotvecs(draw: st.DrawFn) -> Vec3:
    x, y, z = draw(vectors.filter(lambda v: math.hypot(*v) > 0.1))
    scale = draw(angles) / math.hypot(x, y, z)
    return (scale * x, scale * y, scale * z)


quaternions = rotvecs().map(so3.quaternion_from_rotvec)


def scipys(q: Quaternion) -> Rotation:
    w, x, y, z = q
    return Rotation.from_quat((x, y, z, w))


@given(rotvecs())
def test_exp_is_the_matrix_exponential_and_log_its_inverse(rotvec: Vec3) -> None:
    R = so3.exp(np.array(rotvec))
    np.testing.assert_allclose(R, expm(so3.skew(np.array(rotvec))), atol=1e-11)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(so3.log(R), rotvec, atol=1e-7)


@given(st.lists(rotvecs(), min_size=1, max_size=5))
@example([(1e-3, 0.0, 0.0), (1.0001e-3, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_matrices_of_many_rotation_vectors_are_those_of_each(many: list[Vec3]) -> None:
    each = [so3.exp(np.array(rotvec)) for rotvec in many]
    np.testing.assert_allclose(so3.matrices_from_rotvecs(np.array(many)), each, rtol=0.0, atol=2e-15)


@given(vectors, vectors)
def test_skew_is_the_cross_product(u: Vec3, v: Vec3) -> None:
    np.testing.assert_allclose(so3.skew(np.array(u)) @ v, np.cross(u, v), atol=1e-14)


@given(quaternions, quaternions, vectors)
def test_products_compose_rotations(p: Quaternion, q: Quaternion, v: Vec3) -> None:
    product = so3.multiply(p, q)
    assert math.isclose(math.hypot(*product), 1.0, abs_tol=1e-12)
    np.testing.assert_allclose(scipys(p).apply(scipys(q).apply(v)), scipys(product).apply(v), atol=1e-12)
    np.testing.assert_allclose(so3.multiply(product, so3.conjugate(product)), so3.IDENTITY, atol=1e-12)
    np.testing.assert_allclose(so3.transform(so3.rows_from_quaternion(p), v), scipys(p).apply(v), atol=1e-12)
    np.testing.assert_allclose(so3.matrix_from_quaternion(p) @ v, scipys(p).apply(v), atol=1e-12)


@given(rotvecs())
def test_quaternion_rotation_vector_and_matrix_are_the_same_rotation(rotvec: Vec3) -> None:
    q = so3.quaternion_from_rotvec(rotvec)
    np.testing.assert_allclose(so3.rotvec_from_quaternion(q), rotvec, atol=1e-9)
    there_and_back = so3.quaternion_from_matrix(so3.matrix_from_quaternion(q))
    assert there_and_back[0] >= 0.0
    np.testing.assert_allclose(there_and_back, so3.positive(q), atol=1e-9)


@given(quaternions, rotvecs(), st.floats(-0.5, 1.5))
def test_slerp_turns_evenly_about_one_axis(p: Quaternion, rotvec: Vec3, share: float) -> None:
    q = so3.multiply(p, so3.quaternion_from_rotvec(rotvec))
    between = so3.slerp(p, q, share)
    assert between[0] >= 0.0
    expected = scipys(p) * Rotation.from_rotvec(share * np.array(rotvec))
    assert (expected.inv() * scipys(between)).magnitude() < 1e-6
    negated: Quaternion = (-q[0], -q[1], -q[2], -q[3])
    np.testing.assert_allclose(so3.slerp(p, negated, share), between, atol=1e-9)


@given(vectors.filter(lambda v: math.hypot(*v) > 1e-3))
@example((0.0, 1.0241374664820736e-05, -1.0))
def test_up_points_up_by_the_shortest_way(up_B: Vec3) -> None:
    R_WB = so3.matrix_from_quaternion(so3.quaternion_from_up(up_B))
    up = np.array(up_B) / math.hypot(*up_B)
    np.testing.assert_allclose(R_WB @ up, (0.0, 0.0, 1.0), atol=1e-6)
    angle = float(np.linalg.norm(so3.log(R_WB)))
    assert math.isclose(angle, math.acos(np.clip(up[2], -1.0, 1.0)), abs_tol=1e-4)


def test_up_may_point_straight_down_but_not_be_zero() -> None:
    np.testing.assert_allclose(
        so3.matrix_from_quaternion(so3.quaternion_from_up((0.0, 0.0, -9.8))) @ (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
    )
    with pytest.raises(ValueError, match="up_B is the zero vector"):
        so3.quaternion_from_up((0.0, 0.0, 0.0))
