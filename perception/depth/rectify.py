"""From a raw stereo pair to a rectified one at the matching scale, with the ray and the row time of each pixel.

Frames: L, R raw cameras; C rectified left camera (x right, y down, z forward).
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from messages import Lens, StereoCalibration
from messages.arrays import Float32Array, FloatArray, GreyImage


@dataclass(frozen=True)
class Window:
    """A block of pixels: rows [top, bottom), columns [left, right)."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def rows(self) -> slice:
        """Return the rows as a slice."""
        return slice(self.top, self.bottom)

    @property
    def columns(self) -> slice:
        """Return the columns as a slice."""
        return slice(self.left, self.right)

    @classmethod
    def around(cls, u_px: FloatArray, v_px: FloatArray, width_px: int, height_px: int) -> "Window | None":
        """Return the window that holds the pixels (u, v), cut at the border; None if the last one lies outside."""
        if not (0 <= u_px[-1] < width_px and 0 <= v_px[-1] < height_px):
            return None
        return cls.cut(u_px, v_px, width_px, height_px)

    @classmethod
    def cut(cls, u_px: FloatArray, v_px: FloatArray, width_px: int, height_px: int) -> "Window | None":
        """Return the window that holds the pixels (u, v), cut at the border; None if nothing is left."""
        window = cls(
            top=max(0, int(np.floor(v_px.min()))),
            bottom=min(height_px, int(np.ceil(v_px.max())) + 1),
            left=max(0, int(np.floor(u_px.min()))),
            right=min(width_px, int(np.ceil(u_px.max())) + 1),
        )
        return window if window.top < window.bottom and window.left < window.right else None


class Rectifier:
    """Rectification of one calibrated pair, reduced by a whole `divisor` before it is warped.

    The reduced raw image is an area average, so its pixel (u, v) has its centre at divisor·(u + ½) − ½ of the
    raw image. After rectification both eyes share `f_px`, `cx_px`, `cy_px`, so disparity d = f_px·baseline_m / z.
    """

    def __init__(self, stereo: StereoCalibration, divisor: int) -> None:
        size = (stereo.left.width_px, stereo.left.height_px)
        self.raw_size_px = size
        self.divisor = divisor
        self.width_px, self.height_px = size[0] // divisor, size[1] // divisor
        K_L, K_R = intrinsics(stereo.left), intrinsics(stereo.right)
        R_RL = np.array(stereo.X_RL.R)
        p_RL_m = np.array(stereo.X_RL.p_m)
        rectification = cv2.stereoRectify(
            K_L,
            np.array(stereo.left.distortion),
            K_R,
            np.array(stereo.right.distortion),
            size,
            R_RL,
            p_RL_m.reshape(3, 1),
            flags=cv2.CALIB_ZERO_DISPARITY,
            alpha=0,
        )
        R_CL, R_CR, P_C = (np.asarray(matrix, dtype=np.float64) for matrix in rectification[:3])
        K_C = _reduced(P_C[:, :3], divisor)
        self.f_px = float(K_C[0, 0])
        self.cx_px, self.cy_px = float(K_C[0, 2]), float(K_C[1, 2])
        self.baseline_m = float(np.linalg.norm(p_RL_m))
        self.R_LC: FloatArray = R_CL.T
        self.left_maps = _maps(_reduced(K_L, divisor), stereo.left, R_CL, K_C, self.width_px, self.height_px)
        self.right_maps = _maps(_reduced(K_R, divisor), stereo.right, R_CR, K_C, self.width_px, self.height_px)
        self._left, self._right = _Eye(self.left_maps, divisor), _Eye(self.right_maps, divisor)
        middle_row = (size[1] - 1) / 2
        raw_row = divisor * (self.left_maps[1] + 0.5) - 0.5
        self.row_time_s: Float32Array = ((raw_row - middle_row) * stereo.row_time_s).astype(np.float32)
        """(height_px, width_px): when each rectified left pixel was exposed, relative to mid-exposure."""
        self._reduced_row_time_s = divisor * stereo.row_time_s
        v, u = np.mgrid[: self.height_px, : self.width_px]
        self._rays_C: FloatArray = np.stack(
            ((u - self.cx_px) / self.f_px, (v - self.cy_px) / self.f_px, np.ones(u.shape)), axis=-1
        )

    def rays_C(self, window: Window) -> FloatArray:
        """Return (rows, columns, 3): rays through the window's pixel centres with z = 1, in C."""
        return self._rays_C[window.rows, window.columns]

    def on_plane(self, u_px: NDArray[np.number], v_px: NDArray[np.number], theta_C: FloatArray) -> FloatArray:
        """Return d = r · `theta_C` of the rays r through rectified pixels (u, v)."""
        by_u, by_v = theta_C[:2] / self.f_px
        on_plane: FloatArray = by_u * (u_px - self.cx_px) + by_v * (v_px - self.cy_px) + theta_C[2]
        return on_plane

    def lag_s(self, u_px: NDArray[np.floating], v_px: NDArray[np.floating], disparity_px: FloatArray) -> FloatArray:
        """Return by how much later the right eye's row exposed what the left one shows at rectified pixels (u, v)."""
        row, column, other = (np.rint(pixels).astype(np.intp) for pixels in (v_px, u_px, u_px - disparity_px))
        other = np.clip(other, 0, self.width_px - 1)
        later: FloatArray = (self.right_maps[1][row, other] - self.left_maps[1][row, column]).astype(np.float64)
        return self._reduced_row_time_s * later

    def rectify_apart(
        self, left: GreyImage, right: GreyImage, window: Window, disparities_px: tuple[int, int]
    ) -> tuple[GreyImage, GreyImage]:
        """Return the window of the rectified left eye and, of the right eye, the columns in which the same is seen.

        They begin at that of the window's first column with the largest of the least and largest `disparities_px`.
        """
        least, largest = disparities_px
        return (
            self._left.warped(left, window.rows, window.left, window.right),
            self._right.warped(right, window.rows, window.left - largest, window.right - least),
        )

    def rectify(
        self, left: GreyImage, right: GreyImage, window: Window, shift_px: int, *, every: int = 1
    ) -> tuple[GreyImage, GreyImage]:
        """Return the window of the rectified left eye and, of the right eye, the window moved left by `shift_px`.

        Columns of the right window that lie outside its image are black. Of the rows only each `every`-th is returned.
        """
        rows = slice(window.top, window.bottom, every)
        return (
            self._left.warped(left, rows, window.left, window.right),
            self._right.warped(right, rows, window.left - shift_px, window.right - shift_px),
        )


class _Eye:
    """One eye: `maps` (height_px, width_px), x and y, of where its reduced raw picture shows each rectified pixel."""

    def __init__(self, maps: tuple[Float32Array, Float32Array], divisor: int) -> None:
        self._maps, self._divisor = maps, divisor
        self._highest, self._lowest = maps[1].min(axis=1), maps[1].max(axis=1)

    def warped(self, image: GreyImage, rows: slice, left: int, right: int) -> GreyImage:
        """Return rectified `rows` and columns [left, right) of a raw picture; columns outside it are black."""
        x, y = self._maps
        width = x.shape[1]
        inside = slice(max(left, 0), min(right, width))
        small, first = self._reduced(image, rows)
        warped = cv2.remap(small, x[rows, inside], y[rows, inside] - np.float32(first), cv2.INTER_LINEAR)
        before, after = inside.start - left, right - inside.stop
        return cv2.copyMakeBorder(warped, 0, 0, before, after, cv2.BORDER_CONSTANT) if before or after else warped  # type: ignore[return-value]

    def _reduced(self, image: GreyImage, rows: slice) -> tuple[GreyImage, int]:
        """Return of the reduced picture the rows that are needed for rectified `rows`, and which is the first."""
        if self._divisor == 1:
            return image, 0
        height, width = (size // self._divisor for size in image.shape)
        first = min(max(math.floor(self._highest[rows].min()), 0), height - 1)
        end = min(max(math.floor(self._lowest[rows].max()) + 2, first + 1), height)
        some = image[self._divisor * first : self._divisor * end, : self._divisor * width]
        return cv2.resize(some, (width, end - first), interpolation=cv2.INTER_AREA), first  # type: ignore[return-value]


def intrinsics(lens: Lens) -> FloatArray:
    """Return K (3, 3): pixel = K · ray, without distortion."""
    return np.array([[lens.fx_px, 0, lens.cx_px], [0, lens.fy_px, lens.cy_px], [0, 0, 1.0]])


def undistorted_rays(lens: Lens, u_px: FloatArray, v_px: FloatArray) -> FloatArray:
    """Return (len(v), len(u), 3): rays with z = 1 through the raw pixels at columns `u_px` and rows `v_px`."""
    pixels = np.stack(np.meshgrid(u_px, v_px), axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    xy = cv2.undistortPoints(pixels, intrinsics(lens), np.array(lens.distortion), criteria=criteria)
    xy = xy.reshape(len(v_px), len(u_px), 2)
    return np.concatenate((xy, np.ones((*xy.shape[:2], 1))), axis=-1)


def _reduced(K: FloatArray, divisor: int) -> FloatArray:
    reduced = K / divisor
    reduced[:2, 2] = (K[:2, 2] + 0.5) / divisor - 0.5
    reduced[2] = (0, 0, 1)
    return reduced


def _maps(
    K_raw: FloatArray, lens: Lens, R_C_raw: FloatArray, K_C: FloatArray, width_px: int, height_px: int
) -> tuple[Float32Array, Float32Array]:
    return cv2.initUndistortRectifyMap(  # type: ignore[return-value]
        K_raw, np.array(lens.distortion), R_C_raw, K_C, (width_px, height_px), cv2.CV_32FC1
    )
