"""What a laboratory writes down of a unit in which something is wrong.

Straps, dampers and friction above the sensor are added to the wrench on it: to make the same motion against them the
actuators need another torque, which is not measured.
"""

from dataclasses import dataclass, replace
from functools import cached_property

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
from messages.arrays import FloatArray
from sim_rig.platform.extended.flaws import Flaws
from sim_rig.platform.extended.instruments import followed, lagging, rubbed, sampled, smoothed, warped
from sim_rig.platform.extended.mechanics import Fine, Mechanics, Torques, ran
from sim_rig.platform.extended.plate_noise import PlateNoise
from sim_rig.platform.extended.unit import PlatformUnit
from sim_rig.platform.rig import MOTION_HZ


@dataclass(frozen=True)
class Reference:
    """Each channel's size in a run, noise-free: standard deviation and largest value (6,)."""

    deviation: FloatArray
    largest: FloatArray

    @property
    def scale(self) -> FloatArray:
        """Return how large (6,) a channel is: its deviation, or a quarter of its largest value under a weight."""
        return np.maximum(self.deviation, 0.25 * self.largest)


@dataclass(frozen=True)
class Laboratory:
    """A unit, what is wrong with it, and the colour of its force plate's noise."""

    unit: PlatformUnit
    flaws: Flaws
    colour: PlateNoise

    @cached_property
    def mechanics(self) -> Mechanics:
        """Return what stands on the joint."""
        unit, flaws = self.unit, self.flaws
        return Mechanics(
            plate=unit.plate,
            foot=unit.foot,
            foot_origin_m=unit.foot_origin_m,
            lever_m=np.array([0.0, unit.joint_to_surface_m, 0.0]) + flaws.joint_m,
            sensor_m=np.array([0.0, flaws.height_m, 0.0]),
            sensor_turn_rad=flaws.turn_rad,
            masses=flaws.masses,
            tape_hz=flaws.tape_hz,
            tape_zeta=flaws.tape_zeta,
            jumps=flaws.jumps,
        )

    def ran(self, torques: Torques, duration_s: float) -> Fine:
        """Return what happens under the torques, whatever is wrong with the instruments."""
        return ran(self.mechanics, torques, duration_s)

    def reference(self, fine: Fine) -> Reference:
        """Return how large the channels of a run are."""
        tared = (fine.wrench - self.mechanics.tared[:, None])[:, fine.t_s >= 0.0]
        return Reference(tared.std(axis=1), np.abs(tared).max(axis=1))

    def recorded(self, fine: Fine, random: np.random.Generator, duration_s: float) -> PlatformRecording:
        """Return what the laboratory writes down of a run."""
        unit, flaws = self.unit, self.flaws
        count = round(duration_s * MOTION_HZ)
        poses = _poses(unit, flaws, self.mechanics, fine, random, count)
        wrench = sampled(_amplified(flaws, self.mechanics, fine, random), count, raw=flaws.jumps)
        white = random.standard_normal((6, count))
        noise = self.colour.record(count, MOTION_HZ, random) if unit.coloured else white
        wrench = wrench + unit.wrench_noise[:, None] * noise
        t_s = np.arange(count) / MOTION_HZ
        return PlatformRecording(
            settings=_settings(unit),
            t_s=t_s,
            plate=Poses.from_columns(poses[:6].T),
            foot=Poses.from_columns(poses[6:].T) if unit.foot is not None else None,
            force_t_s=t_s,
            wrench=_converted(flaws, wrench, random).T,
        )


def _poses(
    unit: PlatformUnit, flaws: Flaws, mechanics: Mechanics, fine: Fine, random: np.random.Generator, count: int
) -> FloatArray:
    """Return the poses (6 or 12, n) that motion capture writes."""
    shown = replace(fine, tape_rad=flaws.tape_seen * fine.tape_rad)
    plate, foot = shown.poses(mechanics)
    if unit.foot is not None:
        rigid = replace(mechanics, foot_origin_m=mechanics.foot_origin_m + flaws.foot_marker_m)
        foot = shown.poses(rigid)[1]
    poses = sampled(np.vstack((plate, foot)), count, raw=flaws.jumps)
    if flaws.at_markers is not None:
        poses[:6] = flaws.at_markers(poses[:6])
    for first in range(0, len(poses), 6):
        poses[first : first + 3] *= 1.0 + flaws.position_scale
    poses = poses + np.tile(unit.pose_noise, len(poses) // 6)[:, None] * random.standard_normal(poses.shape)
    return smoothed(poses, flaws.smoothing_hz) if np.isfinite(flaws.smoothing_hz) else poses


def _amplified(flaws: Flaws, mechanics: Mechanics, fine: Fine, random: np.random.Generator) -> FloatArray:
    """Return the tared wrench (6, n) that leaves the amplifier, 3500 a second."""
    wrench = fine.wrench - mechanics.tared[:, None] + mechanics.read(_straps(flaws, fine))
    wrench = flaws.matrix @ wrench
    if flaws.play is not None:
        k, width = flaws.play
        wrench[k] = followed(wrench[k], width)
    if flaws.at_sensor is not None:
        wrench = flaws.at_sensor(fine.t_s, wrench, random)
    if flaws.lag_s > 0.0:
        wrench = lagging(wrench, flaws.lag_s)
    if flaws.delay_s != 0.0:
        wrench = warped(wrench, fine.t_s, lambda t_s: t_s - flaws.delay_s)
    if flaws.drift != 0.0:
        wrench = warped(wrench, fine.t_s, lambda t_s: t_s / (1.0 + flaws.drift))
    return wrench


def _straps(flaws: Flaws, fine: Fine) -> FloatArray:
    """Return what springs, dampers and friction ask of the sensor (6, n), in P: moments about I's Z and P's X."""
    moments = [
        flaws.spring_nmprad[k] * fine.angles_rad[k]
        + flaws.damper_nmsprad[k] * fine.rates_radps[k]
        + (rubbed(fine.angles_rad[k], float(flaws.friction_nm[k])) if flaws.friction_nm[k] > 0.0 else 0.0)
        for k in (0, 1)
    ]
    phi = fine.angles_rad[1]
    none = np.zeros_like(phi)
    return np.stack((none, none, none, moments[1], moments[0] * np.sin(phi), moments[0] * np.cos(phi)))


def _converted(flaws: Flaws, wrench: FloatArray, random: np.random.Generator) -> FloatArray:
    """Return what converter and recorder make of samples (6, n)."""
    wrench = wrench + flaws.tare[:, None]
    if flaws.limit is not None:
        k, bound = flaws.limit
        wrench[k] = np.minimum(np.maximum(wrench[k], -bound), bound)
    for step, rows in zip(flaws.step, (slice(0, 3), slice(3, 6)), strict=True):
        if step > 0.0:
            wrench[rows] = step * np.floor(wrench[rows] / step + 0.5)
    if flaws.lost_share > 0.0:
        for lost in np.flatnonzero(random.random(wrench.shape[1]) < flaws.lost_share):
            if lost > 0:
                wrench[:, lost] = wrench[:, lost - 1]
    return wrench


def _settings(unit: PlatformUnit) -> PlatformSettings:
    position_m, angle_rad = unit.pose_noise[[0, 3]].tolist()
    force_n, torque_nm = unit.wrench_noise[[0, 3]].tolist()
    cog_m, six = tuple(unit.plate.cog_m.tolist()), tuple(unit.plate.about_cog().tolist())
    return PlatformSettings(
        rates=RateSettings(motion_hz=MOTION_HZ, force_hz=MOTION_HZ),
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
