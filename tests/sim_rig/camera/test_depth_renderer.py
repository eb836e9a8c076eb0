"""The rig's depth camera: exact depth of the ground, and errors of the kind and size that are stated."""

import dataclasses

import msgspec
import numpy as np
import pytest

from messages.arrays import DepthImage
from sim_rig.camera.depth_renderer import NO_ERRORS, DepthErrors, DepthRenderer
from sim_rig.camera.depth_unit import DEPTH_HEIGHT_PX, DEPTH_WIDTH_PX, DepthUnit, draw_depth_unit
from sim_rig.walk.gait import Gait
from sim_rig.walk.scenario import scenario

START_NS = 10_000_000_000
WALK = scenario("mixed")
AT_THE_STAIRS_NS = START_NS + 33_000_000_000
ON_THE_RAMP_NS = START_NS + 7_500_000_000


def unit(row_time_s: float = 0.0) -> DepthUnit:
    exact, _ = draw_depth_unit(4, perfect_calibration=True)
    return dataclasses.replace(exact, depth=msgspec.structs.replace(exact.depth, row_time_s=row_time_s))


def gait() -> Gait:
    return Gait(WALK.world, WALK.legs, WALK.hip_height_m, 4, START_NS)


def renderer(of: DepthUnit, errors: DepthErrors | None = None) -> DepthRenderer:
    return DepthRenderer(of, WALK.world, gait(), 4, errors)


def image(of: DepthUnit, t_ns: int, errors: DepthErrors, index: int = 0) -> DepthImage:
    depth = np.zeros((DEPTH_HEIGHT_PX, DEPTH_WIDTH_PX), np.uint16)
    renderer(of, errors).render(t_ns, index, depth)
    return depth


def depth_along(of: DepthUnit, t_ns: int, u: int, v: int) -> float:
    """The depth of one pixel, by cutting its ray with every piece of ground in reach."""
    lens = of.depth.lens
    row_ns = round((v - (DEPTH_HEIGHT_PX - 1) / 2) * of.depth.row_time_s * 1e9)
    motion = gait().at(np.array([t_ns + row_ns]))
    ray_D = np.array([(u - lens.cx_px) / lens.fx_px, (v - lens.cy_px) / lens.fy_px, 1.0])
    ray = motion.R_WB[0] @ np.array(of.X_BD.R) @ ray_D
    eye = motion.p_WB_m[0] + motion.R_WB[0] @ np.array(of.X_BD.p_m)
    depths = []
    for piece in WALK.world.between(eye[0] - 1.0, eye[0] + 12.0):
        a = np.array([[ray[0], piece.x0_m - piece.x1_m], [ray[2], piece.z0_m - piece.z1_m]])
        if abs(np.linalg.det(a)) < 1e-12:
            continue
        z_m, share = np.linalg.solve(a, np.array([piece.x0_m - eye[0], piece.z0_m - eye[2]]))
        if z_m > 0 and 0 <= share <= 1:
            depths.append(float(z_m))
    return min(depths, default=float("inf"))


@pytest.mark.parametrize("t_ns", [ON_THE_RAMP_NS, AT_THE_STAIRS_NS])
@pytest.mark.parametrize("row_time_s", [0.0, 30e-6], ids=["global shutter", "rolling shutter"])
def test_depth_is_where_each_pixels_ray_meets_the_ground(t_ns: int, row_time_s: float) -> None:
    of = unit(row_time_s)
    inverse = renderer(of).inverse_depth(t_ns)
    rng = np.random.default_rng(1)
    for u, v in zip(rng.integers(0, DEPTH_WIDTH_PX, 60), rng.integers(0, DEPTH_HEIGHT_PX, 60), strict=True):
        true_m = depth_along(of, t_ns, int(u), int(v))
        if true_m < 8.0:
            assert 1.0 / inverse[v, u] == pytest.approx(true_m, rel=2e-5)


def test_without_errors_the_image_is_depth_in_whole_steps() -> None:
    of = unit()
    inverse = renderer(of).inverse_depth(AT_THE_STAIRS_NS).astype(np.float64)
    depth = image(of, AT_THE_STAIRS_NS, NO_ERRORS)
    seen = depth > 0
    assert seen.mean() > 0.85
    assert np.abs(depth[seen] - 1e3 / inverse[seen]).max() < 0.51


def test_behind_an_edge_the_right_eye_is_blind() -> None:
    of = unit()
    depth = image(of, AT_THE_STAIRS_NS, NO_ERRORS)
    disparity_px = of.depth.lens.fx_px * of.depth.baseline_m * renderer(of).inverse_depth(AT_THE_STAIRS_NS)
    seen_at = np.arange(DEPTH_WIDTH_PX) - disparity_px
    for row in range(0, DEPTH_HEIGHT_PX, 40):
        for column in range(0, DEPTH_WIDTH_PX, 50):
            hidden = seen_at[row, column] < 0 or (seen_at[row, column] > seen_at[row, column:]).any()
            assert (depth[row, column] == 0) == (hidden or disparity_px[row, column] == 0)


def test_the_noise_is_even_in_disparity_and_grows_with_the_square_of_depth() -> None:
    of = unit()
    fB_px_m = of.depth.lens.fx_px * of.depth.baseline_m
    inverse = renderer(of).inverse_depth(ON_THE_RAMP_NS).astype(np.float64)
    depth = image(of, ON_THE_RAMP_NS, DepthErrors(locking_px=0.0, hole_share=0.0))
    seen = depth > 0
    error_px = np.where(seen, fB_px_m * 1e3 / np.maximum(depth, 1) - fB_px_m * inverse, np.nan)
    near, far = (np.nanstd(error_px[rows]) for rows in (slice(300, 480), slice(60, 180)))
    assert near == pytest.approx(0.08, rel=0.15)
    assert far == pytest.approx(near, rel=0.15)
    error_m = np.where(seen, depth * 1e-3 - 1.0 / np.maximum(inverse, 1e-3), np.nan)
    assert np.nanstd(error_m[60:180]) > 2.0 * np.nanstd(error_m[300:480])


def test_holes_take_the_stated_share_and_edges_fly() -> None:
    of = unit()
    whole = image(of, ON_THE_RAMP_NS, DepthErrors(hole_share=0.0))
    holed = image(of, ON_THE_RAMP_NS, DepthErrors(hole_share=0.05))
    assert (holed[whole > 0] == 0).mean() == pytest.approx(0.05, abs=0.02)
    smooth, spoilt = (image(of, AT_THE_STAIRS_NS, errors) for errors in (NO_ERRORS, DepthErrors(hole_share=0.0)))
    seen = (smooth > 0) & (spoilt > 0)
    fB_px_m = of.depth.lens.fx_px * of.depth.baseline_m
    off_px = fB_px_m * 1e3 * np.abs(1.0 / spoilt[seen] - 1.0 / smooth[seen])
    assert 1e-4 < (off_px > 0.5).mean() < 0.05


def test_images_follow_from_seed_and_number() -> None:
    of, errors = unit(), DepthErrors()
    again = image(of, ON_THE_RAMP_NS, errors, 5)
    np.testing.assert_array_equal(image(of, ON_THE_RAMP_NS, errors, 5), again)
    assert (image(of, ON_THE_RAMP_NS, errors, 6) != again).mean() > 0.5


def test_a_bent_lens_is_refused() -> None:
    of = unit()
    lens = msgspec.structs.replace(of.depth.lens, distortion=(0.1, 0.0, 0.0, 0.0))
    bent = dataclasses.replace(of, depth=msgspec.structs.replace(of.depth, lens=lens))
    with pytest.raises(ValueError, match="pinhole"):
        renderer(bent)
