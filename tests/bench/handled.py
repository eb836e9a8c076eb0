"""A unit in a person's hands while it is calibrated: laid on its faces and turned, and shown a board."""

import itertools
import time
from collections.abc import Callable, Iterator

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from calib.stereo.board import Board
from drivers.imu.mpu6050 import Mpu6050
from drivers.imu.settings import Mpu6050Settings
from lab.evaluation.calibration_trials import FACES, POSES, seen
from messages import DropCause, FrameHeader, Lens, StereoFrame
from messages.arrays import FloatArray, GreyImage, IntArray
from messages.constants import STANDARD_GRAVITY_MPS2
from perception.depth.rectify import intrinsics
from sim_rig.imu.i2c_bus import I2cWires
from sim_rig.imu.mpu6050_chip import Mpu6050Chip
from sim_rig.imu.mpu6050_signal import Motion
from sim_rig.unit import Unit

ADDRESS = 0x68
_STILL_S, _TURN_S = 2.5, 1.5
_VIEW_FRAMES = 4
_NOISE_GREY = 1.5
_SQUARE_PX = 48
_BLACK, _WHITE = 40.0, 210.0
_TABLE_GREY = 120.0


class HurriedClock:
    """Time that passes while somebody sleeps and at no other time, there `times` as fast as the machine's.

    What is done to the unit then takes no longer than needed, and nothing is lost on a host that is busy.
    """

    def __init__(self, times: float) -> None:
        self._times = times
        self._now_ns = time.monotonic_ns()

    def __call__(self) -> int:
        return self._now_ns

    def sleep(self, duration_s: float) -> None:
        time.sleep(duration_s / self._times)
        self._now_ns += round(1e9 * duration_s)


def laid_on_its_faces(start_ns: int, poses: FloatArray = POSES) -> Motion:
    """Return the motion of a unit that rests with each of `poses` (n, 3), in B, up, and is turned from one to the next
    by hand; first and last it lies."""
    turns, attitudes = list[FloatArray](), [_upright(poses[0])]
    for number, up in enumerate(poses[1:]):
        turn = _shortest(attitudes[-1].inv().apply((0.0, 0.0, 1.0)), up, number)
        turns.append(turn)
        attitudes.append(attitudes[-1] * Rotation.from_rotvec(turn))
    turns.append(np.zeros(3))
    period_s = _STILL_S + _TURN_S

    def motion(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        t_s = 1e-9 * (t_ns - start_ns)
        segment = np.clip(np.floor(t_s / period_s).astype(int), 0, len(turns) - 1)
        phase = np.clip((t_s - segment * period_s - _STILL_S) / _TURN_S, 0.0, 1.0)
        share = phase - np.sin(2.0 * np.pi * phase) / (2.0 * np.pi)
        rate = (1.0 - np.cos(2.0 * np.pi * phase)) / _TURN_S
        turn = np.array(turns)[segment]
        R_WB = Rotation.concatenate([attitudes[k] for k in segment]) * Rotation.from_rotvec(share[:, None] * turn)
        return STANDARD_GRAVITY_MPS2 * R_WB.inv().apply((0.0, 0.0, 1.0)), rate[:, None] * turn

    return motion


def lying(start_ns: int) -> Motion:
    """Return the motion of a unit that lies on a table."""
    return laid_on_its_faces(start_ns, FACES[[2]])


def driven_imu(unit: Unit, motion: Callable[[int], Motion], times: float = 1.0) -> Mpu6050:
    """Return the driver on the unit's chip, not yet opened, with time `times` as fast; `motion` begins now."""
    hurried = HurriedClock(times)
    clock, sleep = (time.monotonic_ns, time.sleep) if times == 1.0 else (hurried, hurried.sleep)
    chip = Mpu6050Chip(motion(clock()), unit.chip, clock, seed=1)
    wires = I2cWires({ADDRESS: chip}, elapse=sleep)
    return Mpu6050(wires.open, address=ADDRESS, settings=Mpu6050Settings(), clock=clock, sleep=sleep)


class BoardCamera:
    """A camera before which a chessboard is held still, in ever new places and near the pictures' edges too.

    It shows the next frame as soon as that is asked for.
    """

    def __init__(self, unit: Unit, board: Board, seed: int = 1) -> None:
        self.dropped: dict[DropCause, int] = {}
        self.closed = False
        self._unit = unit
        self._board = board
        self._chance = np.random.default_rng(seed)
        self._rays = [_rays(lens) for lens in (unit.stereo.left, unit.stereo.right)]
        self._sheet = _sheet(board)
        size = (unit.stereo.left.height_px, unit.stereo.left.width_px)
        self._noise = np.rint(self._chance.normal(0.0, _NOISE_GREY, (3, *size))).astype(np.int16)
        self._frames = self._shown()

    def read(self, timeout_s: float) -> StereoFrame | None:
        """Return the next frame."""
        del timeout_s
        return next(self._frames)

    def close(self) -> None:
        """Note that it was closed."""
        self.closed = True

    def _shown(self) -> Iterator[StereoFrame]:
        lens, number = self._unit.stereo.left, itertools.count(1)
        while True:
            pictures = self._view()
            for take in range(_VIEW_FRAMES):
                left, right = (self._noisy(picture, take + eye) for eye, picture in enumerate(pictures))
                now_ns = time.monotonic_ns()
                header = FrameHeader(
                    seq=next(number),
                    t_exposure_ns=now_ns - 35_000_000,
                    t_arrival_ns=now_ns,
                    exposure_s=0.005,
                    width_px=lens.width_px,
                    height_px=lens.height_px,
                )
                yield StereoFrame(header=header, left=left, right=right)

    def _view(self) -> list[GreyImage]:
        """Return what both eyes see of the board, held where both see all of it."""
        stereo, board, chance = self._unit.stereo, self._board, self._chance
        R_RL, p_RL = np.array(stereo.X_RL.R), np.array(stereo.X_RL.p_m)
        size = np.array((stereo.left.width_px, stereo.left.height_px))
        middle = board.points.mean(axis=0)
        while True:
            z_m = chance.uniform(0.45, 1.0)
            place = z_m * np.array((chance.uniform(-0.75, 0.85), chance.uniform(-0.42, 0.42), 1.0))
            R = Rotation.from_rotvec(chance.normal(0.0, np.radians((25.0, 25.0, 10.0)))).as_matrix()
            poses = [(R, place - R @ middle)]
            poses.append((R_RL @ R, R_RL @ poses[0][1] + p_RL))
            px = [seen(lens, board.points @ Q.T + p) for lens, (Q, p) in zip(self._lenses, poses, strict=True)]
            if all(((each > 12.0) & (each < size - 13.0)).all() for each in px):
                return [self._picture(rays, *pose) for rays, pose in zip(self._rays, poses, strict=True)]

    @property
    def _lenses(self) -> tuple[Lens, Lens]:
        return self._unit.stereo.left, self._unit.stereo.right

    def _picture(self, rays: FloatArray, R: FloatArray, p_m: FloatArray) -> GreyImage:
        """Return what a lens with these rays (h, w, 3) sees of a board that stands so before it."""
        H = np.linalg.inv(np.column_stack((R[:, 0], R[:, 1], p_m)))  # from a ray to x, y of the board, times the depth
        on_board = rays @ H.T
        xy = on_board[..., :2] / on_board[..., 2:]
        x, y = np.moveaxis((xy / self._board.square_m + 2.0) * _SQUARE_PX - 0.5, -1, 0).astype(np.float32)
        sharp = cv2.remap(self._sheet, x, y, cv2.INTER_LINEAR, borderValue=(_TABLE_GREY,))
        picture: GreyImage = cv2.GaussianBlur(sharp, (0, 0), 0.7).astype(np.uint8, copy=False)
        return picture

    def _noisy(self, picture: GreyImage, take: int) -> GreyImage:
        noisy: GreyImage = np.clip(picture + self._noise[take % len(self._noise)], 0, 255).astype(np.uint8)
        return noisy


def _upright(up: FloatArray) -> Rotation:
    """Return an attitude in which `up`, in B, is up."""
    return Rotation.align_vectors([(0.0, 0.0, 1.0)], [up])[0]


def _shortest(now: FloatArray, up: FloatArray, number: int) -> FloatArray:
    """Return the turn in B that brings `up` up where `now` is, by the shortest way and a twist."""
    axis = np.cross(now, up)
    angle = float(np.arctan2(np.linalg.norm(axis), now @ up))
    if np.linalg.norm(axis) < 1e-9:
        axis = np.cross(now, (1.0, 0.0, 0.0) if abs(now[0]) < 0.9 else (0.0, 1.0, 0.0))
    way = Rotation.from_rotvec(-angle * axis / np.linalg.norm(axis)) * Rotation.from_rotvec(0.6 * np.sin(number) * up)
    return way.as_rotvec()


def _rays(lens: Lens) -> FloatArray:
    """Return the direction (h, w, 3) that each pixel sees, z = 1."""
    x, y = np.meshgrid(np.arange(lens.width_px, dtype=np.float64), np.arange(lens.height_px, dtype=np.float64))
    px = np.stack((x.ravel(), y.ravel()), axis=-1)[:, None]
    plain = cv2.undistortPoints(px, intrinsics(lens), np.array(lens.distortion))[:, 0]
    rays: FloatArray = np.column_stack((plain, np.ones(len(plain))))
    return rays.reshape(lens.height_px, lens.width_px, 3)


def _sheet(board: Board) -> GreyImage:
    """Return the board's print: a square more than inner corners each way, and a white edge."""
    y, x = np.mgrid[: board.rows + 3, : board.columns + 3]
    inside = (x > 0) & (y > 0) & (x < board.columns + 2) & (y < board.rows + 2)
    squares = np.where(inside & ((x + y) % 2 == 0), _BLACK, _WHITE)
    return np.kron(squares, np.ones((_SQUARE_PX, _SQUARE_PX))).astype(np.uint8)
