"""What a depth camera sees: the exact depth of the ground, row by row, and then the errors of an active stereo pair.

Along the ray r (z = 1) of a pixel a plane of ground has the inverse depth r·n / e with its camera's height e over it:
linear in the pixel's column, so a picture takes a few additions a pixel and piece of ground.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from messages.arrays import BoolArray, DepthImage, FloatArray, FloatImage
from sim_rig.camera.depth_unit import DEPTH_HEIGHT_PX, DEPTH_WIDTH_PX, DepthUnit
from sim_rig.walk.gait import Gait
from sim_rig.walk.world import Segment, World

_REACH_M = 10.0
_NEAREST_M = 0.05
_FIELD_MARGIN = 256
_SHAPE = (DEPTH_HEIGHT_PX, DEPTH_WIDTH_PX)


@dataclass(frozen=True)
class DepthErrors:
    """How the camera's own matching errs, in px of its disparity; zero leaves an effect out.

    The noise is Gaussian with neighbours alike over `patch_px`; `locking_px` is the amplitude by which interpolation
    is drawn towards whole pixels; `grain_px` is the step of the disparities that the camera turns into depth.
    `hole_share` of the ground has no depth, in patches; beside an edge, where neighbouring disparities differ by more
    than `edge_px`, a pixel shows a depth between the two ("flying") or none.
    """

    noise_px: float = 0.08
    patch_px: float = 2.0
    locking_px: float = 0.03
    grain_px: float = 1 / 32
    hole_share: float = 0.03
    edge_px: float = 0.5


NO_ERRORS = DepthErrors(0.0, 0.0, 0.0, 0.0, 0.0, np.inf)
"""The exact depth but for what the inner pair cannot both see, and for its rounding to whole steps."""


class DepthRenderer:
    """Renders the depth images of one unit on one walk; deterministic in its arguments and `render`'s."""

    def __init__(self, unit: DepthUnit, world: World, gait: Gait, seed: int, errors: DepthErrors | None = None) -> None:
        lens = unit.depth.lens
        if any(lens.distortion):
            raise ValueError("a depth image is rendered through a pinhole only")
        self._unit, self._world, self._gait, self._seed = unit, world, gait, seed
        self._errors = errors or DepthErrors()
        self._fB_px_m = lens.fx_px * unit.depth.baseline_m
        self._x = ((np.arange(DEPTH_WIDTH_PX) - lens.cx_px) / lens.fx_px).astype(np.float32)
        self._y = (np.arange(DEPTH_HEIGHT_PX) - lens.cy_px) / lens.fy_px
        row_s = (np.arange(DEPTH_HEIGHT_PX) - (DEPTH_HEIGHT_PX - 1) / 2) * unit.depth.row_time_s
        self._row_ns = np.rint(row_s * 1e9).astype(np.int64)
        rng = np.random.default_rng([seed, 10])
        self._noise = _smooth_field(rng, self._errors.patch_px)
        self._patches = _smooth_field(rng, 3.0 * self._errors.patch_px)
        self._hole_below = np.quantile(self._patches, self._errors.hole_share)

    def render(self, t_ns: int, index: int, depth: DepthImage) -> None:
        """Fill `depth` (480, 848) with the image whose middle row is at mid-exposure at `t_ns`; 0 where unknown.

        `index` is the frame's number: it draws the noise.
        """
        disparity_px = self._fB_px_m * self.inverse_depth(t_ns)
        known = (disparity_px > 0) & ~_hidden_from_the_right(disparity_px)
        disparity_px += self._unit.depth.lens.fx_px * self._unit.toe_in_rad
        rng = np.random.default_rng([self._seed, 11, index])
        known &= self._spoil(disparity_px, rng)
        scaled = np.float32(self._fB_px_m * (1.0 + self._unit.scale_error) / self._unit.depth.step_m)
        steps = np.divide(scaled, disparity_px, out=np.zeros_like(disparity_px), where=known)
        depth[:] = np.where(steps < 65535.5, np.rint(steps), 0.0)

    def inverse_depth(self, t_ns: int) -> FloatImage:
        """Return (480, 848) 1/m: 1/z of the nearest ground along each pixel's ray, 0 where there is none."""
        rolling = bool(self._unit.depth.row_time_s)
        motion = self._gait.at(t_ns + self._row_ns if rolling else np.array([t_ns]))
        R_WD = motion.R_WB @ np.array(self._unit.X_BD.R)
        o_W = motion.p_WB_m + motion.R_WB @ np.array(self._unit.X_BD.p_m)
        # the ray of row v and column u is x_u · across + down_v in W
        across_W = np.broadcast_to(R_WD[:, :, 0], (DEPTH_HEIGHT_PX, 3))
        down_W = self._y[:, None] * R_WD[:, :, 1] + R_WD[:, :, 2]
        inverse: FloatImage = np.zeros(_SHAPE, np.float32)
        x_m = float(o_W[:, 0].min())
        looks_back = min(float((down_W[:, 0] + side * across_W[:, 0]).min()) for side in self._x[[0, -1]]) < 0.0
        for segment in self._world.between(x_m - _REACH_M if looks_back else x_m + _NEAREST_M, x_m + _REACH_M):
            self._draw(segment, o_W, across_W, down_W, inverse)
        return inverse

    def _draw(
        self, segment: Segment, o_W: FloatArray, across_W: FloatArray, down_W: FloatArray, inverse: FloatImage
    ) -> None:
        length_m = segment.length_m
        along = np.array([segment.x1_m - segment.x0_m, 0.0, segment.z1_m - segment.z0_m]) / length_m
        into = np.array([along[2], 0.0, -along[0]])
        from_start = o_W - np.array([segment.x0_m, 0.0, segment.z0_m])
        above_m = -from_start @ into
        if above_m.min() <= 0:
            return
        # o + r / i lies on the plane at the inverse depth i = r·into / above, s = along·(o + r / i) from its start
        start_m = from_start @ along
        inward = self._of_pixels((down_W @ into) / above_m, (across_W @ into) / above_m)
        passed = self._of_pixels(down_W @ along, across_W @ along) + _column(start_m) * inward
        hit = (inward > inverse) & (passed >= 0.0) & (passed <= length_m * inward)
        np.copyto(inverse, inward, where=hit)

    def _of_pixels(self, at_centre: FloatArray, per_x: FloatArray) -> FloatImage:
        return _column(per_x) * self._x + _column(at_centre)

    def _spoil(self, disparity_px: FloatImage, rng: np.random.Generator) -> BoolArray:
        """Put the matching's errors into `disparity_px` and return (480, 848) where it still gives any."""
        errors = self._errors
        edge = _range_of_neighbours(disparity_px) > errors.edge_px
        between = cv2.blur(disparity_px, (5, 5))
        np.copyto(disparity_px, between, where=edge)
        known = ~edge | (rng.random(_SHAPE, dtype=np.float32) < 0.5)
        if errors.locking_px:
            disparity_px -= errors.locking_px * np.sin(np.float32(2 * np.pi) * disparity_px)
        if errors.noise_px:
            disparity_px += np.float32(errors.noise_px) * _drawn_from(self._noise, rng)
        if errors.grain_px:
            grain = np.float32(errors.grain_px)
            np.multiply(np.rint(disparity_px / grain), grain, out=disparity_px)
        if errors.hole_share:
            known &= _drawn_from(self._patches, rng) >= self._hole_below
        found: BoolArray = known & (disparity_px > 0)
        return found


def _column(values: FloatArray) -> FloatImage:
    return values.astype(np.float32)[:, None]


def _hidden_from_the_right(disparity_px: FloatImage) -> BoolArray:
    """Return where the right camera of the inner pair sees something nearer, or looks past its picture's border."""
    seen_at = np.arange(DEPTH_WIDTH_PX, dtype=np.float32) - disparity_px
    nearest = np.minimum.accumulate(seen_at[:, ::-1], axis=1)[:, ::-1]
    hidden: BoolArray = (seen_at > nearest) | (seen_at < 0)
    return hidden


def _range_of_neighbours(image: FloatImage) -> FloatImage:
    kernel = np.ones((5, 5), np.uint8)
    found: FloatImage = cv2.dilate(image, kernel) - cv2.erode(image, kernel)
    return found


def _smooth_field(rng: np.random.Generator, sigma_px: float) -> FloatImage:
    """Return a field of unit variance, larger than a picture, whose neighbours are alike over `sigma_px`."""
    field: FloatImage = rng.standard_normal((_SHAPE[0] + _FIELD_MARGIN, _SHAPE[1] + _FIELD_MARGIN), dtype=np.float32)
    if sigma_px:
        cv2.GaussianBlur(field, (0, 0), sigma_px, dst=field)
    field /= field.std()
    return field


def _drawn_from(field: FloatImage, rng: np.random.Generator) -> FloatImage:
    row, column = rng.integers(0, _FIELD_MARGIN, 2)
    return field[row : row + _SHAPE[0], column : column + _SHAPE[1]]
