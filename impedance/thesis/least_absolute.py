"""Least absolute deviations, exactly: the linear programme min Σ cᵢ |rᵢ|, r = y − X b, by an interior-point method.

The dual of min Σ (upᵢ max(rᵢ, 0) + downᵢ max(−rᵢ, 0)) is max yᵀ a with Xᵀ a = 0 and −down ≤ a ≤ up. With u = a + down,
s = up − a and multipliers z, w ≥ 0 of u, s ≥ 0, the central path is

    z − w = −r,   Xᵀ (u − down) = 0,   uᵢ zᵢ = μ,   sᵢ wᵢ = μ                                                     (1)

and Newton's step of it, with D = diag(1 / (z / u + w / s)), is a weighted least-squares problem of as many unknowns as
b has, whatever the number of rows (Portnoy and Koenker, The Gaussian Hare and the Laplacian Tortoise, Statistical
Science 12, 1997; predictor and corrector after Mehrotra, SIAM Journal on Optimization 2, 1992). The cost is linear in
the rows, and the gap between the two programmes bounds how far the result is from the minimum.

Where ties leave the minimiser free along a direction, only rows of vanishing D hold it; see `_weighted_squares`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg

from messages.arrays import FloatArray

_MOST_STEPS: Final = 100
_DEPENDENT: Final = 1e-12  # what a column adds to those before it, of its length
_STEP_SHARE: Final = 0.9995  # of the way to the nearest bound
_HELD: Final = 1e-8  # what a column must add to those before it in QᵀDQ, of its square, for steps good to 8 digits


@dataclass(frozen=True)
class LeastAbsolute:
    """The minimiser `b` (k,), its `cost`, and `gap`: by how much the least cost can be smaller at most."""

    b: FloatArray
    cost: float
    gap: float
    steps: int


def least_absolute(
    X: FloatArray, y: FloatArray, up: FloatArray, down: FloatArray, tolerance: float = 1e-10
) -> LeastAbsolute:
    """Return the b that minimises Σ (up max(r, 0) + down max(−r, 0)), r = y − X b.

    `X` (n, k), `y`, `up` and `down` (n,): costs of a residual above and below zero, neither negative, their sum
    positive. With both equal it is the weighted absolute deviation; a row with one of them zero is an inequality at a
    price. The gap ends below `tolerance` times the cost of b = 0.

    Raises ValueError where the columns of X depend on each other, ArithmeticError where it does not converge.
    """
    Q, R = np.linalg.qr(X)  # unknowns R b: equally scaled
    if np.any(np.abs(np.diag(R)) <= _DEPENDENT * np.linalg.norm(R, axis=0)):
        raise ValueError("the columns of X depend on each other")
    path = _CentralPath(Q, y, up, down)
    for step in range(_MOST_STEPS):
        cost, gap = path.cost, path.gap
        if gap <= tolerance * path.scale:
            return LeastAbsolute(scipy.linalg.solve_triangular(R, path.c), cost, gap, step)
        path.advance()
    raise ArithmeticError(f"least absolute deviations: no minimum after {_MOST_STEPS} steps")


class _CentralPath:
    """The state of (1) for orthonormal columns Q and unknowns c."""

    def __init__(self, Q: FloatArray, y: FloatArray, up: FloatArray, down: FloatArray) -> None:
        self.Q, self.y, self.up, self.down = Q, y, up, down
        self.scale = float(np.maximum(up * y, -down * y).sum()) or 1.0
        self.target = Q.T @ down
        self.c = Q.T @ y
        self.r = y - Q @ self.c
        self.u = 0.5 * (up + down)
        self.s = self.u.copy()
        spread = float(np.abs(self.r).mean()) or self.scale / float((up + down).sum())
        self.z = np.maximum(-self.r, 0.0) + spread
        self.w = np.maximum(self.r, 0.0) + spread

    @property
    def cost(self) -> float:
        """Return the cost of c."""
        return float(np.maximum(self.up * self.r, -self.down * self.r).sum())

    @property
    def gap(self) -> float:
        """Return how far the dual is below the cost, with its constraint's violation at the price of c."""
        missing = self.target - self.Q.T @ self.u
        return abs(self.cost - float(self.y @ (self.u - self.down))) + float(np.abs(missing) @ np.abs(self.c))

    def advance(self) -> None:
        """Take one step: a predictor for μ = 0, then its corrector for the μ that it makes reachable."""
        Q, u, s, z, w = self.Q, self.u, self.s, self.z, self.w
        D = 1.0 / (z / u + w / s)
        solve = _weighted_squares(Q, D)
        missing = self.target - Q.T @ u

        def newton(uz: FloatArray | float, sw: FloatArray | float) -> tuple[FloatArray, ...]:
            """Return the step of c, u, z, w after which u z and s w are, to first order, what is asked."""
            pull = self.r + uz / u - sw / s
            dc = solve(pull, missing)
            du = D * (pull - Q @ dc)
            return dc, du, (uz - z * du) / u - z, (sw + w * du) / s - w

        _, du, dz, dw = newton(0.0, 0.0)
        primal, dual = _reach(u, s, du), min(_share(z, dz), _share(w, dw))
        now = float(u @ z + s @ w)
        then = float((u + primal * du) @ (z + dual * dz) + (s - primal * du) @ (w + dual * dw))
        mu = (then / now) ** 2 * then / (2 * len(u))
        dc, du, dz, dw = newton(mu - du * dz, mu + du * dw)
        primal, dual = _reach(u, s, du), min(_share(z, dz), _share(w, dw))
        self.u, self.s = u + primal * du, s - primal * du
        self.c, self.z, self.w = self.c + dual * dc, z + dual * dz, w + dual * dw
        self.r = self.y - Q @ self.c


def _weighted_squares(Q: FloatArray, D: FloatArray) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Return the c of QᵀDQ c = QᵀD pull − missing as a function of `pull` (n,) and `missing` (k,).

    A direction that only small weights hold is lost in the sums of QᵀDQ, and rounding alone then decides whether they
    have a Cholesky factor. So the factor is used where each pivot stands clear of rounding. Elsewhere √D Q = H R, rows
    sorted by weight and columns pivoted, whose solution for `missing` = 0 is as exact as with the best scaled weights,
    over however many decades they span (Cox and Higham, Stability of Householder QR Factorization for Weighted Least
    Squares Problems, 1998). Rows in another order, or Rᵀ R c = QᵀD pull, lose every digit.
    """
    gram = (Q * D[:, None]).T @ Q
    try:
        triangle = scipy.linalg.cholesky(gram)
    except scipy.linalg.LinAlgError:
        pass
    else:
        if np.all(np.diag(triangle) ** 2 >= _HELD * np.diag(gram)):
            return lambda pull, missing: scipy.linalg.cho_solve((triangle, False), Q.T @ (D * pull) - missing)

    heavy_first = np.argsort(-D, kind="stable")
    root = np.sqrt(D[heavy_first])
    H, R, order = scipy.linalg.qr(root[:, None] * Q[heavy_first], mode="economic", pivoting=True)

    def solve(pull: FloatArray, missing: FloatArray) -> FloatArray:
        c = np.empty(len(order))
        held = H.T @ (root * pull[heavy_first]) - scipy.linalg.solve_triangular(R, missing[order], trans="T")
        c[order] = scipy.linalg.solve_triangular(R, held)
        return c

    return solve


def _reach(u: FloatArray, s: FloatArray, du: FloatArray) -> float:
    return min(_share(u, du), _share(s, -du))


def _share(x: FloatArray, dx: FloatArray) -> float:
    """Return how much of `dx` (≤ 1) keeps x positive."""
    worst = float((-dx / x).max())
    return 1.0 if worst <= _STEP_SHARE else _STEP_SHARE / worst
