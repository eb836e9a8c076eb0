"""The elevation grid on points whose ground is known."""

import numpy as np
import pytest

from lab.baselines.elevation_grid import ElevationGrid
from lab.baselines.path_seen import PathSeen
from messages.arrays import FloatArray

PERIOD_S = 0.05


def seen(frame: int, points_W: FloatArray, p_W_m: FloatArray, speed_mps: float = 0.0, turn: float = 0.0) -> PathSeen:
    """Return a frame from a camera that stands at `p_W_m`, and looks `turn` to the left of W's x."""
    c, s = np.cos(turn), np.sin(turn)
    R_WH = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    points_H = (points_W - p_W_m) @ R_WH
    deviation_m = np.full(len(points_H), 0.004)
    return PathSeen(round(1e9 * PERIOD_S * frame), points_H, deviation_m, R_WH, np.array([speed_mps, 0.0, 0.0]))


def kerb(noise_m: float, seed: int) -> FloatArray:
    """Return a path of points (n, 3) in W: level, and 0.12 m higher from x = 1.2 m on."""
    x, y = np.meshgrid(np.arange(0.305, 2.5, 0.01), np.arange(-0.145, 0.15, 0.01))
    z = -0.9 + 0.12 * (x > 1.2) + np.random.default_rng(seed).normal(0.0, noise_m, x.shape)
    return np.column_stack((x.ravel(), y.ravel(), z.ravel()))


def test_frames_together_know_more_than_one() -> None:
    grid = ElevationGrid()
    grid.add(seen(0, kerb(0.004, 0), np.zeros(3)))
    once = grid.profile(np.eye(3))
    for frame in range(1, 10):
        grid.add(seen(frame, kerb(0.004, frame), np.zeros(3)))
    fused = grid.profile(np.eye(3))
    assert np.all(fused.deviation_m < 0.5 * once.deviation_m)
    level = fused.along_m < 1.2
    assert fused.z_m[level] == pytest.approx(np.full(level.sum(), -0.9), abs=0.002)
    assert fused.z_m[~level] == pytest.approx(np.full((~level).sum(), -0.78), abs=0.002)


def test_what_was_seen_stays_where_it_is_while_the_camera_walks_and_turns() -> None:
    grid, points_W = ElevationGrid(), kerb(0.0, 0)
    grid.add(seen(0, points_W, np.zeros(3), 1.0))
    nothing = np.empty((0, 3))
    for frame in range(1, 11):
        grid.add(seen(frame, nothing, np.zeros(3), 1.0))
    assert grid.p_W_m == pytest.approx([0.5, 0.0, 0.0])
    ahead = grid.profile(np.eye(3))
    edge = ahead.along_m[np.argmax(np.diff(ahead.z_m))]
    assert edge == pytest.approx(0.7, abs=0.02)
    aside = grid.profile(seen(10, nothing, np.zeros(3), turn=np.pi / 2).R_WH)
    assert len(aside.along_m) == 0


def test_what_contradicts_a_cell_takes_its_place() -> None:
    grid, level = ElevationGrid(), kerb(0.0, 0)
    for frame in range(5):
        grid.add(seen(frame, level, np.zeros(3)))
    grid.add(seen(5, level + np.array([0.0, 0.0, 0.3]), np.zeros(3)))
    assert grid.profile(np.eye(3)).z_m[0] == pytest.approx(-0.6)


def test_a_cell_that_was_left_far_behind_is_another_one() -> None:
    grid = ElevationGrid()
    grid.add(seen(0, kerb(0.0, 0), np.zeros(3), 102.4))
    grid.add(seen(1, np.empty((0, 3)), np.zeros(3), 102.4))  # once round: 256 cells of 2 cm
    assert grid.p_W_m[0] == pytest.approx(5.12)
    assert len(grid.profile(np.eye(3)).along_m) == 0


def test_nothing_seen_is_nothing_known() -> None:
    grid = ElevationGrid()
    grid.add(seen(0, np.full((5, 3), np.nan), np.zeros(3)))
    assert len(grid.profile(np.eye(3)).along_m) == 0
