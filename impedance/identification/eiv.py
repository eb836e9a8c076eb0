"""Inertia by maximum likelihood where motion and wrench are both noisy (errors in variables).

Known: coordinates q = q* + e with covariance Σ_q, and wrench w = Y(q*, q̇*, q̈*) π + n with covariance Σ_w, both white.
Unknown: π (10,) and the whole true motion q*. With everything transformed to frequency (spectra), z the
weighed wrench (mechanism), M its weighing of the level plate, and one small matrix per bin

    G(f) = M (G0 − (2πf)² G2),   G0_j = B0_j π,   G2_j = B2_j π,   S(f) = M Σ_w Mᵀ + G Σ_q Gᵀ                      (1)

the motion that is most likely under π differs from the measured one by c, and what both leave is r:

    r = z − D(q + c) π + G c,   c = Σ_q Gᵀ S⁻¹ r                                                                   (2)
    δπ = (Σ_f Dᴴ S⁻¹ D)⁻¹ Σ_f Dᴴ S⁻¹ r                                                                             (3)

(3) is the Gauss-Newton step of the likelihood with q* eliminated: at the true motion its sum is the Fisher information
of π, whose inverse is the Cramér-Rao bound. The likeliest motion has noise of covariance Σ_q − Σ_q Gᵀ S⁻¹ G Σ_q, which
looks like excitation:

    F = Σ_f Dᴴ S⁻¹ D − Σ_f Σ_ij (Σ_q − Σ_q Gᵀ S⁻¹ G Σ_q)_ij (M B_i)ᵀ S⁻¹ (M B_j),   B = B0 − (2πf)² B2             (4)

Products of motion are formed in time from q + c, before any weighing: no filter has to commute with them. The regressor
of the likeliest motion is independent of r, which takes the bias of noise in the regressor away (Carroll et al.,
Measurement Error in Nonlinear Models, 2006, ch. 7; Pintelon and Schoukens, System Identification, 2012, ch. 8).
"""

from dataclasses import dataclass

import numpy as np

from impedance.identification.mechanism import Mechanism
from impedance.identification.spectra import Spectra
from messages.arrays import ComplexArray, FloatArray

_MOST_STEPS = 15
_SETTLED = 1e-3
_START = np.array([10.0, 0.0, 0.0, 0.0, 0.1, 0.1, 0.1, 0.0, 0.0, 0.0])
_LEAST_KG = 0.1
_FLOOR = 1e-6


@dataclass(frozen=True)
class NoiseModel:
    """White noise of one sample: `q_cov` (c, c) of the mechanism's coordinates, `wrench_std` (6,) of the wrench."""

    mechanism: Mechanism
    q_cov: FloatArray
    wrench_std: FloatArray

    def weights(self, f_hz: FloatArray, vector: FloatArray, M: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return by (1), per bin (k,): the root of S⁻¹ (k, 6, 6), Σ_q Gᵀ S⁻¹ (k, c, 6) and G (k, 6, c)."""
        B0, B2 = self.mechanism.level_columns()
        G = M @ ((B0 @ vector).T - ((2.0 * np.pi * f_hz) ** 2)[:, None, None] * (B2 @ vector).T)
        S = (M * self.wrench_std**2) @ M.T + G @ self.q_cov @ np.swapaxes(G, 1, 2)
        root = np.linalg.inv(np.linalg.cholesky(S))
        gain: FloatArray = self.q_cov @ np.swapaxes(G, 1, 2) @ np.swapaxes(root, 1, 2) @ root
        return root, gain, G


@dataclass(frozen=True)
class EivProblem:
    """What was measured: `q` (n, c) and the body's `wrench` (n, 6), its own weight included, with their noise.

    The model's wrench is (Y − `rest`) π with `rest` (6, 10), the columns that the tare took away.
    """

    noise: NoiseModel
    q: FloatArray
    wrench: FloatArray
    rest: FloatArray


@dataclass(frozen=True)
class EivFit:
    """The likeliest parameters (10,), the information (10, 10) about them by (4), and what is left.

    `motion` (n, c) are the likeliest coordinates with two derivatives, `columns` (k, 6, 10) the whitened D, `whitener`
    (k, 6, 6) what whitened it and `left` (k, 6) the r of (2) as it is. `misfit` (k, 6) is the whitened r of the band,
    complex, whose mean square is 1 for each of real and imaginary part. `converged` tells that the last step was short.
    """

    vector: FloatArray
    information: FloatArray
    motion: tuple[FloatArray, FloatArray, FloatArray]
    columns: ComplexArray
    whitener: FloatArray
    left: ComplexArray
    misfit: ComplexArray
    steps: int
    converged: bool

    @property
    def chi2_ratio(self) -> float:
        """Return the mean square of the misfit: 1 if model and noise are as declared."""
        return float(np.mean(np.abs(self.misfit) ** 2) / 2.0)

    def whitened(self, problem: EivProblem, spectra: Spectra, wrenches: FloatArray) -> ComplexArray:
        """Return what wrenches (n, 6, s) in P add to the whitened r: (k, 6, s)."""
        cog_m = self.vector[1:4] / max(self.vector[0], _LEAST_KG)
        weighed = problem.noise.mechanism.weighed(self.motion[0], wrenches, cog_m)
        return self.whitener @ _transformed(spectra, weighed)

    def response(self, whitened: ComplexArray) -> FloatArray:
        """Return by how much (10, s) the parameters move with what adds (k, 6, s) to the whitened r."""
        return solved(product(self.columns, self.columns), product(self.columns, whitened))


def fit(problem: EivProblem, spectra: Spectra, start: FloatArray | None = None) -> EivFit:
    """Return the maximum likelihood by (1) to (3), from `start` (10,)."""
    noise, mechanism = problem.noise, problem.noise.mechanism
    share_root = np.sqrt(spectra.share)[:, None, None]
    mean, measured = spectra.motion(problem.q)
    correction: ComplexArray = np.zeros_like(measured)
    vector = _START if start is None else start
    steps, converged = 0, False
    while steps < _MOST_STEPS and not converged:
        steps += 1
        cog_m = vector[1:4] / max(vector[0], _LEAST_KG)
        likeliest = spectra.kept[:, None] * (measured + correction)
        motion = spectra.derivatives(mean, likeliest)
        D, q = columns_of(problem, spectra, motion, cog_m)
        z = spectra.equations(mechanism.weighed(q, problem.wrench[:, :, None], cog_m)[:, :, 0])
        M = mechanism.level_weighing(cog_m)

        root, _, G = noise.weights(spectra.f_hz, vector, M)
        whitener = root * share_root
        r = z - D @ vector + _times(G, likeliest - measured)
        white = whitener @ D
        information, pull = product(white, white), product(white, _times(whitener, r)[:, :, None])[:, 0]
        step = solved(information, pull)
        vector = vector + step

        root, gain, G = noise.weights(spectra.f_hz, vector, M)
        whitener = root * share_root
        r = z - D @ vector + _times(G, likeliest - measured)
        correction = _times(gain, r)
        converged = bool(step @ information @ step < _SETTLED)
    true_information = _less(information, _noise_information(noise, spectra, vector, M))
    counted, in_band = spectra.counted_s * spectra.rate_hz, spectra.share > 0.0
    misfit = _times(whitener, r)[in_band] * np.sqrt(2.0 / (spectra.share[in_band] * counted))[:, None]
    return EivFit(vector, true_information, motion, whitener @ D, whitener, r, misfit, steps, converged)


def columns_of(
    problem: EivProblem, spectra: Spectra, motion: tuple[FloatArray, FloatArray, FloatArray], cog_m: FloatArray
) -> tuple[ComplexArray, FloatArray]:
    """Return the weighed columns D (k, 6, 10) of coordinates with two derivatives (n, c), and the coordinates."""
    mechanism, q = problem.noise.mechanism, motion[0]
    columns = mechanism.kinematics(*motion).regressor - problem.rest
    return _transformed(spectra, mechanism.weighed(q, columns, cog_m)), q


def solved(matrix: FloatArray, rhs: FloatArray) -> FloatArray:
    """Return the least solution of a symmetric system, scaled to a unit diagonal: what nothing is known of stays."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    scaled_rhs = scale * rhs if rhs.ndim == 1 else scale[:, None] * rhs
    scaled = np.linalg.lstsq(matrix * np.outer(scale, scale), scaled_rhs, rcond=1e-14)[0]
    solution: FloatArray = np.asarray(scaled, dtype=np.float64)
    return scale * solution if rhs.ndim == 1 else scale[:, None] * solution


def _transformed(spectra: Spectra, columns: FloatArray) -> ComplexArray:
    """Return the bins (k, 6, p) of columns (n, 6, p), most of which are zero at all times."""
    filled = (columns != 0.0).any(axis=0)
    bins = np.zeros((len(spectra.f_hz), *filled.shape), dtype=np.complex128)
    bins[:, filled] = spectra.equations(columns[:, filled])
    return bins


def product(first: ComplexArray, second: ComplexArray) -> FloatArray:
    """Return Re Σ_f Aᴴ B of whitened columns (k, 6, p) and (k, 6, s): (p, s)."""
    product: FloatArray = (first.reshape(-1, first.shape[2]).conj().T @ second.reshape(-1, second.shape[2])).real
    return product


def _noise_information(model: NoiseModel, spectra: Spectra, vector: FloatArray, M: FloatArray) -> FloatArray:
    """Return the second sum of (4): the information (10, 10) that the noise of the likeliest motion pretends."""
    root, gain, G = model.weights(spectra.f_hz, vector, M)
    left = model.q_cov - gain @ G @ model.q_cov
    noise = np.linalg.cholesky(left + 1e-12 * model.q_cov)
    B0, B2 = model.mechanism.level_columns()
    size = len(B0)
    whitener = root * np.sqrt(spectra.share)[:, None, None] @ M
    level = (whitener @ np.concatenate(np.concatenate((B0, B2)), axis=1)).reshape(len(G), 6, 2, size, 10)
    columns = level[:, :, 0] - ((2.0 * np.pi * spectra.f_hz) ** 2)[:, None, None, None] * level[:, :, 1]
    turned = np.einsum("kwcp,kcs->kwsp", columns, noise, optimize=True).reshape(-1, 10)
    pretended: FloatArray = spectra.counted_s * spectra.rate_hz * (turned.T @ turned)
    return pretended


def _less(information: FloatArray, pretended: FloatArray) -> FloatArray:
    """Return F of (4), kept positive: at least a millionth of what it seems to be in every direction."""
    root = np.linalg.cholesky(information + _FLOOR**2 * np.diag(np.diag(information)))
    seen = np.linalg.solve(root, np.linalg.solve(root, information - pretended).T)
    values, directions = np.linalg.eigh(0.5 * (seen + seen.T))
    half = root @ directions * np.sqrt(np.maximum(values, _FLOOR))
    true: FloatArray = half @ half.T
    return true


def _times(matrices: FloatArray, vectors: ComplexArray) -> ComplexArray:
    product: ComplexArray = (matrices @ vectors[:, :, None])[:, :, 0]
    return product
