"""What the two cameras see: textured ground through real lenses, row by row, blurred, shaded and noisy.

Geometry is exact on a grid of nodes 8 px apart: each node's ray is undistorted and cut with each piece of ground from
the pose of its own row. Between nodes the homogeneous texture coordinates (s·W, c·W, W) are interpolated and then
divided; for a pinhole and a still camera they are linear in the pixel, so interpolation is exact there, and what
remains is the curvature of lens distortion and of the motion within 8 rows (below 0.02 px).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np

from messages.arrays import BoolArray, FloatArray, FloatImage, GreyImage, IntArray
from sim_rig.camera.blur import LENS_BLUR_PX, line_kernel
from sim_rig.camera.grid import AROUND, CELL, COLUMNS, PICTURE, ROWS, Cells, node_pixels, of_pixels
from sim_rig.camera.light_map import LightMap
from sim_rig.camera.mirrored_ceiling import add_mirrored, ceiling_pieces
from sim_rig.camera.raw_camera import Camera
from sim_rig.camera.textures import CANVAS_COLUMNS, MAX_LEVEL, TILE, canvas, texel_m
from sim_rig.camera.things_layer import ThingsLayer
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, Unit
from sim_rig.walk.gait import Gait, Motion
from sim_rig.walk.polish import Polish
from sim_rig.walk.relief import Relief
from sim_rig.walk.things import Placed, Thing, Walker
from sim_rig.walk.world import Segment, World

_REACH_M = 10.0  # of ground that is drawn; beyond, a camera that looks down sees none
_NEAREST_M = 0.05  # ahead of the camera, from which on ground is drawn
_FAR_M = 1e6  # in place of where a ray meets no ground
_WIDEST_RISER_M = 9.0  # of one canvas: a riser seen along itself reaches to the horizon
_HORIZON = 1e-3  # of a ray's slope towards the ground, below which it counts as never meeting it

_BLUR_ROWS, _BLUR_COLUMNS = 6, 5

_READ_NOISE = 0.9
_SHOT_NOISE = 0.15  # deviation √(read² + (shot² · grey)): 1.7 grey levels at mid-grey
_NOISE_MARGIN = 256
_BACKGROUND = 70
_EVEN_GREY = 120

_Number = TypeVar("_Number", FloatArray, FloatImage)


@dataclass(frozen=True)
class Effects:
    """What may be left out of a picture to measure its geometry."""

    motion_blur: bool = True
    noise: bool = True


class Renderer:
    """Renders the pairs that one unit sees on one walk. Deterministic in its arguments and `render`'s. Not thread-safe.

    The cameras must look downwards: a ray above the horizon sees nothing. `things` stand before the ground. `contrast`
    draws all light that reaches the lenses towards an even grey; the sensor's noise stays as it is.
    """

    def __init__(
        self,
        unit: Unit,
        world: World,
        gait: Gait,
        seed: int,
        effects: Effects | None = None,
        *,
        things: Sequence[Thing] = (),
        contrast: float = 1.0,
    ) -> None:
        self._world = world
        self._gait = gait
        self._seed = seed
        self._walker = Walker(gait, world, seed)
        self._things = things
        self._contrast = contrast
        self._effects = effects or Effects()
        stereo = unit.stereo
        R_BL, p_BL = np.array(unit.X_BL.R), np.array(unit.X_BL.p_m)
        R_RL, p_RL = np.array(stereo.X_RL.R), np.array(stereo.X_RL.p_m)
        R_BR = R_BL @ R_RL.T
        self.cameras = (
            Camera(stereo.left, R_BL, p_BL, unit.gain[0]),
            Camera(stereo.right, R_BR, p_BL - R_BR @ p_RL, unit.gain[1]),
        )
        rows = node_pixels(ROWS)
        self._row_ns = np.rint((rows - (HEIGHT_PX - 1) / 2) * stereo.row_time_s * 1e9).astype(np.int64)
        rng = np.random.default_rng([seed, 3])
        shape = (HEIGHT_PX + _NOISE_MARGIN, WIDTH_PX + _NOISE_MARGIN)
        self._noise = rng.standard_normal(shape, dtype=np.float32)
        self._deviation = np.sqrt(noise_variance(np.arange(256.0))).astype(np.float32)
        self._picture = np.empty((HEIGHT_PX, WIDTH_PX), np.uint8)

    def render(self, t_ns: int, exposure_s: float, index: int, left: GreyImage, right: GreyImage) -> None:
        """Fill `left` and `right` (720, 1280) with the pair whose middle row is at mid-exposure at `t_ns`.

        `index` is the frame's number: it draws the noise.
        """
        rng = np.random.default_rng([self._seed, 4, index])
        for camera, seen, picture in zip(self.cameras, self._seen(t_ns, exposure_s), (left, right), strict=True):
            light: GreyImage | FloatImage = picture
            if self._contrast == 1.0:
                cv2.multiply(seen, camera.shade, dst=picture, scale=camera.gain / 255)
            else:  # not rounded before the noise, which is larger than what is left of a texture
                light = self._dimmed(camera, seen)
                cv2.convertScaleAbs(light, dst=picture)
            if self._effects.noise:
                row, column = rng.integers(0, _NOISE_MARGIN, 2)
                field = self._noise[row : row + HEIGHT_PX, column : column + WIDTH_PX]
                noise = cv2.LUT(picture, self._deviation)
                cv2.multiply(noise, field, dst=noise)
                cv2.add(light, noise, dst=picture, dtype=cv2.CV_8U)

    def light(self, t_ns: int, exposure_s: float) -> tuple[FloatImage, FloatImage]:
        """Return left and right (720, 1280) of `render` in grey levels before noise, rounding and saturation."""
        left, right = (
            self._dimmed(camera, seen) for camera, seen in zip(self.cameras, self._seen(t_ns, exposure_s), strict=True)
        )
        return left, right

    def _seen(self, t_ns: int, exposure_s: float) -> Iterator[GreyImage]:
        """Yield what reaches each eye's sensor in full light, before shading."""
        motion = self._gait.at(t_ns + self._row_ns)
        blocks, instants = self._placed(t_ns, exposure_s)
        for camera in self.cameras:
            view = _View(camera, motion)
            self._picture.fill(_BACKGROUND)
            light = view.light_under(self._world)
            for segment in view.pieces_in_sight(self._world):
                view.draw(segment, self._world.relief, self._picture, light)
            if light is not None:
                cv2.multiply(self._picture, light.pixels, dst=self._picture, dtype=cv2.CV_8U)
            blurred = self._blurred(view, self._picture, exposure_s)
            if self._world.polish is not None:
                self._mirror_ceiling(self._world.polish, _View(camera, motion), exposure_s, blurred)
            if instants is not None:
                ThingsLayer(camera.eye(instants), blocks).draw_over(blurred, blur=self._effects.motion_blur)
            yield blurred

    def _blurred(self, view: "_View", picture: GreyImage, exposure_s: float) -> GreyImage:
        """Return the picture as the lens and the motion blur it."""
        sharp: GreyImage = cv2.GaussianBlur(picture, (3, 3), LENS_BLUR_PX)  # type: ignore[assignment]
        return view.blur(sharp, exposure_s) if self._effects.motion_blur else sharp

    def _mirror_ceiling(self, polish: Polish, view: "_View", exposure_s: float, picture: GreyImage) -> None:
        """Add to `picture` what the floor mirrors; `view` is one that has drawn nothing yet."""
        ceiling = np.zeros_like(picture)
        for piece in ceiling_pieces(polish, view.x_m):
            view.draw(piece, None, ceiling)
        add_mirrored(polish, view.d_W, self._blurred(view, ceiling, exposure_s), picture)

    def _dimmed(self, camera: Camera, seen: GreyImage) -> FloatImage:
        """Return `seen` at this renderer's contrast, shaded, in grey levels."""
        even = np.float32((1.0 - self._contrast) * _EVEN_GREY)
        dimmed: FloatImage = seen * np.float32(self._contrast)
        dimmed += even
        cv2.multiply(dimmed, camera.shade, dst=dimmed, scale=camera.gain / 255, dtype=cv2.CV_32F)
        return dimmed

    def _placed(self, t_ns: int, exposure_s: float) -> tuple[list[Placed], Motion | None]:
        """Return the blocks of all things, and the wearer's motion, at the rows of nodes and at the exposure's ends."""
        if not self._things:
            return [], None
        half_ns = round(0.5e9 * exposure_s)
        instants_ns = t_ns + np.concatenate((self._row_ns, (-half_ns, half_ns)))
        motion = self._gait.at(instants_ns)
        return [p for thing in self._things for p in thing.placed(self._walker, instants_ns, motion)], motion


def noise_variance(grey: _Number) -> _Number:
    """Return the variance of a pixel of mean `grey`, of any shape."""
    variance: _Number = _READ_NOISE**2 + _SHOT_NOISE**2 * grey
    return variance


class _View:
    """One camera at one frame: where each node's row of the sensor was, and where its rays went."""

    def __init__(self, camera: Camera, motion: Motion) -> None:
        self._camera = camera
        self._motion = motion
        self._R_WE = motion.R_WB @ camera.R_BE
        self._o_W = motion.p_WB_m + motion.R_WB @ camera.p_BE_m
        self.d_W = camera.rays_E @ self._R_WE.transpose(0, 2, 1)
        self._blur_rows, self._blur_columns = np.ix_(
            ((np.arange(_BLUR_ROWS) + 0.5) * ROWS / _BLUR_ROWS).astype(int) + 1,
            ((np.arange(_BLUR_COLUMNS) + 0.5) * COLUMNS / _BLUR_COLUMNS).astype(int) + 1,
        )
        self._depth_m = np.full((_BLUR_ROWS, _BLUR_COLUMNS), np.inf)
        self._relief_m: FloatArray | None = None

    @property
    def x_m(self) -> float:
        """Return where along the way the camera was farthest back."""
        return float(self._motion.p_WB_m[:, 0].min())

    def pieces_in_sight(self, world: World) -> list[Segment]:
        """Return the ground within reach, far to near: along any ray the nearest piece is drawn last."""
        x_m = self.x_m
        ahead = list(world.between(x_m + _NEAREST_M, x_m + _REACH_M))[::-1]
        if self.d_W[..., 0].min() >= 0.0:
            return ahead
        return [piece for piece in world.between(x_m - _REACH_M, x_m + _NEAREST_M) if piece not in ahead] + ahead

    def light_under(self, world: World) -> LightMap | None:
        """Return the light under the shades that may lie on ground within reach, None without any."""
        shades = world.shades_between(self.x_m - _REACH_M, self.x_m + _REACH_M)
        return LightMap(shades, self._o_W, self.d_W) if shades else None

    def draw(self, segment: Segment, relief: Relief | None, picture: GreyImage, light: LightMap | None = None) -> None:
        """Draw what of `segment` faces this camera over `picture`, with `relief` on it, and note its `light`."""
        length_m = segment.length_m
        along_x, along_z = (segment.x1_m - segment.x0_m) / length_m, (segment.z1_m - segment.z0_m) / length_m
        ox, oz = self._o_W[:, 0, None] - segment.x0_m, self._o_W[:, 2, None] - segment.z0_m
        above_m = along_x * oz - along_z * ox
        if above_m.min() <= 0:
            return
        if relief is not None:  # each node's ray meets the plane raised by the height at which it meets the ground
            if self._relief_m is None:
                self._relief_m = relief.met(self._o_W, self.d_W)
            above_m = above_m - self._relief_m
        # A ray o + λd meets the plane at λ = above / W, W = −n·d; s and c are homogeneous with W.
        dx, dy, dz = self.d_W[..., 0], self.d_W[..., 1], self.d_W[..., 2]
        W = along_z * dx - along_x * dz
        S = (along_x * ox + along_z * oz) * W + above_m * (along_x * dx + along_z * dz)
        C = -(self._o_W[:, 1, None] * W + above_m * dy)
        ahead = W > _HORIZON
        W_ahead = np.where(ahead, W, 1.0)
        s_m = np.where(ahead, S / W_ahead, _FAR_M)

        seen = _cells_touching(s_m, length_m)
        if seen.any():
            self._note_depth(s_m, above_m / W_ahead, length_m)
            _paint_piece(segment, seen, _Hits(S, C, W, s_m, C / W_ahead), picture)
            if light is not None:
                light.note(above_m, S, W, length_m)

    def blur(self, sharp: GreyImage, exposure_s: float) -> GreyImage:
        """Return the picture smeared along each of 6×5 tiles' own image motion during the exposure."""
        motion_px = self._image_motion() * exposure_s
        height, width = HEIGHT_PX // _BLUR_ROWS, WIDTH_PX // _BLUR_COLUMNS
        blurred: GreyImage = sharp.copy()
        for i, j in np.ndindex(_BLUR_ROWS, _BLUR_COLUMNS):
            kernel = line_kernel(motion_px[i, j])
            if kernel is None:
                continue
            pad = kernel.shape[0] // 2
            top, left = i * height, j * width
            above, before = min(pad, top), min(pad, left)
            padded = sharp[top - above : top + height + pad, left - before : left + width + pad]
            smeared = cv2.filter2D(padded, -1, kernel)
            blurred[top : top + height, left : left + width] = smeared[above : above + height, before : before + width]
        return blurred

    def _note_depth(self, s_m: FloatArray, depth_m: FloatArray, length_m: float) -> None:
        s_m, depth_m = s_m[self._blur_rows, self._blur_columns], depth_m[self._blur_rows, self._blur_columns]
        hit = (s_m >= 0) & (s_m <= length_m)
        self._depth_m[hit] = np.minimum(self._depth_m, depth_m)[hit]

    def _image_motion(self) -> FloatArray:
        """Return the velocity (rows, columns, 2) in px/s of the ground seen at each tile's centre: −ω×P − v in E."""
        rows = self._blur_rows[:, 0]
        motion, camera = self._motion, self._camera
        w_B = motion.w_WB_B_radps[rows]
        v_W = motion.v_WB_mps[rows] + np.einsum("nij,nj->ni", motion.R_WB[rows], np.cross(w_B, camera.p_BE_m))
        w_E = w_B @ camera.R_BE
        v_E = np.einsum("nij,ni->nj", self._R_WE[rows], v_W)
        rays = camera.rays_E[self._blur_rows, self._blur_columns]
        rate = -np.cross(w_E[:, None], rays) - v_E[:, None] / self._depth_m[..., None]
        motion_xy = rate[..., :2] - rays[..., :2] * rate[..., 2:]
        motion_px: FloatArray = np.einsum(
            "rcij,rcj->rci", camera.px_per_ray(self._blur_rows, self._blur_columns), motion_xy
        )
        return motion_px


@dataclass(frozen=True)
class _Hits:
    """Where the nodes' rays meet a piece of ground: along it s and across it c, homogeneous with W, and in metres."""

    S: FloatArray
    C: FloatArray
    W: FloatArray
    s_m: FloatArray
    c_m: FloatArray


def _paint_piece(segment: Segment, seen: BoolArray, at: _Hits, picture: GreyImage) -> None:
    """Draw `segment` in the cells in which it is seen, in bands of rows of like texture reduction."""
    rows, columns = np.nonzero(seen)
    top, bottom = int(rows.min()), int(rows.max()) + 1
    left, right = int(columns.min()), int(columns.max()) + 1
    length_m = segment.length_m
    across_m = texel_m(segment.texture)
    rows_texels = max(1, round(length_m / across_m / 2**MAX_LEVEL)) << MAX_LEVEL
    along_m = length_m / rows_texels  # stretched so that both ends of the piece fall on texels at every level
    middle = (left + right) // 2
    levels = np.stack(
        (
            _levels(at.s_m, top, bottom, middle, along_m),
            _levels(at.c_m, top, bottom, middle, across_m),
        )
    )
    shown = _cells_showing(at.S, at.W, length_m, along_m * 2**MAX_LEVEL)
    changes = np.flatnonzero((np.diff(levels) != 0).any(axis=0)) + 1
    for begin, end in zip((0, *changes), (*changes, bottom - top), strict=True):
        row_level, column_level = (int(level) for level in levels[:, begin])
        band = Cells(top + begin, top + end, left, right)
        touched = cv2.dilate(seen[band.block].view(np.uint8), AROUND) > 0
        c_m, most_m = at.c_m[1:-1, 1:-1][band.block], _WIDEST_RISER_M if segment.is_riser else np.inf
        for c_from_m, c_to_m, cells in _spans(c_m, touched, shown[band.block], band, most_m):
            origin, level = _column_origin(c_from_m, c_to_m, column_level, across_m)
            surface = canvas(segment.texture, rows_texels, segment.texture_phase, row_level, level)
            W_cells = at.W[cells.nodes]
            _paint(
                surface,
                at.C[cells.nodes] / (across_m * 2**level) - origin * W_cells,
                at.S[cells.nodes] / (along_m * 2**row_level),
                W_cells,
                picture[cells.pixels(PICTURE)],
            )


def _spans(
    c_m: FloatArray, touched: BoolArray, shown: BoolArray, band: Cells, most_m: float
) -> Iterator[tuple[float, float, Cells]]:
    """Yield from where to where across the way, no more than `most_m` or a single column, and in which cells of `band`
    a piece is `shown`: its corner need not show in every band of its box.
    """
    c_seen, cells, half = c_m[touched], Cells.holding(shown, band), (band.right - band.left) // 2
    if not len(c_seen) or cells is None:
        return
    c_from_m, c_to_m = float(c_seen.min()), float(c_seen.max())
    if half == 0 or c_to_m - c_from_m <= most_m:
        yield c_from_m, c_to_m, cells
    else:
        before, beyond = band._replace(right=band.left + half), band._replace(left=band.left + half)
        yield from _spans(c_m[:, :half], touched[:, :half], shown[:, :half], before, most_m)
        yield from _spans(c_m[:, half:], touched[:, half:], shown[:, half:], beyond, most_m)


def _cells_touching(s_m: FloatArray, length_m: float) -> BoolArray:
    """Return (rows, columns) of cells: whether any s within the cell or its neighbours' nodes lies on the piece."""
    s32 = s_m.astype(np.float32)
    touching: BoolArray = (cv2.dilate(s32, AROUND) > 0) & (cv2.erode(s32, AROUND) < length_m)
    return touching[1:-1, 1:-1]


def _cells_showing(S: FloatArray, W: FloatArray, length_m: float, margin_m: float) -> BoolArray:
    """Return (rows, columns) of cells: whether s = S / W of any pixel may lie on the piece, or `margin_m` beside it.

    None does where all nodes lie before the piece, or all beyond it: S and W are linear between them.
    """
    before, beyond = S + margin_m * W < 0, (length_m + margin_m) * W - S < 0  # both of a point behind the camera
    side = 1 + before.view(np.uint8) - beyond.view(np.uint8)
    showing: BoolArray = (cv2.erode(side, AROUND) <= 1) & (cv2.dilate(side, AROUND) >= 1)
    return showing[1:-1, 1:-1]


def _levels(position_m: FloatArray, top: int, bottom: int, column: int, full_size_m: float) -> IntArray:
    """Return (bottom − top,) the reduction at which a texel is about as large as a pixel, row of cells by row."""
    nodes = position_m[top : bottom + 2, column : column + 3]
    down = nodes[2:, 1] - nodes[:-2, 1]
    across = nodes[1:-1, 2] - nodes[1:-1, 0]
    footprint_m = np.hypot(down, across) / (2 * CELL)
    level = np.rint(np.log2(np.clip(footprint_m / full_size_m, 1.0, 2.0**MAX_LEVEL)))
    return level.astype(np.int64)


def _column_origin(c_from_m: float, c_to_m: float, level: int, full_size_m: float) -> tuple[int, int]:
    """Return the canvas column, a whole number of tiles, to count from, and the level whose canvas is wide enough."""
    while True:
        reduced_m, tile = full_size_m * 2**level, TILE >> level
        origin = int(np.floor((c_from_m / reduced_m - 1) / tile)) * tile
        if level == MAX_LEVEL or c_to_m / reduced_m + 1 - origin < tile + CANVAS_COLUMNS:
            return origin, level
        level += 1


def _paint(surface: GreyImage, C: FloatArray, S: FloatArray, W: FloatArray, picture: GreyImage) -> None:
    """Draw `surface` where its homogeneous coordinates fall inside it; elsewhere `picture` stays as it is."""
    c, s, w = (of_pixels(nodes) for nodes in (C, S, W))
    cv2.remap(
        surface,
        cv2.divide(c, w, dst=c),
        cv2.divide(s, w, dst=s),
        cv2.INTER_LINEAR,
        dst=picture,
        borderMode=cv2.BORDER_TRANSPARENT,
    )
