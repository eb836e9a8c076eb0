"""What may have made the printed tables: the platform's effects and some beyond, each a change of one stored run.

The range of each size is fixed here, before anything is compared: that which the finder's cases are drawn from, where
it has one. The sensor's height and rotation, play and held samples are `systems.platform`'s formulas. All else is
written in `lab.thesis`: gains as matrices here; filters, rounding and the tape because the finder's model acts on what
is left below 60 Hz, and the thesis's estimator needs the whole recording.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from typing import Final

import numpy as np

from lab.thesis import changes, signals
from lab.thesis.changes import FORCES, MOMENTS, Change
from lab.thesis.signals import Signals
from messages.arrays import FloatArray
from sim_rig.platform.rig import FOOT, THESIS_NOISE, Rig
from systems.platform import sensor

AXES: Final = ("x", "y", "z")
WRENCH: Final = sensor.CHANNELS


class ActsOn(IntEnum):
    """Where on the way to the file a cause acts; of a pair, the earlier acts first."""

    RUN = 0  # another run altogether
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
    acts_on: ActsOn
    change: Change
    neutral: float = 0.0
    library: bool = True
    switch: bool = False

    @property
    def effect(self) -> str:
        """Return the effect's name, without what it acts on."""
        return self.name.partition(" ")[0]


def _timing() -> list[Cause]:
    cutoffs_s = (0.0, 1 / 100.0, 1 / 60.0, 1 / 42.0, 1 / 30.0)
    rates = (-1e-4, -5e-5, 0.0, 5e-5, 1e-4)
    delay, lag, drift = (partial(changes.filtered, f) for f in (signals.delayed, signals.lagged, signals.drifted))
    return [
        Cause("aliasing", "", (0.0, 1.0), ActsOn.RUN, changes.unchanged, switch=True),
        Cause("force_delay", "s", (-5e-3, -2.5e-3, 0.0, 2.5e-3, 5e-3), ActsOn.FILTER, delay),
        Cause("force_lag", "s", (0.0, 1e-3, 2.5e-3, 5e-3), ActsOn.FILTER, lag),
        Cause("motion_smoothing", "s, 1 / cut-off", cutoffs_s, ActsOn.FILTER, changes.motion_smoothing),
        Cause("clock_drift", "", rates, ActsOn.FILTER, drift),
    ]


def _geometry() -> list[Cause]:
    return [
        _read("reference_height", "m", 0.03, sensor.about_height),
        _sensed("joint_offset", "m", 0.03, changes.joint_height),
        _sensed("position_scale", "", 0.05, changes.position_scale),
    ]


def _gains() -> list[Cause]:
    masks = (("all", FORCES + MOMENTS), ("forces", FORCES), ("moments", MOMENTS))
    return [_read(f"force_gain {name}", "", 0.1, _entry(np.diag(mask))) for name, mask in masks]


def _channel(k: int) -> list[Cause]:
    """Return gain, crosstalk and tare error of one channel."""
    name, one = WRENCH[k], np.eye(6)
    reach, unit = (5.0, "N") if k < 3 else (2.0, "N m")
    tare = partial(changes.offset, k)
    return [
        _read(f"force_gain {name}", "", 0.1, _entry(np.outer(one[k], one[k]))),
        *(
            _read(f"crosstalk {name}_from_{source}", "", 0.05, _entry(np.outer(one[k], one[other])))
            for other, source in enumerate(WRENCH)
            if other != k
        ),
        _sensed(f"tare_error {name}, both runs", unit, reach, tare),
        _sensed(f"tare_error {name}, foot's run", unit, reach, changes.on_foot(tare)),
    ]


def _axis(k: int) -> list[Cause]:
    """Return what turns or moves along one axis of P."""
    along = np.eye(3)[k]
    return [
        _read(f"plate_rotation {AXES[k]}", "rad", float(np.deg2rad(5.0)), lambda size: sensor.turned(-size * along)),
        _sensed(f"foot_marker_offset {AXES[k]}", "m", 0.03, partial(changes.foot_marker, k)),
    ]


def _straps() -> list[Cause]:
    """Return what is strapped across the joint, above the sensor."""
    found = []
    kinds: tuple[tuple[str, str, float, Callable[[Signals], FloatArray]], ...] = (
        ("parallel_spring", "N m/rad", 200.0, lambda s: s.angles_rad),
        ("parallel_damping", "N m s/rad", 5.0, lambda s: s.rates_radps),
        ("coulomb_friction", "N m", 2.0, lambda s: np.sign(s.rates_radps)),
    )
    for kind, unit, reach, resisted in kinds:
        for row, axis in enumerate("zx"):
            change, knots = partial(changes.strapped, resisted, row), (0.0, 0.5 * reach, reach)
            found += [
                Cause(f"{kind} {axis}, on the plate", unit, knots, ActsOn.BODY, change),
                Cause(f"{kind} {axis}, on the foot", unit, knots, ActsOn.BODY, changes.on_foot(change)),
            ]
    return found


def _masses() -> list[Cause]:
    on_foot_m = Rig().foot_origin_m
    in_foot_m = (on_foot_m[0], on_foot_m[1] + float(FOOT.cog_m[1]), on_foot_m[2])
    on_plate_m, knots = (0.0, 0.0, 0.0), (0.0, 0.5, 1.0)
    tared = Cause("hidden_mass on the plate", "kg", knots, ActsOn.BODY, partial(changes.point_mass, on_plate_m, True))
    places = (("under the foot", on_plate_m), ("in the foot", in_foot_m), ("on the foot", on_foot_m))
    return [
        tared,
        *(
            Cause(f"hidden_mass {where}", "kg", knots, ActsOn.BODY, changes.on_foot(_untared_mass(at_m)))
            for where, at_m in places
        ),
    ]


def _untared_mass(at_m: tuple[float, float, float]) -> Change:
    return partial(changes.point_mass, at_m, False)


def _tape(axis: int) -> list[Cause]:
    periods_s = (0.0, *(1.0 / hz for hz in (150.0, 100.0, 75.0, 60.0, 50.0, 40.0, 30.0)))
    return [
        Cause(
            f"tape_compliance {'about' if rocking else 'along'} {AXES[axis]}, {'seen' if seen else 'unseen'}",
            "s, period",
            periods_s,
            ActsOn.BODY,
            partial(changes.on_tape, rocking, axis, seen),
        )
        for rocking in (False, True)
        for seen in (False, True)
    ]


def _limits(name: str, unit: str, mask: FloatArray) -> list[Cause]:
    cut, play = partial(changes.saturation, mask), partial(changes.backlash, mask)
    return [
        Cause(f"saturation {name}", "share of the peak", (0.0, 0.2, 0.4), ActsOn.FILE, cut),
        Cause(f"backlash {name}", unit, (0.0, 1.0, 2.0, 4.0), ActsOn.FILTER, play),
    ]


def _losses() -> list[Cause]:
    return [
        Cause("quantisation wrench", "N", (0.0, 2.0, 4.0), ActsOn.FILE, changes.wrench_steps),
        Cause("quantisation positions", "m", (0.0, 3e-4, 6e-4, 1e-3), ActsOn.FILE, changes.position_steps),
        Cause("dropped_samples motion", "share", (0.0, 0.001, 0.003, 0.01, 0.03), ActsOn.FILE, changes.motion_dropped),
        Cause("dropped_samples wrench", "share", (0.0, 0.01, 0.03), ActsOn.FILE, changes.wrench_dropped),
    ]


def _beyond_the_library() -> list[Cause]:
    """Return other noise than the thesis's, and a tare that was taken with the foot on the plate."""

    def noise(name: str, unit: str, knots: tuple[float, ...], change: Change, neutral: float) -> Cause:
        return Cause(name, unit, knots, ActsOn.BODY, change, neutral=neutral, library=False)

    n = THESIS_NOISE
    of_positions, of_angles = (partial(changes.noise, field) for field in ("position_m", "angle_rad"))
    noise_m = (0.0, 0.5e-4, 1e-4, 1.5e-4, 2e-4, 2.5e-4, 3e-4)
    return [
        noise("position_noise", "m", noise_m, of_positions, n.position_m),
        noise("angle_noise", "rad", (0.0, 1e-5, 1e-4, 2e-4, 3e-4, 5e-4), of_angles, n.angle_rad),
        noise("wrench_noise", "times the thesis's", (0.0, 1.0, 5.0, 15.0), changes.wrench_noise, 1.0),
        Cause("tare_with_foot", "", (0.0, 1.0), ActsOn.SENSOR, changes.foot_tared, library=False, switch=True),
    ]


def _sensed(name: str, unit: str, reach: float, change: Change) -> Cause:
    return Cause(name, unit, (-reach, 0.0, reach), ActsOn.SENSOR, change)


def _read(name: str, unit: str, reach: float, matrix: Callable[[float], FloatArray]) -> Cause:
    """Return a cause by which the force plate reads `matrix(size)` (6, 6) times the wrench."""
    return _sensed(name, unit, reach, partial(changes.mixed, matrix))


def _entry(where: FloatArray) -> Callable[[float], FloatArray]:
    return lambda size: np.eye(6) + size * where


CAUSES: Final = {
    cause.name: cause
    for cause in (
        *_timing(),
        *_geometry(),
        *_gains(),
        *(cause for k in range(6) for cause in _channel(k)),
        *(cause for k in range(3) for cause in _axis(k)),
        *_straps(),
        *_masses(),
        *_tape(AXES.index("x")),
        *_tape(AXES.index("z")),
        *_limits("forces", "N", FORCES),
        *_limits("moments", "N m", MOMENTS),
        *_losses(),
        *_beyond_the_library(),
    )
}
"""All causes that are tried, by name."""

ALIASING: Final = "aliasing"


def changed(run: Signals, sizes: Mapping[str, float]) -> Signals:
    """Return the run as all causes leave it, with its noise; of a switch, zero is off."""
    ordered = sorted(sizes, key=lambda name: (CAUSES[name].acts_on, name))
    early = [name for name in ordered if CAUSES[name].acts_on <= ActsOn.BODY]
    for name in early:
        run = CAUSES[name].change(run, sizes[name])
    run = run.noisy()
    for name in ordered[len(early) :]:
        run = CAUSES[name].change(run, sizes[name])
    return run
