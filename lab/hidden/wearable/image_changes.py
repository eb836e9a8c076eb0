"""Images altered after they were taken, as firmware, gloss or dirt does it: the right one's pixels move sideways."""

from collections.abc import Callable

import cv2
import numpy as np

from lab.hidden.wearable.recording import ImageChange, Scene, binned, ground_below
from messages.arrays import Float32Array, FloatArray, GreyImage
from perception.depth.rectify import Rectifier, undistorted_rays
from sim_rig.unit import HEIGHT_PX, WIDTH_PX

_NODE_PX = 16
_CONTRAST_BOX = 15
_MATT = 12.0  # grey levels


def moved_right(scene: Scene, shift_px: Callable[[Float32Array, GreyImage], Float32Array]) -> ImageChange:
    """Return a change that adds `shift_px(disparity, right image)` (720, 1280) to the disparity of the right image.

    Disparities are in px of the binned, rectified image, at the place of the right image's pixel.
    """
    stereo = binned(scene.told).stereo
    rectifier = Rectifier(stereo, 1)
    R_CR = rectifier.R_LC.T @ np.array(stereo.X_RL.R).T
    u, v = (np.arange(0, size + _NODE_PX, _NODE_PX, dtype=np.float64) for size in (WIDTH_PX, HEIGHT_PX))
    rays_C = undistorted_rays(scene.told.stereo.right, u, v) @ R_CR.T
    rays_C /= rays_C[..., 2:]
    row_ns = np.rint((v - (HEIGHT_PX - 1) / 2) * scene.unit.stereo.row_time_s * 1e9).astype(np.int64)
    R_BC = (
        np.array(scene.unit.X_BL.R) @ rectifier.R_LC
    )  # where the camera truly looks, through the lenses as calibrated
    p_BL = np.array(scene.unit.X_BL.p_m)
    columns, rows = np.meshgrid(np.arange(WIDTH_PX, dtype=np.float32), np.arange(HEIGHT_PX, dtype=np.float32))

    def everywhere(nodes: FloatArray) -> Float32Array:
        at = (columns / _NODE_PX, rows / _NODE_PX)
        return cv2.remap(nodes.astype(np.float32), *at, cv2.INTER_LINEAR)  # type: ignore[return-value]

    raw_per_rectified = everywhere(1.0 / (rectifier.f_px * np.gradient(rays_C[..., 0], _NODE_PX, axis=1)))

    def disparity(k: int) -> Float32Array:
        motion = scene.gait.at(scene.true_ns(k) + row_ns)
        R_WC = motion.R_WB @ R_BC
        slope, height_m = ground_below(scene.world, motion.p_WB_m + motion.R_WB @ p_BL, R_WC[:, :, 2])
        normal = np.stack((-np.sin(slope), 0 * slope, np.cos(slope)), axis=-1)
        theta = -np.einsum("nij,ni->nj", R_WC, normal) * (rectifier.baseline_m / (height_m * np.cos(slope)))[:, None]
        at_nodes = np.einsum("vui,vi->vu", rays_C, theta) / (1.0 - theta[:, :1])  # at the right image's pixel
        return everywhere(rectifier.f_px * at_nodes)

    def change(k: int, left: GreyImage, right: GreyImage) -> tuple[GreyImage, GreyImage]:
        raw_px = raw_per_rectified * shift_px(disparity(scene.shown(k)), right)
        moved = cv2.remap(right, columns + raw_px, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return left, np.asarray(moved, np.uint8)

    return change


def locked(amplitude_px: float) -> Callable[[Float32Array, GreyImage], Float32Array]:
    """Return the shift of a resampler whose phases crowd about whole pixels."""

    def shift_px(disparity: Float32Array, _right: GreyImage) -> Float32Array:
        shift: Float32Array = -amplitude_px * np.sin(2.0 * np.pi * disparity)
        return shift

    return shift_px


def glossy(per_octave_px: float) -> Callable[[Float32Array, GreyImage], Float32Array]:
    """Return the shift of ground whose strong texture seems to lie deeper or higher than it does, as gloss has it.

    Contrast is that of the picture as the camera gives it, binned; texture of `_MATT` is seen where it is.
    """

    def shift_px(_disparity: Float32Array, right: GreyImage) -> Float32Array:
        grey = cv2.resize(right, (WIDTH_PX // 2, HEIGHT_PX // 2), interpolation=cv2.INTER_AREA).astype(np.float32)
        box = (_CONTRAST_BOX, _CONTRAST_BOX)
        variance = cv2.sqrBoxFilter(grey, cv2.CV_32F, box) - cv2.blur(grey, box) ** 2
        wide = cv2.blur(variance, (4 * _CONTRAST_BOX, 4 * _CONTRAST_BOX))
        shift = per_octave_px * 0.5 * np.log2(np.maximum(wide, 1.0) / _MATT**2)
        return np.asarray(cv2.resize(shift, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_LINEAR), np.float32)

    return shift_px


def dirty(shift_px: float, centre: tuple[float, float]) -> ImageChange:
    """Return a drop on the right lens: within it the image is displaced and out of focus."""
    u, v = np.meshgrid(np.arange(WIDTH_PX, dtype=np.float32), np.arange(HEIGHT_PX, dtype=np.float32))
    away = ((u - centre[0] * WIDTH_PX) / 230.0) ** 2 + ((v - centre[1] * HEIGHT_PX) / 150.0) ** 2
    drop = np.exp(-(away**2)).astype(np.float32)

    def change(_k: int, left: GreyImage, right: GreyImage) -> tuple[GreyImage, GreyImage]:
        soft = cv2.GaussianBlur(right, (0, 0), 2.0)
        bent = cv2.remap(soft, u + 2.0 * shift_px * drop, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        mixed = drop * bent + (1.0 - drop) * right
        return left, np.rint(mixed).astype(np.uint8)

    return change
