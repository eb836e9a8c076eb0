"""What may have made the printed tables: the platform's effects and some beyond, each a change of one stored run.

The range of each size is fixed here, before anything is compared: that which the finder's cases are drawn from, where
it has one.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from typing import Final

import numpy as np

from impedance.body import geometry
from impedance.body.rigid_body import cross_matrix
from lab.thesis import signals as do
from lab.thesis.signals import Signals
from messages.arrays import FloatArray
from sim_rig.platform.rig import FOOT, THESIS_NOISE, Rig
from systems.platform.memory import last_kept, with_play

AXES: Final = ("x", "y", "z")
WRENCH: Final = ("fx", "fy", "fz", "tx", "ty", "tz")
_TAPE_DAMPING_RATIO: Final = 0.1
_FORCE_PER_MOMENT: Final = 0.5  # m: a force plate's resolution and play of moments over those of forces, as its noise

Change = Callable[[Signals, float], Signals]


class Stage(IntEnum):
    """Where on the way to the file a cause acts; of a pair, the earlier acts first."""

    STEPS = 0  # another run altogether
    BODY = 1  # forces on what is above the sensor, and how much noise there will be
    SENSOR = 2  # where and along what the sensors measure
    FILTER = 3  # what electronics or software do to the course in time
    FILE = 4  # what is lost in writing down


@dataclass(frozen=True)
class Cause:
    """One size of one effect. `knots` are the sizes that are simulated, ascending, `neutral` among them.

    A switch has two knots and nothing between. `library` tells whether the platform's library holds the effect.
    """

    name: str
    unit: str
    knots: tuple[float, ...]
    stage: Stage
    change: Change
    neutral: float = 0.0
    library: bool = True
    switch: bool = False

    @property
    def effect(self) -> str:
        """Return the effect's name, without what it acts on."""
        return self.name.partition(" ")[0]


def _channels(*names: str) -> FloatArray:
    mask = np.array([name in names for name in WRENCH], dtype=np.float64)
    return mask


_FORCES, _MOMENTS = _channels("fx", "fy", "fz"), _channels("tx", "ty", "tz")
_STEPS_OF_FILE = _FORCES + _FORCE_PER_MOMENT * _MOMENTS  # N and N·m for a size of 1 N


def _gain(mask: FloatArray, s: Signals, size: float) -> Signals:
    return s.with_wrench(s.wrench * (1.0 + size * mask))


def _crosstalk(to: int, source: int, s: Signals, size: float) -> Signals:
    wrench = s.wrench.copy()
    wrench[:, to] += size * wrench[:, source]
    return s.with_wrench(wrench)


def _reference_height(s: Signals, size: float) -> Signals:
    wrench = s.wrench.copy()
    wrench[:, 3:] -= np.cross([0.0, size, 0.0], wrench[:, :3])
    return s.with_wrench(wrench)


def _turned(axis: int, s: Signals, size: float) -> Signals:
    K = cross_matrix(np.eye(3)[axis : axis + 1])[0]
    R = np.eye(3) + np.sin(size) * K + (1.0 - np.cos(size)) * K @ K
    return s.with_wrench(np.hstack((s.wrench[:, :3] @ R.T, s.wrench[:, 3:] @ R.T)))


def _foot_marker(axis: int, s: Signals, size: float) -> Signals:
    if s.foot is None:
        return s
    foot = s.foot.copy()
    foot[:, :3] += size * geometry.rotation_IP(*s.foot[:, 3:].T)[:, :, axis]
    return s.with_motion(s.plate, foot)


def _joint(s: Signals, size: float) -> Signals:
    plate = s.plate.copy()
    plate[:, :3] += size * geometry.rotation_IP(*s.plate[:, 3:].T)[:, :, 1]
    return s.with_motion(plate, s.foot)


def _position_scale(s: Signals, size: float) -> Signals:
    scale = np.repeat((1.0 + size, 1.0), 3)
    return s.with_motion(s.plate * scale, None if s.foot is None else s.foot * scale)


def _moment(kind: str, axis: int, foot_only: bool, s: Signals, size: float) -> Signals:
    if foot_only and s.foot is None:
        return s
    if kind == "parallel_spring":
        resisting = -size * s.angles_rad[:, axis]
    elif kind == "parallel_damping":
        resisting = -size * s.rates_radps[:, axis]
    else:
        resisting = -size * np.sign(s.rates_radps[:, axis])
    still = np.zeros_like(resisting)
    return do.external_moment(s, *((resisting, still) if axis == 0 else (still, resisting)))


def _mass(at_m: tuple[float, float, float], foot_only: bool, s: Signals, size: float) -> Signals:
    if foot_only and s.foot is None:
        return s
    return do.point_mass(s, size, at_m, tared=not foot_only)


def _noise(field: str, s: Signals, size: float) -> Signals:
    return replace(s, noise=replace(s.noise, **{field: size}))


def _wrench_noise(s: Signals, size: float) -> Signals:
    n = THESIS_NOISE
    return replace(s, noise=replace(s.noise, force_n=size * n.force_n, torque_nm=size * n.torque_nm))


def _tare(channel: int, foot_only: bool, s: Signals, size: float) -> Signals:
    if foot_only and s.foot is None:
        return s
    return s.with_wrench(s.wrench + size * np.eye(6)[channel])


def _force_delay(s: Signals, size: float) -> Signals:
    return s.with_wrench(do.delayed(s.wrench, size))


def _force_lag(s: Signals, size: float) -> Signals:
    return s.with_wrench(do.lagged(s.wrench, size))


def _motion_smoothing(s: Signals, size: float) -> Signals:
    return s.with_motion(do.smoothed(s.plate, size), None if s.foot is None else do.smoothed(s.foot, size))


def _clock_drift(s: Signals, size: float) -> Signals:
    return s.with_wrench(do.drifted(s.wrench, size))


def _saturation(mask: FloatArray, s: Signals, size: float) -> Signals:
    limit = np.where(mask > 0.0, (1.0 - size) * np.abs(s.wrench).max(axis=0), np.inf)
    return s.with_wrench(np.clip(s.wrench, -limit, limit))


def _backlash(mask: FloatArray, s: Signals, size: float) -> Signals:
    return s.with_wrench(with_play(s.wrench, 0.5 * size * mask, 0.0))


def _wrench_steps(s: Signals, size: float) -> Signals:
    if size == 0.0:
        return s
    steps = size * _STEPS_OF_FILE
    return s.with_wrench(steps * np.round(s.wrench / steps))


def _position_steps(s: Signals, size: float) -> Signals:
    if size == 0.0:
        return s

    def rounded(poses: FloatArray) -> FloatArray:
        return np.hstack((size * np.round(poses[:, :3] / size), poses[:, 3:]))

    return s.with_motion(rounded(s.plate), None if s.foot is None else rounded(s.foot))


def _dropped(motion: bool, s: Signals, size: float) -> Signals:
    lost = np.random.default_rng((s.seed, 1)).random(len(s.wrench)) < size
    last = last_kept(lost)
    if not motion:
        return s.with_wrench(s.wrench[last])
    return s.with_motion(s.plate[last], None if s.foot is None else s.foot[last])


def _foot_tared(s: Signals, size: float) -> Signals:
    if s.foot is None or size == 0.0:
        return s
    static = do.level_foot_wrench()
    return replace(s, recording=do.tared_with_foot(s.recording), wrench=s.wrench - static)


def _unchanged(s: Signals, size: float) -> Signals:  # noqa: ARG001  (the run itself is another one)
    return s


def _both_ways(size: float) -> tuple[float, ...]:
    return (-size, 0.0, size)


def _tape(axis: int, rocking: bool, seen: bool) -> Cause:
    change = do.on_rocking_tape if rocking else do.on_sliding_tape
    name = f"tape_compliance {'about' if rocking else 'along'} {AXES[axis]}, {'seen' if seen else 'unseen'}"
    knots = (0.0, 1 / 150.0, 1 / 100.0, 1 / 75.0, 1 / 60.0, 1 / 50.0, 1 / 40.0, 1 / 30.0)
    act = partial(_on_tape, change, axis, seen)
    return Cause(name, "s, period", knots, Stage.BODY, act)


def _on_tape(change: Callable[..., Signals], axis: int, seen: bool, s: Signals, size: float) -> Signals:
    return change(s, axis, size, _TAPE_DAMPING_RATIO, seen=seen)


def _causes() -> tuple[Cause, ...]:
    top_m = Rig().foot_origin_m
    middle_m = (top_m[0], top_m[1] + float(FOOT.cog_m[1]), top_m[2])
    found = [
        Cause("aliasing", "", (0.0, 1.0), Stage.STEPS, _unchanged, switch=True),
        Cause("force_delay", "s", (-5e-3, -2.5e-3, 0.0, 2.5e-3, 5e-3), Stage.FILTER, _force_delay),
        Cause("force_lag", "s", (0.0, 1e-3, 2.5e-3, 5e-3), Stage.FILTER, _force_lag),
        Cause(
            "motion_smoothing",
            "s, 1 / cut-off",
            (0.0, 1 / 100.0, 1 / 60.0, 1 / 42.0, 1 / 30.0),
            Stage.FILTER,
            _motion_smoothing,
        ),
        Cause("clock_drift", "", (-1e-4, -5e-5, 0.0, 5e-5, 1e-4), Stage.FILTER, _clock_drift),
        Cause("reference_height", "m", _both_ways(0.03), Stage.SENSOR, _reference_height),
        Cause("joint_offset", "m", _both_ways(0.03), Stage.SENSOR, _joint),
        Cause("position_scale", "", _both_ways(0.05), Stage.SENSOR, _position_scale),
        Cause("force_gain all", "", _both_ways(0.1), Stage.SENSOR, partial(_gain, _FORCES + _MOMENTS)),
        Cause("force_gain forces", "", _both_ways(0.1), Stage.SENSOR, partial(_gain, _FORCES)),
        Cause("force_gain moments", "", _both_ways(0.1), Stage.SENSOR, partial(_gain, _MOMENTS)),
    ]
    for k, channel in enumerate(WRENCH):
        found.append(Cause(f"force_gain {channel}", "", _both_ways(0.1), Stage.SENSOR, partial(_gain, np.eye(6)[k])))
        for other, source in enumerate(WRENCH):
            if other != k:
                change = partial(_crosstalk, k, other)
                found.append(Cause(f"crosstalk {channel}_from_{source}", "", _both_ways(0.05), Stage.SENSOR, change))
        reach, unit = (5.0, "N") if k < 3 else (2.0, "N m")
        for foot_only in (False, True):
            whose = "foot's run" if foot_only else "both runs"
            change = partial(_tare, k, foot_only)
            found.append(Cause(f"tare_error {channel}, {whose}", unit, _both_ways(reach), Stage.SENSOR, change))
    for k, axis in enumerate(AXES):
        reach = float(np.deg2rad(5.0))
        found.append(Cause(f"plate_rotation {axis}", "rad", _both_ways(reach), Stage.SENSOR, partial(_turned, k)))
        found.append(Cause(f"foot_marker_offset {axis}", "m", _both_ways(0.03), Stage.SENSOR, partial(_foot_marker, k)))
    for kind, unit, reach in (
        ("parallel_spring", "N m/rad", 200.0),
        ("parallel_damping", "N m s/rad", 5.0),
        ("coulomb_friction", "N m", 2.0),
    ):
        for k, axis in enumerate(("z", "x")):
            for foot_only in (False, True):
                name = f"{kind} {axis}, {'on the foot' if foot_only else 'on the plate'}"
                change = partial(_moment, kind, k, foot_only)
                found.append(Cause(name, unit, (0.0, 0.5 * reach, reach), Stage.BODY, change))
    for where, at_m, foot_only in (
        ("on the plate", (0.0, 0.0, 0.0), False),
        ("under the foot", (0.0, 0.0, 0.0), True),
        ("in the foot", middle_m, True),
        ("on the foot", top_m, True),
    ):
        change = partial(_mass, at_m, foot_only)
        found.append(Cause(f"hidden_mass {where}", "kg", (0.0, 0.5, 1.0), Stage.BODY, change))
    for k in (0, 2):
        found += [_tape(k, rocking, seen) for rocking in (False, True) for seen in (False, True)]
    for name, mask in (("forces", _FORCES), ("moments", _MOMENTS)):
        found.append(
            Cause(f"saturation {name}", "share of the peak", (0.0, 0.2, 0.4), Stage.FILE, partial(_saturation, mask))
        )
        found.append(
            Cause(
                f"backlash {name}",
                "N" if name == "forces" else "N m",
                (0.0, 1.0, 2.0, 4.0),
                Stage.FILTER,
                partial(_backlash, mask),
            )
        )
    noise_m = (0.0, 0.5e-4, 1e-4, 1.5e-4, 2e-4, 2.5e-4, 3e-4)
    found += [
        Cause("quantisation wrench", "N", (0.0, 2.0, 4.0), Stage.FILE, _wrench_steps),
        Cause("quantisation positions", "m", (0.0, 3e-4, 6e-4, 1e-3), Stage.FILE, _position_steps),
        Cause("dropped_samples motion", "share", (0.0, 0.001, 0.003, 0.01, 0.03), Stage.FILE, partial(_dropped, True)),
        Cause("dropped_samples wrench", "share", (0.0, 0.01, 0.03), Stage.FILE, partial(_dropped, False)),
        Cause(
            "position_noise",
            "m",
            noise_m,
            Stage.BODY,
            partial(_noise, "position_m"),
            neutral=THESIS_NOISE.position_m,
            library=False,
        ),
        Cause(
            "angle_noise",
            "rad",
            (0.0, 1e-5, 1e-4, 2e-4, 3e-4, 5e-4),
            Stage.BODY,
            partial(_noise, "angle_rad"),
            neutral=THESIS_NOISE.angle_rad,
            library=False,
        ),
        Cause(
            "wrench_noise",
            "times the thesis's",
            (0.0, 1.0, 5.0, 15.0),
            Stage.BODY,
            _wrench_noise,
            neutral=1.0,
            library=False,
        ),
        Cause("tare_with_foot", "", (0.0, 1.0), Stage.SENSOR, _foot_tared, library=False, switch=True),
    ]
    return tuple(found)


CAUSES: Final = {cause.name: cause for cause in _causes()}
"""All causes that are tried, by name."""

ALIASING: Final = "aliasing"


def changed(signals: Signals, sizes: Mapping[str, float]) -> Signals:
    """Return the signals as all causes leave them, with their noise; of a switch, zero is off."""
    ordered = sorted(sizes, key=lambda name: (CAUSES[name].stage, name))
    early = [name for name in ordered if CAUSES[name].stage <= Stage.BODY]
    for name in early:
        signals = CAUSES[name].change(signals, sizes[name])
    signals = signals.noisy()
    for name in ordered[len(early) :]:
        signals = CAUSES[name].change(signals, sizes[name])
    return signals
