"""The interior-point solver of least absolute deviations against linear programming and against known answers."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from impedance.thesis.least_absolute import _weighted_squares, least_absolute


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


def test_ties_that_leave_the_minimiser_free_cost_no_accuracy() -> None:
    rng = np.random.default_rng(8)
    for _ in range(60):  # small whole numbers: many residuals are zero at once, and many minimisers as good
        n, k = int(rng.integers(12, 80)), int(rng.integers(1, 6))
        X, y = rng.integers(-2, 3, (n, k)).astype(float), rng.integers(-3, 4, n).astype(float)
        if np.linalg.matrix_rank(X) < k:
            continue
        found = least_absolute(X, y, np.ones(n), np.ones(n))
        assert found.cost == pytest.approx(_by_linear_programming(X, y, np.ones(n), np.ones(n)), rel=1e-8)


# With none or all four held by the large weights, QᵀDQ may keep enough: its factor's eight digits.
@pytest.mark.parametrize(("held", "share"), [(0, 1e-7), (1, 1e-12), (2, 1e-12), (3, 1e-12), (4, 1e-7)])
def test_a_step_is_exact_for_weights_over_forty_decades(held: int, share: float) -> None:
    rng = np.random.default_rng(held)
    for _ in range(20):  # the large weights hold `held` of the four directions: with 1 to 3, QᵀDQ is singular in floats
        Q = np.linalg.qr(rng.normal(size=(30, 4))).Q
        D = rng.permutation(np.where(np.arange(30) < held, 1.0, 10.0 ** rng.uniform(-40.0, -30.0, 30)))
        pull = rng.normal(size=30)
        exact = _exact_weighted_squares(Q, D, pull)
        found = _weighted_squares(Q, D)(pull, np.zeros(4))
        np.testing.assert_allclose(found, exact, rtol=0.0, atol=share * np.abs(exact).max())


def _exact_weighted_squares(Q: np.ndarray, D: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Return the c of QᵀDQ c = QᵀD pull by elimination in fractions."""
    rows, weights, wanted = (np.vectorize(Fraction, otypes=[object])(a) for a in (Q, D, pull))
    A = np.column_stack([(rows * weights[:, None]).T @ rows, (rows * weights[:, None]).T @ wanted])
    for pivot in range(len(A)):
        A[pivot] /= A[pivot, pivot]
        for other in range(len(A)):
            if other != pivot:
                A[other] -= A[other, pivot] * A[pivot]
    return A[:, -1].astype(float)
