"""The Cramér-Rao bound of an identification, and what noise does to it in first order: for those who know the truth."""

from collections.abc import Iterator

import numpy as np

from impedance.identification.eiv import EivProblem, columns_of, product
from impedance.identification.spectra import Spectra
from messages.arrays import ComplexArray, FloatArray


def true_information(problem: EivProblem, spectra: Spectra, vector: FloatArray) -> FloatArray:
    """Return the Fisher information (10, 10) about the true π (10,), `problem` holding the noise-free motion.

    It is that of the whole recording: nothing is lost to the tapers. Its inverse is the Cramér-Rao bound.
    """
    whitened, _, _ = _whitened(problem, spectra, vector)
    whole = len(problem.q) / (spectra.counted_s * spectra.rate_hz)
    return whole * product(whitened, whitened)


def propagated(
    problem: EivProblem, spectra: Spectra, vector: FloatArray, draws: int, seed: int
) -> Iterator[FloatArray]:
    """Yield the errors (10,) of π that draws of white noise on motion and wrench cause, to first order about the truth.

    The noise is drawn in time and takes the estimator's way: weighed, tapered, transformed.
    """
    whitened, root, G = _whitened(problem, spectra, vector)
    influence = np.linalg.solve(product(whitened, whitened), whitened.reshape(-1, 10).conj().T)
    noise, mechanism = problem.noise, problem.noise.mechanism
    q_root = np.linalg.cholesky(noise.q_cov)
    cog_m = vector[1:4] / vector[0]
    rng = np.random.default_rng(seed)
    for _ in range(draws):
        wrench = noise.wrench_std * rng.standard_normal(problem.wrench.shape)
        _, coordinates = spectra.motion(rng.standard_normal(problem.q.shape) @ q_root.T)
        z = spectra.equations(mechanism.weighed(problem.q, wrench[:, :, None], cog_m)[:, :, 0])
        r: ComplexArray = (root @ (z[:, :, None] - G @ coordinates[:, :, None])).reshape(-1)
        yield (influence @ r).real


def _whitened(problem: EivProblem, spectra: Spectra, vector: FloatArray) -> tuple[ComplexArray, FloatArray, FloatArray]:
    """Return the whitened columns (k, 6, 10) of the given motion, the whitener (k, 6, 6) and G (k, 6, c)."""
    mean, motion = spectra.motion(problem.q)
    cog_m = vector[1:4] / vector[0]
    D, _ = columns_of(problem, spectra, spectra.derivatives(mean, spectra.kept[:, None] * motion), cog_m)
    M = problem.noise.mechanism.level_weighing(cog_m)
    root, _, G = problem.noise.weights(spectra.f_hz, vector, M)
    root = root * np.sqrt(spectra.share)[:, None, None]
    return root @ D, root, G
