"""What a laboratory writes down of a unit in which something is wrong.

Straps, dampers and friction above the sensor are added to what it feels: the actuators' torque that makes the same
motion beside them is another, which nobody measures.
"""

from dataclasses import dataclass, replace

import numpy as np

from impedance.recording.recording import (
    FootSettings,
    NoiseSettings,
    PlateSettings,
    PlatformRecording,
    PlatformSettings,
    Poses,
    RateSettings,
    TareSettings,
)
from lab.hidden.platform.drawn import Hidden
from lab.hidden.platform.instruments import followed, lagging, rubbed, sampled, smoothed, warped
from lab.hidden.platform.mechanics import RATE_HZ, Fine, Mechanics
from lab.hidden.platform.noise import PlateNoise
from lab.hidden.platform.outside import at_markers, at_sensor
from lab.hidden.platform.scene import Scene
from messages.arrays import FloatArray


@dataclass(frozen=True)
class Reference:
    """What the fit recording tells of each channel, noise-free: standard deviation and largest value (6,)."""

    deviation: FloatArray
    largest: FloatArray

    @property
    def scale(self) -> FloatArray:
        """Return how large (6,) a channel is: its deviation, or a quarter of its largest value under a weight."""
        return np.maximum(self.deviation, 0.25 * self.largest)


def mechanics_of(unit: Scene, hidden: Hidden) -> Mechanics:
    """Return the mechanics of a unit in which something is wrong."""
    return Mechanics(
        plate=unit.plate,
        foot=unit.foot,
        foot_origin_m=unit.foot_origin_m,
        lever_m=np.array([0.0, unit.joint_to_surface_m, 0.0]) + hidden.joint_m,
        sensor_m=np.array([0.0, hidden.height_m, 0.0]),
        sensor_turn_rad=hidden.turn_rad,
        hidden=hidden.masses,
        tape_hz=hidden.tape_hz,
        tape_zeta=hidden.tape_zeta,
        jumps=hidden.jumps,
    )


def reference_of(fine: Fine, mechanics: Mechanics) -> Reference:
    """Return how large the channels of a run are."""
    tared = (fine.wrench - mechanics.tared[:, None])[:, fine.t_s >= 0.0]
    return Reference(tared.std(axis=1), np.abs(tared).max(axis=1))


def recorded(
    unit: Scene,
    hidden: Hidden,
    mechanics: Mechanics,
    fine: Fine,
    reference: Reference,
    colour: PlateNoise,
    random: np.random.Generator,
    duration_s: float,
) -> PlatformRecording:
    """Return what the laboratory writes down."""
    count = round(duration_s * RATE_HZ)
    poses = _poses(unit, hidden, mechanics, fine, random, count)
    wrench = sampled(_felt(hidden, mechanics, fine, reference, random), count, raw=hidden.jumps)
    white = random.standard_normal((6, count))
    noise = colour.record(count, RATE_HZ, random) if unit.coloured else white
    wrench = wrench + unit.wrench_noise[:, None] * noise
    t_s = np.arange(count) / RATE_HZ
    return PlatformRecording(
        settings=_settings(unit),
        t_s=t_s,
        plate=Poses.from_columns(poses[:6].T),
        foot=Poses.from_columns(poses[6:].T) if unit.foot is not None else None,
        force_t_s=t_s,
        wrench=_converted(hidden, reference, wrench, random).T,
    )


def _poses(
    unit: Scene, hidden: Hidden, mechanics: Mechanics, fine: Fine, random: np.random.Generator, count: int
) -> FloatArray:
    """Return the poses (6 or 12, n) that motion capture writes."""
    shown = replace(fine, tape_rad=hidden.tape_seen * fine.tape_rad)
    plate, foot = shown.poses(mechanics)
    if unit.foot is not None:
        rigid = replace(mechanics, foot_origin_m=mechanics.foot_origin_m + hidden.foot_marker_m)
        foot = shown.poses(rigid)[1]
    poses = sampled(np.vstack((plate, foot)), count, raw=hidden.jumps)
    if hidden.outside is not None:
        poses[:6] = at_markers(*hidden.outside, poses[:6])
    for first in range(0, len(poses), 6):
        poses[first : first + 3] *= 1.0 + hidden.position_scale
    poses = poses + np.tile(unit.pose_noise, len(poses) // 6)[:, None] * random.standard_normal(poses.shape)
    return smoothed(poses, hidden.smoothing_hz) if np.isfinite(hidden.smoothing_hz) else poses


def _felt(
    hidden: Hidden, mechanics: Mechanics, fine: Fine, reference: Reference, random: np.random.Generator
) -> FloatArray:
    """Return the tared wrench (6, n) that leaves the amplifier, 3500 a second."""
    wrench = fine.wrench - mechanics.tared[:, None] + mechanics.read(_straps(hidden, fine))
    wrench = hidden.matrix @ wrench
    if hidden.play is not None:
        k, share = hidden.play
        wrench[k] = followed(wrench[k], share * reference.deviation[k])
    if hidden.outside is not None:
        wrench = at_sensor(*hidden.outside, fine.t_s, wrench, reference.scale, random)
    if hidden.lag_s > 0.0:
        wrench = lagging(wrench, hidden.lag_s)
    if hidden.delay_s != 0.0:
        wrench = warped(wrench, fine.t_s, lambda t_s: t_s - hidden.delay_s)
    if hidden.drift != 0.0:
        wrench = warped(wrench, fine.t_s, lambda t_s: t_s / (1.0 + hidden.drift))
    return wrench


def _straps(hidden: Hidden, fine: Fine) -> FloatArray:
    """Return what springs, dampers and friction ask of the sensor (6, n), in P: moments about I's Z and P's X."""
    moments = [
        hidden.spring_nmprad[k] * fine.angles_rad[k]
        + hidden.damper_nmsprad[k] * fine.rates_radps[k]
        + (rubbed(fine.angles_rad[k], float(hidden.friction_nm[k])) if hidden.friction_nm[k] > 0.0 else 0.0)
        for k in (0, 1)
    ]
    phi = fine.angles_rad[1]
    none = np.zeros_like(phi)
    return np.stack((none, none, none, moments[1], moments[0] * np.sin(phi), moments[0] * np.cos(phi)))


def _converted(hidden: Hidden, reference: Reference, wrench: FloatArray, random: np.random.Generator) -> FloatArray:
    """Return what converter and recorder make of samples (6, n)."""
    wrench = wrench + hidden.tare[:, None]
    if hidden.limit is not None:
        k, share = hidden.limit
        bound = share * reference.largest[k]
        wrench[k] = np.minimum(np.maximum(wrench[k], -bound), bound)
    for step, rows in zip(hidden.step, (slice(0, 3), slice(3, 6)), strict=True):
        if step > 0.0:
            wrench[rows] = step * np.floor(wrench[rows] / step + 0.5)
    if hidden.lost_share > 0.0:
        for lost in np.flatnonzero(random.random(wrench.shape[1]) < hidden.lost_share):
            if lost > 0:
                wrench[:, lost] = wrench[:, lost - 1]
    return wrench


def _settings(unit: Scene) -> PlatformSettings:
    position_m, angle_rad = unit.pose_noise[[0, 3]].tolist()
    force_n, torque_nm = unit.wrench_noise[[0, 3]].tolist()
    cog_m, six = tuple(unit.plate.cog_m.tolist()), tuple(unit.plate.about_cog().tolist())
    return PlatformSettings(
        rates=RateSettings(motion_hz=RATE_HZ, force_hz=RATE_HZ),
        plate=PlateSettings(
            mass_kg=unit.plate.mass_kg,
            joint_to_surface_m=unit.joint_to_surface_m,
            cog_m=cog_m if unit.known else None,
            inertia_kgm2=six if unit.known else None,
        ),
        foot=FootSettings(present=unit.foot is not None, origin_in_plate_m=tuple(unit.foot_origin_m.tolist())),
        tare=TareSettings(at_rest=True),
        noise=NoiseSettings(position_m=position_m, angle_rad=angle_rad, force_n=force_n, torque_nm=torque_nm)
        if unit.declared
        else NoiseSettings(),
    )
