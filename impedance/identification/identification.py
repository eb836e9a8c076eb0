"""Ten inertia parameters of plate or foot from one recording: maximum likelihood, intervals, and what cannot be told.

What the tare took is the rest weight of what stood on it, level: the model says (Y − Y⁰) π, whatever offset the load
cells had, and the constants subtracted are not taken for a weight. With the bare plate tared and the foot mounted,

    w = (Y − Y⁰) π_P + Y π_F',   π = π_P + π_F' from  w + Y⁰ π_P = Y π                                            (1)

so plate and foot are one body, and the foot is what the plate leaves. With K = ∂π/∂w⁰ Y⁰ its covariance is

    cov π_F' = F⁻¹ + (K − 1) cov π_P (K − 1)ᵀ                                                                     (2)
"""

from dataclasses import dataclass

import numpy as np

from impedance.body.geometry import PLATFORM_GRAVITY_MPS2
from impedance.body.physical import Boundary, boundary, consistent
from impedance.body.rigid_body import Inertia
from impedance.identification.eiv import EivFit, EivProblem, NoiseModel, fit
from impedance.identification.mechanism import FreeBody, Mechanism, UniversalJoint, level_rest
from impedance.identification.noise_level import NoiseLevel, noise_level
from impedance.identification.observability import (
    Observability,
    about_cog,
    about_cog_slope,
    covariance_of,
    moving,
    observed,
    vector_scale,
)
from impedance.identification.pose_fusion import JointTest, MarkerFrame, fused, joint_test, mounting_offset
from impedance.identification.spectra import Spectra
from impedance.recording.recording import PlatformRecording
from impedance.recording.synchronous import Synchronous, synchronous
from messages.arrays import FloatArray
from messages.constants import NORMAL_95
from messages.errors import UserError

BAND_SHARE = 100.0 / 350.0
"""Of the rate: the equations are weighed up to 100 of 350 Hz, beyond what the platform moves."""
_MISFIT_NOTED = 0.1
_MASS_REFUTED = 4.0
_OFFSET_NOTED = 5.0


@dataclass(frozen=True)
class KnownBody:
    """Parameters π (10,) known beforehand in P, with their covariance (10, 10): zeros where they count as exact."""

    vector: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class Identification:
    """One body as a recording tells it, in its own frame: the plate in P, the foot in F, axes parallel to P's.

    `vector` (10,) is the likeliest π and `covariance` (10, 10) that of π; `body` is the nearest one that can exist, at
    `boundary` where that is a limit, `pull_chi2` away. `constrained` tells whether the joint was used, `test` what the
    markers say of it. `plate_known` is False where the foot's intervals leave the plate's uncertainty out.
    """

    what: str
    vector: FloatArray
    covariance: FloatArray
    body: Inertia
    boundary: Boundary | None
    pull_chi2: float
    observability: Observability
    constrained: bool
    test: JointTest
    noise: NoiseLevel
    fit: EivFit
    spectra: Spectra
    notes: tuple[str, ...]

    @property
    def estimate(self) -> FloatArray:
        """Return η (10,) of the body that can exist."""
        return about_cog(self.body.vector)

    @property
    def interval(self) -> FloatArray:
        """Return the 95 % intervals (10, 2) of η about the likeliest parameters."""
        step = about_cog_slope(self.body.vector) @ (self.vector - self.body.vector)
        half = NORMAL_95 * self.observability.deviation
        return np.column_stack((self.estimate + step - half, self.estimate + step + half))

    @property
    def known(self) -> KnownBody:
        """Return what another identification may take as known."""
        return KnownBody(self.vector, self.covariance)


def identify(
    recording: PlatformRecording, plate: KnownBody | None = None, joint: bool | None = None, *, weighed: bool = True
) -> Identification:
    """Return the plate of a recording without a foot, or the foot of one with it.

    `plate` is what an earlier run told of the plate; without it the foot's recording must state the plate's inertia.
    `joint` tells whether the universal joint holds the plate; None asks the markers. `weighed` takes the bare plate's
    stated mass for what a second on this force plate read, unless the motion refutes it. Raises UserError where the
    plate is not known, or where too little of the recording counts.
    """
    streams = synchronous(recording)
    noise = noise_level(streams)
    L = recording.settings.plate.joint_to_surface_m
    seen = MarkerFrame(streams.plate.p_m[streams.valid], streams.plate.euler_rad[streams.valid], np.zeros(3))
    test = joint_test(UniversalJoint(L), seen, noise.position_m, noise.angle_rad)
    constrained = test.holds if joint is None else joint
    mechanism: Mechanism = UniversalJoint(L) if constrained else FreeBody()
    known = plate if plate is not None else _stated_plate(recording)
    notes = list(recording.notes)
    if noise.estimated:
        notes.append(f"noise of {', '.join(noise.estimated)} is estimated from the quiet band")
    notes += _marker_notes(streams, test, L, noise.position_m)
    if not constrained and joint is None:
        notes.append("the markers refute the joint: identified without its constraint")

    spectra = Spectra.of(streams.rate_hz, streams.valid, BAND_SHARE * streams.rate_hz)
    problem = problem_of(streams, mechanism, noise, known)
    start = None
    if not constrained:
        start = fit(problem_of(streams, UniversalJoint(L), noise, known), spectra).vector
    found = fit(problem, spectra, start)
    if not found.converged:
        notes.append("the likelihood's maximum was not reached: take the estimate with care")
    if abs(found.chi2_ratio - 1.0) > _MISFIT_NOTED:
        notes.append(f"what is left is {found.chi2_ratio:.2f} times the declared noise's power: model or noise is off")

    nearest = consistent(found.information, found.information @ found.vector, bodies=1)
    covariance = covariance_of(found.information, vector_scale(nearest))
    if recording.foot is None:
        vector = found.vector
        stated_kg = recording.settings.plate.mass_kg
        off = abs(vector[0] - stated_kg) / float(np.sqrt(covariance[0, 0]))
        if weighed and off > _MASS_REFUTED:
            notes.append(f"plate.mass_kg {stated_kg:g} is {off:.1f} deviations from what moves: not used")
        elif weighed:
            gain = covariance[:, 0] / (covariance[0, 0] + weighing_deviation_kg(noise.force_n, streams.rate_hz) ** 2)
            vector = vector + gain * (stated_kg - vector[0])
            covariance = covariance - np.outer(gain, covariance[0])
        return _finished("plate", vector, covariance, constrained, test, noise, found, spectra, notes)
    assert known is not None
    if plate is None:
        notes.append(
            "the plate's inertia is taken as exact; its recording would bring its uncertainty into the intervals"
        )
    response = found.constant_response @ _tared_columns(streams) - np.eye(10)
    to_foot = moving(np.array(recording.settings.foot.origin_in_plate_m))
    foot_vector = to_foot @ (found.vector - known.vector)
    foot_covariance = to_foot @ (covariance + response @ known.covariance @ response.T) @ to_foot.T
    return _finished("foot", foot_vector, foot_covariance, constrained, test, noise, found, spectra, notes)


def _tared_columns(streams: Synchronous) -> FloatArray:
    """Return Y⁰ (6, 10) of (1) if the bare plate was tared under a foot, else zeros."""
    return level_rest() if streams.foot is not None and not streams.settings.tare.with_foot else np.zeros((6, 10))


def _marker_notes(streams: Synchronous, test: JointTest, L: float, position_std_m: float) -> list[str]:
    """Return what the markers say against the stated geometry."""
    notes = []
    if test.height_sigmas > _OFFSET_NOTED:
        half_mm = 1e3 * NORMAL_95 * test.height_deviation_m
        notes.append(
            f"joint_offset: the markers swing about a joint {1e3 * test.height_m:.2f} ± {half_mm:.2f} mm below the "
            f"surface, joint_to_surface_m is {1e3 * L:g} mm"
        )
    if streams.foot is not None:
        plate, foot = _frames(streams)
        here = streams.valid
        plate, foot = (MarkerFrame(f.p_m[here], f.euler_rad[here], f.lever_m) for f in (plate, foot))
        offset_m = mounting_offset(plate, foot)
        if np.abs(offset_m).max() > _OFFSET_NOTED * position_std_m * float(np.sqrt(2.0 / here.sum())):
            off = ", ".join(f"{1e3 * value:+.3f}" for value in offset_m)
            notes.append(f"foot_marker_offset: the foot's markers lie ({off}) mm from foot.origin_in_plate_m")
    return notes


def weighing_deviation_kg(force_std_n: float, rate_hz: float) -> float:
    """Return the standard deviation of a mass weighed for one second."""
    return force_std_n / PLATFORM_GRAVITY_MPS2 / float(np.sqrt(rate_hz))


def problem_of(streams: Synchronous, mechanism: Mechanism, noise: NoiseLevel, plate: KnownBody | None) -> EivProblem:
    """Return (1) as a problem of one body; raises UserError where a foot's recording does not know the `plate`."""
    q, q_cov = fused(mechanism, _frames(streams), noise.position_m, noise.angle_rad)
    wrench = np.where(streams.valid[:, None], streams.wrench, 0.0)
    level = rest = level_rest()
    if streams.foot is not None:
        if plate is None:
            raise UserError("platform.toml: plate.cog_m, plate.inertia_kgm2: needed to identify the foot")
        if not streams.settings.tare.with_foot:
            wrench, rest = wrench + level @ plate.vector, np.zeros((6, 10))
    wrench_std = np.repeat((noise.force_n, noise.torque_nm), 3)
    return EivProblem(NoiseModel(mechanism, q_cov, wrench_std), q, wrench, rest)


def _frames(streams: Synchronous) -> list[MarkerFrame]:
    present = streams.valid[:, None]

    def frame(p_m: FloatArray, euler_rad: FloatArray, lever_m: FloatArray) -> MarkerFrame:
        return MarkerFrame(np.where(present, p_m, 0.0), np.where(present, euler_rad, 0.0), lever_m)

    frames = [frame(streams.plate.p_m, streams.plate.euler_rad, np.zeros(3))]
    if streams.foot is not None:
        lever_m = np.array(streams.settings.foot.origin_in_plate_m)
        frames.append(frame(streams.foot.p_m, streams.foot.euler_rad, lever_m))
    return frames


def _stated_plate(recording: PlatformRecording) -> KnownBody | None:
    inertia = recording.settings.plate.inertia
    return None if inertia is None else KnownBody(inertia.vector, np.zeros((10, 10)))


def _finished(
    what: str,
    vector: FloatArray,
    covariance: FloatArray,
    constrained: bool,
    test: JointTest,
    noise: NoiseLevel,
    found: EivFit,
    spectra: Spectra,
    notes: list[str],
) -> Identification:
    information = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    nearest = consistent(information, information @ vector, bodies=1)
    off = nearest - vector
    return Identification(
        what=what,
        vector=vector,
        covariance=covariance,
        body=Inertia.from_vector(nearest),
        boundary=boundary(nearest),
        pull_chi2=float(off @ information @ off),
        observability=observed(nearest, covariance),
        constrained=constrained,
        test=test,
        noise=noise,
        fit=found,
        spectra=spectra,
        notes=tuple(notes),
    )
