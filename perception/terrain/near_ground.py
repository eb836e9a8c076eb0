"""The ground near the feet where a frame does not show it: as the frames before did.

The wearer's own legs swing through the lower part of the picture, and a bend of the trunk lifts it off the ground. What
lies nearer than the first surface of a frame is carried on from the frames before by the odometer.
"""

from collections.abc import Sequence
from dataclasses import replace

from perception.terrain.path_ahead import moved
from perception.terrain.surfaces import Surface


class NearGround:
    """Keeps the surfaces of the newest frame and, nearer than these, those of earlier ones for `lasts_ns`."""

    lasts_ns = 1_000_000_000

    def __init__(self) -> None:
        self._known: list[tuple[Surface, int]] = []

    def clear(self) -> None:
        """Forget everything: the way since is not known."""
        self._known = []

    def update(self, t_ns: int, ahead_m: float, up_m: float, surfaces: Sequence[Surface]) -> list[Surface]:
        """Return the surfaces of a frame at `t_ns` and what is known nearer than these, in their order.

        The camera has gone `ahead_m` and `up_m` since the frame before. Of a frame without surfaces nothing is known.
        """
        carried = [(moved(surface, ahead_m, up_m), seen_ns) for surface, seen_ns in self._known]
        carried = [each for each in carried if each[0].to_m > 0.0 and t_ns - each[1] <= self.lasts_ns]
        if not surfaces:
            self._known = carried
            return []
        first_m = surfaces[0].from_m
        nearer = [
            (replace(surface, to_m=min(surface.to_m, first_m)), seen_ns)
            for surface, seen_ns in carried
            if surface.from_m < first_m - _LEAST_M
        ]
        self._known = nearer + [(surface, t_ns) for surface in surfaces]
        return [surface for surface, _ in self._known]


_LEAST_M = 0.08
