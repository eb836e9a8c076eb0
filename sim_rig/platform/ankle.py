"""A person on the vibrating platform: cycles of stance, perturbed.

The truth is made without any of the estimator's equations: the shank answers the ankle's moments by its own equation of
motion, and so does the foot on shoe and heel pad, where there is a shoe; the reflex is a half-wave rectified stretch
rate, 0.1 s late, through muscle dynamics; balance is a late feedback of the shank's sway; the wrench on the sensor is
the rate of change of the momenta of plate and foot, differentiated numerically at four times the sampling rate, minus
weight and what the shank does at the ankle, wherever shoe and heel have taken it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from impedance.ankle.trial import Perturbation, TrialSettings
from messages.arrays import BoolArray, FloatArray, IntArray
from sim_rig.platform.ankle_known import FLAT_FOOT, settings_of
from sim_rig.platform.ankle_person import Person, Shoe
from sim_rig.platform.ankle_sensed import derivative, moments_about, sensed
from sim_rig.platform.rig import MOTION_HZ

_OVERSAMPLING = 4
_PAD = 24
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
    plate_rate, plate_acceleration = derivative(plate, dt), derivative(derivative(plate, dt), dt)

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
    wrench = sensed(person, plate, slip, rise, push, on_foot, dt)
    inertia = moments_about(person.ankle_P_m, person.foot_kg, person.foot_cog_P_m, person.foot_kgm2)

    taken = np.zeros(stance.shape, dtype=np.bool_)
    taken[:, _PAD:-_PAD:_OVERSAMPLING] = True
    taken &= (stance >= 0.0) & (stance <= 1.0)
    cycle = np.nonzero(taken)[0]
    ramp = np.array([kind is Perturbation.RAMP for kind in plan])
    return AnkleRun(
        person=person,
        settings=settings_of(person, slope_deg, rng),
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
    foot_kgm2 = moments_about(person.ankle_P_m * (1.0, 0.0, 1.0), person.foot_kg, person.foot_cog_P_m, person.foot_kgm2)
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
