"""Pendulum inertia: what is swung is found again, and errors are carried through."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance.body.pendulum import (
    centre_of_lines,
    centre_of_pairs,
    compound_inertia,
    period_of,
    planar_tensor,
    rod_inertia,
    torsional_inertia,
)
from impedance.identification.propagation import propagated

sizes = st.floats(0.05, 5.0)


@given(sizes, sizes, sizes)
def test_a_compound_pendulum_gives_back_its_moment(mass_kg: float, length_m: float, moment_kgm2: float) -> None:
    about_axis = moment_kgm2 + mass_kg * length_m**2
    period_s = 2.0 * np.pi * np.sqrt(about_axis / (mass_kg * 9.81 * length_m))
    assert compound_inertia(period_s, mass_kg, length_m, 9.81) == pytest.approx(
        moment_kgm2, rel=1e-6, abs=1e-9 * about_axis
    )


@given(st.floats(0.1, 2.0), st.floats(0.1, 2.0), st.floats(-0.9, 0.9), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_tensor_and_centre_come_back(xx: float, zz: float, share: float, x: float, z: float) -> None:
    xz = share * np.sqrt(xx * zz)
    beta = np.array([0.2, 1.1, 2.3, 4.0])
    axis = np.column_stack((np.cos(beta), -np.sin(beta)))
    moments = np.einsum("ni,ij,nj->n", axis, np.array([[xx, xz], [xz, zz]]), axis)
    np.testing.assert_allclose(planar_tensor(beta, moments), (xx, xz, zz), atol=1e-9)
    distance = -(x * np.sin(beta) + z * np.cos(beta))
    np.testing.assert_allclose(centre_of_lines(beta, distance), (x, z), atol=1e-9)
    np.testing.assert_allclose(centre_of_pairs(beta, distance), (x, z), atol=1e-9)


def test_orientations_that_do_not_determine_it_are_refused() -> None:
    with pytest.raises(ValueError, match="do not determine"):
        planar_tensor(np.array([0.3, 0.3, 1.0]), np.ones(3))


def test_propagation_is_the_linear_one() -> None:
    found = propagated(lambda x: np.array([x[0] * x[1], x[0]]), np.array([2.0, 3.0, 1.0]), np.array([0.1, 0.2, 0.0]))
    np.testing.assert_allclose(found.value, (6.0, 2.0))
    np.testing.assert_allclose(found.covariance, [[0.25, 0.03], [0.03, 0.01]], rtol=1e-6)
    rod = rod_inertia(5.56, 1.05, 0.015)
    assert rod == pytest.approx(5.56 * (1.05**2 / 12 + 0.015**2 / 4))
    assert torsional_inertia(np.array([1.0]), 2.0, rod)[0] == pytest.approx(rod / 4)


def test_the_period_of_a_decaying_swing_is_found_within_its_error() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(5000) / 500.0
    clean = 0.7 + np.exp(-0.05 * t) * np.sin(2.0 * np.pi * t / 1.5903 + 0.4)
    off = []
    for _ in range(20):
        period_s, deviation_s = period_of(clean + 0.05 * rng.standard_normal(5000), 500.0)
        off.append((period_s - 1.5903) / deviation_s)
    assert np.abs(off).max() < 4.0
    assert 0.5 < np.std(off) < 1.6
    with pytest.raises(ValueError, match="two periods"):
        period_of(clean[:500], 500.0)
