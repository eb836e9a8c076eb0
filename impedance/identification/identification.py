"""Ten inertia parameters of plate or foot from one recording: maximum likelihood, intervals, and what cannot be told.

What the tare took is the rest weight of what stood on it, level: the model says (Y − Y⁰) π, whatever offset the load
cells had, and the constants subtracted are not taken for a weight. With the bare plate tared and the foot mounted,

    w = (Y − Y⁰) π_P + Y π_F',   π = π_P + π_F' from  w + Y⁰ π_P = Y π                                            (1)

so plate and foot are one body, and the foot is what the plate leaves. With ε the errors considered
(impedance.identification.considered), C what is believed of them after the run, K by what they move π, and J the part
of ε that is the plate's own parameters,

    cov π_F' = F⁻¹ + (K + J) C (K + J)ᵀ                                                                           (2)

What the plate's run tells of instruments and plate, together, is where the foot's run begins.
"""

from dataclasses import dataclass

import numpy as np

from impedance.body.geometry import PLATFORM_GRAVITY_MPS2
from impedance.body.physical import Boundary, boundary, consistent
from impedance.body.rigid_body import Inertia
from impedance.identification.considered import WEIGHING, Belief, Found, root_of
from impedance.identification.eiv import EivFit
from impedance.identification.fitted_run import PLATE_ERRORS, FittedRun, KnownBody, fitted_run, frames_of
from impedance.identification.noise_level import NoiseLevel
from impedance.identification.observability import Observability, about_cog, about_cog_slope, moving, observed
from impedance.identification.pose_fusion import JointTest, MarkerFrame, mounting_offset
from impedance.identification.spectra import Spectra
from impedance.recording.recording import PlatformRecording, UncertaintySettings
from messages.arrays import FloatArray
from messages.constants import NORMAL_95
from messages.errors import UserError

_MISFIT_NOTED = 0.1
_MASS_REFUTED = 4.0
_OFFSET_NOTED = 5.0
_DELAY_NOTED_S = 2e-5


@dataclass(frozen=True)
class Identification:
    """One body as a recording tells it, in its own frame: the plate in P, the foot in F, axes parallel to P's.

    `vector` (10,) is the likeliest π and `covariance` (10, 10) that of π; `noise_covariance` what noise alone leaves.
    `known` is what another run may start from; `checked` is what the misfit says of the instruments. `body` is the
    nearest one that can exist, at `boundary` where that is a limit, `pull_chi2` away. `constrained` tells whether the
    joint was used, `test` what the markers say of it. `chi2_left` is what is left of the misfit once the instruments'
    errors are taken out, 1 for noise alone.
    """

    what: str
    vector: FloatArray
    covariance: FloatArray
    noise_covariance: FloatArray
    known: KnownBody
    chi2_left: float
    checked: Found
    stated: UncertaintySettings
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
    def noise_deviation(self) -> FloatArray:
        """Return the standard deviations (10,) of η that noise alone leaves."""
        return observed(self.body.vector, self.noise_covariance).deviation

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


def identify(
    recording: PlatformRecording, plate: KnownBody | None = None, joint: bool | None = None, *, weighed: bool = True
) -> Identification:
    """Return the plate of a recording without a foot, or the foot of one with it.

    `plate` is what an earlier run told of the plate; without it the foot's recording must state the plate's inertia.
    `joint` tells whether the universal joint holds the plate; None asks the markers. `weighed` takes the bare plate's
    stated mass for what a second on this force plate read, unless the motion refutes it. Raises UserError where the
    plate is not known, where too little of the recording counts, or where the misfit refutes what `[uncertainty]` says
    of the instruments.
    """
    run = fitted_run(recording, plate if plate is not None else _stated_plate(recording), joint)
    notes = [*recording.notes, *_noise_notes(run), *_delay_notes(run.checked), *_marker_notes(run, joint)]
    if recording.foot is None:
        return _plate(run, weighed, notes)
    if plate is None:
        notes.append(
            "the plate's inertia is taken as exact; its recording would bring its uncertainty into the intervals"
        )
    return _foot(run, notes)


def weighing_deviation_kg(force_std_n: float, rate_hz: float) -> float:
    """Return the standard deviation of a mass weighed for one second."""
    return force_std_n / PLATFORM_GRAVITY_MPS2 / float(np.sqrt(rate_hz))


def _plate(run: FittedRun, weighed: bool, notes: list[str]) -> Identification:
    """Return the bare plate, with its mass as it was weighed: an update of parameters and errors by one reading more.

    With x = (ε, π), stated mass = π_0 (1 + ε_mass + ε_gain) + the noise of the reading, ε_gain being that of all
    channels alike, unless another scale weighed it.
    """
    errors = run.checked.errors
    q = len(errors.deviation)
    of_errors, noise_covariance = run.belief.root[:q], run.noise_covariance
    root = np.block([[of_errors, np.zeros((q, 10))], [-run.response @ run.belief.root, root_of(noise_covariance)]])
    mean, covariance = np.concatenate((run.belief.mean[:q], run.vector)), root @ root.T
    stated_kg = run.streams.settings.plate.mass_kg
    reads = np.zeros(q + 10)
    reads[q] = 1.0
    reads[errors.where(WEIGHING)] = stated_kg
    stated = run.streams.settings.uncertainty
    if stated.mass_share is None:
        reads[errors.where("gain")[0]] = stated_kg
    read_kg2 = weighing_deviation_kg(run.noise.force_n, run.streams.rate_hz) ** 2
    off_kg, open_kg2 = stated_kg - reads @ mean, reads @ covariance @ reads
    beyond = abs(off_kg) > _MASS_REFUTED * np.sqrt(open_kg2 + read_kg2)
    if weighed and beyond and stated.mass_share is not None and stated.gain_share > 0.0:
        raise UserError(_shared_gain("the plate", stated_kg, float(mean[q]), stated))
    if weighed and beyond:
        notes.append(
            f"plate.mass_kg {stated_kg:g} is {abs(off_kg) / np.sqrt(open_kg2):.1f} deviations from what moves: not used"
        )
    elif weighed:
        gain, of_mass = covariance @ reads / (open_kg2 + read_kg2), noise_covariance[0]
        mean, covariance = mean + gain * off_kg, covariance - np.outer(gain, reads @ covariance)
        noise_covariance = noise_covariance - np.outer(of_mass, of_mass) / (of_mass[0] + read_kg2)
    belief = Belief(np.concatenate((mean[:q], np.zeros(10))), root_of(covariance))
    return _finished("plate", KnownBody(mean[q:], covariance[q:, q:], belief), noise_covariance, run, notes)


def _foot(run: FittedRun, notes: list[str]) -> Identification:
    """Return the foot, in F, by (1) and (2)."""
    assert run.known is not None
    settings = run.streams.settings
    to_foot = moving(np.array(settings.foot.origin_in_plate_m))
    vector = to_foot @ (run.vector - run.known.vector)
    off = run.response.copy()
    off[:, PLATE_ERRORS] += np.eye(10)
    off = to_foot @ off @ run.belief.root
    of_lever = np.stack([(moving(unit) - moving(-unit)) @ vector / 2.0 for unit in np.eye(3)], axis=1)
    noise_covariance = to_foot @ run.noise_covariance @ to_foot.T
    covariance = noise_covariance + off @ off.T + settings.uncertainty.foot_origin_m**2 * of_lever @ of_lever.T
    stated_kg, read_kg2 = settings.foot.mass_kg, settings.foot.mass_deviation_kg**2
    if stated_kg is not None:
        off_kg, open_kg2 = stated_kg - vector[0], covariance[0, 0]
        if abs(off_kg) > _MASS_REFUTED * np.sqrt(open_kg2 + read_kg2):
            raise UserError(_shared_gain("the foot", stated_kg, float(vector[0]), settings.uncertainty))
        share, half = -off_kg / stated_kg, NORMAL_95 * float(np.sqrt(noise_covariance[0, 0] + read_kg2)) / stated_kg
        notes.append(
            f"the known mass of {stated_kg:g} kg is read {100.0 * share:+.3f} ± {100.0 * half:.3f} % off, beyond what "
            "was found before: a gain of all channels alike, taken out"
        )
        vector = vector + covariance[:, 0] * off_kg / (open_kg2 + read_kg2)
        covariance = covariance - np.outer(covariance[0], covariance[0]) / (open_kg2 + read_kg2)
        noise_covariance = noise_covariance - np.outer(noise_covariance[0], noise_covariance[0]) / (
            noise_covariance[0, 0] + read_kg2
        )
    elif settings.uncertainty.gain_share > 0.0:
        notes.append(
            "a gain that all channels share shows in no motion; that it is at most uncertainty.gain_share "
            f"({100.0 * settings.uncertainty.gain_share:g} %) is believed: foot.mass_kg of another scale would tell it"
        )
    return _finished("foot", KnownBody(vector, covariance), noise_covariance, run, notes)


def _shared_gain(what: str, known_kg: float, read_kg: float, stated: UncertaintySettings) -> str:
    """Return one line on a known mass that the force plate does not read as such."""
    return (
        f"recording: the force plate reads {what} of {known_kg:g} kg as {read_kg:.4g} kg, a gain of "
        f"{100.0 * (read_kg / known_kg - 1.0):+.2f} % in all channels alike; uncertainty.gain_share is "
        f"{stated.gain_share:g}: correct it, or state what the laboratory knows"
    )


def _stated_plate(recording: PlatformRecording) -> KnownBody | None:
    inertia = recording.settings.plate.inertia
    return None if inertia is None else KnownBody(inertia.vector, np.zeros((10, 10)))


def _finished(
    what: str, known: KnownBody, noise_covariance: FloatArray, run: FittedRun, notes: list[str]
) -> Identification:
    information = np.asarray(np.linalg.inv(known.covariance), dtype=np.float64)
    nearest = consistent(information, information @ known.vector, bodies=1)
    off = nearest - known.vector
    return Identification(
        what=what,
        vector=known.vector,
        covariance=known.covariance,
        noise_covariance=noise_covariance,
        known=known,
        chi2_left=run.chi2_left,
        checked=run.checked,
        stated=run.streams.settings.uncertainty,
        body=Inertia.from_vector(nearest),
        boundary=boundary(nearest),
        pull_chi2=float(off @ information @ off),
        observability=observed(nearest, known.covariance),
        constrained=run.constrained,
        test=run.test,
        noise=run.noise,
        fit=run.fit,
        spectra=run.spectra,
        notes=tuple(notes),
    )


def _noise_notes(run: FittedRun) -> list[str]:
    """Return how the noise was found, and what the fit leaves beyond it."""
    noise, notes = run.noise, []
    if noise.estimated:
        levels = ", ".join(f"{value:.3g}" for value in noise.wrench_std)
        notes.append(
            f"noise of {', '.join(noise.estimated)} is estimated from the misfit: {levels} N and N·m along x, y, z, "
            f"{1e3 * noise.position_m:.3g} mm, {1e6 * noise.angle_rad:.3g} µrad"
        )
    if not run.fit.converged:
        notes.append("the likelihood's maximum was not reached: take the estimate with care")
    if abs(run.chi2_left - 1.0) > _MISFIT_NOTED:
        whose = "of noise that is alike at all frequencies" if noise.estimated else "of the declared noise"
        notes.append(
            f"what is left is {run.chi2_left:.2f} times the power {whose}: model or noise is off"
            + (", the intervals are wider by its root" if run.chi2_left > 1.0 else "")
        )
    return notes


def _delay_notes(checked: Found) -> list[str]:
    """Return that the force stamps are late, or early, where the interval leaves ± 20 µs out."""
    (k,) = checked.errors.where("delay")
    value_s, half_s = float(checked.value[k]), NORMAL_95 * float(checked.deviation[k])
    if abs(value_s) - half_s < _DELAY_NOTED_S:
        return []
    what = "taken out" if checked.errors.deviation[k] > 0.0 else "the stamps are used as they are"
    return [f"force_delay: the force is {1e3 * value_s:+.3f} ± {1e3 * half_s:.3f} ms late: {what}"]


def _marker_notes(run: FittedRun, joint: bool | None) -> list[str]:
    """Return what the markers say against the stated geometry."""
    streams, test = run.streams, run.test
    notes = []
    if test.elsewhere:
        seen = ", ".join(
            f"{1e3 * value:+.2f} ± {1e3 * NORMAL_95 * deviation:.2f}"
            for value, deviation in zip(test.seen_m, test.seen_deviation_m, strict=True)
        )
        used = "used" if run.constrained and streams.settings.uncertainty.joint_m > 0.0 else "not used"
        notes.append(
            f"joint_offset: from the joint that the markers swing about, P's origin lies ({seen}) mm away, stated is "
            f"(0, {1e3 * streams.settings.plate.joint_to_surface_m:g}, 0) mm: {used}"
        )
    if joint is None and not run.constrained:
        notes.append("the markers refute the joint: identified without its constraint")
    if streams.foot is not None:
        plate, foot = frames_of(streams)
        here = streams.valid
        plate, foot = (MarkerFrame(f.p_m[here], f.euler_rad[here], f.lever_m) for f in (plate, foot))
        offset_m = mounting_offset(plate, foot)
        if np.abs(offset_m).max() > _OFFSET_NOTED * run.noise.position_m * float(np.sqrt(2.0 / here.sum())):
            off = ", ".join(f"{1e3 * value:+.3f}" for value in offset_m)
            notes.append(f"foot_marker_offset: the foot's markers lie ({off}) mm from foot.origin_in_plate_m")
    return notes
