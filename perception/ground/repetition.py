"""Which of the planes that a repeating floor offers is the ground.

A floor of tiles that are all alike matches as well one tile further along the row. Then planes of the same slopes fit
the pair whose inverse heights differ by whole multiples of

    δ = q / h,                                                                                              (1)

with h the height found and q the share of its disparities by which a tile moves them. Which of them the ground is, the
picture tells where one fits clearly better than all others, as it does whenever the rows cross the tiles askew, or
where the others are out of reach; else the track of earlier frames, which is nearer to the right one than half of δ;
else nothing does. Beyond the foothold nothing tells the tiles apart: of such a floor there is no path, nor of one whose
path shows a surface as steep as the ground at another of these heights, unless the picture tells that surface too.
"""

from collections.abc import Callable, Sequence

from messages import Reason
from perception.depth.repeats import Repeats
from perception.ground.meter import GroundMeasurement
from perception.ground.plane import Plane, PlaneFit
from perception.ground.region import FootholdRegion
from perception.terrain.surfaces import Surface


class RepetitionWatch:
    """Remembers that the floor repeats, and keeps a measurement from being off by a tile."""

    remembered_s = 1.0
    surprising_m = 0.03  # off the height expected: the hip moves by a third of that between two frames
    least_inlier_share = 0.9  # fewer may be those of two planes
    as_far_as_tiles = 0.15  # of a tile, beside a whole number of them
    share_off, share_off_each = 0.025, 0.02  # of a disparity: by which a height errs, and q for each tile
    most_misfit = 0.15  # of the plane to the region: level tiles leave 0.07, two treads of a stair 0.2 and more

    def __init__(self) -> None:
        self._until_ns: int | None = None
        self._ambiguous = False
        self._to_check = False  # what is expected was not measured in the foothold's region
        self._spacing_per_m = 0.0  # δ of (1)

    def repeats(self, t_ns: int) -> bool:
        """Return whether the floor was found to repeat itself of late."""
        return self._until_ns is not None and t_ns < self._until_ns

    def is_ambiguous(self, t_ns: int) -> bool:
        """Return whether the picture alone did not tell which tile matches which, since the floor repeats itself.

        A stride turns the camera against the tiles, and for a part of it they can be told apart.
        """
        return self._ambiguous and self.repeats(t_ns)

    def makes_ambiguous(
        self, t_ns: int, height_m: float, alike: Sequence[tuple[Surface, float]], ask: Callable[[Surface], Repeats]
    ) -> bool:
        """Return whether surfaces `alike` the ground at `height_m` (`as_steep`), each with its own height, may be the
        same floor a tile off: it repeats itself, one lies where (1) puts another plane, and the rivals that
        `ask` tells of it fit nearly as well. It is ambiguous then."""
        if self.repeats(t_ns) and not self._ambiguous:
            self._ambiguous = any(
                self._is_tiles_off(height_m, other_m) and not self._is_itself(ask(surface))
                for surface, other_m in alike
            )
        return self.is_ambiguous(t_ns)

    def _is_itself(self, found: Repeats) -> bool:
        """Return whether the picture tells that the plane asked about is one, and no other a tile off."""
        return found.misfit <= self.most_misfit and found.standing_out() == 1.0

    def _is_tiles_off(self, height_m: float, other_m: float) -> bool:
        share = self._spacing_per_m * height_m
        off = height_m / other_m - 1.0
        tiles = round(off / share)
        most_off = min(self.as_far_as_tiles * share, self.share_off + self.share_off_each * abs(tiles))
        return tiles != 0 and abs(off - tiles * share) < most_off

    def check_next(self) -> None:
        """Believe what is expected only once the floor is seen not to repeat itself, or tells its planes apart."""
        self._to_check = True

    def margin_m(self, t_ns: int, expected: Plane | None) -> float | None:
        """Return how far from `expected` the ground may be taken to lie; None where only its steps bound that."""
        return self._half_gap_m(expected.height_m) if expected is not None and self.repeats(t_ns) else None

    def resolved(
        self,
        t_ns: int,
        measured: GroundMeasurement,
        fit: PlaneFit,
        expected: Plane | None,
        region: FootholdRegion,
        ask: Callable[[Plane], Repeats],
        measure: Callable[[Plane, float], GroundMeasurement],
    ) -> tuple[GroundMeasurement, bool]:
        """Return the measurement to go on with, and whether it may contradict what is `expected`.

        `fit` is the plane of `measured`. `ask` tells the rivals of a plane; `measure` measures again, near a plane, to
        a distance in m.
        """
        if not self._asks(t_ns, fit, expected):
            return measured, True
        was_ambiguous, proven = self.is_ambiguous(t_ns), not self._to_check
        found = ask(fit.plane)
        if expected is not None and not self.repeats(t_ns):
            found = found.of_the_floor()  # the other surface at an edge is no tile
        if not found.rivals and not self.repeats(t_ns):
            self._to_check = False
            return measured, True
        if found.of_the_floor().rivals:
            self._until_ns = t_ns + round(1e9 * self.remembered_s)
        if found.rivals:
            self._spacing_per_m = min(abs(1.0 - rival.ratio) for rival in found.rivals) / fit.plane.height_m  # (1)
        ratio = (_where_ground_may_be(found, fit.plane, region) if expected is None else found).standing_out()
        if found.best_misfit <= self.most_misfit:  # else it is no plane, and tells nothing of tiles
            self._ambiguous = ratio is None or was_ambiguous
        if ratio is not None:
            self._to_check = False
            height_m = fit.plane.height_m / ratio
        elif expected is not None and proven:
            height_m = expected.height_m
        else:
            return GroundMeasurement(Reason.LOW_TEXTURE, measured.matched_share), False
        if found.misfit_near(fit.plane.height_m / height_m) > self.most_misfit:
            return GroundMeasurement(Reason.NOT_PLANAR, measured.matched_share), False
        margin_m = self._half_gap_m(height_m)
        if abs(fit.plane.height_m - height_m) > margin_m:
            measured = measure(Plane(fit.plane.gradient, height_m), margin_m)
        return measured, ratio is not None

    def _asks(self, t_ns: int, fit: PlaneFit, expected: Plane | None) -> bool:
        return (
            expected is None
            or self._to_check
            or self.repeats(t_ns)
            or abs(fit.plane.height_m - expected.height_m) > self.surprising_m
            or fit.inlier_share < self.least_inlier_share
        )

    def _half_gap_m(self, height_m: float) -> float:
        """Return how far below `height_m` the plane midway to the next rival lies: 1/h grows by δ/2."""
        half = 0.5 * self._spacing_per_m * height_m
        return height_m * half / (1.0 + half)


def as_steep(surfaces: Sequence[Surface], slope: float) -> list[tuple[Surface, float]]:
    """Return those surfaces that are about of this slope, a tangent, as a plane a tile off another is; and how far
    below the camera a plane of it lies that goes through the middle of each."""
    alike = [each for each in surfaces if abs(each.slope - slope) < _AS_STEEP + _AS_STEEP_SIGMAS * each.slope_sd]
    heights_m = [(each, slope * each.middle_m - each.height_m) for each in alike]
    return [(each, height_m) for each, height_m in heights_m if height_m > 0.0]


def _where_ground_may_be(found: Repeats, plane: Plane, region: FootholdRegion) -> Repeats:
    """Return the rivals of `plane` that the region's first bounds of the height allow."""
    low_m, high_m = (region.nominal_height_m + side * region.height_margin_m for side in (-1.0, 1.0))
    return found.within((plane.height_m / high_m, plane.height_m / low_m))


_AS_STEEP, _AS_STEEP_SIGMAS = 0.03, 3.0
