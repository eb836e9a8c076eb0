"""Where and when the feet of a simulated wearer land: each landing with a scatter of its own."""

from dataclasses import dataclass

import numpy as np

from messages.arrays import FloatArray
from sim_rig.walk.gait import Gait
from sim_rig.walk.world import World

_AHEAD_SIGMA_M, _ACROSS_SIGMA_M = 0.03, 0.02
_HALF_STEP_WIDTH_M = 0.06
_MOST_SIGMAS = 2.5
_FROM_EDGE_M = 0.10  # of a foot's middle: feet are put on treads and off kerbs, not across edges


@dataclass(frozen=True)
class Foothold:
    """A foot's landing: when (CLOCK_MONOTONIC), and where in W its middle comes to rest on the ground, p_WF (3,).

    `slope_rad` is the ground's along x of W.
    """

    t_land_ns: int
    p_WF_m: FloatArray
    left: bool
    slope_rad: float
    kind: str


class Footholds:
    """All landings of the wearer who moves as `gait` over `world`; `seed` draws where each foot lands.

    A foot lands when the gait's heel strikes: half a step ahead of the hip and half a step's width beside it, each with
    a scatter.
    """

    def __init__(self, world: World, gait: Gait, seed: int) -> None:
        chance = np.random.default_rng([seed, 13])
        self._world = world
        self._gait = gait
        course = gait.course(gait.strike_s)
        count = len(gait.strike_s)
        scatter = np.clip(chance.standard_normal((count, 2)), -_MOST_SIGMAS, _MOST_SIGMAS)
        side = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
        ahead_m, left_m = 0.5 * course.step_m, side * _HALF_STEP_WIDTH_M
        forward = np.stack((np.cos(course.heading_rad), np.sin(course.heading_rad)), axis=1)
        leftward = np.stack((-forward[:, 1], forward[:, 0]), axis=1)
        self._meant_m = course.xy_m + ahead_m[:, None] * forward + left_m[:, None] * leftward
        across = _ACROSS_SIGMA_M * scatter[:, 1, None] * leftward
        self._off_m = _AHEAD_SIGMA_M * scatter[:, 0, None] * forward + across

    @property
    def meant_x_m(self) -> FloatArray:
        """Return x of W (n,) of the first lap's landings as they are meant, without the scatter."""
        x_m: FloatArray = self._meant_m[:, 0]
        return x_m

    def next_after(self, t_ns: int, left: bool | None = None) -> Foothold | None:
        """Return the first landing after `t_ns`, of the left or the right foot where one is named; None for a wearer
        who never walks."""
        number = self._landed_by(t_ns)
        landing = self._landing(number)
        while landing is not None and left is not None and landing.left != left:
            number += 1
            landing = self._landing(number)
        return landing

    def last_before(self, t_ns: int) -> Foothold | None:
        """Return the last landing up to `t_ns`, where that foot still stands; None before the first step."""
        landed = self._landed_by(t_ns)
        return self._landing(landed - 1) if landed else None

    def _landed_by(self, t_ns: int) -> int:
        """Return how many feet have landed since the start."""
        gait, most = self._gait, len(self._gait.strike_s)
        lap, t_lap_s = divmod(max(1e-9 * (t_ns - gait.start_ns), 0.0), gait.lap_s)
        number = int(lap) * most + int(np.searchsorted(gait.strike_s, t_lap_s, side="right"))
        return number + 1 if most and self._land_ns(number) <= t_ns else number  # rounded to the nanosecond

    def _land_ns(self, number: int) -> int:
        lap, step = divmod(number, len(self._gait.strike_s))
        return self._gait.start_ns + round(1e9 * (lap * self._gait.lap_s + float(self._gait.strike_s[step])))

    def _landing(self, number: int) -> Foothold | None:
        gait = self._gait
        if len(gait.strike_s) == 0:
            return None
        lap, step = divmod(number, len(gait.strike_s))
        meant_m = self._meant_m[step] + lap * gait.lap_advance_m
        x_m, y_m = (float(each) for each in meant_m + self._off_m[step])
        from_m, to_m = self._world.between_risers(float(meant_m[0]))
        margin_m = min(_FROM_EDGE_M, 0.5 * (to_m - from_m))
        x_m = min(max(x_m, from_m + margin_m), to_m - margin_m)
        ground = self._world.segment_at(x_m)
        return Foothold(
            t_land_ns=self._land_ns(number),
            p_WF_m=np.array([x_m, y_m, ground.height_at(x_m)]),
            left=step % 2 == 0,
            slope_rad=ground.slope_rad,
            kind=ground.kind,
        )
