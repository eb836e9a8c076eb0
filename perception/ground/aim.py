"""Where the ground of a frame is measured: on the surface that carries the predicted foothold.

The region lies about the foothold and within the surface on which it is: the edges and bends that the frames before
have shown bound it, and so does what a falling lip hides. From an optical centre h above a lip at d, the ground behind
it, lower by r, is seen from

    u_s = d (h + r) / h                                                                                        (1)

on. Where no border is near, it is no farther than the settings have it: the nearer the ground, the better it is
measured.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from messages import Reason
from messages.arrays import FloatArray
from perception.depth.disparity import DisparityCamera
from perception.ground.foothold import FootholdSettings
from perception.ground.region import FootholdRegion
from perception.terrain.path_ahead import PathAhead


@dataclass(frozen=True)
class View:
    """How high the camera is over the ground, and from where to where along x of H it sees level ground."""

    height_m: float
    nearest_m: float
    farthest_m: float


@dataclass(frozen=True)
class Aim:
    """The region to measure, or the `reason` why the surface under the foothold cannot be. Where it is `passed` the
    picture does not show it any more: it does not reach down to it, or legs hide it."""

    region: FootholdRegion
    reason: Reason = Reason.NONE
    passed: bool = False


def aimed(settings: FootholdSettings, place_m: tuple[float, float] | None, path: PathAhead, view: View) -> Aim:
    """Return where to measure for a foot that lands at `place_m`, x and y of H; without one, the fixed region."""
    fixed = settings.region
    ahead_m, left_m = place_m or (fixed.ahead_m, fixed.left_m)
    aside_m = min(max(left_m, -_MOST_ASIDE_M), _MOST_ASIDE_M)
    borders_m = path.borders_m(aside_m)
    before_m = max((at for at in borders_m if at <= ahead_m), default=-math.inf)
    behind_m = min((at for at in borders_m if at > ahead_m), default=math.inf)
    bounded = before_m > min(ahead_m, fixed.ahead_m) - _NEAR_BORDER_M or behind_m < ahead_m + _NEAR_BORDER_M
    from_m, to_m = before_m + _BESIDE_BORDER_M, behind_m - _BESIDE_BORDER_M
    place = Aim(replace(fixed, ahead_m=ahead_m, left_m=aside_m))
    if view.nearest_m == math.inf:  # the camera looks up
        return replace(place, reason=Reason.FOOTHOLD_OUT_OF_VIEW)
    lip = path.edge_at(before_m, aside_m)
    if lip is not None and lip.rise_m < 0.0:
        above_m = path.height_before(before_m, view.height_m)
        from_m = max(from_m, before_m * (above_m - lip.rise_m) / above_m + _BESIDE_SHADOW_M)  # (1)
        if lip.bound_only or to_m - from_m < _LEAST_LENGTH_M:
            return replace(place, reason=Reason.OCCLUDED)
    if bounded:
        u_m = ahead_m + aside_m * math.tan(path.yaw_rad)
        surface = path.surface_at(u_m)
        if surface is None:
            passed = ahead_m < view.nearest_m or path.known_at(u_m) is not None
            return replace(place, reason=Reason.FOOTHOLD_OUT_OF_VIEW, passed=passed)
        from_m, to_m = max(from_m, surface.from_m), min(to_m, surface.to_m)
    elif place_m is None:
        return replace(place, region=fixed)
    if to_m - max(from_m, view.nearest_m) < _LEAST_LENGTH_M:
        return replace(place, reason=Reason.FOOTHOLD_OUT_OF_VIEW, passed=from_m < view.nearest_m)
    from_m, to_m = max(from_m, view.nearest_m), min(to_m, view.farthest_m)
    half_m = _HALF_OF_TREAD_M if bounded else fixed.half_length_m
    best_m = ahead_m
    if not bounded:
        best_m = min(max(ahead_m, view.nearest_m + half_m), fixed.ahead_m)
    middle_m = min(max(best_m, from_m + half_m), max(to_m - half_m, from_m + half_m))
    begin_m, end_m = max(middle_m - half_m, from_m), min(middle_m + half_m, to_m)
    region = replace(
        fixed,
        ahead_m=0.5 * (begin_m + end_m),
        left_m=aside_m,
        half_length_m=0.5 * (end_m - begin_m),
        yaw_rad=path.yaw_rad if bounded else 0.0,
        step_m=_BOUNDED_STEP_M if bounded else fixed.step_m,
        bounded=bounded,
    )
    return replace(place, region=region)


def view_of(camera: DisparityCamera, R_HC: FloatArray, height_m: float) -> View:
    """Return what `camera` sees of level ground `height_m` below it, straight ahead."""
    top, bottom = (R_HC @ np.array([0.0, tangent, 1.0]) for tangent in camera.tangents_down)
    nearest_m = height_m * bottom[0] / -bottom[2] if bottom[2] < 0.0 else math.inf
    farthest_m = height_m * top[0] / -top[2] if top[2] < -_LEAST_FALL else math.inf
    return View(height_m, float(nearest_m) + _BESIDE_PICTURE_M, float(farthest_m))


_MOST_ASIDE_M = 0.15
_BESIDE_BORDER_M = 0.03
_BESIDE_SHADOW_M = 0.03
_LEAST_LENGTH_M = 0.09
_NEAR_BORDER_M = 0.45
_HALF_OF_TREAD_M = 0.17
_BESIDE_PICTURE_M = 0.02
_LEAST_FALL = 0.1
_BOUNDED_STEP_M = 0.08
"""What lies farther off than this is one of the surfaces beyond the borders."""
