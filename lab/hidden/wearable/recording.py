"""One recording of a simulated wearer whose unit may differ from what its calibration says.

The rig's own gait, renderer and chip play; the project's own driver and recording file write. Pictures are rendered at
1280×720 and binned to 640×360, as a camera does that reads out two by two; the calibration in the recording says so.
"""

import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import msgspec
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from calib.files import format_calibration
from daemon.config import Configuration, format_configuration
from daemon.recording_file import RecordingFile, RecordingInfo, entries_of
from drivers.imu.mpu6050 import Mpu6050
from drivers.imu.settings import Mpu6050Settings
from messages import TOPICS, Calibration, FrameHeader, ImuSample, Source, StereoFrame, reduced_stereo
from messages.arrays import FloatArray, GreyImage, IntArray
from sim_rig.camera.renderer import Renderer
from sim_rig.imu.i2c_bus import I2cWires
from sim_rig.imu.mpu6050_chip import Mpu6050Chip
from sim_rig.imu.simulated_clock import SimulatedClock
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, Unit
from sim_rig.walk.gait import Gait, Motion
from sim_rig.walk.world import World

ImageChange = Callable[[int, GreyImage, GreyImage], tuple[GreyImage, GreyImage]]

FRAME_NS = TOPICS["frame"].period_ns
FOOTHOLD_M = 0.7
_POLL_NS = 5_000_000
_BOOT_NS = 2_700_000_000
_TRACK_NS = 5_000_000
_TRACK_MARGIN_NS = 150_000_000
_LATENCY_NS = 38_000_000
_MARKER_FILTER_S = 0.015
_NOISE_MARGIN = 256


def _nothing(t_ns: IntArray) -> FloatArray:
    return np.zeros((len(t_ns), 3))


def _no_error(_k: int) -> int:
    return 0


@dataclass(frozen=True)
class Scene:
    """All that makes one recording. `unit` is what truly is, `told` the calibration that the recording carries.

    Callables take the frame's number or instants (n,) in ns. `mount_C_rad` turns the camera in its mount, as a
    rotation vector (n, 3) in the left camera's axes; `vehicle_W_mps2` (n, 3) is how the room itself accelerates, which
    neither `gait` nor the laboratory's reference sees. `stamp_error_ns` is stamp minus true mid-exposure.
    The right camera exposes `lag_right_ns` later; frame k shows what frame `shown(k)` saw; images are exposed for
    `untold_exposure_s` longer than their headers say. `image_changes` alter the finished images, 1280×720; each is
    made for the scene in the end, with all that other causes change.
    `ground_says` turns the true slope and height (n,) into what the laboratory writes down. `reference_noise` is the
    deviation in rad and m, `pixel_noise` that of the images' additional noise in grey levels.
    """

    unit: Unit
    told: Calibration
    world: World
    gait: Gait
    seed: int
    first_ns: int
    frames: int
    exposure_s: Callable[[int], float]
    untold_exposure_s: float = 0.0
    lag_right_ns: int = 0
    stamp_error_ns: Callable[[int], int] = _no_error
    mount_C_rad: Callable[[IntArray], FloatArray] = _nothing
    vehicle_W_mps2: Callable[[IntArray], FloatArray] = _nothing
    unit_at: Callable[[int], Unit] | None = None
    image_changes: tuple[Callable[["Scene"], ImageChange], ...] = ()
    shown: Callable[[int], int] = field(default=lambda k: k)
    ground_says: Callable[[IntArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]] | None = None
    reference_noise: tuple[float, float] = (5e-5, 5e-5)
    pixel_noise: float = 0.0

    @property
    def end_ns(self) -> int:
        """Return when the last frame is exposed."""
        return self.first_ns + self.frames * FRAME_NS

    def true_ns(self, k: int) -> int:
        """Return the true mid-exposure of frame `k`."""
        return self.first_ns + k * FRAME_NS


class _Mounted:
    """The gait as the camera moves: turned in its mount, and `late_ns` later. It passes for a Gait."""

    def __init__(self, scene: Scene, late_ns: int) -> None:
        self._scene, self._late_ns = scene, late_ns
        self._R_BL = np.array(scene.unit.X_BL.R)

    def at(self, t_ns: IntArray) -> Motion:
        t_ns = np.asarray(t_ns) + self._late_ns
        motion = self._scene.gait.at(t_ns)
        turned = Rotation.from_rotvec(self._scene.mount_C_rad(t_ns) @ self._R_BL.T).as_matrix()
        return replace(motion, R_WB=motion.R_WB @ turned)


def write_recording(scene: Scene, folder: Path) -> None:
    """Write walk.mcap, ground.csv and reference.csv into `folder`, which is made here."""
    folder.mkdir(parents=True, exist_ok=True)
    info = RecordingInfo(
        device="wearer",
        source=Source.SIMULATED,
        calibration_text=format_calibration(binned(scene.told)),
        configuration_text=format_configuration(Configuration()),
    )
    file = RecordingFile(folder / "walk.mcap", info)
    for message in _inputs(scene):
        if isinstance(message, StereoFrame):
            file.write(entries_of(message, message.header.t_arrival_ns))
        else:
            file.write(entries_of(message, message.t_arrival_ns))
    file.close()
    _write_tables(scene, folder)


def binned(calibration: Calibration) -> Calibration:
    """Return the calibration of the same unit whose pixels are read out two by two."""
    return msgspec.structs.replace(calibration, stereo=reduced_stereo(calibration.stereo, 2))


def _inputs(scene: Scene) -> Iterator[ImuSample | StereoFrame]:
    """Yield samples and frames in the order in which they arrive."""
    return heapq.merge(_samples(scene), _pairs(scene), key=_arrival)


def _arrival(message: ImuSample | StereoFrame) -> int:
    return message.header.t_arrival_ns if isinstance(message, StereoFrame) else message.t_arrival_ns


def _samples(scene: Scene) -> Iterator[ImuSample]:
    def imu_motion(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        motion = scene.gait.at(t_ns)
        vehicle_B = np.einsum("nij,ni->nj", motion.R_WB, scene.vehicle_W_mps2(t_ns))
        return motion.sf_B_mps2 + vehicle_B, motion.w_WB_B_radps

    clock = SimulatedClock(scene.first_ns - _BOOT_NS)
    chip = Mpu6050Chip(imu_motion, scene.unit.chip, clock, scene.seed)
    wires = I2cWires({0x68: chip}, elapse=clock.sleep)
    imu = Mpu6050(wires.open, settings=Mpu6050Settings(), clock=clock, sleep=clock.sleep)
    imu.open()
    for t_ns in range(clock(), scene.end_ns + FRAME_NS, _POLL_NS):
        clock.advance_to(t_ns)
        yield from imu.read(timeout_s=0.0)
    imu.close()


def _pairs(scene: Scene) -> Iterator[StereoFrame]:
    cameras = _Cameras(scene)
    pixel_noise = _PixelNoise(scene)
    changes = [change(scene) for change in scene.image_changes]
    for k in range(scene.frames):
        left, right = (pixel_noise.on(picture) for picture in cameras.images(scene.shown(k)))
        for change in changes:
            left, right = change(k, left, right)
        true_ns = scene.true_ns(k)
        header = FrameHeader(
            seq=k,
            t_exposure_ns=true_ns + scene.stamp_error_ns(k),
            t_arrival_ns=true_ns + _LATENCY_NS,
            exposure_s=scene.exposure_s(k),
            width_px=WIDTH_PX // 2,
            height_px=HEIGHT_PX // 2,
        )
        size = (WIDTH_PX // 2, HEIGHT_PX // 2)
        halves = (cv2.resize(picture, size, interpolation=cv2.INTER_AREA) for picture in (left, right))
        left, right = (np.asarray(half, np.uint8) for half in halves)
        yield StereoFrame(header=header, left=left, right=right)


class _PixelNoise:
    """Noise of an image: for each a part at a random place of one large field, for drawing it anew takes far longer."""

    def __init__(self, scene: Scene) -> None:
        self._random = np.random.default_rng([scene.seed, 11])
        shape = (HEIGHT_PX + _NOISE_MARGIN, WIDTH_PX + _NOISE_MARGIN)
        self._field = np.float32(scene.pixel_noise) * self._random.standard_normal(shape, dtype=np.float32)

    def on(self, picture: GreyImage) -> GreyImage:
        row, column = self._random.integers(0, _NOISE_MARGIN, 2)
        noise = self._field[row : row + HEIGHT_PX, column : column + WIDTH_PX]
        return cv2.add(picture, noise, dtype=cv2.CV_8U)  # type: ignore[return-value]


class _Cameras:
    """The renderer, or two where the right camera exposes later, or a new one each frame where the unit changes."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._left = self._renderer(scene.unit, 0)
        self._right = self._renderer(scene.unit, scene.lag_right_ns) if scene.lag_right_ns else None
        self._pictures = np.empty((3, HEIGHT_PX, WIDTH_PX), np.uint8)

    def images(self, k: int) -> tuple[GreyImage, GreyImage]:
        scene = self._scene
        left, right, spare = self._pictures
        renderer = self._left if scene.unit_at is None else self._renderer(scene.unit_at(k), 0)
        exposed_s = scene.exposure_s(k) + scene.untold_exposure_s
        renderer.render(scene.true_ns(k), exposed_s, k, left, right)
        if self._right is not None:
            self._right.render(scene.true_ns(k), exposed_s, k, spare, right)
        return left, right

    def _renderer(self, unit: Unit, late_ns: int) -> Renderer:
        camera_gait: Gait = _Mounted(self._scene, late_ns)  # type: ignore[assignment]
        return Renderer(unit, self._scene.world, camera_gait, self._scene.seed)


def _write_tables(scene: Scene, folder: Path) -> None:
    """Write what the laboratory knows: the ground under the left eye and how B moves, 200 times a second."""
    t_ns = np.arange(scene.first_ns - _TRACK_MARGIN_NS, scene.end_ns + _TRACK_MARGIN_NS, _TRACK_NS)
    motion = scene.gait.at(t_ns)
    p_WL = motion.p_WB_m + motion.R_WB @ np.array(scene.unit.X_BL.p_m)
    slope, height_m = ground_below(scene.world, p_WL, motion.R_WB @ np.array(scene.unit.X_BL.R)[:, 2])
    if scene.ground_says is not None:
        slope, height_m = scene.ground_says(t_ns, slope, height_m)
    random = np.random.default_rng([scene.seed, 12])
    angle_rad, position_m = scene.reference_noise

    def tracking(deviation: float, columns: int) -> FloatArray:
        white = random.standard_normal((len(t_ns), columns))
        smooth = gaussian_filter1d(white, _MARKER_FILTER_S / (_TRACK_NS * 1e-9), axis=0)
        noise: FloatArray = deviation * smooth / smooth.std()
        return noise

    turn = Rotation.from_rotvec(tracking(angle_rad, 3)) * Rotation.from_matrix(motion.R_WB)
    q = turn.as_quat(canonical=True, scalar_first=True)
    p = motion.p_WB_m + tracking(position_m, 3)
    normal = np.stack((-np.sin(slope), np.zeros_like(slope), np.cos(slope)), axis=-1)
    height_m = height_m + tracking(position_m, 1)[:, 0]
    t_s = t_ns * 1e-9
    _save(folder / "ground.csv", "t_s,nx,ny,nz,height_m", np.column_stack((t_s, normal, height_m)))
    _save(folder / "reference.csv", "t_s,qw,qx,qy,qz,px_m,py_m,pz_m", np.column_stack((t_s, q, p)))


def _save(path: Path, header: str, table: FloatArray) -> None:
    np.savetxt(path, table, fmt="%.9f", delimiter=",", header=header, comments="")


def ground_below(world: World, p_WL: FloatArray, axis_W: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return slope (n,) and height (n,) of the ground's tangent at the foothold, 0.7 m ahead of the eyes at `p_WL`.

    Between the middles of two pieces the gradient goes over from one to the other.
    """
    ahead = axis_W[:, 0] / np.hypot(axis_W[:, 0], axis_W[:, 1])
    foothold_x = p_WL[:, 0] + FOOTHOLD_M * ahead
    pieces = list(world.between(float(foothold_x.min()) - 1.0, float(foothold_x.max()) + 1.0))
    middles = [0.5 * (piece.x0_m + piece.x1_m) for piece in pieces]
    gradient = np.interp(foothold_x, middles, [np.tan(piece.slope_rad) for piece in pieces])
    edges_x = [*(piece.x0_m for piece in pieces), pieces[-1].x1_m]
    z = np.interp(foothold_x, edges_x, [*(piece.z0_m for piece in pieces), pieces[-1].z1_m])
    return np.arctan(gradient), p_WL[:, 2] - z + gradient * FOOTHOLD_M * ahead
