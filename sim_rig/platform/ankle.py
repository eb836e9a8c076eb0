"""A person on the vibrating platform: cycles of stance, perturbed, and what the sensors make of them.

The truth is made without any of the estimator's equations: the shank answers the ankle's moments by its own equation of
motion, and so does the foot on shoe and heel pad, where there is a shoe; the reflex is a half-wave rectified stretch
rate, 0.1 s late, through muscle dynamics; balance is a late feedback of the shank's sway; the wrench on the sensor is
the rate of change of the momenta of plate and foot, differentiated numerically at four times the sampling rate, minus
weight and what the shank does at the ankle, wherever shoe and heel have taken it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from impedance.ankle.table import AnkleTable, AxisTable
from impedance.ankle.trial import (
    Ankle,
    AnkleTrial,
    BodyPrior,
    FlatFoot,
    Manoeuvre,
    Perturbation,
    Subject,
    TrialSettings,
)
from impedance.body.geometry import GRAVITY_I_MPS2
from messages.arrays import BoolArray, FloatArray, IntArray
from sim_rig.platform.ankle_person import Person, Shoe
from sim_rig.platform.rig import MOTION_HZ, PLATE, THESIS_NOISE

FLAT_FOOT: Final = (0.10, 0.80)
_OVERSAMPLING = 4
_PAD = 24
_JOINT_TO_SURFACE_M: Final = 0.12
_RAMP_RAD: Final = np.deg2rad(2.0)
_RAMP_S: Final = 0.075
_RANDOM_BAND_HZ: Final = (4.0, 25.0)
_RANDOM_RMS_RAD: Final = np.deg2rad(0.5)
_REFLEX_DELAY_S: Final = 0.100
_MUSCLE_RADPS: Final = 25.0
_BALANCE_DELAY_S: Final = 0.15
_BALANCE_PER_S2: Final = 3.0
_SLOW_BAND_HZ: Final = (0.2, 2.0)
_SLOW_MOMENT_PER_KG: Final = np.array([0.03, 0.01])
_SLOW_SHANK_RAD: Final = 0.008
_SLOW_FORCE_SHARE: Final = 0.02
_HEEL_OFF_DIFFERS: Final = 0.02
_HEEL_RISE_RAD: Final = 0.5


@dataclass(frozen=True)
class AnkleNoise:
    """Standard deviations of white noise; `snr_db`, if any, sets the moments' noise from the perturbed moment
    instead."""

    plate_rad: float = THESIS_NOISE.angle_rad
    shank_rad: float = 3e-4
    foot_rad: float = 3e-4
    heel_m: float = 1e-4
    force_n: float = THESIS_NOISE.force_n
    torque_nm: float = THESIS_NOISE.torque_nm
    snr_db: float | None = None


SENSOR_NOISE: Final = AnkleNoise()
AT_15_DB: Final = AnkleNoise(snr_db=15.0)


@dataclass(frozen=True)
class AnkleRun:
    """Noise-free cycles at 350 Hz, one after the other (n samples), and the truth about them.

    `foot_rad` (n, 2) is the foot's angle, the plate's without a shoe, and `heel_rise_m` (n,) how far its heel rose;
    `turn`, `rate` (n, 2): x and ẋ of the ankle against its own course, `acceleration` (n, 2) of the plate;
    `intrinsic_nm` (n, 2) = K x + B ẋ + I θ̈, I the foot's moment about the ankle `foot_about_ankle_kgm2` (2,);
    `flat` (n,) where it counts.
    """

    person: Person
    settings: TrialSettings
    cycle: IntArray
    t_s: FloatArray
    stance: FloatArray
    plate_rad: FloatArray
    shank_rad: FloatArray
    wrench: FloatArray
    perturbation: tuple[Perturbation, ...]
    onset_s: FloatArray
    foot_rad: FloatArray
    heel_rise_m: FloatArray
    turn: FloatArray
    rate: FloatArray
    acceleration: FloatArray
    intrinsic_nm: FloatArray
    foot_about_ankle_kgm2: FloatArray
    flat: BoolArray

    @property
    def perturbed(self) -> BoolArray:
        """Return (n,) where the flat foot is perturbed; of a ramp from its onset to before the reflex."""
        moved = np.array([kind is not Perturbation.NONE for kind in self.perturbation])[self.cycle]
        after_s = self.t_s - self.onset_s[self.cycle]
        in_time: BoolArray = np.isnan(after_s) | ((after_s >= 0.0) & (after_s < _REFLEX_DELAY_S))
        perturbed: BoolArray = self.flat & moved & in_time
        return perturbed


def walk(person: Person, plan: Sequence[Perturbation], seed: int, slope_deg: float = 0.0) -> AnkleRun:
    """Return the cycles of `plan`, one perturbation each; a ramp's onset lies anywhere in the flat foot's stance."""
    rng = np.random.default_rng((seed, 2))
    count, dt = len(plan), 1.0 / (MOTION_HZ * _OVERSAMPLING)
    stance_s = person.stance_s * (1.0 + 0.03 * np.clip(rng.standard_normal(count), -2.0, 2.0))
    samples = int(np.ceil(stance_s.max() / dt)) + 2 * _PAD
    t = dt * np.arange(-_PAD, samples - _PAD, dtype=np.float64)
    stance: FloatArray = np.divide(t, stance_s[:, None], dtype=np.float64)
    onset_s = stance_s * rng.permutation(np.linspace(FLAT_FOOT[0], FLAT_FOOT[1] - 0.12, count))
    slope = np.array([np.deg2rad(slope_deg), 0.0])
    plate = slope + _plate_motion(plan, onset_s, t, stance, rng)
    plate_rate, plate_acceleration = _derivative(plate, dt), _derivative(_derivative(plate, dt), dt)

    answer = _answered(person, plate - slope, plate_rate, stance, dt)
    sway, turn, rate = answer.sway, answer.turn, answer.rate
    slow = _slow(rng, t, count, 2) * person.restless * person.mass_kg * _SLOW_MOMENT_PER_KG
    fatigue = np.linspace(-1.0, 1.0, count)[:, None, None] * 0.02 * person.usual_moment(np.clip(stance, 0.0, 1.0))
    contact = np.clip(stance, 0.0, 1.0)
    on_foot = -(person.usual_moment(contact) + fatigue + slow + answer.moment)
    natural = person.restless * _SLOW_SHANK_RAD * _slow(rng, t, count, 2)
    shank = person.usual_shank(contact) + natural + sway
    push = person.usual_force(contact) * (1.0 + person.restless * _SLOW_FORCE_SHARE * _slow(rng, t, count, 3))
    slip, rise = np.zeros(plate.shape), np.zeros(plate.shape)
    heel_m = np.zeros(stance.shape)
    if person.shoe is not None:
        slip = answer.slip - (person.usual_moment(contact) + fatigue + slow) / person.shoe.stiffness
        rise[..., 0] = _heel_rise(person.shoe, stance, rng)
        heel_m = (person.shoe.heel_m - person.shoe.ball_m) * np.sin(rise[..., 0]) + person.shoe.heel_m * slip[..., 0]
    wrench = _sensed(person, plate, slip, rise, push, on_foot, dt)
    inertia = _about(person.ankle_P_m, person.foot_kg, person.foot_cog_P_m, person.foot_kgm2)

    taken = np.zeros(stance.shape, dtype=np.bool_)
    taken[:, _PAD:-_PAD:_OVERSAMPLING] = True
    taken &= (stance >= 0.0) & (stance <= 1.0)
    cycle = np.nonzero(taken)[0]
    ramp = np.array([kind is Perturbation.RAMP for kind in plan])
    return AnkleRun(
        person=person,
        settings=_settings(person, slope_deg, rng),
        cycle=cycle,
        t_s=np.broadcast_to(t, stance.shape)[taken],
        stance=stance[taken],
        plate_rad=plate[taken],
        shank_rad=shank[taken],
        wrench=wrench[taken],
        perturbation=tuple(plan),
        onset_s=np.where(ramp, onset_s, np.nan),
        foot_rad=(plate + slip + rise)[taken],
        heel_rise_m=heel_m[taken],
        turn=turn[taken],
        rate=rate[taken],
        acceleration=plate_acceleration[taken],
        intrinsic_nm=(answer.intrinsic + inertia * plate_acceleration)[taken],
        foot_about_ankle_kgm2=inertia,
        flat=(stance[taken] >= FLAT_FOOT[0]) & (stance[taken] <= FLAT_FOOT[1]),
    )


def measured(run: AnkleRun, noise: AnkleNoise, seed: int) -> AnkleTrial:
    """Return the trial that the sensors record of the run; the signal of `snr_db` is the perturbed intrinsic moment."""
    rng = np.random.default_rng((seed, 3))
    torque_nm = np.full(3, noise.torque_nm)
    if noise.snr_db is not None:
        signal = np.sqrt((run.intrinsic_nm[run.perturbed] ** 2).mean(axis=0))
        torque_nm[[2, 0]] = signal / 10.0 ** (noise.snr_db / 20.0)
    deviations = np.concatenate((np.full(3, noise.force_n), torque_nm))
    trial = AnkleTrial(
        settings=run.settings,
        cycle=run.cycle,
        t_s=run.t_s,
        stance=run.stance,
        plate_rad=run.plate_rad + noise.plate_rad * rng.standard_normal(run.plate_rad.shape),
        shank_rad=run.shank_rad + noise.shank_rad * rng.standard_normal(run.shank_rad.shape),
        wrench=run.wrench + deviations * rng.standard_normal(run.wrench.shape),
        perturbation=run.perturbation,
        onset_s=run.onset_s,
    )
    if run.person.shoe is None:
        return trial
    return replace(
        trial,
        foot_rad=run.foot_rad + noise.foot_rad * rng.standard_normal(run.foot_rad.shape),
        heel_rise_m=run.heel_rise_m + noise.heel_m * rng.standard_normal(len(run.t_s)),
    )


def true_table(run: AnkleRun, points: int = 29) -> AnkleTable:
    """Return the true impedance as the table that an identification of the run should come to; no interval."""
    stance = np.linspace(*FLAT_FOOT, points)
    K, B = run.person.stiffness(stance), run.person.damping(stance)
    moment, rest = run.person.usual_moment(stance), true_equilibrium(run, stance)
    first, second = (
        AxisTable(
            *(K[:, axis].tolist(),) * 3,
            *(B[:, axis].tolist(),) * 3,
            *(float(run.foot_about_ankle_kgm2[axis]),) * 3,
            [],
            *(0.0, 0.0),
            *(moment[:, axis].tolist(),) * 3,
            *(rest[:, axis].tolist(),) * 3,
        )
        for axis in range(2)
    )
    settings = run.settings
    return AnkleTable(
        manoeuvre=settings.manoeuvre,
        ground_slope_deg=settings.ground_slope_deg,
        subject=settings.subject.code,
        body_mass_kg=settings.subject.mass_kg,
        perturbed_cycles=sum(kind is not Perturbation.NONE for kind in run.perturbation),
        stance_percent=(100.0 * stance).round(6).tolist(),
        dorsi_plantarflexion=first,
        inversion_eversion=second,
    )


def true_equilibrium(run: AnkleRun, stance: FloatArray) -> FloatArray:
    """Return (k, 2): the angle of foot against shank, rad, at which the ankle's spring makes no moment."""
    slope = np.array([np.deg2rad(run.settings.ground_slope_deg), 0.0])
    person = run.person
    rest: FloatArray = slope - person.usual_shank(stance) - person.usual_moment(stance) / person.stiffness(stance)
    return rest


def _plate_motion(
    plan: Sequence[Perturbation], onset_s: FloatArray, t: FloatArray, stance: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return (c, n, 2): θ and φ against the level or the slope."""
    signs = rng.choice([-1.0, 1.0], (len(plan), 1, 2))
    u = np.clip((t - onset_s[:, None]) / _RAMP_S, 0.0, 1.0)[..., None]
    ramp = signs * _RAMP_RAD * (u**3 * (10.0 - 15.0 * u + 6.0 * u**2))
    envelope = np.clip(stance / 0.12, 0.0, 1.0)[..., None]
    envelope = envelope**3 * (10.0 - 15.0 * envelope + 6.0 * envelope**2)
    random = _RANDOM_RMS_RAD * envelope * _band(rng, t, len(plan), 2, _RANDOM_BAND_HZ)
    kind = np.array([(each is Perturbation.RAMP, each is Perturbation.RANDOM) for each in plan], dtype=np.float64)
    motion: FloatArray = kind[:, :1, None] * ramp + kind[:, 1:, None] * random
    return motion


def _band(
    rng: np.random.Generator, t: FloatArray, cycles: int, channels: int, band_hz: tuple[float, float]
) -> FloatArray:
    """Return (c, n, k) of Gaussian noise of unit variance, flat within the band: 60 random harmonics of each."""
    f = rng.uniform(*band_hz, (60, cycles, channels))
    sine, cosine = rng.standard_normal((2, 60, cycles, channels))
    noise: FloatArray = np.zeros((cycles, len(t), channels))
    for f_k, sine_k, cosine_k in zip(f, sine, cosine, strict=True):
        phase = 2.0 * np.pi * f_k[:, None] * t[:, None]
        noise += sine_k[:, None] * np.sin(phase) + cosine_k[:, None] * np.cos(phase)
    unit: FloatArray = noise / np.sqrt(60.0)
    return unit


def _slow(rng: np.random.Generator, t: FloatArray, cycles: int, channels: int) -> FloatArray:
    return _band(rng, t, cycles, channels, _SLOW_BAND_HZ)


@dataclass(frozen=True)
class _Answer:
    """What plate and body do to each other, (c, n, 2): the shank's `sway`, the foot's `slip` on its shoe, the ankle's
    `turn` and `rate`, its `intrinsic` moment, and the whole `moment`, with reflex and balance."""

    sway: FloatArray
    slip: FloatArray
    turn: FloatArray
    rate: FloatArray
    intrinsic: FloatArray
    moment: FloatArray


def _answered(person: Person, plate: FloatArray, plate_rate: FloatArray, stance: FloatArray, dt: float) -> _Answer:
    """Return the answer to the plate: semi-implicit Euler at 1400 Hz, all cycles and axes at once.

    J η̈ = M − c η̇ and, on a shoe, I φ̈ = −M − Kₛ (φ − θ) − Bₛ (φ̇ − θ̇), with M = K x + B ẋ + late, x = φ − η.
    """
    K, B, across = person.stiffness(stance), person.damping(stance), person.cross_stiffness(stance)[..., None]
    J, shoe = person.shank_kgm2, person.shoe
    foot_kgm2 = _about(person.ankle_P_m * (1.0, 0.0, 1.0), person.foot_kg, person.foot_cog_P_m, person.foot_kgm2)
    resist = 6.0 * J
    reflex_late, balance_late = round(_REFLEX_DELAY_S / dt), round(_BALANCE_DELAY_S / dt)
    gain = person.reflex_nm_s * np.clip(np.sin(np.pi * np.clip(stance, 0.0, 1.0)), 0.0, 1.0)[..., None]
    balancing = person.restless * _BALANCE_PER_S2 * J
    contact = ((stance >= 0.0) & (stance <= 1.0))[..., None]
    sway, speed = np.zeros(plate.shape), np.zeros(plate.shape)
    foot, foot_rate = plate.copy(), plate_rate.copy()
    turn, rate = np.zeros(plate.shape), np.zeros(plate.shape)
    intrinsic, moment = np.zeros(plate.shape), np.zeros(plate.shape)
    active, activation = np.zeros_like(plate[:, 0]), np.zeros_like(plate[:, 0])
    for k in range(1, plate.shape[1]):
        now = k - 1
        turn[:, now], rate[:, now] = foot[:, now] - sway[:, now], foot_rate[:, now] - speed[:, now]
        stretch = np.maximum(rate[:, max(k - reflex_late, 0)], 0.0)
        activation = activation + dt * _MUSCLE_RADPS * (stretch - activation)
        active = active + dt * _MUSCLE_RADPS * (activation - active)
        past = max(k - balance_late, 0)
        late = gain[:, now] * active - balancing * (sway[:, past] + 0.3 * speed[:, past])
        own = K[:, now] * turn[:, now] + B[:, now] * rate[:, now] + across[:, now] * turn[:, now, ::-1]
        intrinsic[:, now], moment[:, now] = contact[:, now] * own, contact[:, now] * (own + late)
        speed[:, k] = speed[:, now] + dt * (moment[:, now] - resist * speed[:, now]) / J
        sway[:, k] = sway[:, now] + dt * speed[:, k]
        if shoe is not None:
            give, give_rate = foot[:, now] - plate[:, now], foot_rate[:, now] - plate_rate[:, now]
            borne = -moment[:, now] - shoe.stiffness * give - shoe.damping * give_rate
            foot_rate[:, k] = foot_rate[:, now] + dt * borne / foot_kgm2
            foot[:, k] = foot[:, now] + dt * foot_rate[:, k]
    turn[:, -1], rate[:, -1] = foot[:, -1] - sway[:, -1], foot_rate[:, -1] - speed[:, -1]
    return _Answer(sway, foot - plate, turn, rate, intrinsic, moment)


def _heel_rise(shoe: Shoe, stance: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the foot's turn over the ball (c, n) about Z; steps differ in where it begins."""
    begins = shoe.heel_off + _HEEL_OFF_DIFFERS * rng.standard_normal((len(stance), 1))
    u = np.clip((stance - begins) / np.maximum(1.0 - begins, 1e-3), 0.0, 1.0)
    turned: FloatArray = -_HEEL_RISE_RAD * u * u * (3.0 - 2.0 * u)
    return turned if shoe.heel_off < 1.0 else 0.0 * turned


def _sensed(
    person: Person,
    plate: FloatArray,
    slip: FloatArray,
    rise: FloatArray,
    push: FloatArray,
    on_foot: FloatArray,
    dt: float,
) -> FloatArray:
    """Return the wrench (c, n, 6) of the sensor on the plate, in P about P's origin, the level plate's weight tared.

    The foot has turned by `slip` (c, n, 2) about the point below the ankle and then by `rise` over the ball; `push` (c, n, 3) in I is what the platform must carry of the person beside the foot's weight; `on_foot` (c, n, 2) is
    the moment of the shank on the foot about P's Z and X at the ankle.
    """
    shape = plate.shape[:2]
    R, R_slip, R_rise = (_rotation(each) for each in (plate, slip, rise))
    up = np.array([0.0, _JOINT_TO_SURFACE_M, 0.0])
    below = person.ankle_P_m * (1.0, 0.0, 1.0)
    ball = below + (0.0 if person.shoe is None else person.shoe.ball_m) * np.array([1.0, 0.0, 0.0])
    R_foot = R @ R_rise @ R_slip

    def on_foot_at(place: FloatArray) -> FloatArray:
        moved = (R_slip @ (place - below)) + below - ball
        held: FloatArray = (R @ (up + ball + (R_rise @ moved[..., None])[..., 0])[..., None])[..., 0]
        return held

    origin, ankle = R @ up, on_foot_at(person.ankle_P_m)
    force, moment = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    for mass_kg, c, J, turned in (
        (PLATE.mass_kg, R @ (up + PLATE.cog_m), PLATE.inertia_kgm2, R),
        (person.foot_kg, on_foot_at(person.foot_cog_P_m), person.foot_kgm2, R_foot),
    ):
        spun = np.einsum("...ij,jk,...lk,...l->...i", turned, J, turned, _spin(turned, dt))
        load = mass_kg * (_derivative(_derivative(c, dt), dt) - GRAVITY_I_MPS2)
        force += load
        moment += np.cross(c - origin, load) + _derivative(spun, dt)
    shank = -push - person.leg_kg * _derivative(_derivative(ankle, dt), dt)
    shank_moment = np.stack((on_foot[..., 1], np.zeros(shape), on_foot[..., 0]), axis=-1)
    force -= shank
    moment -= np.cross(ankle - origin, shank) + np.einsum("...ij,...j->...i", R, shank_moment)
    into_P = np.swapaxes(R, -1, -2)
    tare_n = -PLATE.mass_kg * GRAVITY_I_MPS2
    tare_nm = np.cross(PLATE.cog_m, tare_n)
    return np.concatenate(
        ((into_P @ force[..., None])[..., 0] - tare_n, (into_P @ moment[..., None])[..., 0] - tare_nm), axis=-1
    )


def _rotation(turned: FloatArray) -> FloatArray:
    """Return the rotations (c, n, 3, 3) by angles (c, n, 2) about Z and X."""
    R: FloatArray = Rotation.from_euler("ZX", turned.reshape(-1, 2)).as_matrix().reshape(*turned.shape[:2], 3, 3)
    return R


def _spin(R: FloatArray, dt: float) -> FloatArray:
    """Return the angular velocity (c, n, 3) in I."""
    spin = _derivative(R.reshape(*R.shape[:2], 9), dt).reshape(R.shape) @ np.swapaxes(R, -1, -2)
    return np.stack((spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]), axis=-1)


def _about(A: FloatArray, mass_kg: float, cog: FloatArray, J: FloatArray) -> FloatArray:
    """Return a body's moments of inertia (2,) about Z and X through A."""
    x, y, z = cog - A
    moments: FloatArray = np.array([J[2, 2] + mass_kg * (x * x + y * y), J[0, 0] + mass_kg * (y * y + z * z)])
    return moments


def _derivative(values: FloatArray, dt: float) -> FloatArray:
    """Return the time derivative along axis 1 by central differences of eighth order; ends count as at rest."""
    rate = np.zeros_like(values)
    for reach, weight in enumerate((4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0), start=1):
        ahead, behind = values[:, 4 + reach : values.shape[1] - 4 + reach], values[:, 4 - reach : -4 - reach]
        rate[:, 4:-4] += weight * (ahead - behind)
    derivative: FloatArray = rate / dt
    return derivative


def _settings(person: Person, slope_deg: float, rng: np.random.Generator) -> TrialSettings:
    """Return what the laboratory knows: bodies and ankle, each off by its own deviation."""
    plate = _prior(rng, PLATE.mass_kg, PLATE.cog_m, PLATE.inertia_kgm2, 0.005, 2e-4, 0.01)
    foot = _prior(rng, person.foot_kg, person.foot_cog_P_m, person.foot_kgm2, 0.05 * person.foot_kg, 4e-3, 0.15)
    x, y, z = (person.ankle_P_m + 0.002 * rng.standard_normal(3)).tolist()
    return TrialSettings(
        manoeuvre=Manoeuvre.STRAIGHT if person.walks else Manoeuvre.STANDING,
        ground_slope_deg=slope_deg,
        rate_hz=MOTION_HZ,
        joint_to_surface_m=_JOINT_TO_SURFACE_M,
        subject=Subject(code="simulated", mass_kg=round(person.mass_kg, 1)),
        flat_foot=FlatFoot(100.0 * FLAT_FOOT[0], 100.0 * FLAT_FOOT[1]),
        ankle=Ankle(in_plate_m=(x, y, z), deviation_m=0.002),
        plate=plate,
        foot=foot,
    )


def _prior(
    rng: np.random.Generator, mass_kg: float, cog_m: FloatArray, J: FloatArray, dm: float, dd: float, share: float
) -> BodyPrior:
    """Return a body as it was measured before: mass ± dm, centre of gravity ± dd, tensor ± `share` of its moments."""
    tensor = J[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
    deviation = share * np.concatenate((np.diag(J), np.full(3, np.diag(J).min())))
    return BodyPrior(
        mass_kg + dm * float(rng.standard_normal()),
        tuple((cog_m + dd * rng.standard_normal(3)).tolist()),
        tuple((tensor + deviation * rng.standard_normal(6)).tolist()),
        dm,
        (dd, dd, dd),
        tuple(deviation.tolist()),
    )
