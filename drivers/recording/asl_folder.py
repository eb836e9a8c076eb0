"""A folder in the EuRoC/ASL layout as one more device: stereo images, IMU and truth as the data set has them.

    cam0/ cam1/               8-bit PNG or JPEG named by the time in ns, directly or below data/
    imu0.csv | imu0/data.csv  ns, angular rate x y z in rad/s, specific force x y z in m/s²; any rate
    *_sensor.yaml             cam0_sensor.yaml or cam0/sensor.yaml, and so on (read by calib.asl_yaml)
    truth*.csv | state_groundtruth_estimate0/data.csv
                              ns, position x y z in m, quaternion w x y z body to world; further columns are ignored

All of it may stand below mav0/, tables may be gzipped (.gz), lines that begin with # are comments. Source: Burri et
al., "The EuRoC micro aerial vehicle datasets", IJRR 2016.
"""

import heapq
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.protocols import DeviceError
from drivers.recording.asl_tables import Table, read_table
from messages import TOPICS, DropCause, DroppedFrame, FrameHeader, ImuSample, Input, StereoFrame, Tick, vec3
from messages.arrays import FloatArray, GreyImage, IntArray

FRAME_LATENCY_NS = 40_000_000
"""Mid-exposure to arrival, as of a ZED at 60 fps; the folder does not say. IMU samples arrive at their own time."""

START_NS = 1_250_000_000
"""No frame arrives before the IMU has been heard for so long: an attitude needs its first second at rest, and where a
recording begins with its first image there would be none for the images of that second."""

PAIR_TOLERANCE_NS = 5_000_000
TICK_NS = TOPICS["tick"].period_ns
TAIL_NS = 50_000_000
"""Ticks go on for this long after the last arrival, so that nothing is left waiting."""

LONGEST_NS = 24 * 3600 * 1_000_000_000

_IMAGE_ENDS = {".png": b"IEND\xaeB`\x82", ".jpg": b"\xff\xd9", ".jpeg": b"\xff\xd9"}
_IMU_RANK, _FRAME_RANK, _TICK_RANK = range(3)
_IMU_COLUMNS, _TRUTH_COLUMNS = 6, 7
_QUATERNION_TOLERANCE = 0.01


class TruthTrack(NamedTuple):
    """The body's pose: `t_ns` (n,), `q_WB` (n, 4) as w, x, y, z with w ≥ 0, `p_WB_m` (n, 3); W as in the file, z up."""

    t_ns: IntArray
    q_WB: FloatArray
    p_WB_m: FloatArray


class _Shot(NamedTuple):
    """What the cameras took at one time; None where an eye has no image."""

    t_ns: int
    left: Path | None
    right: Path | None


class AslFolder:
    """The recording in the folder `path`.

    Raises DeviceError, one line, for anything missing or unsound in the tables and file names; images are read only
    as they come. `unit` names the folder, `sensor_files` are the sensor yaml files found, by `cam0`, `cam1`, `imu0`;
    `width_px` and `height_px` are the size of the first image, which all must have.
    """

    def __init__(self, path: Path) -> None:
        if not path.is_dir():
            raise DeviceError(f"{path}: is no folder")
        self._root = path / "mav0" if (path / "mav0").is_dir() else path
        self.unit = f"asl-{path.resolve().name}"[:64]
        left, right = (_images(self._root, camera) for camera in ("cam0", "cam1"))
        self._shots = _paired(left, right)
        if not any(shot.left and shot.right for shot in self._shots):
            raise DeviceError(f"{self._root}: no image of cam0 is within 5 ms of one of cam1")
        self._imu = _imu_table(self._root)
        self._check_times()
        self.sensor_files = _sensor_files(self._root)
        self._first = next(iter(left.values()))
        self.height_px, self.width_px = _decoded(self._first).shape

    def inputs(self) -> Iterator[Input]:
        """Yield IMU samples, frames and 100 Hz ticks in the order of their arrival, the same in every run.

        A frame arrives `FRAME_LATENCY_NS` after its stamp, which is cam0's and taken as mid-exposure, or `START_NS`
        after the first IMU sample if that is later; ticks are given while frames are. An image whose
        other eye is missing becomes a `DroppedFrame` (camera_gap). Raises DeviceError at an image that cannot be
        read or has another size than the first.
        """
        t_imu_ns = self._imu.t_ns.tolist()
        first_ns, last_ns = (self._arrival_ns(self._shots[k]) for k in (0, -1))
        lost = _lost_before(self._imu.t_ns)
        arrivals = heapq.merge(
            ((t_ns, _IMU_RANK, k) for k, t_ns in enumerate(t_imu_ns)),
            ((self._arrival_ns(shot), _FRAME_RANK, k) for k, shot in enumerate(self._shots)),
            ((t_ns, _TICK_RANK, 0) for t_ns in range(first_ns, last_ns + TAIL_NS + 1, TICK_NS)),
            key=itemgetter(0, 1),
        )
        for t_ns, rank, k in arrivals:
            if rank == _IMU_RANK:
                yield ImuSample(
                    seq=k,
                    t_sample_ns=t_ns,
                    t_arrival_ns=t_ns,
                    sf_B_mps2=vec3(self._imu.values[k, 3:]),
                    w_WB_B_radps=vec3(self._imu.values[k, :3]),
                    temperature_degC=float("nan"),
                    lost_before=lost[k],
                )
            elif rank == _FRAME_RANK:
                yield self._frame(k, self._shots[k])
            else:
                yield Tick(t_ns=t_ns)

    def truth_attitude(self) -> TruthTrack | None:
        """Return the truth if the folder has one; raises DeviceError if it is unsound."""
        candidates = [
            *sorted(self._root.glob("truth*.csv")),
            *sorted(self._root.glob("truth*.csv.gz")),
            *sorted(self._root.glob("state_groundtruth_estimate0/data.csv*")),
        ]
        if not candidates:
            return None
        if len(candidates) > 1:
            raise DeviceError(f"{self._root}: more than one truth: {', '.join(found.name for found in candidates)}")
        return read_truth(candidates[0])

    def _check_times(self) -> None:
        first_ns, last_ns = self._shots[0].t_ns, self._shots[-1].t_ns
        imu_first_ns, imu_last_ns = int(self._imu.t_ns[0]), int(self._imu.t_ns[-1])
        spans = f"images {first_ns} to {last_ns} ns, IMU {imu_first_ns} to {imu_last_ns} ns"
        if imu_last_ns < first_ns or last_ns < imu_first_ns:
            raise DeviceError(f"{self._root}: images and IMU do not overlap in time: {spans}")
        if max(last_ns, imu_last_ns) - min(first_ns, imu_first_ns) > LONGEST_NS:
            raise DeviceError(f"{self._root}: longer than a day, allowed up to 24 h: {spans}")

    def _arrival_ns(self, shot: _Shot) -> int:
        return max(shot.t_ns + FRAME_LATENCY_NS, int(self._imu.t_ns[0]) + START_NS)

    def _frame(self, seq: int, shot: _Shot) -> StereoFrame | DroppedFrame:
        header = FrameHeader(
            seq=seq,
            t_exposure_ns=shot.t_ns,
            t_arrival_ns=self._arrival_ns(shot),
            exposure_s=float("nan"),
            width_px=self.width_px,
            height_px=self.height_px,
        )
        if shot.left is None or shot.right is None:
            return DroppedFrame(header=header, cause=DropCause.CAMERA_GAP)
        return StereoFrame(header=header, left=self._image(shot.left), right=self._image(shot.right))

    def _image(self, path: Path) -> GreyImage:
        image = _decoded(path)
        height_px, width_px = image.shape
        if (width_px, height_px) != (self.width_px, self.height_px):
            raise DeviceError(
                f"{path}: is {width_px}x{height_px} px, allowed {self.width_px}x{self.height_px} px "
                f"as the first image {self._first.name}"
            )
        image.flags.writeable = False
        return image


def read_truth(path: Path) -> TruthTrack:
    """Return the poses of one table of truth; raises DeviceError, one line, if it is unsound."""
    table = read_table(path, _TRUTH_COLUMNS)
    q_WB = table.values[:, 3:7]
    norms = np.linalg.norm(q_WB, axis=1)
    wrong = np.flatnonzero(np.abs(norms - 1.0) > _QUATERNION_TOLERANCE)
    if wrong.size:
        raise DeviceError(
            f"{path}: line {table.lines[wrong[0]]}: the quaternion has the length {norms[wrong[0]]:.4g}, "
            f"allowed {1 - _QUATERNION_TOLERANCE:g} to {1 + _QUATERNION_TOLERANCE:g}"
        )
    sign = np.where(q_WB[:, 0] < 0, -1.0, 1.0)
    return TruthTrack(table.t_ns, q_WB * (sign / norms)[:, None], table.values[:, :3])


def _images(root: Path, camera: str) -> dict[int, Path]:
    """Return the images of one camera by time, in order."""
    for folder in (root / camera / "data", root / camera):
        found = _images_in(folder) if folder.is_dir() else {}
        if found:
            return found
    raise DeviceError(f"{root}: no image in {camera}/ or {camera}/data/ (PNG or JPEG named by the time in ns)")


def _images_in(folder: Path) -> dict[int, Path]:
    found: dict[int, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in _IMAGE_ENDS or path.name.startswith("."):
            continue
        if not (path.stem.isascii() and path.stem.isdigit() and int(path.stem) < 2**63):
            raise DeviceError(f"{path}: an image's name must be its time in ns")
        t_ns = int(path.stem)
        if t_ns in found:
            raise DeviceError(f"{path}: has the same time as {found[t_ns].name}")
        found[t_ns] = path
    return dict(sorted(found.items()))


def _paired(left: dict[int, Path], right: dict[int, Path]) -> list[_Shot]:
    """Pair images that are each other's nearest in time and within the tolerance; keep the others as lone ones."""
    t_left_ns, t_right_ns = (np.fromiter(images, dtype=np.int64) for images in (left, right))
    nearest_right, nearest_left = _nearest(t_left_ns, t_right_ns), _nearest(t_right_ns, t_left_ns)
    partner = {
        int(t_left_ns[i]): int(t_right_ns[j])
        for i, j in enumerate(nearest_right)
        if nearest_left[j] == i and abs(t_left_ns[i] - t_right_ns[j]) <= PAIR_TOLERANCE_NS
    }
    taken = set(partner.values())
    shots = [
        _Shot(t_ns, path, right[partner[t_ns]]) if t_ns in partner else _Shot(t_ns, path, None)
        for t_ns, path in left.items()
    ]
    shots += [_Shot(t_ns, None, path) for t_ns, path in right.items() if t_ns not in taken]
    return sorted(shots, key=itemgetter(0))


def _nearest(t_ns: IntArray, others_ns: IntArray) -> NDArray[np.intp]:
    """Return, for each time, the index of the nearest of the others; of two equally near ones the earlier."""
    after = np.searchsorted(others_ns, t_ns).clip(0, len(others_ns) - 1)
    before = (after - 1).clip(0)
    return np.where(np.abs(others_ns[before] - t_ns) <= np.abs(others_ns[after] - t_ns), before, after)


def _imu_table(root: Path) -> Table:
    names = ("imu0.csv", "imu0.csv.gz", "imu0/data.csv", "imu0/data.csv.gz")
    for name in names:
        if (root / name).is_file():
            return read_table(root / name, _IMU_COLUMNS)
    raise DeviceError(f"{root}: no IMU: none of {', '.join(names)}")


def _lost_before(t_ns: IntArray) -> list[int]:
    """Return how many samples are missing before each one, measured by the median interval."""
    if len(t_ns) < 2:
        return [0] * len(t_ns)
    intervals = np.diff(t_ns)
    return [0, *(np.rint(intervals / np.median(intervals)).astype(int) - 1).clip(0).tolist()]


def _sensor_files(root: Path) -> dict[str, Path]:
    files: dict[str, Path] = {}
    for sensor in ("cam0", "cam1", "imu0"):
        for path in (
            root / f"{sensor}_sensor.yaml",
            root / sensor / "sensor.yaml",
            root / sensor / f"{sensor}_sensor.yaml",
        ):
            if path.is_file():
                files.setdefault(sensor, path)
    return files


def _decoded(path: Path) -> GreyImage:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DeviceError(f"{path}: {error.strerror}") from error
    if _IMAGE_ENDS[path.suffix.lower()] not in data[-64:]:
        raise DeviceError(f"{path}: the image is cut off")
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    if image is None:
        raise DeviceError(f"{path}: cannot be read as an image")
    if image.dtype != np.uint8:
        raise DeviceError(f"{path}: has {8 * image.itemsize} bits a pixel, allowed 8")
    return np.asarray(image, dtype=np.uint8)
