"""The pictures against geometry computed in other ways: the pair's disparity, single rays, slower renderings."""

import dataclasses
from collections.abc import Callable

import cv2
import msgspec
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from messages import Lens, Pose
from messages.arrays import FloatArray, GreyImage
from perception.depth.rectify import Rectifier, Window, undistorted_rays
from sim_rig.camera import textures
from sim_rig.camera.renderer import Effects, Renderer
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, Unit, draw_unit
from sim_rig.walk.gait import Gait
from sim_rig.walk.legs import Leg, Stand, Turn, Walk
from sim_rig.walk.scenario import scenario
from sim_rig.walk.shade import Shade
from sim_rig.walk.world import World, WorldBuilder

GEOMETRY_ONLY = Effects(motion_blur=False, noise=False)
STANDING: tuple[Leg, ...] = (Stand(60.0),)
WALKING: tuple[Leg, ...] = (Stand(1.0), Walk(8.0, 1.2, 1.8), Stand(1.0))
EXPOSURE_S = 0.008


def field(texture: str) -> World:
    return WorldBuilder().level(8.0, texture).build()


def render(renderer: Renderer, t_ns: int = 0, index: int = 0) -> tuple[GreyImage, GreyImage]:
    left, right = np.empty((2, HEIGHT_PX, WIDTH_PX), np.uint8)
    renderer.render(t_ns, EXPOSURE_S, index, left, right)
    return left, right


def ideal(unit: Unit) -> Unit:
    """Return the unit with perfect lenses and parallel eyes of equal brightness."""
    pinhole = Lens(
        width_px=WIDTH_PX, height_px=HEIGHT_PX, fx_px=700, fy_px=700, cx_px=639.5, cy_px=359.5, distortion=(0.0,) * 5
    )
    parallel = Pose(R=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), p_m=(-0.12, 0.0, 0.0))
    stereo = msgspec.structs.replace(unit.stereo, left=pinhole, right=pinhole, X_RL=parallel)
    return dataclasses.replace(unit, stereo=stereo, gain=(1.0, 1.0))


def disparity_errors_px(unit: Unit, world: World, gait: Gait) -> FloatArray:
    """Return (n, 2): the shift along and across the rows, patch by patch, left between the eyes after the ground's own
    disparity, computed from the true plane, is taken out.
    """
    left, right = render(Renderer(unit, world, gait, 1, GEOMETRY_ONLY))
    rectifier = Rectifier(unit.stereo, 1)
    window = Window(0, rectifier.height_px, 0, rectifier.width_px)
    left, right = rectifier.rectify(left, right, window, 0)
    motion = gait.at(np.array([0]))
    R_WL = motion.R_WB[0] @ np.array(unit.X_BL.R)
    p_WL = motion.p_WB_m[0] + motion.R_WB[0] @ np.array(unit.X_BL.p_m)
    ground = world.segment_at(p_WL[0] + 1.0)
    normal_W = np.array([-np.sin(ground.slope_rad), 0.0, np.cos(ground.slope_rad)])
    distance_m = normal_W @ (p_WL - [ground.x0_m, 0.0, ground.z0_m])
    rays_W = rectifier.rays_C(window) @ (R_WL @ rectifier.R_LC).T
    disparity_px = rectifier.f_px * rectifier.baseline_m * -(rays_W @ normal_W) / distance_m
    v, u = np.mgrid[window.rows, window.columns]
    matched = map_coordinates(right.astype(float), [v, u - disparity_px], order=3, mode="nearest")
    return patch_shifts_px(left.astype(float), matched)


def patch_shifts_px(first: FloatArray, second: FloatArray, size: int = 64) -> FloatArray:
    """Return (n, 2): least-squares (Lucas-Kanade) shift of each patch of the inner picture, contrast normalised."""

    def normalised(image: FloatArray) -> FloatArray:
        detail = image - cv2.GaussianBlur(image, (0, 0), 8)
        return detail / (np.sqrt(cv2.GaussianBlur(detail**2, (0, 0), 8)) + 1e-3)

    first, second = normalised(first), normalised(second)
    both = 0.5 * (first + second)
    gradient = [np.gradient(both, axis=1), np.gradient(both, axis=0)]
    shifts = []
    for top in range(40, first.shape[0] - size - 20, size):
        for left in range(240, first.shape[1] - size - 20, size):
            patch = np.s_[top : top + size, left : left + size]
            A = np.stack([g[patch].ravel() for g in gradient], axis=1)
            shifts.append(np.linalg.lstsq(A, (second - first)[patch].ravel())[0])
    return np.array(shifts)


@pytest.mark.parametrize(("texture", "lenses", "allowed_px"), [("concrete", "ideal", 0.005), ("gravel", "real", 0.008)])
def test_the_disparity_of_level_ground_is_that_of_its_plane(texture: str, lenses: str, allowed_px: float) -> None:
    unit = draw_unit(1, rolling_shutter=False)
    world = field(texture)
    gait = Gait(world, STANDING, 0.95, 1, 0)
    errors = disparity_errors_px(ideal(unit) if lenses == "ideal" else unit, world, gait)
    assert np.abs(errors.mean(axis=0)).max() < allowed_px
    assert errors.std(axis=0).max() < 0.02


@pytest.mark.parametrize("slope_deg", [8.0, -8.0])
def test_the_disparity_of_a_ramp_is_that_of_its_plane(slope_deg: float) -> None:
    unit = draw_unit(2, rolling_shutter=False)
    world = WorldBuilder().ramp(12.0, slope_deg, "asphalt").ramp(12.0, -slope_deg, "asphalt").build()
    errors = disparity_errors_px(unit, world, Gait(world, STANDING, 0.95, 1, 0))
    assert np.abs(errors.mean(axis=0)).max() < 0.01
    assert errors.std(axis=0).max() < 0.03


@pytest.mark.parametrize("turned_deg", [90.0, 180.0])
def test_the_disparity_of_level_ground_is_that_of_its_plane_also_behind_and_beside(turned_deg: float) -> None:
    unit, turn = draw_unit(1, rolling_shutter=False), Turn(np.deg2rad(turned_deg), 1.0)
    back = Turn(np.deg2rad(360.0 - turned_deg), 1.0)
    world = field("gravel")
    errors = disparity_errors_px(unit, world, Gait(world, (turn, Stand(9.0), back), 0.95, 1, -3_000_000_000))
    assert np.abs(errors.mean(axis=0)).max() < 0.008
    assert errors.std(axis=0).max() < 0.02


def grey_of_each_piece(world: World, monkeypatch: pytest.MonkeyPatch) -> World:
    """Return the world with a plain grey of its own for each piece."""

    def plain(grey: float) -> Callable[[], FloatArray]:
        return lambda: np.full((textures.TILE, textures.TILE), grey)

    for k in range(len(world.lap)):
        monkeypatch.setitem(textures.TEXTURES, f"grey {k}", plain(40.0 + 25.0 * k))
    return World(tuple(dataclasses.replace(s, texture=f"grey {k}") for k, s in enumerate(world.lap)))


def first_hit(world: World, origin: FloatArray, ray: FloatArray) -> tuple[str, float]:
    """Return the texture of the piece that the ray meets first, and how far along the profile from its nearer end."""
    best = (np.inf, "", 0.0)
    for s in world.between(origin[0] - 12.0, origin[0] + 12.0):
        along = np.array([s.x1_m - s.x0_m, s.z1_m - s.z0_m])
        A = np.stack((ray[[0, 2]], -along), axis=1)
        if abs(np.linalg.det(A)) < 1e-12:
            continue
        distance, share = np.linalg.solve(A, np.array([s.x0_m, s.z0_m]) - origin[[0, 2]])
        if distance > 0 and 0 <= share <= 1 and distance < best[0]:
            best = (distance, s.texture, min(share, 1 - share) * s.length_m)
    return best[1], best[2]


@pytest.mark.parametrize("rise_m", [0.17, -0.17])
@pytest.mark.parametrize("x_m", [0.2, 1.6])
@pytest.mark.parametrize(("nosing_m", "course_rad"), [(0.0, 0.0), (0.025, 0.0), (0.015, 0.6)])
def test_every_pixel_shows_the_piece_its_ray_meets_first(
    rise_m: float, x_m: float, nosing_m: float, course_rad: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = WorldBuilder().level(2.0, "concrete").stairs(3, rise_m, 0.29, "concrete", "concrete", nosing_m)
    world = steps.level(1.0, "concrete").ramp(1.0, np.degrees(np.arctan(-3 * rise_m)), "concrete").build()
    world = grey_of_each_piece(world, monkeypatch)
    unit = dataclasses.replace(draw_unit(3), gain=(1.0, 1.0))
    shifted = World(tuple(s.ahead_by(-x_m) for s in world.lap))
    gait = Gait(shifted, STANDING, 0.95, 3, 0, course_rad=course_rad)
    left, _ = render(Renderer(unit, shifted, gait, 3, GEOMETRY_ONLY))

    u, v = np.arange(20.0, WIDTH_PX - 20, 111), np.arange(10.0, HEIGHT_PX - 10, 7)
    rays_L = undistorted_rays(unit.stereo.left, u, v)
    row_ns = np.rint((v - (HEIGHT_PX - 1) / 2) * unit.stereo.row_time_s * 1e9).astype(np.int64)
    motion = gait.at(row_ns)
    seen = wrong = 0
    for i, row in enumerate(v.astype(int)):
        origin = motion.p_WB_m[i] + motion.R_WB[i] @ np.array(unit.X_BL.p_m)
        rays_W = rays_L[i] @ (motion.R_WB[i] @ np.array(unit.X_BL.R)).T
        for ray, column in zip(rays_W, u.astype(int), strict=True):
            texture, from_edge_m = first_hit(shifted, origin, ray)
            around = left[row - 3 : row + 4, column]
            if not texture or from_edge_m < 0.01 or np.ptp(around) > 4:
                continue  # within 3 px of an edge in the picture or 1 cm of one on the ground
            radius2 = (column - unit.stereo.left.cx_px) ** 2 + (row - unit.stereo.left.cy_px) ** 2
            grey = left[row, column] / (1 - 0.28 * radius2 / (655.0**2 + 375.0**2))
            nearest = min(range(len(world.lap)), key=lambda k: abs(40 + 25 * k - grey))
            seen += 1
            wrong += f"grey {nearest}" != texture
    assert seen > 700
    assert wrong == 0


def test_every_pixel_is_as_light_as_the_shades_leave_the_point_its_ray_meets(monkeypatch: pytest.MonkeyPatch) -> None:
    shades = (
        Shade((0.8, 0.36, 0.48), 0.9, 1.5, 0.5),
        Shade((1.0, 0.0, 0.0), 1.2, 1.35, 0.6),
        Shade((1.0, 0.0, 0.0), -3.0, -2.7, 0.3),
    )
    stairs = WorldBuilder().level(0.9, "grey").stairs(3, 0.15, 0.3, "grey", "grey", 0.02)
    world = stairs.level(1.0, "grey").ramp(2.0, np.degrees(np.arctan(-0.45 / 2.0)), "grey").build(shades=shades)
    monkeypatch.setitem(textures.TEXTURES, "grey", lambda: np.full((textures.TILE, textures.TILE), 200.0))
    unit = dataclasses.replace(draw_unit(3), gain=(1.0, 1.0))
    gait = Gait(world, STANDING, 0.95, 3, 0, course_rad=-0.3)
    left, _ = render(Renderer(unit, world, gait, 3, GEOMETRY_ONLY))
    bright, _ = render(Renderer(unit, dataclasses.replace(world, shades=()), gait, 3, GEOMETRY_ONLY))
    u, v = np.arange(20.0, WIDTH_PX - 20, 61), np.arange(10.0, HEIGHT_PX - 10, 7)
    rays_L = undistorted_rays(unit.stereo.left, u, v)
    motion = gait.at(np.rint((v - (HEIGHT_PX - 1) / 2) * unit.stereo.row_time_s * 1e9).astype(np.int64))
    seen = {1.0: 0, 0.5: 0, 0.6: 0, 0.3: 0, 0.3 * 0.5: 0, 0.5 * 0.6: 0}
    for i, row in enumerate(v.astype(int)):
        origin = motion.p_WB_m[i] + motion.R_WB[i] @ np.array(unit.X_BL.p_m)
        rays_W = rays_L[i] @ (motion.R_WB[i] @ np.array(unit.X_BL.R)).T
        for ray, column in zip(rays_W, u.astype(int), strict=True):
            around = (
                left[row - 3 : row + 4, column - 3 : column + 4] / bright[row - 3 : row + 4, column - 3 : column + 4]
            )
            if np.ptp(around) > 0.03:
                continue  # at a shadow's border
            point = met(world, origin, ray)
            light = float(np.prod([shade.light(point) for shade in world.shades_between(-9.0, 9.0)]))
            assert around[3, 3] == pytest.approx(light, abs=0.02)
            seen[round(light, 3)] += 1
    assert min(count for light, count in seen.items() if light in (1.0, 0.5, 0.6)) > 20


@pytest.mark.parametrize("askew_rad", [0.0, 0.4])
def test_a_shadow_in_a_column_is_as_long_as_its_rays_tell_to_a_tenth_of_a_pixel(
    monkeypatch: pytest.MonkeyPatch, askew_rad: float
) -> None:
    shade = Shade((np.cos(askew_rad), np.sin(askew_rad), 0.0), 0.9, 1.2, 0.4)
    world = WorldBuilder().level(4.0, "grey").build(shades=(shade,))
    monkeypatch.setitem(textures.TEXTURES, "grey", lambda: np.full((textures.TILE, textures.TILE), 200.0))
    unit = dataclasses.replace(draw_unit(3), gain=(1.0, 1.0))
    gait = Gait(world, STANDING, 0.95, 3, 0)
    left, _ = render(Renderer(unit, world, gait, 3, GEOMETRY_ONLY))
    bright, _ = render(Renderer(unit, dataclasses.replace(world, shades=()), gait, 3, GEOMETRY_ONLY))
    u, v = np.arange(440.0, 840.0, 7.0), np.arange(0.0, HEIGHT_PX)
    motion = gait.at(np.rint((v - (HEIGHT_PX - 1) / 2) * unit.stereo.row_time_s * 1e9).astype(np.int64))
    R_WL = motion.R_WB @ np.array(unit.X_BL.R)
    origin_W = motion.p_WB_m + motion.R_WB @ np.array(unit.X_BL.p_m)
    rays_W = np.einsum("vij,vuj->vui", R_WL, undistorted_rays(unit.stereo.left, u, v))
    points_W = origin_W[:, None] - rays_W * (origin_W[:, None, 2:] / rays_W[..., 2:])
    along_m = points_W @ np.array(shade.normal_W)
    length_px = [np.ptp(np.interp((-shade.to_m, -shade.from_m), -along, v)) for along in along_m.T]
    shares = ((1.0 - left / bright) / (1.0 - shade.factor))[:, u.astype(int)]
    covered = np.where(shares < 0.02, 0.0, np.where(shares > 0.98, 1.0, shares)).sum(axis=0)  # grey values are whole
    assert min(length_px) > 50.0
    np.testing.assert_allclose(covered, length_px, atol=0.1)


def met(world: World, origin: FloatArray, ray: FloatArray) -> FloatArray:
    """Return the point at which a ray meets the ground first."""
    best = np.inf
    for s in world.between(origin[0] - 12.0, origin[0] + 12.0):
        A = np.stack((ray[[0, 2]], -np.array([s.x1_m - s.x0_m, s.z1_m - s.z0_m])), axis=1)
        if abs(np.linalg.det(A)) > 1e-12:
            distance, share = np.linalg.solve(A, np.array([s.x0_m, s.z0_m]) - origin[[0, 2]])
            if 0 < distance < best and 0 <= share <= 1:
                best = distance
    return origin + best * ray


def test_each_row_is_exposed_at_its_own_time() -> None:
    unit = draw_unit(4)
    world = field("gravel")
    gait = Gait(world, WALKING, 0.95, 4, 0)
    rolling = Renderer(unit, world, gait, 4, GEOMETRY_ONLY)
    at_once = Renderer(draw_unit(4, rolling_shutter=False), world, gait, 4, GEOMETRY_ONLY)
    t_ns = 4_180_000_000
    left, right = render(rolling, t_ns)
    middle, _ = render(at_once, t_ns)
    for row in (40, 200, 500, 700):
        row_ns = round((row - 359.5) * unit.stereo.row_time_s * 1e9)
        left_then, right_then = render(at_once, t_ns + row_ns)
        for picture, then in ((left, left_then), (right, right_then)):
            assert np.abs(picture[row].astype(int) - then[row]).mean() < 1.0
        assert np.abs(left[row].astype(int) - middle[row]).mean() > 3.0


def test_motion_blur_is_the_mean_over_the_exposure() -> None:
    unit = draw_unit(5)
    world = field("gravel")
    gait = Gait(world, WALKING, 0.95, 5, 0)
    sharp = Renderer(unit, world, gait, 5, GEOMETRY_ONLY)
    t_ns = 4_300_000_000
    blurred, _ = render(Renderer(unit, world, gait, 5, Effects(noise=False)), t_ns)
    parts = 15
    moments = [round(EXPOSURE_S * 1e9 * ((k + 0.5) / parts - 0.5)) for k in range(parts)]
    mean = np.mean([render(sharp, t_ns + moment)[0] for moment in moments], axis=0)
    unblurred, _ = render(sharp, t_ns)
    inner = np.s_[8:-8, 8:-8]
    missing = np.sqrt(np.mean((unblurred[inner] - mean[inner]) ** 2))
    left_over = np.sqrt(np.mean((blurred[inner] - mean[inner]) ** 2))
    assert missing > 6.0
    assert left_over < 0.25 * missing
    shifts = patch_shifts_px(blurred.astype(float), mean)
    assert np.abs(shifts.mean(axis=0)).max() < 0.02


def test_standing_still_blurs_nothing() -> None:
    unit, world = draw_unit(6), field("gravel")
    gait = Gait(world, STANDING, 0.95, 6, 0)
    sharp, _ = render(Renderer(unit, world, gait, 6, GEOMETRY_ONLY))
    exposed, _ = render(Renderer(unit, world, gait, 6, Effects(noise=False)))
    np.testing.assert_array_equal(sharp, exposed)


def test_noise_is_as_strong_as_stated_fresh_each_frame_and_repeatable() -> None:
    unit, world = draw_unit(7), field("concrete")
    gait = Gait(world, STANDING, 0.95, 7, 0)
    clean, _ = render(Renderer(unit, world, gait, 7, Effects(noise=False)))
    renderer = Renderer(unit, world, gait, 7)
    first, again, other = render(renderer, index=1), render(renderer, index=1), render(renderer, index=2)
    np.testing.assert_array_equal(first, again)
    grain = first[0].astype(float) - clean
    assert grain.std() == pytest.approx(np.sqrt(0.9**2 + 0.15**2 * clean.mean()), rel=0.05)
    assert abs(grain.mean()) < 0.05
    other_grain = other[0].astype(float) - clean
    right_grain = first[1] - render(Renderer(unit, world, gait, 7, Effects(noise=False)))[1].astype(float)
    for unrelated in (other_grain, right_grain):
        assert abs(np.corrcoef(grain.ravel(), unrelated.ravel())[0, 1]) < 0.02


def test_the_eyes_differ_in_brightness_as_the_unit_says_and_corners_are_darker() -> None:
    unit, world = draw_unit(8), field("concrete")
    unit = dataclasses.replace(unit, gain=(1.0, 1.05))
    left, right = render(Renderer(unit, world, Gait(world, STANDING, 0.95, 8, 0), 8, GEOMETRY_ONLY))
    assert right.mean() / left.mean() == pytest.approx(1.05, abs=0.01)
    assert left[:60, :60].mean() < 0.85 * left[330:390, 600:660].mean()


def test_two_renderers_give_the_same_bytes_anywhere_on_the_walk() -> None:
    walked = scenario("mixed")
    unit = draw_unit(9)

    def made() -> Renderer:
        return Renderer(unit, walked.world, Gait(walked.world, walked.legs, 0.95, 9, 0), 9)

    first, second = made(), made()
    for t_ns in (0, 17_000_000_000, 30_500_000_000):
        pictures = render(first, t_ns, 5)
        np.testing.assert_array_equal(pictures, render(second, t_ns, 5))
        assert all(picture.std() > 5 for picture in pictures)
        assert not any((picture == 70).all(axis=1).any() for picture in pictures)
