"""Blocks drawn over the ground, for one camera and frame. Which block a pixel shows is decided by its depth.

With the eye at o and a node's ray d (z = 1 in the camera, so that λ is depth), both in the block's frame T at the
node's own row, the face that looks along ±T's axis k at half the size h_k is met where

    1/λ = ∓d_k / (±o_k − h_k),   s/λ = ((o_a + h_a) / λ + d_a) / 2h_a,   c/λ = ((o_b + h_b) / λ + d_b) / 2h_b

with s and c from 0 to 1 over the face along the two other axes a and b. For a still pinhole all three are linear
in the pixel, so they are interpolated between nodes and then divided, as for the ground.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from messages import Lens
from messages.arrays import FloatArray, FloatImage, GreyImage
from perception.depth.rectify import intrinsics
from sim_rig.camera.blur import LENS_BLUR_PX, line_kernel
from sim_rig.camera.grid import AROUND, CELL, COLUMNS, PICTURE, ROWS, Cells, of_pixels
from sim_rig.camera.textures import MAX_LEVEL, face
from sim_rig.walk.things import Block, Placed

_NEAREST_M = 0.005
_MARGIN_PX = 3 * CELL  # around a block's projected edges: lens distortion bends them between the points projected
_LATTICE = np.stack(np.meshgrid(*[(-0.5, 0.0, 0.5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


@dataclass(frozen=True)
class Eye:
    """A raw camera E in W at the rows of nodes, and last at begin and end of the exposure: R_WE (n, 3, 3), o_W (n, 3).

    `rays_E` (rows, columns, 3) are those of the nodes, z = 1.
    """

    lens: Lens
    rays_E: FloatArray
    R_WE: FloatArray
    o_W: FloatArray

    def project(self, points_E: FloatArray) -> FloatArray:
        """Return the pixels (n, 2) of points (n, 3) in E."""
        none = np.zeros(3)
        pixels, _ = cv2.projectPoints(points_E, none, none, intrinsics(self.lens), np.array(self.lens.distortion))
        return pixels.reshape(-1, 2).astype(np.float64)


class ThingsLayer:
    """What one eye sees of `blocks` at one frame: of each pixel the nearest block's number, grey and inverse depth.

    The blocks' instants are those of the eye's poses.
    """

    def __init__(self, eye: Eye, blocks: Sequence[Placed]) -> None:
        self._eye = eye
        around = [(placed, cells) for placed in blocks if (cells := _cells_around(eye, placed)) is not None]
        self._all = Cells.over([cells for _, cells in around]).grown() if around else Cells(0, 0, 0, 0)
        self._owner = np.zeros(self._all.shape_px, np.uint8)  # 1 for the first block; 0 is the ground
        self._grey = np.zeros(self._all.shape_px, np.uint8)
        self._inverse: FloatImage = np.zeros(self._all.shape_px, np.float32)
        self._drawn: list[tuple[int, Placed, Cells]] = []
        for number, (placed, cells) in enumerate(around, start=1):
            painted = self._draw(number, placed, cells)
            if painted:
                self._drawn.append((number, placed, Cells.over(painted)))

    def draw_over(self, ground: GreyImage, *, blur: bool) -> None:
        """Draw the blocks over `ground` (720, 1280), a picture through the lens.

        Each block's visible part goes through the lens and, with `blur`, is smeared along its own image motion.
        """
        if not self._drawn:
            return
        extent = Cells.over([cells for _, _, cells in self._drawn]).grown()
        share, light = np.zeros((2, *extent.shape_px), np.float32)
        for number, placed, cells in self._drawn:
            mine = (self._owner[cells.pixels(self._all)] == number).view(np.uint8)
            moments = cv2.moments(mine, binaryImage=True)
            if moments["m00"] == 0.0:
                continue
            middle = moments["m01"] / moments["m00"], moments["m10"] / moments["m00"]
            inverse = float(cv2.mean(self._inverse[cells.pixels(self._all)], mine)[0])
            kernel = line_kernel(self._image_motion(placed, cells, middle, 1.0 / inverse)) if blur else None
            around = cells.grown()
            window = around.pixels(self._all)
            covered = (self._owner[window] == number).astype(np.float32)
            of_light = cv2.multiply(covered, self._grey[window], dtype=cv2.CV_32F)
            for sharp, total in ((covered, share), (of_light, light)):
                through_lens = cv2.GaussianBlur(sharp, (3, 3), LENS_BLUR_PX)
                part = total[around.pixels(extent)]
                part += through_lens if kernel is None else cv2.filter2D(through_lens, -1, kernel)
        behind = ground[extent.pixels(PICTURE)]
        light += np.maximum(1.0 - share, 0.0) * behind
        cv2.divide(light, np.maximum(share, 1.0), dst=behind, dtype=cv2.CV_8U)

    def _draw(self, number: int, placed: Placed, cells: Cells) -> list[Cells]:
        """Draw a block where it is nearer than what was drawn before; return in which cells its faces lie."""
        painted: list[Cells] = []
        half_m = 0.5 * np.array(placed.block.size_m)
        rows, columns = cells.nodes
        R_WT, R_WE = placed.R_WT[rows], self._eye.R_WE[rows]
        o_T = np.einsum("nij,ni->nj", R_WT, self._eye.o_W[rows] - placed.p_WT_m[rows])
        R_ET = R_WE.transpose(0, 2, 1) @ R_WT
        d_T = self._eye.rays_E[rows, columns] @ R_ET
        for axis in range(3):
            side = 1.0 if o_T[:, axis].mean() > 0 else -1.0
            above_m = side * o_T[:, axis] - half_m[axis]
            if above_m.min() <= 0:
                continue
            a, b = (axis + 1) % 3, (axis + 2) % 3
            inverse = -side * d_T[..., axis] / above_m[:, None]
            s = ((o_T[:, a] + half_m[a])[:, None] * inverse + d_T[..., a]) / (2 * half_m[a])
            c = ((o_T[:, b] + half_m[b])[:, None] * inverse + d_T[..., b]) / (2 * half_m[b])
            within = _cells_touching((s, c, inverse - s, inverse - c), cells)
            if within is None:
                continue
            middle = len(o_T) // 2
            centre_T = side * half_m[axis] * np.eye(3)[axis] - o_T[middle]
            m_per_px = max(_NEAREST_M, float((R_ET[middle] @ centre_T)[2])) / self._eye.lens.fx_px
            texels, surface = _surface(placed.block, (a, b), centre_T / np.linalg.norm(centre_T), m_per_px)
            part = (
                slice(within.top - cells.top, within.bottom - cells.top + 2),
                slice(within.left - cells.left, within.right - cells.left + 2),
            )
            self._paint(number, within, (inverse[part], s[part], c[part]), texels, surface)
            painted.append(within)
        return painted

    def _paint(
        self,
        number: int,
        cells: Cells,
        nodes: tuple[FloatArray, FloatArray, FloatArray],
        texels: tuple[float, float],
        surface: GreyImage,
    ) -> None:
        """Draw a face in `cells`: at its nodes 1/λ, s/λ and c/λ, with s and c from 0 to 1 over the whole face."""
        inverse, s, c = (of_pixels(each) for each in nodes)
        window = cells.pixels(self._all)
        nearest = self._inverse[window]
        inside = cv2.min(cv2.min(s, c), cv2.min(cv2.subtract(inverse, s), cv2.subtract(inverse, c)))
        shown = (inside >= 0) & (inverse > nearest) & (inverse < 1 / _NEAREST_M)
        painted = cv2.remap(
            surface,
            cv2.divide(c, inverse, scale=texels[1]),
            cv2.divide(s, inverse, scale=texels[0]),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        np.copyto(self._grey[window], painted, where=shown)
        np.copyto(nearest, inverse, where=shown)
        np.copyto(self._owner[window], number, where=shown)

    def _image_motion(self, placed: Placed, cells: Cells, middle_px: tuple[float, float], depth_m: float) -> FloatArray:
        """Return how far (2,), in px, a block's point moves during the exposure that is seen `middle_px`, row and
        column, from the first pixel of `cells`.
        """
        eye = self._eye
        row, column = cells.top + int(middle_px[0]) // CELL + 1, cells.left + int(middle_px[1]) // CELL + 1
        point_W = eye.o_W[row] + eye.R_WE[row] @ eye.rays_E[row, column] * depth_m
        point_T = placed.R_WT[row].T @ (point_W - placed.p_WT_m[row])
        ends_W = placed.p_WT_m[-2:] + placed.R_WT[-2:] @ point_T
        begin, end = eye.project(np.einsum("nij,ni->nj", eye.R_WE[-2:], ends_W - eye.o_W[-2:]))
        moved: FloatArray = end - begin
        return moved


def _cells_around(eye: Eye, placed: Placed) -> Cells | None:
    """Return the cells that may show the block at any row, None if there are none."""
    lattice_T = _LATTICE * np.array(placed.block.size_m)
    at = np.array([0, ROWS // 2, ROWS + 1])
    points_W = lattice_T @ placed.R_WT[at].transpose(0, 2, 1) + placed.p_WT_m[at, None]
    points_E = ((points_W - eye.o_W[at, None]) @ eye.R_WE[at]).reshape(-1, 3)
    if points_E[:, 2].max() < _NEAREST_M:
        return None
    if points_E[:, 2].min() < _NEAREST_M:  # partly behind the camera: its projection has no bounds
        return PICTURE
    low, high = (eye.project(points_E) - _MARGIN_PX).min(axis=0), (eye.project(points_E) + _MARGIN_PX).max(axis=0)
    left, top = np.maximum(low // CELL, 0).astype(int)
    right, bottom = np.minimum(high // CELL + 1, (COLUMNS, ROWS)).astype(int)
    return Cells(int(top), int(bottom), int(left), int(right)) if top < bottom and left < right else None


def _cells_touching(bounds: Sequence[FloatArray], cells: Cells) -> Cells | None:
    """Return those of `cells` near whose nodes each of `bounds` is positive somewhere, and the cells between; or None.

    Each by itself: a face may pass between nodes.
    """
    near = np.ones((cells.bottom - cells.top, cells.right - cells.left), np.bool_)
    for bound in bounds:
        near &= cv2.dilate((bound > 0).view(np.uint8), AROUND)[1:-1, 1:-1] > 0
    return Cells.holding(near, cells)


def _surface(
    block: Block, axes: tuple[int, int], view_T: FloatArray, m_per_px: float
) -> tuple[tuple[float, float], GreyImage]:
    """Return how many texels the face along `axes` has, each about as large as a pixel, and its surface.

    The face is seen along `view_T` (3,), of length 1, at a depth where a pixel is `m_per_px` wide.
    """
    seen_m = m_per_px / np.sqrt(np.maximum(1.0 - view_T[list(axes)] ** 2, 1e-4))
    levels = np.rint(np.log2(np.clip(seen_m / block.texel_m, 1.0, 2.0**MAX_LEVEL))).astype(int).tolist()
    row_texels, column_texels = (block.size_m[axis] / block.texel_m for axis in axes)
    surface = face(block.texture, int(np.ceil(row_texels)), int(np.ceil(column_texels)), levels[0], levels[1])
    return (row_texels / 2.0 ** levels[0], column_texels / 2.0 ** levels[1]), surface
