import math

import numpy as np
import pytest

from messages import Quaternion
from perception import so3

HALF = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("q", "turned_x"),
    [
        (so3.IDENTITY, (1.0, 0.0, 0.0)),
        ((HALF, 0.0, 0.0, HALF), (0.0, 1.0, 0.0)),  # +90° about z takes x to y
        ((HALF, 0.0, HALF, 0.0), (0.0, 0.0, -1.0)),  # +90° about y takes x to −z
        ((HALF, HALF, 0.0, 0.0), (1.0, 0.0, 0.0)),
    ],
)
def test_quaternions_turn_by_the_right_hand(q: Quaternion, turned_x: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(so3.matrix_from_quaternion(q)[:, 0], turned_x, atol=1e-15)


def test_product_applies_the_right_factor_first() -> None:
    about_z, about_x = (HALF, 0.0, 0.0, HALF), (HALF, HALF, 0.0, 0.0)
    R = so3.matrix_from_quaternion(so3.multiply(about_x, about_z))
    np.testing.assert_allclose(R @ (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), atol=1e-15)


def test_half_turns_and_tiny_turns_keep_their_axis() -> None:
    for axis in np.eye(3):
        np.testing.assert_allclose(np.abs(so3.log(so3.exp(math.pi * axis))), math.pi * axis, atol=1e-9)
        np.testing.assert_allclose(so3.log(so3.exp(1e-9 * axis)), 1e-9 * axis, rtol=1e-6, atol=1e-18)


def test_positive_and_normalised() -> None:
    assert so3.positive((-0.5, 0.5, -0.5, 0.5)) == (0.5, -0.5, 0.5, -0.5)
    assert so3.positive((0.0, -1.0, 0.0, 0.0)) == (0.0, -1.0, 0.0, 0.0)
    assert so3.normalised((2.0, 0.0, 0.0, 0.0)) == (1.0, 0.0, 0.0, 0.0)
    with pytest.raises(ZeroDivisionError):
        so3.normalised((0.0, 0.0, 0.0, 0.0))


def test_half_way_between_identity_and_a_quarter_turn_is_an_eighth() -> None:
    np.testing.assert_allclose(
        so3.slerp(so3.IDENTITY, (HALF, 0.0, 0.0, HALF), 0.5),
        (math.cos(math.pi / 8), 0.0, 0.0, math.sin(math.pi / 8)),
        atol=1e-15,
    )
