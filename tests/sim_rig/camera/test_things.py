"""Blocks in the picture against geometry computed in other ways: their disparity, single rays, slower renderings."""

import dataclasses
from collections.abc import Iterable
from functools import partial
from typing import TypeVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from messages import Vec3, vec3
from messages.arrays import FloatArray, IntArray, rms
from perception.depth.rectify import undistorted_rays
from sim_rig.camera import textures
from sim_rig.camera.renderer import Effects, Renderer
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, Unit, draw_unit
from sim_rig.walk.gait import Gait, Motion
from sim_rig.walk.legs import Leg, Stand, Walk
from sim_rig.walk.own_legs import OwnLegs
from sim_rig.walk.passers_by import PassersBy
from sim_rig.walk.things import BAG, TROLLEY, Block, Placed, Thing, Walker, Worn
from sim_rig.walk.walking_aids import WhiteCane
from sim_rig.walk.world import World, WorldBuilder
from tests.sim_rig.camera.test_renderer import EXPOSURE_S, GEOMETRY_ONLY, ideal, patch_shifts_px, render

_Blocks = TypeVar("_Blocks", int, IntArray)

EVERYTHING: tuple[Thing, ...] = (*TROLLEY, *BAG, PassersBy(every_s=1.2, ahead_m=(0.8, 1.6)), WhiteCane(), OwnLegs())
WALKING: tuple[Leg, ...] = (Stand(1.0), Walk(8.0, 1.2, 1.8), Stand(1.0))
FIELD = WorldBuilder().level(8.0, "gravel").build()
T_NS = 3_730_000_000


def made(
    unit: Unit, things: tuple[Thing, ...], effects: Effects = GEOMETRY_ONLY, world: World = FIELD, contrast: float = 1.0
) -> Renderer:
    return Renderer(unit, world, Gait(world, WALKING, 0.95, 1, 0), 1, effects, things=things, contrast=contrast)


@pytest.mark.parametrize("distance_m", [0.45, pytest.param(1.2, marks=pytest.mark.long)])
def test_a_worn_board_has_the_disparity_of_its_distance(distance_m: float) -> None:
    unit = ideal(draw_unit(1, rolling_shutter=False))
    R_BL, p_BL = np.array(unit.X_BL.R), np.array(unit.X_BL.p_m)
    board = Worn(Block((0.1, 6.0, 6.0), "gravel", 0.006), vec3(p_BL + np.array((distance_m + 0.05, 0.0, 0.0))))
    left, right = render(made(unit, (board,)), T_NS)
    v, u = np.mgrid[0:HEIGHT_PX, 0:WIDTH_PX]
    rays_L = np.stack(((u - 639.5) / 700, (v - 359.5) / 700, np.ones(u.shape)), axis=-1)
    depth_m = distance_m / (rays_L @ R_BL.T)[..., 0]  # the board is square to B's x, L by its tolerance is not
    matched = map_coordinates(right.astype(float), [v, u - 700 * 0.12 / depth_m], order=3, mode="nearest")
    shifts = patch_shifts_px(left.astype(float), matched)
    assert np.abs(shifts.mean(axis=0)).max() < 0.01
    assert shifts.std(axis=0).max() < 0.05


@dataclasses.dataclass(frozen=True)
class Grey:
    """Things in plain grey, each block in one of its own."""

    things: tuple[Thing, ...]

    def placed(self, walker: Walker, t_ns: IntArray, motion: Motion) -> Iterable[Placed]:
        blocks = [placed for thing in self.things for placed in thing.placed(walker, t_ns, motion)]
        for k, placed in enumerate(blocks):
            yield dataclasses.replace(placed, block=dataclasses.replace(placed.block, texture=f"grey {grey_of(k)}"))


def grey_of(block: _Blocks) -> _Blocks:
    return 60 + 5 * block


@pytest.fixture
def grey_world(monkeypatch: pytest.MonkeyPatch) -> World:
    for grey in (30, *map(grey_of, range(38))):
        monkeypatch.setitem(textures.TEXTURES, f"grey {grey}", partial(np.full, (textures.TILE,) * 2, float(grey)))
    return WorldBuilder().level(8.0, "grey 30").build()


def first_hits(blocks: list[Placed], eye_W: FloatArray, rays_W: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the block (n,) that each ray meets first, −1 for none, and how far (n,), in rad, it passes from any
    block's edge: face by face, by solving for the crossing.
    """
    nearest, found, from_edge = np.full(len(rays_W), np.inf), np.full(len(rays_W), -1), np.full(len(rays_W), np.inf)
    for k, placed in enumerate(blocks):
        half_m = 0.5 * np.array(placed.block.size_m)
        for axis, side in ((axis, side) for axis in range(3) for side in (-1.0, 1.0)):
            across = [other for other in range(3) if other != axis]
            middle_W = placed.p_WT_m + side * half_m[axis] * placed.R_WT[:, :, axis]
            A = np.concatenate((placed.R_WT[:, :, across], -rays_W[:, :, None]), axis=2)
            crossing = np.linalg.solve(A, (eye_W - middle_W)[:, :, None])[:, :, 0]
            inside_m, distance = (half_m[across] - np.abs(crossing[:, :2])), crossing[:, 2]
            ahead = distance > 0.005
            from_edge = np.where(ahead, np.minimum(from_edge, np.abs(inside_m).min(axis=1) / distance), from_edge)
            hit = ahead & (inside_m > 0).all(axis=1) & (distance < nearest)
            nearest[hit], found[hit] = distance[hit], k
    return found, from_edge


@pytest.mark.parametrize("eye", ["left", "right"])
def test_every_pixel_shows_the_block_its_ray_meets_first_at_its_rows_instant(eye: str, grey_world: World) -> None:
    unit = dataclasses.replace(draw_unit(3), gain=(1.0, 1.0))
    things = (Grey(EVERYTHING),)
    renderer = made(unit, things, world=grey_world)
    picture = render(renderer, T_NS)[eye == "right"]
    camera = renderer.cameras[eye == "right"]

    u, v = np.arange(30.0, WIDTH_PX - 20, 31), np.arange(12.0, HEIGHT_PX - 10, 23)
    rays_E = undistorted_rays(camera.lens, u, v).reshape(-1, 3)
    row, column = (grid.ravel().astype(int) for grid in np.meshgrid(v, u, indexing="ij"))
    row_ns = T_NS + np.rint((row - (HEIGHT_PX - 1) / 2) * unit.stereo.row_time_s * 1e9).astype(np.int64)
    gait = Gait(grey_world, WALKING, 0.95, 1, 0)
    motion = gait.at(row_ns)
    blocks = list(things[0].placed(Walker(gait, grey_world, 1), row_ns, motion))
    rays_W = np.einsum("nij,nj->ni", motion.R_WB @ camera.R_BE, rays_E)
    block, from_edge = first_hits(blocks, motion.p_WB_m + motion.R_WB @ camera.p_BE_m, rays_W)
    inner = from_edge > 3e-3  # not within 2 px of an edge, seen or not
    expected = np.where(block < 0, 30, grey_of(block))
    seen = picture[row, column] / (camera.shade[row, column] / 255)
    np.testing.assert_allclose(seen[inner], expected[inner], atol=2.5)
    assert len(np.unique(block[inner])) >= 6


@pytest.mark.long
def test_a_crossing_block_is_smeared_by_its_own_motion_and_a_worn_one_not_at_all(grey_world: World) -> None:
    unit = draw_unit(5, rolling_shutter=False)
    things = (Grey((PassersBy(every_s=1.2, ahead_m=(0.8, 1.6)),)),)
    sharp = made(unit, things, world=grey_world)
    blurred = render(made(unit, things, Effects(noise=False), grey_world), T_NS)[0].astype(float)
    parts = 6
    moments = [round(EXPOSURE_S * 1e9 * ((k + 0.5) / parts - 0.5)) for k in range(parts)]
    mean = np.mean([render(sharp, T_NS + moment)[0] for moment in moments], axis=0)
    unblurred = render(sharp, T_NS)[0].astype(float)
    edges = np.abs(unblurred - mean) > 5.0
    assert np.count_nonzero(edges) > 300
    assert rms((blurred - mean)[edges]) < 0.4 * rms((unblurred - mean)[edges])
    worn = made(unit, TROLLEY, Effects(noise=False))
    basket = np.s_[20:160, 500:800]
    np.testing.assert_allclose(render(worn, T_NS)[0][basket], render(made(unit, TROLLEY), T_NS)[0][basket], atol=1)


def test_a_block_out_of_sight_changes_nothing() -> None:
    unit = draw_unit(6)
    behind = Worn(Block((0.2, 0.2, 0.2), "print"), (-0.5, 0.0, 0.0))
    plain, with_block = (render(made(unit, things, Effects()), T_NS, 3) for things in ((), (behind,)))
    np.testing.assert_array_equal(plain, with_block)


@pytest.mark.long
def test_two_renderers_give_the_same_bytes() -> None:
    unit = draw_unit(7)
    first, second = (made(unit, EVERYTHING, Effects(), contrast=0.5) for _ in range(2))
    render(first, T_NS + 1_000_000_000, 2)  # leaves nothing behind
    np.testing.assert_array_equal(render(first, T_NS, 1), render(second, T_NS, 1))


@pytest.mark.long
def test_dim_light_takes_the_texture_and_leaves_the_noise() -> None:
    unit = draw_unit(8)
    bright, dim = (made(unit, (), Effects(noise=False), contrast=contrast) for contrast in (1.0, 0.1))
    full, tenth = (renderer.light(T_NS, EXPOSURE_S)[0] for renderer in (bright, dim))
    inner = np.s_[200:500, 400:900]
    assert np.diff(tenth[inner]).std() == pytest.approx(0.1 * np.diff(full[inner]).std(), rel=0.03)
    noisy = render(made(unit, (), Effects(), contrast=0.1), T_NS)[0]
    noise = noisy[inner] - tenth[inner]
    assert noise.std() == pytest.approx(np.sqrt(0.9**2 + 0.15**2 * tenth[inner].mean() + 1 / 12), rel=0.03)


@given(
    size_m=st.tuples(*[st.floats(0.05, 2.0)] * 3),
    turn=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    eye=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    point=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)
def test_a_block_hides_what_a_line_through_it_leads_to(size_m: Vec3, turn: Vec3, eye: Vec3, point: Vec3) -> None:
    R_WT = Rotation.from_rotvec(turn).as_matrix()
    placed = Placed(Block(size_m, "print"), R_WT[None], np.zeros((1, 3)))
    along_T = np.linspace(eye, point, 801) @ R_WT
    margin_m = (0.5 * np.array(size_m) - np.abs(along_T)).min(axis=1).max()
    hidden = bool(placed.hides(np.array([eye]), np.array([point]))[0])
    if abs(margin_m) > 0.01:  # the line is cut into pieces of up to 1 cm
        assert hidden == (margin_m > 0)
