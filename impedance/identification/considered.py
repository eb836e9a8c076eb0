"""Errors of the laboratory that noise does not tell: what they do to the parameters, and what the misfit says of them.

What is measured differs from the wrench w of the model by w' = Σ_k e_k ε_k, to first order in the errors ε

    gain, crosstalk   e = A_ij w_j          axes       e = −(n × f, n × T)                                           (1)
    reference         e = −(0, n × f)       delay      e = −ẇ
    joint             e = (m a, h × a),  a = α × n + ω × (ω × n)           plate      e = −Y⁰ π_n under a tared foot

with n a unit vector, h = m d, and w tared: the tare was taken by the same plate. Before the run ε has the mean ε₀ and
the covariance P = L Lᵀ: what `[uncertainty]` states, the markers say of the joint and an earlier run of the plate.
Left alone they move the parameters by K ε; the misfit r that these leave knows something of them:

    K = (Dᴴ S⁻¹ D)⁻¹ Dᴴ S⁻¹ E,   N = Eᴴ S⁻¹ E − Eᴴ S⁻¹ D K                                                         (2)
    ε̂ = L (Lᵀ N L + 1)⁻¹ Lᵀ Eᴴ S⁻¹ r,   C = L (Lᵀ N L + 1)⁻¹ Lᵀ                                                    (3)
    π = π(ε = 0) − K ε̂,   cov π = F⁻¹ + K C Kᵀ                                                                     (4)

the Kalman filter's update for errors that are considered beside what is estimated [Tapley, Schutz and Born, Statistical
Orbit Determination, 2004, ch. 6]. As e depends on ε in second order, the wrench is corrected by ε̂ and (2) to (4) are
repeated about it.
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.linalg import block_diag

from impedance.body.rigid_body import cross_matrix
from impedance.identification.eiv import EivFit, EivProblem, product
from impedance.identification.mechanism import UniversalJoint
from impedance.identification.spectra import Spectra
from impedance.recording.recording import UncertaintySettings
from messages.arrays import ComplexArray, FloatArray

CHANNELS = ("fx", "fy", "fz", "Tx", "Ty", "Tz")
WEIGHING, ALIKE = "mass", "all alike"
_AXES = "xyz"
_REFUTED = 4.0
_MATRICES = 43
_UNSEEN = 1e-9
"""Of an error's effect: what is left beside the parameters' is rounding."""
_NO_MATTER = {"gain": 5e-4, "crosstalk": 5e-4, "axes": 5e-4, "reference": 1e-3, "delay": 2e-5}
"""What an error of each kind may be without mattering: to no statement, however sure, is less of it an objection."""


@dataclass(frozen=True)
class Errors:
    """The errors ε that are considered: `kind` and `of` name each, `deviation` (q,) is the root of P's diagonal."""

    kind: tuple[str, ...]
    of: tuple[str, ...]
    deviation: FloatArray

    def where(self, kind: str) -> list[int]:
        """Return the places of one kind."""
        return [k for k, each in enumerate(self.kind) if each == kind]


@dataclass(frozen=True)
class Belief:
    """What is believed of errors: `mean` (q,) and `root` L (q, r) of their covariance L Lᵀ."""

    mean: FloatArray
    root: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Return the covariance (q, q)."""
        covariance: FloatArray = self.root @ self.root.T
        return covariance

    def with_independent(self, covariance: FloatArray) -> "Belief":
        """Return the belief of these errors and further ones of mean zero and `covariance` (s, s), below them."""
        return Belief(
            np.concatenate((self.mean, np.zeros(len(covariance)))), block_diag(self.root, root_of(covariance))
        )


@dataclass(frozen=True)
class Found:
    """What the misfit says of the instruments: `value` and `deviation` (q,), `sigmas` (q,) from what is stated.

    Errors that are stated to be smaller than a laboratory's usual ones are looked for as if they were usual. `alone`
    and `alone_deviation` (q,) are what each error would be if it were the only one, `explains` (q,) by how much it then
    lowers χ², of which `misfit_chi2` is more than noise makes.
    """

    errors: Errors
    value: FloatArray
    deviation: FloatArray
    sigmas: FloatArray
    alone: FloatArray
    alone_deviation: FloatArray
    explains: FloatArray
    misfit_chi2: float

    def worst(self, kind: str) -> int:
        """Return the place of the error of one kind that agrees least with what is stated."""
        return max(self.errors.where(kind), key=lambda k: float(self.sigmas[k]))

    @property
    def refuted(self) -> bool:
        """Tell whether the misfit refutes what is stated, by four deviations or more."""
        return bool(self.sigmas.max() > _REFUTED)


def errors_of(stated: UncertaintySettings) -> Errors:
    """Return the errors in the order of (1), with what is stated of them."""
    mass = stated.gain_share if stated.mass_share is None else stated.mass_share
    every = [
        ("gain", ALIKE, stated.gain_share),
        *(("gain", name, stated.gain_share) for name in CHANNELS),
        *(("crosstalk", f"{of} from {source}", stated.crosstalk_share) for of, source in permutations(CHANNELS, 2)),
        *(("axes", axis, stated.axes_rad) for axis in _AXES),
        *(("reference", axis, stated.reference_m) for axis in _AXES),
        ("delay", "force", stated.delay_s),
        (WEIGHING, "plate", mass),
    ]
    kinds, names, deviations = zip(*every, strict=True)
    return Errors(kinds, names, np.array(deviations))


def effects(
    problem: EivProblem, spectra: Spectra, fit: EivFit, tared: FloatArray, moment_per_force_m: float
) -> ComplexArray:
    """Return E of (1), whitened (k, 6, q), for the errors of the wrench; `tared` (6,) is what the tare took besides.

    The last error, that of the weighing, does nothing to the wrench.
    """
    motion = problem.noise.mechanism.kinematics(*fit.motion)
    wrench = (motion.regressor - problem.rest) @ fit.vector - tared
    jw = 2j * np.pi * np.fft.rfftfreq(len(wrench), 1.0 / spectra.rate_hz)[:, None]
    rate = np.fft.irfft(jw * np.fft.rfft(wrench, axis=0), len(wrench), axis=0)
    matrices = wrench_matrices(moment_per_force_m)
    wrenches = np.concatenate(
        (np.einsum("kij,nj->nik", matrices, wrench, optimize=True), -rate[:, :, None], np.zeros((len(rate), 6, 1))),
        axis=2,
    )
    return fit.whitened(problem, spectra, wrenches)


def wrench_matrices(moment_per_force_m: float) -> FloatArray:
    """Return the matrices (43, 6, 6) that gains, crosstalk, axes and reference multiply the tared wrench by."""
    to_moment = np.repeat((1.0, moment_per_force_m), 3)
    scaled = np.outer(to_moment, 1.0 / to_moment)
    gains = [np.eye(6), *(np.diag(unit) for unit in np.eye(6))]
    crosstalk = []
    for of, source in permutations(range(6), 2):
        matrix = np.zeros((6, 6))
        matrix[of, source] = scaled[of, source]
        crosstalk.append(matrix)
    axes, reference = np.zeros((3, 6, 6)), np.zeros((3, 6, 6))
    crosses = cross_matrix(np.eye(3))
    axes[:, :3, :3] = axes[:, 3:, 3:] = -crosses
    reference[:, 3:, :3] = -crosses
    return np.concatenate((gains, crosstalk, axes, reference))


def joint_effects(problem: EivProblem, spectra: Spectra, fit: EivFit) -> ComplexArray:
    """Return E of (1), whitened (k, 6, 3), for P's origin elsewhere on the joint; zeros without the joint."""
    mechanism = problem.noise.mechanism
    if not isinstance(mechanism, UniversalJoint):
        return np.zeros((*fit.left.shape, 3), dtype=np.complex128)
    motion = mechanism.kinematics(*fit.motion)
    turning = cross_matrix(motion.alpha) + cross_matrix(motion.w) @ cross_matrix(motion.w)
    wrenches = np.concatenate((fit.vector[0] * turning, cross_matrix(fit.vector[None, 1:4]) @ turning), axis=1)
    return fit.whitened(problem, spectra, wrenches)


def corrected(wrench: FloatArray, rate_hz: float, value: FloatArray, moment_per_force_m: float) -> FloatArray:
    """Return a tared wrench (n, 6) without gaps, with the instruments' errors `value` (q,) taken out."""
    if not value.any():
        return wrench
    f_hz = np.fft.rfftfreq(len(wrench), 1.0 / rate_hz)
    earlier = np.exp(2j * np.pi * f_hz * value[_MATRICES])[:, None] * np.fft.rfft(wrench, axis=0)
    A = np.eye(6) + np.einsum("k,kij->ij", value[:_MATRICES], wrench_matrices(moment_per_force_m))
    found: FloatArray = np.linalg.solve(A, np.fft.irfft(earlier, len(wrench), axis=0).T).T
    return found


def updated(fit: EivFit, E: ComplexArray, before: Belief, at: FloatArray, power: float) -> Belief:
    """Return by (3) what is believed (q,) after the misfit of a fit that took the errors to be `at` (q,).

    `power` is by how much the noise is larger than S says, 1 where it is not.
    """
    r: ComplexArray = fit.whitener @ fit.left[:, :, None]
    seen = E @ (before.root / np.sqrt(power))
    N = product(seen, seen) - product(seen, fit.columns) @ fit.response(seen)
    pull = product(seen, r)[:, 0] / np.sqrt(power) + N @ _solved_for(before.root, at - before.mean)
    after = np.linalg.inv(N + np.eye(len(N)))
    return Belief(before.mean + before.root @ (after @ pull), before.root @ np.linalg.cholesky(after))


def chi2_left(fit: EivFit, spectra: Spectra, E: ComplexArray, step: FloatArray) -> float:
    """Return the mean square of the misfit, 1 for noise alone, once the errors have moved by `step` (q,)."""
    band = spectra.share > 0.0
    moved = (E @ step[:, None] - fit.columns @ fit.response(E @ step[:, None]))[band, :, 0]
    scale = np.sqrt(2.0 / (spectra.share[band] * spectra.counted_s * spectra.rate_hz))[:, None]
    return float(np.mean(np.abs(fit.misfit - scale * moved) ** 2) / 2.0)


def told(fit: EivFit, E: ComplexArray, errors: Errors, before: Belief, at: FloatArray) -> Found:
    """Return what the misfit says of the instruments' `errors`, the first of those believed `before`."""
    q = len(errors.deviation)
    seen = E[:, :, :q]
    whole = np.diag(product(seen, seen))
    tells = whole - np.einsum("qp,pq->q", product(seen, fit.columns), fit.response(seen))
    tells = np.where(tells > _UNSEEN * whole, tells, np.inf)
    r = fit.whitener @ fit.left[:, :, None]
    pull = product(seen, r)[:, 0]
    excess = float(product(r, r)[0, 0]) * max(0.0, 1.0 - 1.0 / fit.chi2_ratio)
    usual = np.maximum(errors_of(UncertaintySettings()).deviation, errors.deviation)
    wider = Belief(np.zeros(q), np.diag(usual)).with_independent(before.covariance[q:, q:])
    after = updated(fit, E, wider, at, 1.0)
    value, deviation = after.mean[:q], np.sqrt(np.diag(after.covariance)[:q])
    tolerated = np.array([_NO_MATTER.get(kind, np.inf) for kind in errors.kind])
    sigmas = np.abs(value) / np.sqrt(errors.deviation**2 + deviation**2 + tolerated**2)
    return Found(errors, value, deviation, sigmas, pull / tells, tells**-0.5, pull**2 / tells, excess)


def root_of(covariance: FloatArray) -> FloatArray:
    """Return L (q, q) with L Lᵀ = `covariance`, which may be singular."""
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, directions = np.linalg.eigh(covariance / np.outer(scale, scale))
    root: FloatArray = scale[:, None] * directions * np.sqrt(np.maximum(values, 0.0))
    return root


def _solved_for(root: FloatArray, errors: FloatArray) -> FloatArray:
    """Return the least x with L x = `errors`."""
    scale = np.linalg.norm(root, axis=1)
    scale = np.where(scale > 0.0, scale, 1.0)
    least = np.linalg.lstsq(root / scale[:, None], errors / scale, rcond=1e-10)[0]
    return np.asarray(least, dtype=np.float64)
