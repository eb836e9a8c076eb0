"""A linear model whose parts differ in what is known of them beforehand, and whose noise has a colour.

    y = Σ_b X_b β_b + Z κ + e,   β_b free | ~ N(0, 1) | ~ N(0, a_b²), a_b learnt;   κ ~ N(0, 1);   e autoregressive  (1)

Given the a_b and σ, the estimate is the generalised least-squares (equally: Bayesian) one,

    C = (Σ Xᵀ W X / σ² + Λ)⁻¹,   β = C Xᵀ W y / σ²                                                               (2)

with Λ = 0, 1 or 1 / a_b² on the diagonal and W the whitening of the autoregression. The variances are those of
restricted maximum likelihood by the fixed point of Fellner and Schall (Wood and Fasiolo, Biometrics 73, 2017):

    a_b² ← |β_b|² / γ_b,   γ_b = k_b − tr C_bb / a_b²,   σ² ← |e|² / (n − Σ γ)                                   (3)

κ is considered, not estimated (Schmidt 1966): it stays at its mean, and C grows by G Gᵀ with G = C Xᵀ W Z / σ². So a
small misfit elsewhere cannot hide in it, and the interval still holds it. γ is how many parameters of the block the
data decide. The colour is fitted to the residual by Yule and Walker, its order by Schwarz's criterion, and (2), (3)
are repeated.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_toeplitz

from messages.arrays import FloatArray, IntArray

_ROUNDS = 40
_COLOURINGS = 1
_HIGHEST_ORDER = 6
_CONVERGED = 2e-3
_LEAST_SHARE = 1e-12
"""A learnt variance never falls below this share of what the data could show: then the block is as good as absent."""


class Prior(Enum):
    """What is known of a block's parameters before the data speak."""

    FREE = "free"
    UNIT = "standard normal"
    LEARNT = "normal, its variance learnt from the data"
    CONSIDERED = "standard normal, not estimated"


@dataclass(frozen=True)
class Block:
    """Columns X (n, k) of (1) that share a prior."""

    name: str
    X: FloatArray
    prior: Prior


@dataclass(frozen=True)
class MixedFit:
    """The estimate: β and C of the estimated blocks in their order, `slices` by block; σ is the noise's innovation.

    `variances` of the learnt blocks; `autoregression` (p,) with e_k = Σ ar_j e_{k−j} + σ w_k; `residual` (n,) in y's
    order; `freedom` n − Σ γ.
    """

    beta: FloatArray
    covariance: FloatArray
    slices: dict[str, slice]
    variances: dict[str, float]
    sigma: float
    autoregression: FloatArray
    residual: FloatArray
    freedom: float

    def of(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return β (k,) and its covariance (k, k) of one block."""
        rows = self.slices[name]
        return self.beta[rows], self.covariance[rows, rows]


def fit(y: FloatArray, blocks: Sequence[Block], segment: IntArray) -> MixedFit:
    """Return the estimate of (1); `segment` (n,) numbers the unbroken stretches, one after the other.

    Raises ValueError where the free columns depend on each other or outnumber the samples.
    """
    considered = [block.X for block in blocks if block.prior is Prior.CONSIDERED]
    blocks = [block for block in blocks if block.X.shape[1] > 0 and block.prior is not Prior.CONSIDERED]
    X = np.hstack([block.X for block in blocks])
    ends = np.cumsum([0, *(block.X.shape[1] for block in blocks)]).tolist()
    slices = {b.name: slice(first, end) for b, first, end in zip(blocks, ends[:-1], ends[1:], strict=True)}
    if sum(block.X.shape[1] for block in blocks if block.prior is Prior.FREE) >= len(y):
        raise ValueError(f"{len(y)} samples are too few for the model's free parameters")
    autoregression = np.zeros(0)
    for colouring in range(_COLOURINGS + 1):
        whitened_X, whitened_y = whiten(X, segment, autoregression), whiten(y[:, None], segment, autoregression)[:, 0]
        beta, covariance, variances, sigma, freedom = _restricted(whitened_X, whitened_y, blocks, slices)
        residual = y - X @ beta
        if colouring < _COLOURINGS:
            autoregression = _colour(residual, segment)
    if considered:
        shift = covariance @ whitened_X.T @ whiten(np.hstack(considered), segment, autoregression) / sigma**2
        covariance = covariance + shift @ shift.T
    return MixedFit(beta, covariance, slices, variances, sigma, autoregression, residual, freedom)


def whiten(values: FloatArray, segment: IntArray, autoregression: FloatArray) -> FloatArray:
    """Return values (n, k) minus what the autoregression (p,) predicts; each segment's first p rows are left out."""
    order = len(autoregression)
    if order == 0:
        return values
    innovation = values[order:].copy()
    for lag, weight in enumerate(autoregression, start=1):
        innovation -= weight * values[order - lag : len(values) - lag]
    kept: FloatArray = innovation[segment[order:] == segment[:-order]]
    return kept


def _restricted(
    X: FloatArray, y: FloatArray, blocks: Sequence[Block], slices: dict[str, slice]
) -> tuple[FloatArray, FloatArray, dict[str, float], float, float]:
    """Return β, C, the learnt variances, σ and the freedom by (2) and (3)."""
    gram, right, square = X.T @ X, X.T @ y, float(y @ y)
    power = np.diag(gram) + np.finfo(float).tiny
    learnt = [block.name for block in blocks if block.prior is Prior.LEARNT]
    highest = {name: float(y.var() * len(y) / power[slices[name]].mean()) for name in learnt}
    variances = dict(highest)
    variance = float(y.var() + np.finfo(float).tiny)
    for _ in range(_ROUNDS):
        precision = np.zeros(len(right))
        for block in blocks:
            if block.prior is not Prior.FREE:
                precision[slices[block.name]] = 1.0 / variances.get(block.name, 1.0)
        C = _inverse(gram / variance + np.diag(precision))
        beta = C @ right / variance
        freedom = len(y) - (len(right) - float(np.diag(C) @ precision))
        if freedom <= 0.0:
            raise ValueError(f"{len(y)} samples are too few for the model")
        left = max(square - 2.0 * float(beta @ right) + float(beta @ gram @ beta), 0.0)
        before = np.array([variance, *variances.values()])
        variance = max(left / freedom, 1e-14 * square / len(y))
        for name in learnt:
            rows = slices[name]
            decided = max(len(beta[rows]) - float(np.trace(C[rows, rows])) / variances[name], 1e-6)
            variances[name] = max(float(beta[rows] @ beta[rows]) / decided, _LEAST_SHARE * highest[name])
        after = np.array([variance, *variances.values()])
        if np.all(np.abs(np.log(after / before)) < _CONVERGED):
            break
    return beta, C, variances, float(np.sqrt(variance)), freedom


def _inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverse of a positive definite matrix, scaled to a unit diagonal first."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    try:
        factor = cho_factor(matrix * np.outer(scale, scale), lower=True)
    except np.linalg.LinAlgError:
        raise ValueError("the model's columns depend on each other") from None
    inverse: FloatArray = cho_solve(factor, np.eye(len(scale))) * np.outer(scale, scale)
    return inverse


def _colour(residual: FloatArray, segment: IntArray) -> FloatArray:
    """Return the autoregression (p,) of a residual, p = 0 to 6 by Schwarz's criterion."""
    count = len(residual)
    lagged = np.array(
        [
            float((residual[lag:] * residual[: count - lag])[segment[lag:] == segment[: count - lag]].sum())
            for lag in range(_HIGHEST_ORDER + 1)
        ]
    )
    lagged /= count
    best = np.zeros(0)
    least = float(count * np.log(lagged[0]))
    for order in range(1, _HIGHEST_ORDER + 1):
        weights = solve_toeplitz(lagged[:order], lagged[1 : order + 1])
        left = max(float(lagged[0] - weights @ lagged[1 : order + 1]), float(np.finfo(float).tiny))
        criterion = float(count * np.log(left) + order * np.log(count))
        if criterion < least:
            best, least = weights, criterion
    return best
