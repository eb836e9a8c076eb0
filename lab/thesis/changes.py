"""What a cause does to a stored run: forces on the body, geometry and gains of the sensors, losses in the file.

Each function takes a run and the size of its cause, after what a cause is made of; `lab.thesis.causes` lists them.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import msgspec
import numpy as np

from impedance.body import geometry
from impedance.body.kinematics import Kinematics
from impedance.body.rigid_body import Inertia
from lab.thesis import signals, tape
from lab.thesis.signals import Signals
from messages.arrays import FloatArray
from sim_rig.platform.rig import THESIS_NOISE
from systems.platform.memory import last_kept, with_play

Change = Callable[[Signals, float], Signals]

FORCES: Final = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
MOMENTS: Final = 1.0 - FORCES
_MOMENT_PER_FORCE_M: Final = 0.5  # a force plate's resolution of moments over that of forces, as its noise
_FILE_STEPS: Final = FORCES + _MOMENT_PER_FORCE_M * MOMENTS  # N and N·m for a size of 1 N
_TAPE_DAMPING_RATIO: Final = 0.1
_X, _Y, _Z = range(3)


def unchanged(s: Signals, size: float) -> Signals:  # noqa: ARG001  (the run itself is another one)
    """Return the run as it is."""
    return s


def on_foot(change: Change) -> Change:
    """Return the change where a foot is on the plate; a run without one stays as it is."""
    return lambda s, size: s if s.foot is None else change(s, size)


# Forces on what is above the sensor


def strapped(resisted: Callable[[Signals], FloatArray], row: int, s: Signals, size: float) -> Signals:
    """Resist an axis of the joint (0: I's Z, 1: P's X) by `size` times what is `resisted` (n, 2) there.

    The sensor then gives that much less than the motion asks of it.
    """
    axis = s.axis_z if row == 0 else np.eye(3)[_X]
    wrench = s.wrench.copy()
    wrench[:, 3:] += size * resisted(s)[:, row, None] * axis
    return s.with_wrench(wrench)


def point_mass(at_m: tuple[float, float, float], tared: bool, s: Signals, size: float) -> Signals:
    """Add a mass at `at_m` in P, there at the tare or not."""
    vector = Inertia.about(size, np.array(at_m), np.zeros(6)).vector
    more = s.kinematics.regressor @ vector
    if tared:
        more = more - Kinematics.at_rest(np.zeros((1, 3))).regressor[0] @ vector
    return s.with_wrench(s.wrench + more)


def on_tape(rocking: bool, axis: int, seen: bool, s: Signals, size: float) -> Signals:
    """Let the foot rock about an axis of P, or slide along it, with a resonance whose period is `size`."""
    change = tape.on_rocking_tape if rocking else tape.on_sliding_tape
    return change(s, axis, size, _TAPE_DAMPING_RATIO, seen=seen)


# Noise, drawn later


def noise(field: str, s: Signals, size: float) -> Signals:
    """Set one standard deviation of the noise."""
    return replace(s, noise=replace(s.noise, **{field: size}))


def wrench_noise(s: Signals, size: float) -> Signals:
    """Multiply the wrench's noise."""
    n = THESIS_NOISE
    return replace(s, noise=replace(s.noise, force_n=size * n.force_n, torque_nm=size * n.torque_nm))


# What the sensors measure, and where


def mixed(matrix: Callable[[float], FloatArray], s: Signals, size: float) -> Signals:
    """Let the force plate read `matrix(size)` (6, 6) times the wrench."""
    return s.with_wrench(s.wrench @ matrix(size).T)


def offset(channel: int, s: Signals, size: float) -> Signals:
    """Add a constant to one channel of the wrench."""
    return s.with_wrench(s.wrench + size * np.eye(6)[channel])


def joint_height(s: Signals, size: float) -> Signals:
    """Raise the plate's markers along its normal."""
    return s.with_motion(_moved_along(s.plate, _Y, size), s.foot)


def foot_marker(axis: int, s: Signals, size: float) -> Signals:
    """Move the foot's markers along an axis of P."""
    return s.with_motion(s.plate, None if s.foot is None else _moved_along(s.foot, axis, size))


def position_scale(s: Signals, size: float) -> Signals:
    """Scale all positions by 1 + `size`."""
    scale: FloatArray = np.repeat((1.0 + size, 1.0), 3)
    return s.with_poses(lambda poses: poses * scale)


def foot_tared(s: Signals, size: float) -> Signals:
    """Take the tare with the foot on the plate."""
    if s.foot is None or size == 0.0:
        return s
    settings = s.recording.settings
    tare = msgspec.structs.replace(settings.tare, with_foot=True)
    recording = replace(s.recording, settings=msgspec.structs.replace(settings, tare=tare))
    return replace(s, recording=recording, wrench=s.wrench - tape.level_foot_wrench())


def _moved_along(poses: FloatArray, axis: int, by_m: float) -> FloatArray:
    moved: FloatArray = poses.copy()
    moved[:, :3] += by_m * geometry.rotation_IP(*poses[:, 3:].T)[:, :, axis]
    return moved


# The course in time


def filtered(course: Callable[[FloatArray, float], FloatArray], s: Signals, size: float) -> Signals:
    """Pass the wrench through one of the filters of `lab.thesis.signals`."""
    return s.with_wrench(course(s.wrench, size))


def motion_smoothing(s: Signals, size: float) -> Signals:
    """Smooth motion capture's poses."""
    return s.with_poses(lambda poses: signals.smoothed(poses, size))


def backlash(mask: FloatArray, s: Signals, size: float) -> Signals:
    """Give the channels of `mask` (6,) a play of `size`."""
    return s.with_wrench(with_play(s.wrench, 0.5 * size * mask, 0.0))


# What is lost in writing down


def saturation(mask: FloatArray, s: Signals, size: float) -> Signals:
    """Cut off the share `size` of the peak of the channels of `mask` (6,)."""
    limit = np.where(mask > 0.0, (1.0 - size) * np.abs(s.wrench).max(axis=0), np.inf)
    return s.with_wrench(np.clip(s.wrench, -limit, limit))


def wrench_steps(s: Signals, size: float) -> Signals:
    """Round the wrench."""
    return s if size == 0.0 else s.with_wrench(_rounded(s.wrench, size * _FILE_STEPS))


def position_steps(s: Signals, size: float) -> Signals:
    """Round all positions."""
    if size == 0.0:
        return s
    return s.with_poses(lambda poses: np.hstack((_rounded(poses[:, :3], size), poses[:, 3:])))


def wrench_dropped(s: Signals, size: float) -> Signals:
    """Repeat the last wrench in place of a share of them."""
    return s.with_wrench(s.wrench[_last(s, size)])


def motion_dropped(s: Signals, size: float) -> Signals:
    """Repeat the last pose in place of a share of them."""
    last = _last(s, size)
    return s.with_poses(lambda poses: poses[last])


def _rounded(values: FloatArray, step: FloatArray | float) -> FloatArray:
    rounded: FloatArray = step * np.round(values / step)
    return rounded


def _last(s: Signals, share: float) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    return last_kept(np.random.default_rng((s.seed, 1)).random(len(s.wrench)) < share)
