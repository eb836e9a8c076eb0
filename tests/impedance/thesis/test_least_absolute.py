"""The interior-point solver of least absolute deviations against linear programming and against known answers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from impedance.thesis.least_absolute import _factored, least_absolute


def _by_linear_programming(X: np.ndarray, y: np.ndarray, up: np.ndarray, down: np.ndarray) -> float:
    n, k = X.shape
    found = linprog(
        np.concatenate([np.zeros(k), up, down]),
        A_eq=np.hstack([X, np.eye(n), -np.eye(n)]),
        b_eq=y,
        bounds=[(None, None)] * k + [(0, None)] * (2 * n),
    )
    assert found.fun is not None
    return float(found.fun)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(12, 80), st.booleans())
def test_cost_is_that_of_linear_programming(seed: int, k: int, n: int, lopsided: bool) -> None:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, k)) * 10.0 ** rng.uniform(-3, 3, k)
    y = rng.standard_cauchy(n)
    up = rng.uniform(0.5, 2.0, n)
    down = rng.uniform(0.5, 2.0, n) if lopsided else up
    found = least_absolute(X, y, up, down)
    assert found.cost == pytest.approx(_by_linear_programming(X, y, up, down), rel=1e-8)
    assert 0.0 <= found.gap <= 1e-10 * found.cost + 1e-9


def test_noise_free_data_are_met_exactly_and_outliers_ignored() -> None:
    rng = np.random.default_rng(5)
    X = rng.normal(size=(4000, 9)) * np.geomspace(1e-3, 1e2, 9)
    b = rng.normal(size=9)
    y = X @ b
    weight = np.where(np.arange(4000) % 6 < 3, 1.0, 2.0)
    np.testing.assert_allclose(least_absolute(X, y, weight, weight).b, b, rtol=1e-9)
    y[::4] += rng.normal(scale=50.0, size=1000)
    np.testing.assert_allclose(least_absolute(X, y, weight, weight).b, b, rtol=1e-6, atol=1e-6)


def test_a_row_priced_on_one_side_is_an_inequality() -> None:
    rng = np.random.default_rng(6)
    X = rng.normal(size=(500, 2))
    y = X @ np.array([1.0, -3.0]) + 0.1 * rng.normal(size=500)
    bound = np.array([[0.0, 1.0]])  # b₁ ≥ 0 at a price above any gain
    price = float(np.abs(X[:, 1]).sum())
    up, down = np.append(np.ones(500), price), np.append(np.ones(500), 0.0)
    found = least_absolute(np.vstack([X, bound]), np.append(y, 0.0), up, down)
    assert found.b[1] == pytest.approx(0.0, abs=1e-7)
    alone = least_absolute(X[:, :1], y, np.ones(500), np.ones(500))
    assert found.b[0] == pytest.approx(alone.b[0], abs=1e-6)


def test_dependent_columns_are_refused() -> None:
    column = np.random.default_rng(7).normal(size=(50, 1))
    with pytest.raises(ValueError, match="depend"):
        least_absolute(np.hstack([column, 2.0 * column]), column[:, 0], np.ones(50), np.ones(50))


@pytest.mark.parametrize("seed", range(4))
def test_weights_that_span_forty_decades_still_have_a_triangle(seed: int) -> None:
    Q = np.linalg.qr(np.random.default_rng(seed).normal(size=(40, 3))).Q
    D = np.where(np.arange(40) < 2, 1.0, 1e-40)  # as close to a minimum that two rows hold: QᵀDQ is singular in floats
    R, lower = _factored(Q, D)
    assert not lower
    assert np.allclose(R.T @ R, (Q * D[:, None]).T @ Q, atol=1e-15)
    beyond = np.linalg.svd(Q[:2]).Vh[2]  # the direction that only the small weights hold
    assert np.linalg.norm(R @ beyond) < 1e-15
