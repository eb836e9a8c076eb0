"""What the rig says of the foothold region against pictures in which everything has a grey of its own."""

import numpy as np
import pytest

from messages import Vec3
from sim_rig.camera import textures
from sim_rig.camera.rendered_frames import Scene
from sim_rig.camera.usable_region import RegionSeen, UsableRegion
from sim_rig.unit import draw_unit
from sim_rig.walk.legs import Stand
from sim_rig.walk.scenario import Scenario, scenario
from sim_rig.walk.things import Block, Thing, carried
from sim_rig.walk.world import WorldBuilder
from sim_rig.wearer import SimulatedWearer

EXPOSURE_S = 0.006
REGION = (0.7, 0.3, 0.3)


def seen(texture: str, things: tuple[Thing, ...] = (), contrast: float = 1.0) -> RegionSeen:
    world = WorldBuilder().level(8.0, texture).build()
    walk = Scenario("one", "", world, (Stand(60.0),), things=things, contrast=contrast)
    return UsableRegion(Scene(draw_unit(2), walk, 2, 0)).seen(0, EXPOSURE_S, *REGION)


def board(ahead_m: float, left_m: float, up_m: float, size_m: Vec3) -> tuple[Thing, ...]:
    return (carried(Block(size_m, "print", 0.002), ahead_m, left_m, up_m),)


def test_bare_textured_ground_is_all_usable() -> None:
    assert seen("gravel") == RegionSeen(usable=1.0, hidden=0.0, saturated=0.0, plain=0.0)


@pytest.mark.parametrize(
    ("things", "hidden"),
    [
        (board(0.4, 0.0, -0.4, (0.6, 1.5, 0.02)), 1.0),  # half-way up over all of it
        (board(2.0, 0.0, -0.5, (0.1, 2.0, 0.8)), 0.0),  # behind it
        (board(-1.0, 0.0, -0.5, (0.5, 2.0, 0.8)), 0.0),  # behind the wearer
    ],
)
def test_what_stands_before_the_region_hides_it_and_nothing_else_does(things: tuple[Thing, ...], hidden: float) -> None:
    assert seen("gravel", things).hidden == hidden


def test_a_mat_on_the_ground_hides_the_share_that_it_covers() -> None:
    # 1 cm above the ground, over the near half of the region, wide enough for both eyes
    found = seen("gravel", board(0.5, 0.06, -0.935, (0.4, 2.0, 0.01)))
    assert found.hidden == pytest.approx(0.5, abs=0.08)
    assert found.usable == pytest.approx(1.0 - found.hidden)


@pytest.mark.long
def test_one_eye_is_enough_to_hide() -> None:
    # a post close to the left eye, which the right one looks past
    found = seen("gravel", board(0.15, 0.06, -0.25, (0.02, 0.03, 0.3)))
    assert 0.05 < found.hidden < 0.6


@pytest.mark.long
def test_white_ground_is_saturated_and_grey_ground_plain(monkeypatch: pytest.MonkeyPatch) -> None:
    tile = (textures.TILE, textures.TILE)
    monkeypatch.setitem(textures.TEXTURES, "white", lambda: np.full(tile, 255.0))
    monkeypatch.setitem(textures.TEXTURES, "grey", lambda: np.full(tile, 120.0))
    assert seen("grey") == RegionSeen(usable=0.0, hidden=0.0, saturated=0.0, plain=1.0)
    white = seen("white")
    assert white.usable == 0.0
    assert white.saturated > 0.2  # the corners are darker than the middle


@pytest.mark.long
def test_texture_counts_by_what_the_noise_leaves_of_it() -> None:
    shares = [seen("gravel", contrast=contrast).usable for contrast in (1.0, 0.05, 0.01)]
    assert shares[0] == 1.0
    assert shares[0] >= shares[1] > shares[2] == 0.0


@pytest.mark.long
def test_the_wearer_tells_it_of_each_frame_by_its_stamp() -> None:
    wearer = SimulatedWearer(5, scenario("bag"), 10_000_000_000)
    shares = [wearer.region_seen(wearer.shutter.header(k).t_exposure_ns) for k in (10, 60)]
    again = [wearer.region_seen(wearer.shutter.header(k).t_exposure_ns) for k in (10, 60)]
    assert shares == again
    assert all(0.01 < share.hidden < 0.3 and sum(share) == pytest.approx(1.0) for share in shares)
