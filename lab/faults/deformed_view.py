"""What lies in front of a lens, or how the picture is turned: each function returns one `ImageChange`.

A drop of water, a bent window or a pressed lens deflects light along the gradient of its thickness φ. So what it moves
in the picture is a gradient as well,

    (u, v) = (∂φ/∂x, ∂φ/∂y),                                                                                (1)

and only where φ depends on the column alone does nothing move up or down.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from lab.faults.faulty_camera import ImageChange, Pair
from messages import Lens, StereoCalibration
from messages.arrays import Float32Array, FloatArray
from perception import so3
from perception.depth.rectify import intrinsics, undistorted_rays
from sim_rig.unit import HEIGHT_PX, WIDTH_PX

FOOTHOLD_ROWS, FOOTHOLD_COLUMNS = (340, 640), (460, 820)
"""About where a hip-worn camera shows the ground of the foothold region."""
_SCALE_PX = 180.0
"""Half its width."""


@dataclass(frozen=True)
class Warp:
    """By how many px to the right, `u_px`, and down, `v_px`, (HEIGHT_PX, WIDTH_PX) each, a picture is moved."""

    u_px: FloatArray
    v_px: FloatArray

    @property
    def vertical_px(self) -> float:
        """Return by how much what the foothold region shows is moved up or down, at most, about the mean."""
        return _about_mean(self.v_px)

    @property
    def along_rows_px(self) -> float:
        """Return the same along the rows."""
        return _about_mean(self.u_px)

    def of_size(self, most_px: float) -> "Warp":
        """Return the same warp with `most_px` as the longest move within the foothold region."""
        times = most_px / float(np.hypot(_in_region(self.u_px), _in_region(self.v_px)).max())
        return Warp(times * self.u_px, times * self.v_px)

    def with_vertical(self, most_px: float) -> "Warp":
        """Return the same along the rows, with `most_px` of vertical part."""
        return Warp(self.u_px, self.v_px * (most_px / self.vertical_px if most_px else 0.0))


def _in_region(field: FloatArray) -> FloatArray:
    return field[slice(*FOOTHOLD_ROWS), slice(*FOOTHOLD_COLUMNS)]


def _about_mean(field: FloatArray) -> float:
    region = _in_region(field)
    return float(np.abs(region - region.mean()).max())


def drop(chance: np.random.Generator) -> Warp:
    """Return (1) of a drop somewhere on the foothold region: a bump of 60 to 150 px."""
    x0, y0 = chance.uniform(*FOOTHOLD_COLUMNS), chance.uniform(*FOOTHOLD_ROWS)
    size_px = chance.uniform(60.0, 150.0)
    y, x = np.mgrid[:HEIGHT_PX, :WIDTH_PX].astype(np.float64)
    x, y = (x - x0) / size_px, (y - y0) / size_px
    bump = np.exp(0.5 - 0.5 * (x * x + y * y))
    return Warp(-x * bump, -y * bump)


def bent(chance: np.random.Generator) -> Warp:
    """Return (1) of a bent window: a thickness that is a polynomial of the third order."""
    xx, xy, yy, xxx, xxy, xyy, yyy = chance.standard_normal(7)
    y, x = np.mgrid[:HEIGHT_PX, :WIDTH_PX].astype(np.float64)
    x, y = (x - np.mean(FOOTHOLD_COLUMNS)) / _SCALE_PX, (y - np.mean(FOOTHOLD_ROWS)) / _SCALE_PX
    u = 2 * xx * x + xy * y + 3 * xxx * x * x + 2 * xxy * x * y + xyy * y * y
    v = xy * x + 2 * yy * y + xxy * x * x + 2 * xyy * x * y + 3 * yyy * y * y
    return Warp(u, v)


def stretched(most_px: float) -> Warp:
    """Return (1) of a window bent about the vertical: a thickness that grows with the square of the column."""
    x = (np.arange(float(WIDTH_PX)) - np.mean(FOOTHOLD_COLUMNS)) / _SCALE_PX
    return Warp(np.tile(most_px * x, (HEIGHT_PX, 1)), np.zeros((HEIGHT_PX, WIDTH_PX)))


def warped(warp: Warp, *, left: bool) -> ImageChange:
    """One eye's picture moved by `warp`."""
    y, x = np.mgrid[:HEIGHT_PX, :WIDTH_PX].astype(np.float32)
    return _moved((x - warp.u_px).astype(np.float32), (y - warp.v_px).astype(np.float32), left=left)


def _moved(columns: Float32Array, rows: Float32Array, *, left: bool) -> ImageChange:
    """One eye's picture with each pixel (height, width) taken from these columns and rows."""
    at, between = cv2.convertMaps(columns, rows, cv2.CV_16SC2)

    def change(pair: Pair) -> Pair:
        moved = cv2.remap(pair[0 if left else 1], at, between, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return (moved.astype(np.uint8), pair[1]) if left else (pair[0], moved.astype(np.uint8))

    return change


def covered(side: str, *, left: bool) -> ImageChange:
    """Half of one eye's picture dark, "left", "right", "upper" or "lower", with an edge that is out of focus."""
    y, x = np.mgrid[:HEIGHT_PX, :WIDTH_PX]
    across = {
        "left": WIDTH_PX / 2 - x,
        "right": x - WIDTH_PX / 2,
        "upper": HEIGHT_PX / 2 - y,
        "lower": y - HEIGHT_PX / 2,
    }
    light = 1.0 / (1.0 + np.exp(across[side] / _EDGE_PX))
    return _darkened(light, left=left)


def blurred(width_px: int, *, left: bool) -> ImageChange:
    """Grease on one lens: a box blur of `width_px`."""

    def change(pair: Pair) -> Pair:
        eye = cv2.blur(pair[0 if left else 1], (width_px, width_px)).astype(np.uint8)
        return (eye, pair[1]) if left else (pair[0], eye)

    return change


def dirty(chance: np.random.Generator, *, left: bool) -> ImageChange:
    """Splashes of mud on the foothold region of one eye, each out of focus."""
    light = np.ones((HEIGHT_PX, WIDTH_PX))
    y, x = np.mgrid[:HEIGHT_PX, :WIDTH_PX]
    for _ in range(int(chance.integers(2, 7))):
        x0, y0, radius_px = (
            chance.uniform(*FOOTHOLD_COLUMNS),
            chance.uniform(*FOOTHOLD_ROWS),
            chance.uniform(20.0, 90.0),
        )
        off_px = np.hypot(x - x0, y - y0) - radius_px
        light *= 1.0 - chance.uniform(0.6, 1.0) / (1.0 + np.exp(off_px / (0.25 * radius_px)))
    return _darkened(light, left=left)


def _darkened(light: FloatArray, *, left: bool) -> ImageChange:
    """One eye's picture behind something dark that lets `light` (HEIGHT_PX, WIDTH_PX) through, 0 to 1."""

    def change(pair: Pair) -> Pair:
        eye = (pair[0 if left else 1] * light + _DARK * (1.0 - light)).astype(np.uint8)
        return (eye, pair[1]) if left else (pair[0], eye)

    return change


def drawn(
    kind: str, size: str, chance: np.random.Generator, stereo: StereoCalibration
) -> tuple[ImageChange, Warp | None]:
    """Draw what happens to one eye, or how the pictures turn over, and the warp where it is one.

    `kind` is "drop", "bent", "thin" and "rows" (either of the two with 0.3 px, with no vertical part), "stretched",
    "toed" and "rolled", "blur", "half" covered, "dirt", "mirrored", "upside" down, "turned" round or "aligned"; `size`
    is in px of the raw picture, in degrees for an eye that is toed or rolled, or what of the aligned pictures is turned
    over. Raises KeyError for another kind.
    """
    left = bool(chance.integers(2))
    if kind in ("drop", "bent", "thin", "rows"):
        make = drop if kind == "drop" or (kind != "bent" and chance.integers(2)) else bent
        warp = make(chance).of_size(float(size))
        warp = warp.with_vertical({"thin": 0.3, "rows": 0.0}[kind]) if kind in ("thin", "rows") else warp
        return warped(warp, left=left), warp
    if kind == "stretched":
        warp = stretched(float(size))
        return warped(warp, left=left), warp
    if kind in ("toed", "rolled"):
        axis = np.array([0.0, 1.0, 0.0] if kind == "toed" else [0.0, 0.0, 1.0])
        turn = float(chance.choice([-1.0, 1.0])) * np.radians(float(size)) * axis
        return turned_eye(stereo, so3.exp(turn), left=left), None
    if kind == "blur":
        return blurred(int(size), left=left), None
    if kind == "half":
        return covered(str(chance.choice(["left", "right", "upper", "lower"])), left=left), None
    if kind == "dirt":
        return dirty(chance, left=left), None
    if kind == "aligned":
        return turned_over(stereo, across=size != "upside-down", down=size != "mirrored"), None
    return {"mirrored": mirrored, "upside": upside_down, "turned": turned_round}[kind], None


def mirrored(pair: Pair) -> Pair:
    """Left and right exchanged within the whole buffer: the eyes, too, change places."""
    left, right = (np.ascontiguousarray(picture[:, ::-1]) for picture in pair)
    return right, left


def upside_down(pair: Pair) -> Pair:
    """Rows in the opposite order, in both pictures."""
    left, right = (np.ascontiguousarray(picture[::-1]) for picture in pair)
    return left, right


def turned_round(pair: Pair) -> Pair:
    """The whole buffer turned by 180°, as a camera does that is set up to hang from a ceiling."""
    return upside_down(mirrored(pair))


def turned_over(stereo: StereoCalibration, *, across: bool, down: bool) -> ImageChange:
    """The rectified pictures turned over, about their centre, so that the eyes still see everything on one row.

    With `across` the eyes change places.
    """
    turn = np.array([-1.0 if across else 1.0, -1.0 if down else 1.0, 1.0])
    R_RL, p_R = np.array(stereo.X_RL.R), np.array(stereo.X_RL.p_m)
    x_C = -R_RL.T @ p_R / np.linalg.norm(p_R)
    y_C = np.cross([0.0, 0.0, 1.0], x_C)
    R_CL = np.array([x_C, y_C / np.linalg.norm(y_C), np.cross(x_C, y_C / np.linalg.norm(y_C))])
    eyes = ((stereo.left, R_CL), (stereo.right, R_CL @ R_RL.T))
    maps = [_seen_by(eyes[1 - k if across else k], _rays(eyes[k]) * turn) for k in (0, 1)]

    def change(pair: Pair) -> Pair:
        before = (pair[1], pair[0]) if across else pair
        left, right = (
            cv2.remap(eye, *at, cv2.INTER_LINEAR).astype(np.uint8) for eye, at in zip(before, maps, strict=True)
        )
        return left, right

    return change


def turned_eye(stereo: StereoCalibration, R: FloatArray, *, left: bool) -> ImageChange:
    """One eye turned by R (3, 3) about its optical centre, as by a knock: the calibration does not know."""
    lens = stereo.left if left else stereo.right
    return _moved(*_seen_by((lens, R), _rays((lens, np.eye(3)))), left=left)


def _rays(eye: tuple[Lens, FloatArray]) -> FloatArray:
    """Return the rays (height, width, 3), z = 1, of a lens turned by R (3, 3)."""
    lens, R = eye
    rays = undistorted_rays(lens, np.arange(float(lens.width_px)), np.arange(float(lens.height_px))) @ R.T
    along: FloatArray = rays / rays[..., 2:]
    return along


def _seen_by(eye: tuple[Lens, FloatArray], rays: FloatArray) -> tuple[Float32Array, Float32Array]:
    """Return the columns and rows where a lens turned by R (3, 3) shows `rays`."""
    lens, R = eye
    points, still = (rays @ R).reshape(-1, 1, 3), np.zeros(3)
    at, _ = cv2.projectPoints(points, still, still, intrinsics(lens), np.array(lens.distortion))
    columns, rows = at.reshape(*rays.shape[:2], 2).astype(np.float32).transpose(2, 0, 1)
    return columns, rows


_EDGE_PX = 12.0
_DARK = 12.0
