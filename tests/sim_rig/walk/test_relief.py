"""Rough ground against rays followed in small steps, and the picture and the truth of it."""

import dataclasses

import numpy as np
import pytest

from messages.arrays import FloatArray
from perception.depth.rectify import undistorted_rays
from sim_rig.camera import textures
from sim_rig.camera.renderer import Effects, Renderer
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, draw_unit
from sim_rig.walk.gait import Gait
from sim_rig.walk.legs import Stand
from sim_rig.walk.relief import Relief
from sim_rig.walk.scenario import scenario
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer

RELIEF = Relief()


def followed(o_m: FloatArray, d: FloatArray) -> FloatArray:
    """Return the points (n, 3) at which rays from o (n, 3) along d (n, 3) first lie below the ground, to 0.1 mm."""
    reach = np.linspace(0.0, 1.0, 1500)[:, None, None]
    fall = -d[:, 2:]
    first, last = (o_m[:, 2:] - 0.031) / fall, (o_m[:, 2:] + 0.031) / fall
    points = o_m + (first + reach * (last - first)) * d
    below = points[..., 2] <= RELIEF.heights(points[..., 0], points[..., 1])
    met: FloatArray = points[below.argmax(axis=0), np.arange(len(o_m))]
    return met


def test_it_stays_within_its_bounds_and_repeats() -> None:
    x, y = np.meshgrid(np.linspace(-9, 9, 700), np.linspace(-6, 6, 500))
    z = RELIEF.heights(x, y)
    assert 0.025 < np.abs(z).max() <= 0.03
    assert abs(z.mean()) < 0.002
    np.testing.assert_allclose(RELIEF.heights(x + 5.12, y - 5.12), z, atol=1e-6)
    assert np.abs(np.diff(z, axis=1)).max() < 0.012


def test_a_ray_meets_the_ground_where_small_steps_do() -> None:
    rng = np.random.default_rng(1)
    o_m = np.column_stack((rng.uniform(-5, 5, (40, 2)), rng.uniform(0.7, 1.1, 40)))
    d = np.concatenate((rng.uniform(-1, 1, (40, 30, 2)), np.full((40, 30, 1), -0.6)), axis=2)
    met = RELIEF.met(o_m, d)
    expected = followed(np.repeat(o_m, 30, axis=0), d.reshape(-1, 3))[:, 2]
    np.testing.assert_allclose(met.ravel(), expected, atol=0.3e-3)
    assert np.ptp(met) > 0.03


def test_the_picture_shows_the_point_that_each_ray_meets(monkeypatch: pytest.MonkeyPatch) -> None:
    # grey says how far along the tile, 2.048 m long, a point lies
    along = np.abs((np.arange(textures.TILE) - textures.TILE / 2) / (textures.TILE / 2))
    monkeypatch.setitem(textures.TEXTURES, "scale", lambda: np.repeat((20 + 220 * along)[:, None], textures.TILE, 1))
    world = WorldBuilder().level(8.192, "scale").build(RELIEF)
    unit = dataclasses.replace(draw_unit(3), gain=(1.0, 1.0))
    gait = Gait(world, (Stand(60.0),), 0.95, 3, 0)
    renderer = Renderer(unit, world, gait, 3, Effects(motion_blur=False, noise=False))
    pictures = renderer.light(0, 0.006)
    u, v = np.arange(40.0, WIDTH_PX - 40, 59), np.arange(280.0, HEIGHT_PX - 20, 31)
    row, column = (grid.ravel().astype(int) for grid in np.meshgrid(v, u, indexing="ij"))
    motion = gait.at(np.rint((row - (HEIGHT_PX - 1) / 2) * unit.stereo.row_time_s * 1e9).astype(np.int64))
    for camera, picture in zip(renderer.cameras, pictures, strict=True):
        rays_E = undistorted_rays(camera.lens, u, v).reshape(-1, 3)
        rays_W = np.einsum("nij,nj->ni", motion.R_WB @ camera.R_BE, rays_E)
        eyes_W = motion.p_WB_m + motion.R_WB @ camera.p_BE_m
        x_m = followed(eyes_W, rays_W)[:, 0]
        flat_x_m = (eyes_W - rays_W * (eyes_W[:, 2] / rays_W[:, 2])[:, None])[:, 0]
        seen = picture[row, column] / (camera.shade[row, column] / 255)
        greys = [20 + 220 * np.abs(np.mod(each, 2.048) / 1.024 - 1) for each in (x_m, flat_x_m)]
        turning = np.abs(np.mod(x_m, 1.024) - 0.512) > 0.49  # the scale's own ends are smoothed
        rough, flat = (np.abs(seen - grey)[~turning] for grey in greys)
        assert np.percentile(rough, 99) < 2.0  # pictures and textures are rounded
        assert np.percentile(flat, 99) > 4.0


def test_the_truth_is_the_plane_through_the_region() -> None:
    wearer = SimulatedWearer(4, scenario("rough-ground"), 10_000_000_000)
    truths = [wearer.truth(wearer.shutter.header(k).t_exposure_ns) for k in range(0, 160, 10)]
    slopes_deg = np.degrees([truth.slope_sagittal_rad for truth in truths])
    assert 0.2 < slopes_deg.std() < 3.0
    assert all(not truth.transition for truth in truths)
    level = dataclasses.replace(wearer.scenario.world, relief=None)
    smooth = SimulatedWearer(4, dataclasses.replace(wearer.scenario, world=level), 10_000_000_000)
    flat = [smooth.truth(smooth.shutter.header(k).t_exposure_ns) for k in range(0, 160, 10)]
    rise_m = np.array([here.height_m - there.height_m for here, there in zip(truths, flat, strict=True)])
    assert 0.001 < np.abs(rise_m).max() < 0.06


def test_a_relief_lies_on_level_ground_only() -> None:
    with pytest.raises(ValueError, match="level ground"):
        WorldBuilder().ramp(4.0, 3.0, "grass").ramp(4.0, -3.0, "grass").build(RELIEF)


def test_a_relief_of_a_stated_size_has_it() -> None:
    rough = Relief.of_rms(0.05, 0.2, 3)
    x, y = np.meshgrid(np.arange(0.0, 5.12, 0.02), np.arange(0.0, 5.12, 0.02))
    assert rough.heights(x, y).std() == pytest.approx(0.05, rel=0.02)
    assert rough.rms_m == pytest.approx(0.05)
