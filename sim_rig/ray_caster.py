"""A second renderer, for judging: each pixel's own ray is cut with flat ground that is covered with photographs.

It shares the wearer's motion, the unit's lenses and the ground with `sim_rig.camera.renderer`, and nothing of how a
picture is made: no grid, no drawn textures, no rolling shutter. Lenses darken as cos³, pictures go through JPEG.
"""

import hashlib
from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from drivers.camera.frame_pool import FramePair
from messages import GroundTruth, Lens, StereoFrame
from messages.arrays import BoolArray, FloatArray, FloatImage, GreyImage
from perception.depth.rectify import undistorted_rays
from sim_rig.unit import HEIGHT_PX, WIDTH_PX
from sim_rig.walk.world import Segment, World
from sim_rig.wearer import SimulatedWearer

_REACH_M = (-0.8, 7.0)
_FARTHEST = 12.0  # of a ray, in its depth
_TEXELS, _PHOTOGRAPH_M = 1024, 1.7
_LEVELS = 4
_FOCAL_PX = 700.0
_GRAIN = 3.0  # grey levels: what a real floor has beside a photograph of something larger
_MEAN, _CONTRAST, _DARKEST, _LIGHTEST = 110.0, 0.8, 5.0, 235.0
_RISER_LIGHT = 0.72
_NOWHERE = 60
_LENS_BLUR_PX = 0.6
_READ_VARIANCE, _SHOT_VARIANCE = 0.8, 0.02
_JPEG_QUALITY = 92


def is_flat(world: World) -> bool:
    """Return whether a world's ground is made of flat pieces alone, and mirrors nothing."""
    return world.relief is None and world.polish is None


class RayCaster:
    """The stereo camera of a `wearer` whose unit has a global shutter; things and shadows are left out.

    `photographs` are grey pictures of any size; `seed` draws which of them covers what. Raises ValueError for ground
    that is not flat, as `is_flat` tells.
    """

    def __init__(self, wearer: SimulatedWearer, photographs: Sequence[GreyImage], seed: int) -> None:
        world = wearer.scenario.world
        if not is_flat(world):
            raise ValueError(f"'{wearer.scenario.name}' has more than flat ground")
        self.shutter = wearer.shutter
        self._wearer, self._world, self._gait = wearer, world, wearer.gait
        self._photographs, self._seed = photographs, seed
        self._surfaces: dict[str, list[GreyImage]] = {}
        stereo = wearer.unit.stereo
        R_BL, p_BL = np.array(wearer.unit.X_BL.R), np.array(wearer.unit.X_BL.p_m)
        R_RL, p_RL = np.array(stereo.X_RL.R), np.array(stereo.X_RL.p_m)
        R_BR = R_BL @ R_RL.T
        self._eyes = (_Eye(stereo.left, R_BL, p_BL), _Eye(stereo.right, R_BR, p_BL - R_BR @ p_RL))

    def frames(self, count: int, first: int = 0) -> Iterator[tuple[StereoFrame, GroundTruth]]:
        """Yield frames `first`, `first` + 1 … with their truth."""
        for k in range(first, first + count):
            motion = self._gait.at(np.array([self.shutter.true_ns(k)]))
            chance = np.random.default_rng([self._seed, 44, k])
            left, right = (
                self._sensed(eye, self._seen(eye, motion.R_WB[0], motion.p_WB_m[0]), chance) for eye in self._eyes
            )
            frame = FramePair(left, right).frame(self.shutter.header(k))
            yield frame, self._wearer.truth(frame.header.t_exposure_ns)

    def _seen(self, eye: "_Eye", R_WB: FloatArray, p_WB_m: FloatArray) -> GreyImage:
        """Return the light (720, 1280) that each pixel's ray meets first."""
        o_W = p_WB_m + R_WB @ eye.p_BE_m
        d_W: FloatImage = eye.rays_E @ (R_WB @ eye.R_BE).T.astype(np.float32)
        nearest = np.full((HEIGHT_PX, WIDTH_PX), _FARTHEST, np.float32)
        picture = np.full((HEIGHT_PX, WIDTH_PX), _NOWHERE, np.uint8)
        for piece in self._world.between(o_W[0] + _REACH_M[0], o_W[0] + _REACH_M[1]):
            depth, along_m, met = _met(piece, o_W, d_W, nearest)
            if not met.any():
                continue
            np.copyto(nearest, depth, where=met)
            rows = np.flatnonzero(met.any(axis=1))
            band = slice(rows[0], rows[-1] + 1)
            left_m = np.float32(o_W[1]) + depth[band] * d_W[band, :, 1]
            self._cover(piece, depth[band], along_m[band], left_m, met[band], picture[band])
        return picture

    def _cover(
        self,
        piece: Segment,
        depth: FloatImage,
        along_m: FloatImage,
        left_m: FloatImage,
        met: BoolArray,
        picture: GreyImage,
    ) -> None:
        """Draw a piece's photograph where it is `met`, at that reduction whose texels are about a pixel large."""
        surface = self._surface(piece.texture)
        light = np.float32(_RISER_LIGHT if piece.is_riser else 1.0)
        begun_m = piece.texture_phase * _PHOTOGRAPH_M / 7.0 + piece.x0_m
        texel_m = _PHOTOGRAPH_M / _TEXELS
        with np.errstate(divide="ignore", invalid="ignore"):
            levels = np.clip(np.rint(np.log2(depth / (_FOCAL_PX * texel_m))), 0, _LEVELS - 1)
        for level in range(_LEVELS):
            here = met & (levels == level)
            if here.any():
                texels = np.stack((left_m[here], along_m[here] + np.float32(begun_m))) / np.float32(texel_m * 2**level)
                picture[here] = (_sampled(surface[level], texels) * light).astype(np.uint8)

    def _surface(self, texture: str) -> list[GreyImage]:
        """Return a photograph beside its mirror images, so that it goes on for ever, and its reductions."""
        if texture not in self._surfaces:
            drawn = int.from_bytes(hashlib.sha256(f"{texture}{self._seed}".encode()).digest()[:4], "big")
            photograph = self._photographs[drawn % len(self._photographs)]
            side = min(photograph.shape)
            top, left = ((size - side) // 2 for size in photograph.shape)
            square = cv2.resize(photograph[top : top + side, left : left + side], (_TEXELS, _TEXELS)).astype(np.float64)
            grain = np.random.default_rng(drawn).normal(0.0, _GRAIN, square.shape)
            even = np.clip((square - square.mean()) * _CONTRAST + _MEAN + grain, _DARKEST, _LIGHTEST).astype(np.uint8)
            levels: list[GreyImage] = [np.block([[even, even[:, ::-1]], [even[::-1], even[::-1, ::-1]]])]
            for _ in range(_LEVELS - 1):
                levels.append(cv2.resize(levels[-1], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))  # type: ignore[arg-type]
            self._surfaces[texture] = levels
        return self._surfaces[texture]

    def _sensed(self, eye: "_Eye", light: GreyImage, chance: np.random.Generator) -> GreyImage:
        """Return what the sensor makes of the light, after JPEG."""
        grey = cv2.GaussianBlur(light, (0, 0), _LENS_BLUR_PX).astype(np.float32) * eye.shade
        noise = chance.standard_normal(grey.shape, dtype=np.float32)
        grey += np.sqrt(_READ_VARIANCE + _SHOT_VARIANCE * grey) * noise
        _, packed = cv2.imencode(
            ".jpg", np.clip(grey, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        )
        return cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)  # type: ignore[return-value]


class _Eye:
    """One camera: its pose in B, the ray of each pixel (720, 1280, 3) with z = 1, and how it darkens."""

    def __init__(self, lens: Lens, R_BE: FloatArray, p_BE_m: FloatArray) -> None:
        self.R_BE, self.p_BE_m = R_BE, p_BE_m
        columns, rows = np.arange(WIDTH_PX, dtype=np.float64), np.arange(HEIGHT_PX, dtype=np.float64)
        self.rays_E: FloatImage = undistorted_rays(lens, columns, rows).astype(np.float32)
        self.shade: FloatImage = np.linalg.norm(self.rays_E, axis=2) ** np.float32(-3.0)


def _met(
    piece: Segment, o_W: FloatArray, d_W: FloatImage, nearest: FloatImage
) -> tuple[FloatImage, FloatImage, BoolArray]:
    """Return where rays o + λd meet a piece: λ, how far along the piece, and whether they do, before `nearest`."""
    tangent = np.array([piece.x1_m - piece.x0_m, piece.z1_m - piece.z0_m]) / piece.length_m
    normal = np.array([-tangent[1], tangent[0]])
    from_piece = o_W[[0, 2]] - (piece.x0_m, piece.z0_m)
    above_m = float(normal @ from_piece)
    falling = -(np.float32(normal[0]) * d_W[..., 0] + np.float32(normal[1]) * d_W[..., 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.float32(above_m) / falling
        going = np.float32(tangent[0]) * d_W[..., 0] + np.float32(tangent[1]) * d_W[..., 2]
        along_m = np.float32(tangent @ from_piece) + depth * going
        met = (falling > 0.0) & (depth < nearest) & (along_m >= 0.0) & (along_m <= np.float32(piece.length_m))
    return depth, along_m, met if above_m > 0.0 else np.zeros_like(met)


def _sampled(surface: GreyImage, texels: FloatImage) -> GreyImage:
    """Return a surface that repeats, at `texels` (2, n): column and row, between texels in proportion."""
    rows, columns = surface.shape
    (u, v), whole = texels, np.floor(texels).astype(np.int64)
    fu, fv = u - whole[0], v - whole[1]
    (left, top), (right, bottom) = whole % ((columns,), (rows,)), (whole + 1) % ((columns,), (rows,))
    upper = surface[top, left] * (1 - fu) + surface[top, right] * fu
    lower = surface[bottom, left] * (1 - fu) + surface[bottom, right] * fu
    sampled: GreyImage = np.rint(upper * (1 - fv) + lower * fv).astype(np.uint8)
    return sampled
