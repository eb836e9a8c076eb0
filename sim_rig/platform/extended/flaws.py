"""What can be wrong with a platform: in its mechanics, its instruments or its recorder."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from messages.arrays import FloatArray

CHANNELS: Final = ("fx", "fy", "fz", "tx", "ty", "tz")

SensorChange = Callable[[FloatArray, FloatArray, np.random.Generator], FloatArray]
"""From times (n,) in s and a tared wrench (6, n), 3500 a second, to what the sensor makes of it (6, n)."""
MarkerChange = Callable[[FloatArray], FloatArray]
"""From the plate's poses (6, n) at 350 Hz to what motion capture sees (6, n)."""
Fields = Mapping[str, object]
"""Values of some of the fields of `Flaws`, by name."""


@dataclass(frozen=True)
class Flaws:
    """All that is wrong with a unit; without arguments nothing is.

    `matrix` mixes the channels. `play` and `limit` are (channel, size in the channel's unit). `tape_seen` is the share
    of the foot's rocking that its markers show. `at_sensor` and `at_markers` are mechanisms that have no field here.
    """

    delay_s: float = 0.0
    lag_s: float = 0.0
    drift: float = 0.0
    smoothing_hz: float = np.inf
    jumps: bool = False
    matrix: FloatArray = field(default_factory=lambda: np.eye(6))
    height_m: float = 0.0
    turn_rad: FloatArray = field(default_factory=lambda: np.zeros(3))
    foot_marker_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    joint_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    spring_nmprad: FloatArray = field(default_factory=lambda: np.zeros(2))
    damper_nmsprad: FloatArray = field(default_factory=lambda: np.zeros(2))
    friction_nm: FloatArray = field(default_factory=lambda: np.zeros(2))
    masses: tuple[tuple[float, FloatArray], ...] = ()
    play: tuple[int, float] | None = None
    limit: tuple[int, float] | None = None
    tape_hz: tuple[float, float] = (np.inf, np.inf)
    tape_zeta: float = 0.0
    tape_seen: float = 1.0
    tare: FloatArray = field(default_factory=lambda: np.zeros(6))
    step: tuple[float, float] = (0.0, 0.0)
    lost_share: float = 0.0
    position_scale: float = 0.0
    at_sensor: SensorChange | None = None
    at_markers: MarkerChange | None = None


def combined(fields: Sequence[Fields]) -> Flaws:
    """Return what several effects make wrong together: changes of the channels' matrix add up."""
    flaws = Flaws()
    for each in fields:
        matrix = flaws.matrix + each.get("matrix", np.eye(6)) - np.eye(6)  # type: ignore[operator]
        flaws = replace(flaws, **{**each, "matrix": matrix})
    return flaws
