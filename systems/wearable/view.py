"""What the camera sees of the ground, to first order in what may be wrong with it: n frames, p patches.

Symbols: r ray of a patch's centre in C with z = 1; θ(t) of ground_path (1); s the frame's stamp, τ its row's time;
x_R = x − d / f the partner's place in the right eye. Everything returns disparity in px, (n, p).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from messages import Calibration, Lens
from messages.arrays import FloatArray
from perception.depth.rectify import Rectifier
from systems.wearable.blur import Steepness
from systems.wearable.ground_path import GroundPath, Smooth
from systems.wearable.pictures import Layout

_HIGHEST_SHARE = 0.5
"""Of the camera's height: ground does not rise or fall by more, where a fit tries a bend far too strong."""
Swelling = Callable[[Lens, FloatArray], FloatArray]


@dataclass(frozen=True)
class Scene:
    """The seen ground at the stamps, precomputed.

    `disparity_px` (n, p); `right_x` (n, p) is x_R; `flow_R` (n, p, 2) px/s is how the partner moves in the right
    picture, `flow_px_s` (n, p, 2) how the patch moves in the left one; `fall_px` (n, p) is what a partner one pixel
    too low adds to the disparity; `place_m` (n, p, 2) is where the patch lies on the ground, along the walk (the mean
    heading) and to its left, from the camera; `height_m` (n, 1).
    """

    disparity_px: FloatArray
    right_x: FloatArray
    flow_R: FloatArray
    flow_px_s: FloatArray
    fall_px: FloatArray
    place_m: FloatArray
    height_m: FloatArray


def scene_of(
    path: GroundPath,
    layout: Layout,
    rectifier: Rectifier,
    calibration: Calibration,
    stamp_s: FloatArray,
    position: Smooth | None,
    lean: FloatArray,
) -> Scene:
    """Return what is seen at the stamps (n,) of texture with the `lean` (n, p).

    Without `position` the camera turns but does not travel.
    """
    f_px, r = rectifier.f_px, layout.centre_C
    theta = path.theta(stamp_s[:, None] + layout.centre_time_s)
    d = np.einsum("npi,pi->np", theta, r)
    R_WB = path.attitude.R_WB(stamp_s)
    R_WC, w_B = R_WB @ path.R_BC, path.attitude.w_B_radps(stamp_s)
    v_W = np.zeros((len(stamp_s), 3)) if position is None else position(stamp_s, 1)
    v_W = v_W + np.einsum("nij,nj->ni", R_WB, np.cross(w_B, np.array(calibration.X_BL.p_m)))
    w_C, v_C = w_B @ path.R_BC, np.einsum("nij,ni->nj", R_WC, v_W)
    right_x = r[:, 0] - d / f_px
    right = np.stack((right_x, np.broadcast_to(r[:, 1], d.shape), np.ones_like(d)), axis=-1)
    near = (d / path.fB_px_m)[..., None]  # 1 / z
    points_W = np.einsum("nij,pj->npi", R_WC, r) / near
    walk = np.nanmean(R_WC[:, :2, 2], axis=0)
    walk /= np.linalg.norm(walk)
    place = points_W[..., :2] @ np.array([[walk[0], -walk[1]], [walk[1], walk[0]]])
    height_m = np.interp(stamp_s, path.grid_s, path.height_m)[:, None]
    return Scene(
        disparity_px=d,
        right_x=right_x,
        flow_R=_flow(right, w_C, v_C, near, f_px),
        flow_px_s=_flow(np.broadcast_to(r, right.shape), w_C, v_C, near, f_px),
        fall_px=lean - theta[..., 1] / f_px,
        place_m=place,
        height_m=height_m,
    )


def _flow(rays: FloatArray, w_C: FloatArray, v_C: FloatArray, near: FloatArray, f_px: float) -> FloatArray:
    """Return (n, p, 2) px/s: ṙ = −ω × r − v / z, brought back to z = 1."""
    rate = -np.cross(w_C[:, None], rays) - v_C[:, None] * near
    flow: FloatArray = f_px * (rate[..., :2] - rays[..., :2] * rate[..., 2:])
    return flow


def misaligned(scene: Scene, across_px: FloatArray, down_px: FloatArray) -> FloatArray:
    """Return the change of disparity where the partner stands `across_px` too far right and `down_px` too low."""
    return scene.fall_px * down_px - across_px


def right_rows_late(scene: Scene, layout: Layout, readout_s: float) -> FloatArray:
    """Return the change because the partner's raw row, of another height, is read out at another time."""
    late_s = (layout.right_row - layout.row) * readout_s
    return misaligned(scene, scene.flow_R[..., 0] * late_s, scene.flow_R[..., 1] * late_s)


def toed_in(scene: Scene, layout: Layout, f_px: float, y_rad: float) -> FloatArray:
    """Return the change where the right eye is turned by ε = `y_rad` about y: x' = x + ε (1 + x²), y' = y + ε x y."""
    x, y = scene.right_x, layout.centre_C[:, 1]
    return misaligned(scene, f_px * y_rad * (1.0 + x**2), f_px * y_rad * x * y)


def swollen(
    scene: Scene, layout: Layout, theta: FloatArray, rectifier: Rectifier, lenses: tuple[Lens, Lens], swelling: Swelling
) -> FloatArray:
    """Return the change where each eye takes a ray r for r (1 + g), g = `swelling` of its lens and of its raw rays."""
    f_px, r = rectifier.f_px, layout.centre_C
    x, y, x_R = r[:, 0], r[:, 1], scene.right_x
    right = np.stack((x_R, np.broadcast_to(y, x_R.shape), np.ones_like(x_R)), axis=-1)
    g = swelling(lenses[0], r @ rectifier.R_LC.T)
    g_R = swelling(lenses[1], right @ rectifier.R_LC.T)
    other_ground = -g * (theta[..., 0] * x + theta[..., 1] * y)
    return other_ground + misaligned(scene, f_px * (x_R * g_R - x * g), f_px * y * (g_R - g))


def more_distortion(k1: float) -> Swelling:
    """Return g = k₁ ρ² / s(ρ) of a lens with `k1` more than told; s = 1 + 3 k₁ ρ² + 5 k₂ ρ⁴ is the told slope."""

    def swelling(lens: Lens, rays: FloatArray) -> FloatArray:
        rho2, _, slope = _radial(lens, rays)
        return k1 * rho2 / slope

    return swelling


def longer_focus(share: float) -> Swelling:
    """Return g = e (1 + k₁ ρ² + k₂ ρ⁴) / s(ρ) of a focal length longer by `share`: the told lens unbends too little."""

    def swelling(lens: Lens, rays: FloatArray) -> FloatArray:
        _, bent, slope = _radial(lens, rays)
        return share * bent / slope

    return swelling


def _radial(lens: Lens, rays: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    k1, k2 = lens.distortion[0], lens.distortion[1]
    rho2 = (rays[..., 0] ** 2 + rays[..., 1] ** 2) / rays[..., 2] ** 2
    return rho2, 1.0 + k1 * rho2 + k2 * rho2**2, 1.0 + 3.0 * k1 * rho2 + 5.0 * k2 * rho2**2


def bent_ground(scene: Scene, ahead_m: float, sagittal_per_m: float, frontal_per_m: float) -> FloatArray:
    """Return the change on ground that bends up from its plane, by ½ κ ξ² either way; a rise b is d b / (h − b)."""
    along, across = scene.place_m[..., 0] - ahead_m, scene.place_m[..., 1]
    rise_m = 0.5 * (sagittal_per_m * along**2 + frontal_per_m * across**2)
    rise_m = np.clip(rise_m, -_HIGHEST_SHARE * scene.height_m, _HIGHEST_SHARE * scene.height_m)
    bent: FloatArray = scene.disparity_px * rise_m / (scene.height_m - rise_m)
    return bent


def smeared(scene: Scene, exposed_s: FloatArray, steepness: Steepness) -> FloatArray:
    """Return (n,) octaves by which smears, flow · exposure, change the steepness downwards against that across."""
    across_px, down_px = np.moveaxis(np.abs(scene.flow_px_s) * exposed_s[:, None, None], -1, 0)
    change: FloatArray = np.mean(steepness.loss(down_px) - steepness.loss(across_px), axis=1)
    return change


def turned(theta: FloatArray, turn_C: FloatArray) -> FloatArray:
    """Return θ as a camera sees it that is turned by the rotation vectors `turn_C` in its own axes: exp(−[δ]×) θ."""
    once = np.cross(turn_C, theta)
    return theta - once + 0.5 * np.cross(turn_C, once)
