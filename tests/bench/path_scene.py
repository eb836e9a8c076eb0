"""A path of straight pieces as a camera above it sees it: exact rays, and noise in the disparities alone."""

from collections.abc import Sequence

import numpy as np

from messages.arrays import FloatArray
from perception.terrain.path_points import PathPoints

F_PX, B_M = 340.0, 0.12
_ROWS, _COLUMNS = np.arange(0.0, 360.0, 2.0), np.arange(200.0, 440.0, 6.0)
_LEAST_DISPARITY_PX = 12.0

Piece = tuple[float, float, float, float]
"""From (u0, z0) to (u1, z1) along the path, z over the ground at u = 0; a riser has u0 = u1."""


def flight(start_m: float, rise_m: float, tread_m: float, count: int) -> list[Piece]:
    """Return level ground up to `start_m`, `count` steps and the landing behind them."""
    pieces, u, z = [(-1.0, 0.0, start_m, 0.0)], start_m, 0.0
    for step in range(count):
        pieces.append((u, z, u, z + rise_m))
        z += rise_m
        length_m = tread_m if step < count - 1 else 6.0
        pieces.append((u, z, u + length_m, z))
        u += length_m
    return pieces


def points_seen(
    pieces: Sequence[Piece], *, height_m: float = 0.95, yaw_rad: float = 0.0, noise_px: float = 0.05, seed: int = 1
) -> PathPoints:
    """Return what a camera `height_m` over the ground, pitched down by 45°, sees of a path whose edges have
    `yaw_rad`."""
    v, u = np.meshgrid((_ROWS - 180.0) / F_PX, (_COLUMNS - 320.0) / F_PX, indexing="ij")
    half = np.sqrt(0.5)
    rays_H = np.stack((half * (1.0 - v), -u, -half * (1.0 + v)), axis=-1).reshape(-1, 3)
    depth_m = _depths(rays_H, pieces, height_m, yaw_rad)
    shown = np.isfinite(depth_m)
    disparity_px = F_PX * B_M / depth_m[shown] + np.random.default_rng(seed).normal(0.0, noise_px, shown.sum())
    depth_m = F_PX * B_M / np.maximum(disparity_px, _LEAST_DISPARITY_PX)
    x_m, y_m, z_m = (rays_H[shown] * depth_m[:, None]).T
    along_m = 2.0 * depth_m**2 / (F_PX * np.abs(z_m))
    points = PathPoints(
        x_m, y_m, z_m, 0.1 * depth_m * np.abs(z_m) / (F_PX * B_M), along_m * 6.0 * depth_m / F_PX, along_m
    )
    return points.where(np.abs(y_m) < 0.25)


def _depths(rays_H: FloatArray, pieces: Sequence[Piece], height_m: float, yaw_rad: float) -> FloatArray:
    """Return how far along each ray (n, 3) the first piece is met, inf where none is."""
    along = rays_H[:, 0] + rays_H[:, 1] * np.tan(yaw_rad)
    depth_m = np.full(len(rays_H), np.inf)
    for u0, z0, u1, z1 in pieces:
        # s (along, r_z) = (u0, z0 − h) + t (u1 − u0, z1 − z0)
        du, dz = u1 - u0, z1 - z0
        det = -along * dz + rays_H[:, 2] * du
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (-u0 * dz + (z0 - height_m) * du) / det
            t = (along * (z0 - height_m) - rays_H[:, 2] * u0) / det
        met = (s > 0.05) & (t >= 0.0) & (t <= 1.0)
        depth_m[met] = np.minimum(depth_m[met], s[met])
    return depth_m
