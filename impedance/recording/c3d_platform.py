"""A C3D file's own force platforms: group FORCE_PLATFORM, types 2, 3 and 4 of the C3D standard (c3d.org).

A platform's axes follow from its corners c1 to c4, in the laboratory: x towards the side c1 c4, y towards c1 c2, z
into the ground. Its ORIGIN o leads from the point that its moments are about to the middle of its surface:

    types 2, 4   (f, m) = (fx, fy, fz, mx, my, mz), of type 4 times CAL_MATRIX;   m' = m − o × f                    (1)
    type 3       fx = fx12 + fx34,  fy = fy14 + fy23,  fz = fz1 + fz2 + fz3 + fz4                                 (2)
                 mx = b (fz1 + fz2 − fz3 − fz4) + fy z,   my = a (−fz1 + fz2 + fz3 − fz4) − fx z
                 mz = b (fx34 − fx12) + a (fy14 − fy23)

of type 3 with o = (a, b, z): half the sensors' distances, and the surface's place, at z ≤ 0. Files with the sign of z
reversed are common: a surface lies above its sensors.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from messages.arrays import FloatArray
from messages.errors import UserError

GROUP = "FORCE_PLATFORM"
_CHANNELS = {2: 6, 3: 8, 4: 6}
_LEAST_SIDE_M = 0.05


@dataclass(frozen=True)
class ForcePlatform:
    """One platform: type, places of its channels, the middle of its surface `centre_m` (3,) in the laboratory.

    `axes` (3, 3) holds x, y, z in the laboratory, one in each row; `origin_m` (3,) is o and `matrix` (6, 6) that of
    type 4, whose moments are in the unit of force times that of length.
    """

    kind: int
    channels: tuple[int, ...]
    centre_m: FloatArray
    axes: FloatArray
    origin_m: FloatArray
    matrix: FloatArray | None

    def wrench(self, channels: FloatArray, length_m: float) -> FloatArray:
        """Return the wrench (n, 6) about the middle of the surface, N and N·m along the platform's axes.

        `channels` (n, 6 or 8) are in N and N·m, or for type 4 as the matrix wants them; `length_m` is the file's unit.
        """
        if self.kind == 3:
            fx12, fx34, fy14, fy23, fz1, fz2, fz3, fz4 = channels.T
            a, b, z = self.origin_m
            fx, fy, fz = fx12 + fx34, fy14 + fy23, fz1 + fz2 + fz3 + fz4
            mx = b * (fz1 + fz2 - fz3 - fz4) + fy * z
            my = a * (-fz1 + fz2 + fz3 - fz4) - fx * z
            mz = b * (fx34 - fx12) + a * (fy14 - fy23)
            return np.stack((fx, fy, fz, mx, my, mz), axis=1)
        if self.matrix is not None:
            channels = channels @ self.matrix.T * np.repeat((1.0, length_m), 3)
        force, moment = channels[:, :3], channels[:, 3:]
        return np.hstack((force, moment - np.cross(self.origin_m, force)))


def platform_of(path: Path, group: Mapping[str, FloatArray], number: int, length_m: float) -> ForcePlatform:
    """Return platform `number`, from 1, of a file's group; raises UserError naming the field that does not hold it."""
    if "TYPE" not in group:
        raise UserError(f"{path}: has no {GROUP}:TYPE")
    kinds = group["TYPE"].reshape(-1)
    if not 1 <= number <= len(kinds):
        raise UserError(f"{path}: {GROUP} holds {len(kinds)} platforms, c3d.force_platform is {number}")
    kind = int(kinds[number - 1])
    if kind not in _CHANNELS:
        raise UserError(f"{path}: {GROUP}:TYPE of platform {number} is {kind}, allowed 2, 3 or 4")

    def field(name: str, *shape: int) -> FloatArray:
        value = group.get(name)
        if value is None:
            raise UserError(f"{path}: has no {GROUP}:{name}")
        value = value.reshape(*value.shape, 1) if value.ndim == len(shape) else value
        fits = value.ndim == len(shape) + 1 and all(n >= m for n, m in zip(value.shape, shape, strict=False))
        if not fits or value.shape[-1] < number:
            raise UserError(f"{path}: {GROUP}:{name} has the shape {value.shape}, needed {shape} for each platform")
        one = value[..., number - 1][tuple(slice(m) for m in shape)]
        if not np.isfinite(one).all():
            raise UserError(f"{path}: {GROUP}:{name} of platform {number} is not finite")
        return one

    corners_m = length_m * field("CORNERS", 3, 4).T
    origin_m = length_m * field("ORIGIN", 3)
    channels = field("CHANNEL", _CHANNELS[kind]).astype(int) - 1
    if kind == 3:
        origin_m = np.array([abs(origin_m[0]), abs(origin_m[1]), -abs(origin_m[2])])
    elif origin_m[2] > 0.0:
        origin_m = -origin_m
    return ForcePlatform(
        kind=kind,
        channels=tuple(channels.tolist()),
        centre_m=corners_m.mean(axis=0),
        axes=_axes(path, number, corners_m),
        origin_m=origin_m,
        matrix=field("CAL_MATRIX", 6, 6) if kind == 4 else None,
    )


def _axes(path: Path, number: int, corners_m: FloatArray) -> FloatArray:
    x = corners_m[0] + corners_m[3] - corners_m[1] - corners_m[2]
    y = corners_m[0] + corners_m[1] - corners_m[2] - corners_m[3]
    if min(np.linalg.norm(x), np.linalg.norm(y)) < 2.0 * _LEAST_SIDE_M:
        raise UserError(f"{path}: {GROUP}:CORNERS of platform {number} span no plate of {_LEAST_SIDE_M:g} m or more")
    z = np.cross(x, y)
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.stack((x, np.cross(z, x), z))
