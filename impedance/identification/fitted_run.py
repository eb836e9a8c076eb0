"""One recording fitted: the likeliest parameters beside what is believed of instruments, plate and joint.

The errors that are considered are ε = (instruments (q,), the plate's own parameters (10,), the joint's place (3,)), in
this order, see impedance.identification.considered. A fit at ε₀ is followed by an update of ε, until that is short.
"""

from dataclasses import dataclass, replace

import numpy as np

from impedance.body.physical import consistent
from impedance.identification.checks import refutation
from impedance.identification.considered import (
    Belief,
    Errors,
    Found,
    chi2_left,
    corrected,
    effects,
    errors_of,
    joint_effects,
    told,
    updated,
)
from impedance.identification.eiv import EivFit, EivProblem, NoiseModel, fit
from impedance.identification.mechanism import FreeBody, Mechanism, UniversalJoint, level_rest
from impedance.identification.noise_level import NoiseLevel, from_misfit, noise_level
from impedance.identification.observability import covariance_of, vector_scale
from impedance.identification.pose_fusion import JointTest, MarkerFrame, fused, joint_test
from impedance.identification.spectra import Spectra
from impedance.recording.recording import PlatformRecording
from impedance.recording.synchronous import Synchronous, synchronous
from messages.arrays import ComplexArray, FloatArray
from messages.errors import UserError

BAND_SHARE = 100.0 / 350.0
"""Of the rate: the equations are weighed up to 100 of 350 Hz, beyond what the platform moves."""
PLATE_ERRORS, JOINT_ERRORS = slice(-13, -3), slice(-3, None)
_NOISE_ROUNDS = 2
_ESTIMATED_SHARE = 0.05
"""By what share the power of the markers' noise is unsure that the quiet band tells."""
_MOST_UPDATES = 4
_SETTLED = 0.2
"""Of its deviation: what an error may still move by."""


@dataclass(frozen=True)
class KnownBody:
    """Parameters π (10,) known beforehand in P, with their covariance (10, 10): zeros where they count as exact.

    `belief` is that of the instruments' errors (q,) and then of the parameters' own (10,), where the run that told them
    had the same instruments.
    """

    vector: FloatArray
    covariance: FloatArray
    belief: Belief | None = None


@dataclass(frozen=True)
class FittedRun:
    """What a recording tells before plate or foot is made of it.

    `vector` (10,) is π of what the force plate carries, about `belief`'s mean of the errors (q + 13,), and `response`
    (10, q + 13) by what it moves with them; `noise_covariance` (10, 10) is what noise leaves. `known` is the plate,
    moved likewise, and None for a bare plate of which nothing is known. `chi2_left` is what is left of the misfit once
    the errors are taken out, 1 for noise alone, by which all covariances have grown where it is more.
    """

    streams: Synchronous
    known: KnownBody | None
    test: JointTest
    noise: NoiseLevel
    mechanism: Mechanism
    spectra: Spectra
    fit: EivFit
    vector: FloatArray
    noise_covariance: FloatArray
    response: FloatArray
    belief: Belief
    chi2_left: float
    checked: Found

    @property
    def constrained(self) -> bool:
        """Tell whether the universal joint was used."""
        return isinstance(self.mechanism, UniversalJoint)


def fitted_run(recording: PlatformRecording, known: KnownBody | None, joint: bool | None) -> FittedRun:
    """Return the recording fitted, with the plate `known`; `joint` None asks the markers whether there is one.

    Raises UserError where the plate under a foot is not known, where too little of the recording counts, or where the
    misfit refutes what `[uncertainty]` says of the instruments.
    """
    streams = synchronous(recording)
    stated = recording.settings.uncertainty
    noise = noise_level(streams)
    seen = MarkerFrame(streams.plate.p_m[streams.valid], streams.plate.euler_rad[streams.valid], np.zeros(3))
    said = UniversalJoint(recording.settings.plate.joint_to_surface_m)
    unsure = _ESTIMATED_SHARE if noise.estimated else 0.0
    test = joint_test(said, stated.joint_m, seen, noise.position_m, noise.angle_rad, unsure)
    constrained = test.holds if joint is None else joint
    mechanism: Mechanism = test.joint if constrained else FreeBody()
    spectra = Spectra.of(streams.rate_hz, streams.valid, BAND_SHARE * streams.rate_hz)
    start = None if constrained else fit(problem_of(streams, test.joint, noise, known), spectra).vector
    problem = problem_of(streams, mechanism, noise, known)
    found = fit(problem, spectra, start)
    for _ in range(_NOISE_ROUNDS if noise.estimated else 0):
        noise = from_misfit(noise, problem, spectra, found, lambda p, a: fused(mechanism, frames_of(streams), p, a)[1])
        problem = problem_of(streams, mechanism, noise, known)
        found = fit(problem, spectra, found.vector)

    errors = errors_of(stated)
    before = _before(errors, streams, known).with_independent(test.lever_cov_m2)
    at, E, moved = np.zeros(len(before.mean)), _effects(problem, spectra, found, streams, known), known
    first = told(found, E, errors, before, at)
    after = updated(found, E, before, at, 1.0)
    for _ in range(_MOST_UPDATES):
        if (np.abs(after.mean - at) <= _SETTLED * np.sqrt(np.diag(after.covariance))).all():
            break
        at = after.mean
        mechanism = test.joint.moved(at[JOINT_ERRORS]) if constrained else mechanism
        moved = None if known is None else replace(known, vector=known.vector + at[PLATE_ERRORS])
        right = _corrected(streams, at)
        problem = problem_of(right, mechanism, noise, moved)
        found = fit(problem, spectra, found.vector)
        E = _effects(problem, spectra, found, right, moved)
        after = updated(found, E, before, at, 1.0)
    checked = told(found, E, errors, before, at)
    if checked.refuted:
        raise UserError(f"recording: {refutation(first, checked)}")
    left = chi2_left(found, spectra, E, after.mean - at)
    after = updated(found, E, before, at, max(1.0, left))
    response = found.response(E)
    nearest = consistent(found.information, found.information @ found.vector, bodies=1)
    return FittedRun(
        streams=streams,
        known=None if known is None else replace(known, vector=known.vector + after.mean[PLATE_ERRORS]),
        test=test,
        noise=noise,
        mechanism=mechanism,
        spectra=spectra,
        fit=found,
        vector=found.vector - response @ (after.mean - at),
        noise_covariance=max(1.0, left) * covariance_of(found.information, vector_scale(nearest)),
        response=response,
        belief=after,
        chi2_left=left,
        checked=checked,
    )


def problem_of(streams: Synchronous, mechanism: Mechanism, noise: NoiseLevel, plate: KnownBody | None) -> EivProblem:
    """Return (1) of impedance.identification.identification as a problem of one body.

    Raises UserError where a foot's recording does not know the `plate`.
    """
    q, q_cov = fused(mechanism, frames_of(streams), noise.position_m, noise.angle_rad)
    wrench = np.where(streams.valid[:, None], streams.wrench, 0.0)
    level = rest = level_rest()
    if streams.foot is not None:
        if plate is None:
            raise UserError("platform.toml: plate.cog_m, plate.inertia_kgm2: needed to identify the foot")
        if not streams.settings.tare.with_foot:
            wrench, rest = wrench + level @ plate.vector, np.zeros((6, 10))
    return EivProblem(NoiseModel(mechanism, q_cov, noise.wrench_std), q, wrench, rest)


def frames_of(streams: Synchronous) -> list[MarkerFrame]:
    """Return the frames whose markers are seen, plate and then foot; zeros where a sample is missing."""
    present = streams.valid[:, None]

    def frame(p_m: FloatArray, euler_rad: FloatArray, lever_m: FloatArray) -> MarkerFrame:
        return MarkerFrame(np.where(present, p_m, 0.0), np.where(present, euler_rad, 0.0), lever_m)

    frames = [frame(streams.plate.p_m, streams.plate.euler_rad, np.zeros(3))]
    if streams.foot is not None:
        lever_m = np.array(streams.settings.foot.origin_in_plate_m)
        frames.append(frame(streams.foot.p_m, streams.foot.euler_rad, lever_m))
    return frames


def _before(errors: Errors, streams: Synchronous, known: KnownBody | None) -> Belief:
    """Return what is believed of the instruments' errors (q,) and the plate's parameters (10,) before a run."""
    if streams.foot is not None and known is not None and known.belief is not None:
        return known.belief
    of_plate = np.zeros((10, 10)) if streams.foot is None or known is None else known.covariance
    return Belief(np.zeros(len(errors.deviation)), np.diag(errors.deviation)).with_independent(of_plate)


def _corrected(streams: Synchronous, at: FloatArray) -> Synchronous:
    """Return the streams with the instruments' errors `at` (q + 13,) taken out of the wrench."""
    here = np.arange(len(streams.t_s))
    bridged = [np.interp(here, here[streams.valid], column[streams.valid]) for column in streams.wrench.T]
    per_force_m = streams.settings.uncertainty.moment_per_force_m
    return replace(streams, wrench=corrected(np.stack(bridged, axis=1), streams.rate_hz, at[:-13], per_force_m))


def _effects(
    problem: EivProblem, spectra: Spectra, found: EivFit, streams: Synchronous, known: KnownBody | None
) -> ComplexArray:
    """Return the whitened effects (k, 6, q + 13) of instruments, plate and joint."""
    bare_tared = streams.foot is not None and not streams.settings.tare.with_foot
    tared = level_rest() if bare_tared else np.zeros((6, 10))
    was_tared = np.zeros(6) if known is None else tared @ known.vector
    parts = (
        effects(problem, spectra, found, was_tared, streams.settings.uncertainty.moment_per_force_m),
        found.whitened(problem, spectra, np.broadcast_to(-tared, (len(streams.t_s), 6, 10))),
        joint_effects(problem, spectra, found),
    )
    return np.concatenate(parts, axis=2)
