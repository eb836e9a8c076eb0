"""A hip that walks by a formula of its own, not the rig's: contacts, places and attitudes are known exactly."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from messages import Side
from messages.arrays import FloatArray
from perception.attitude.history import AttitudeAt
from perception.gait.watch import GaitWatch

FRAME_NS = 50_000_000
START_NS = 10_000_000_000


def always(value: float) -> Callable[[float], float]:
    """Return the function of time that is always `value`."""
    return lambda _: value


@dataclass(frozen=True)
class Hip:
    """Walks ahead from rest after a second: `speed_mps` and `step_hz` are functions of the time since then,
    `turn_radps` the rate of a turn. At odd phases the left foot lands.

    `bump_m` of ground is climbed at `bump_s`, within a third of a second.
    """

    speed_mps: Callable[[float], float] = field(default_factory=lambda: always(1.1))
    step_hz: Callable[[float], float] = field(default_factory=lambda: always(1.8))
    turn_radps: float = 0.0
    bob_m: float = 0.02
    sway_m: float = 0.02
    yaw_rad: float = 0.08
    bump_m: float = 0.0
    bump_s: float = 4.0
    seconds: float = 8.0
    _table: dict[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        t = np.arange(0.0, self.seconds + 2.0, _GRID_S)
        walked = np.maximum(t - 1.0, 0.0)
        fade = _smooth(walked / 0.6)
        speed = np.array([self.speed_mps(float(s)) for s in walked]) * fade
        going = _smooth(speed / 0.3)
        phase = np.cumsum(np.array([self.step_hz(float(s)) for s in walked]) * (fade > 0.0) * (going > 0.0)) * _GRID_S
        heading = self.turn_radps * walked
        bump = self.bump_m / (1.0 + np.exp(-(walked - self.bump_s) / 0.06))
        up = -self.bob_m * going * np.cos(2.0 * np.pi * phase) + bump
        left = -self.sway_m * going * np.sin(np.pi * phase)
        x = np.cumsum(speed * np.cos(heading)) * _GRID_S
        y = np.cumsum(speed * np.sin(heading)) * _GRID_S
        place = np.stack((x - left * np.sin(heading), y + left * np.cos(heading), up), axis=1)
        yaw = heading + self.yaw_rad * going * np.cos(np.pi * phase)
        self._table.update(
            t=t, phase=phase, middle=np.stack((x, y), axis=1), heading=heading, speed=speed, yaw=yaw, place=place
        )
        self._table["velocity"] = np.gradient(place, _GRID_S, axis=0)
        self._table["rate"] = np.gradient(yaw, _GRID_S)

    def _at(self, name: str, t_ns: int) -> FloatArray:
        found: FloatArray = self._table[name][round(1e-9 * (t_ns - START_NS) / _GRID_S)]
        return found

    def attitude(self, t_ns: int) -> AttitudeAt:
        """Return what the filter would know at `t_ns`."""
        half = 0.5 * float(self._at("yaw", t_ns))
        v = self._at("velocity", t_ns)
        return AttitudeAt(
            t_ns,
            (math.cos(half), 0.0, 0.0, math.sin(half)),
            (0.0, 0.0, float(self._at("rate", t_ns))),
            0.0,
            np.zeros((3, 3)),
            (float(v[0]), float(v[1]), float(v[2])),
        )

    def heading_rad(self, t_ns: int) -> float:
        """Return the camera's heading."""
        return float(self._at("yaw", t_ns))

    def next_contact_ns(self, t_ns: int, left: bool) -> int:
        """Return when the left or the right foot lands next."""
        phase, t = self._table["phase"], self._table["t"]
        number = math.floor(float(self._at("phase", t_ns))) + 1
        number += (number % 2 == 1) != left
        return START_NS + round(1e9 * float(t[np.searchsorted(phase, number)]))

    def foot_m(self, t_ns: int, contact_ns: int, half_width_m: float = 0.055) -> FloatArray:
        """Return where, ahead and to the left of the hip's heading at `t_ns`, the foot lands at `contact_ns`."""
        heading = float(self._at("heading", contact_ns))
        step_m = float(self._at("speed", contact_ns)) / self.step_hz(1e-9 * (contact_ns - START_NS) - 1.0)
        left = round(float(self._at("phase", contact_ns))) % 2 == 1
        forward = np.array([math.cos(heading), math.sin(heading)])
        leftward = np.array([-forward[1], forward[0]])
        foot = self._at("middle", contact_ns) + 0.5 * step_m * forward
        foot = foot + (half_width_m if left else -half_width_m) * leftward - self._at("place", t_ns)[:2]
        yaw = self.heading_rad(t_ns)
        return np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]]) @ foot

    def watched(self, until_s: float, side: Side = Side.RIGHT, watch: GaitWatch | None = None) -> tuple[GaitWatch, int]:
        """Return a watch that was shown every frame from the start on, and the time of the last one."""
        watch = watch or GaitWatch(np.zeros(3))
        t_ns = START_NS
        for t_ns in range(START_NS, START_NS + round(1e9 * until_s), FRAME_NS):
            watch.add_frame(t_ns, self.attitude, side)
        return watch, t_ns


def _smooth(share: FloatArray) -> FloatArray:
    """Return a step from 0 at 0 to 1 at 1, smooth at both ends."""
    s = np.clip(share, 0.0, 1.0)
    step: FloatArray = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return step


_GRID_S = 0.001
