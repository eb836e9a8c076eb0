"""Units of known errors to be calibrated: an IMU laid on its faces by hand, a board seen by a known pair."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from calib.imu.log import ImuLog
from calib.imu.rests import Rest
from calib.stereo.board import Board
from calib.stereo.bundle import SeenPair
from messages import Lens, StereoCalibration
from messages.arrays import FloatArray, GreyImage
from messages.constants import STANDARD_GRAVITY_MPS2
from perception.depth.rectify import intrinsics

FACES = np.concatenate((np.eye(3), -np.eye(3)))
BETWEEN = np.array([(1, 1, 0), (1, -1, 0), (-1, 0, 1), (0, 1, 1), (0, -1, 1), (-1, 0, -1), (1, 1, 1), (-1, 1, -1)])
POSES = np.concatenate((FACES, BETWEEN / np.linalg.norm(BETWEEN, axis=1)[:, None]))
RATE_HZ, STILL_S, TURN_S = 100.0, 3.0, 1.5


def symmetric(values: FloatArray) -> FloatArray:
    """Return S (3, 3) of the last six of the accelerometer's nine values."""
    sx, sy, sz, xy, xz, yz = values[3:]
    return np.array(((1.0 + sx, xy, xz), (xy, 1.0 + sy, yz), (xz, yz, 1.0 + sz)))


def drawn_values(rng: np.random.Generator) -> FloatArray:
    """Return nine values of an accelerometer within its data sheet."""
    return rng.normal(0.0, (0.03, 0.03, 0.04, 0.015, 0.015, 0.015, 0.007, 0.007, 0.007))


def drawn_rests(rng: np.random.Generator, values: FloatArray, poses: FloatArray, std: float = 3e-4) -> list[Rest]:
    """Return one rest a pose (n, 3), leaning by some degrees, with noise `std` (g) of each mean."""
    S, bias = symmetric(values), values[:3]
    rests = []
    for number, up in enumerate(poses):
        leaning = Rotation.from_rotvec(rng.normal(0.0, 0.05, 3)).apply(up)
        sf = np.linalg.solve(S, leaning) + bias + rng.normal(0.0, std, 3)
        rests.append(
            Rest(
                log=0,
                first=number * 400,
                last=number * 400 + 300,
                sf=STANDARD_GRAVITY_MPS2 * sf,
                w=np.zeros(3),
                sf_std=STANDARD_GRAVITY_MPS2 * std,
                w_std=1e-4,
                temperature_degC=30.0,
                seconds=3.0,
            )
        )
    return rests


def drawn_log(
    rng: np.random.Generator, values: FloatArray, gyro: FloatArray, w_bias: FloatArray, poses: FloatArray
) -> ImuLog:
    """Return the log of an IMU that rests in each pose and is turned to the next by the shortest way and a twist.

    The corrected rate is `gyro` (3, 3) times the measured one less `w_bias`.
    """
    turned, rates, still = Rotation.identity(), [], []
    attitudes = [turned]
    for number, up in enumerate(poses):
        now = turned.inv().apply((0.0, 0.0, 1.0))
        axis = np.cross(now, up)
        angle = np.arctan2(np.linalg.norm(axis), now @ up)
        if np.linalg.norm(axis) < 1e-9:
            axis = np.array((now[1], -now[0], 0.0)) if abs(now[2]) < 0.9 else np.array((1.0, 0.0, 0.0))
        step = -angle * axis / np.linalg.norm(axis)
        whole = Rotation.from_rotvec(step) * Rotation.from_rotvec(0.6 * np.sin(number) * up)
        count = round(TURN_S * RATE_HZ)
        share = np.sin(np.linspace(0.0, np.pi, count)) ** 2
        share /= share.sum()
        rotvec = whole.as_rotvec()
        # the body turns about its own axes by `rotvec` in all: R ← R exp(part)
        for part in share:
            turned = turned * Rotation.from_rotvec(part * rotvec)
            attitudes.append(turned)
            rates.append(part * rotvec * RATE_HZ)
            still.append(False)
        for _ in range(round(STILL_S * RATE_HZ)):
            attitudes.append(turned)
            rates.append(np.zeros(3))
            still.append(True)
    up_B = Rotation.concatenate(attitudes[:-1]).inv().apply((0.0, 0.0, 1.0))
    w_B = np.array(rates)
    n = len(w_B)
    sf = np.linalg.solve(symmetric(values), up_B.T).T + values[:3] + rng.normal(0.0, 3e-3, (n, 3))
    w = np.linalg.solve(gyro, w_B.T).T + w_bias + rng.normal(0.0, np.radians(0.07), (n, 3))
    return ImuLog("bench", np.arange(n) / RATE_HZ, STANDARD_GRAVITY_MPS2 * sf, w, np.full(n, 31.0))


def drawn_views(
    rng: np.random.Generator, stereo: StereoCalibration, board: Board, count: int, noise_px: float, bulge_m: float = 0.0
) -> list[SeenPair]:
    """Return views with all corners inside both pictures, near and far, everywhere and tilted up to 45°."""
    points = board.points
    middle = points.mean(axis=0)
    reach = np.linalg.norm(points[0] - middle)
    points[:, 2] += bulge_m * (1.0 - (np.linalg.norm(points - middle, axis=1) / reach) ** 2)
    size = np.array((stereo.left.width_px, stereo.left.height_px))
    views = list[SeenPair]()
    while len(views) < count:
        z_m = rng.uniform(0.45, 1.0)
        across = z_m * np.array((rng.uniform(-0.75, 0.85), rng.uniform(-0.42, 0.42), 1.0))
        R = Rotation.from_rotvec(rng.normal(0.0, np.radians((25.0, 25.0, 10.0)))).as_matrix()
        in_left = (points - middle) @ R.T + across
        in_right = in_left @ np.array(stereo.X_RL.R).T + np.array(stereo.X_RL.p_m)
        left, right = (seen(lens, each) for lens, each in ((stereo.left, in_left), (stereo.right, in_right)))
        if all(((px > 5.0) & (px < size - 6.0)).all() for px in (left, right)):
            noise = rng.normal(0.0, noise_px, (2, *left.shape))
            ids = np.arange(len(points), dtype=np.int64)
            views.append(SeenPair(f"{len(views)}", ids, left + noise[0], right + noise[1]))
    return views


def seen(lens: Lens, points: FloatArray) -> FloatArray:
    """Return where (n, 2) a lens sees points (n, 3) of its camera."""
    px = cv2.projectPoints(points[:, None], np.zeros(3), np.zeros(3), intrinsics(lens), np.array(lens.distortion))[0]
    return np.asarray(px[:, 0], dtype=np.float64)


def charuco_picture(board: Board, rng: np.random.Generator) -> tuple[GreyImage, FloatArray]:
    """Return a picture of a ChArUco board, tilted, blurred and with noise, and where its corners truly are."""
    side = 40
    flat = board.charuco().generateImage(((board.columns + 1) * side, (board.rows + 1) * side), marginSize=0)
    height, width = flat.shape
    corners = np.array(((0, 0), (width, 0), (width, height), (0, height)), dtype=np.float32) - 0.5
    to = np.array(((210, 150), (980, 120), (1040, 600), (160, 560)), dtype=np.float32)
    H = cv2.getPerspectiveTransform(corners.astype(np.float32), to)
    large = cv2.warpPerspective(flat, H, (1280, 720), flags=cv2.INTER_AREA, borderValue=255)
    picture = cv2.GaussianBlur(large, (0, 0), 0.8).astype(np.float64) * 0.7 + 30.0 + rng.normal(0.0, 2.0, large.shape)
    y, x = np.mgrid[1 : board.rows + 1, 1 : board.columns + 1]
    on_flat = side * np.stack((x.ravel(), y.ravel()), axis=-1) - 0.5
    true = cv2.perspectiveTransform(on_flat[None].astype(np.float64), H)[0]
    return np.clip(picture, 0, 255).astype(np.uint8), true


def true_values(stereo: StereoCalibration) -> dict[str, float]:
    """Return what a fit calls its quantities, and their true values."""
    names = ("fx_px", "fy_px", "cx_px", "cy_px")
    lenses = {"left": stereo.left, "right": stereo.right}
    told = {f"{eye}.{name}": getattr(lens, name) for eye, lens in lenses.items() for name in names}
    terms = ("k1", "k2", "p1", "p2")
    told |= {f"{eye}.{name}": lens.distortion[k] for eye, lens in lenses.items() for k, name in enumerate(terms)}
    rotvec = Rotation.from_matrix(np.array(stereo.X_RL.R)).as_rotvec()
    told |= dict(zip(("pair.rx_rad", "pair.ry_rad", "pair.rz_rad"), rotvec.tolist(), strict=True))
    return told | dict(zip(("pair.tx_m", "pair.ty_m", "pair.tz_m"), stereo.X_RL.p_m, strict=True))
