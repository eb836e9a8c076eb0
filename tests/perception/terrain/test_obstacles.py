"""Things on the path: found where they are, told once they are sure, and none that move with the wearer."""

from dataclasses import replace

import numpy as np
import pytest

from messages.arrays import FloatArray
from perception.terrain.obstacle_memory import ObstacleMemory
from perception.terrain.obstacles import Obstacle, Scatter, find_obstacles
from perception.terrain.path_points import PathPoints
from perception.terrain.profile import profile_of
from perception.terrain.surfaces import PathSurfaces, find_surfaces
from tests.bench.path_scene import B_M, F_PX, Piece, flight, points_seen

LEVEL: list[Piece] = [(-1.0, 0.0, 8.0, 0.0)]
HALF_M = 0.25
FRAME_NS = 50_000_000


def found(pieces: list[Piece], thing: FloatArray | None = None) -> list[Obstacle]:
    """Return what is found on a path of `pieces`, before which a thing (n, 3) stands, points over the ground."""
    points = points_seen(pieces)
    if thing is not None:
        shadow = (points.y_m > thing[:, 1].min()) & (points.y_m < thing[:, 1].max()) & (points.x_m > thing[:, 0].min())
        points = points.where(~shadow)
        x, y, z = thing.T + np.array([[0.0], [0.0], [-0.95]])
        more = (x, y, z, np.full(len(x), 0.002), np.full(len(x), 1e-4), np.full(len(x), 0.01))
        points = PathPoints(*(np.concatenate(pair) for pair in zip(_arrays(points), more, strict=True)))
    surfaces = PathSurfaces(find_surfaces(profile_of(points, 0.0, 2 * HALF_M)), 0.0)
    return find_obstacles(points, surfaces, 0.003, HALF_M)[0]


def _arrays(points: PathPoints) -> tuple[FloatArray, ...]:
    return points.x_m, points.y_m, points.z_m, points.deviation_m, points.area_m2, points.along_m


def face(x_m: float, from_y_m: float, to_y_m: float, height_m: float) -> FloatArray:
    y, z = np.meshgrid(np.arange(from_y_m, to_y_m, 0.008), np.arange(0.0, height_m, 0.008))
    return np.column_stack((np.full(y.size, x_m), y.ravel(), z.ravel()))


def test_level_ground_stairs_and_ramps_hold_no_obstacle() -> None:
    assert found(LEVEL) == []
    assert found(flight(0.9, 0.17, 0.29, 4)) == []
    assert found(flight(0.7, -0.17, 0.29, 4)) == []
    assert found([(-1.0, 0.0, 0.8, 0.0), (0.8, 0.0, 8.0, 1.2)]) == []


@pytest.mark.parametrize(("height_m", "at_m", "left_m"), [(0.09, 0.9, -0.1), (0.45, 1.4, 0.12), (0.2, 1.8, 0.0)])
def test_a_thing_is_found_where_it_stands(height_m: float, at_m: float, left_m: float) -> None:
    [thing] = found(LEVEL, face(at_m, left_m - 0.05, left_m + 0.05, height_m))
    assert thing.distance_m == pytest.approx(at_m, abs=0.02)
    assert thing.left_m == pytest.approx(left_m, abs=0.02)
    assert thing.height_m == pytest.approx(height_m, abs=0.03)


def test_faint_texture_whose_matches_err_alike_in_patches_holds_no_obstacle() -> None:
    """Where the ground's own disparities scatter by 0.8 px, a thing has to stand out from that."""
    found_with = {1.0: 0, 8.0: 0}
    for seed in range(6):
        points = points_seen(LEVEL, noise_px=0.0)
        patch = np.floor(points.x_m / 0.08).astype(int) * 7 + np.floor(points.y_m / 0.08).astype(int) + 4
        off_px = np.random.default_rng(seed).normal(0.0, 0.8, patch.max() + 1)[patch]
        disparity_px = F_PX * B_M * np.sqrt(2.0) / (points.x_m - points.z_m)
        nearer = disparity_px / (disparity_px + off_px)
        points = replace(points, x_m=nearer * points.x_m, y_m=nearer * points.y_m, z_m=nearer * points.z_m)
        surfaces = PathSurfaces(find_surfaces(profile_of(points, 0.0, 2 * HALF_M)), 0.0)
        for scatter in found_with:
            found_with[scatter] += len(find_obstacles(points, surfaces, 0.003, HALF_M, scatter)[0])
    assert found_with[1.0] > 3
    assert found_with[8.0] == 0


def test_the_scatter_follows_the_grounds_own_and_no_bumps() -> None:
    scatter = Scatter()
    for _ in range(40):
        scatter.add(0.4)
    assert scatter.of_stated == pytest.approx(4.0, abs=0.01)
    for noise_px in (1.0, float("nan")):
        scatter.add(noise_px)
    assert scatter.of_stated == pytest.approx(4.0, abs=0.01)


def test_a_wall_is_an_obstacle_and_a_face_as_high_as_a_kerb_is_none() -> None:
    [wall] = found([(-1.0, 0.0, 1.5, 0.0)], face(1.5, -0.25, 0.25, 0.5))
    assert wall.distance_m == pytest.approx(1.5, abs=0.02)
    assert found([(-1.0, 0.0, 1.5, 0.0)], face(1.5, -0.25, 0.25, 0.2)) == []


def walked(places: list[Obstacle | None], speed_mps: float = 1.2) -> list[list[Obstacle]]:
    """Return what is told, frame by frame, of one thing seen at `places` in H, by a wearer who walks ahead."""
    memory, v_W = ObstacleMemory(HALF_M), np.array([speed_mps, 0.0])
    return [memory.update(k * FRAME_NS, v_W, 0.0, [] if seen is None else [seen]) for k, seen in enumerate(places)]


def test_what_stands_is_told_after_a_few_frames_and_until_it_is_behind() -> None:
    told = walked([Obstacle(1.8 - 0.06 * k, 0.1, 0.1) if k < 22 else None for k in range(40)])
    assert not any(told[:3])
    assert all(len(each) == 1 for each in told[5:33])
    assert told[30][0].distance_m == pytest.approx(0.0, abs=0.01)  # remembered
    assert told[39] == []


def test_matches_that_jump_from_frame_to_frame_are_hardly_ever_told() -> None:
    chance, told = np.random.default_rng(0), 0
    for _ in range(20):
        about = chance.uniform(-0.14, 0.14, (30, 2))
        told += sum(map(len, walked([Obstacle(2.2 - 0.06 * k + x, y, 0.3) for k, (x, y) in enumerate(about)])))
    assert told < 0.1 * 20 * 30


def test_a_runner_who_comes_towards_the_wearer_is_told() -> None:
    told = walked([Obstacle(2.6 - (1.2 + 2.5) / 20.0 * k, 0.1, 0.5) for k in range(14)])
    assert all(told[6:])


def test_what_moves_with_the_wearer_is_not_told() -> None:
    assert not any(walked([Obstacle(0.95, 0.2, 0.4)] * 40))


def test_own_feet_are_not_told() -> None:
    steps = [Obstacle(0.55 - 0.06 * (k % 10), 0.1, 0.08) for k in range(60)]
    assert not any(walked([*steps]))


def test_one_that_is_gone_is_forgotten() -> None:
    told = walked([Obstacle(1.8 - 0.06 * k, 0.1, 0.1) if k < 8 else None for k in range(14)])
    assert told[7]
    assert told[11] == []


def test_the_same_thing_seen_twice_is_told_once_and_two_that_are_apart_twice() -> None:
    memory, v_W = ObstacleMemory(HALF_M), np.array([1.2, 0.0])
    told: list[Obstacle] = []
    for k in range(10):
        x = 2.2 - 0.06 * k
        told = memory.update(
            k * FRAME_NS, v_W, 0.0, [Obstacle(x - 0.6, 0.1, 0.1), Obstacle(x, 0.1, 0.1), Obstacle(x, -0.15, 0.1)]
        )
    assert [round(each.distance_m, 1) for each in told] == [1.1, 1.7]
    assert len(memory.update(11 * FRAME_NS, v_W, 0.0, [])) == 2


def test_as_many_as_come_only_so_many_are_kept() -> None:
    memory, chance = ObstacleMemory(HALF_M), np.random.default_rng(2)
    for k in range(50):
        seen = [Obstacle(*chance.uniform((0.9, -0.25, 0.05), (2.5, 0.25, 0.5))) for _ in range(20)]
        memory.update(k * FRAME_NS, np.zeros(2), 0.0, seen)
    assert len(memory) <= 12
