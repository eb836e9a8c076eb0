"""The wearer's recording as files: the project's own MCAP, the ground that a laboratory measured, and its reference."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from calib.files import parse_calibration
from drivers.recording.recording import McapRecording
from impedance.recording.plain_files import read_table
from messages import Calibration, ImuSample, StereoFrame
from messages.arrays import BoolArray, FloatArray
from messages.errors import UserError

GROUND_COLUMNS = ("t_s", "nx", "ny", "nz", "height_m")
REFERENCE_COLUMNS = ("t_s", "qw", "qx", "qy", "qz", "px_m", "py_m", "pz_m")
LEAST_FRAMES = 30
"""Of a recording: a second and a half, about one stride."""
LEAST_ROWS = 4
"""Of a table, without gaps: a cubic needs as many."""
_UNIT_LENGTH = 0.01
"""By which a unit vector or quaternion may be longer or shorter: two digits of each part leave less."""
_HEIGHT_M = (0.1, 3.0)
"""Of a worn camera above ground: else the unit of the column is another one."""
_UPRIGHT = 0.3
"""Of a ground normal's nz, at least: steeper than 72° nobody walks, and the axes are another frame's."""


@dataclass(frozen=True)
class Track:
    """A table of the laboratory: strictly rising times (n,) in s and values (n, c); NaN where it knows nothing."""

    t_s: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class WearableFiles:
    """What a folder holds. `mcap` is opened anew by who reads it, because its pictures fill the memory.

    `stamp_shift_s` is added to the frames' stamps, where `calibration` is not the one they were stamped with.
    """

    mcap: Path
    calibration: Calibration
    ground: Track
    reference: Track | None
    stamp_shift_s: float = 0.0


def read_files(folder: Path) -> WearableFiles:
    """Return what `folder`, or the folder of the MCAP file that is named, holds.

    Raises UserError with one line that names file, column and row.
    """
    mcap = folder if folder.suffix == ".mcap" else _only_mcap(folder)
    folder = mcap.parent
    calibration = parse_calibration(McapRecording(mcap).calibration_text, f"{mcap} calibration.yaml")
    if not isinstance(calibration, Calibration):
        raise UserError(f"{mcap}: calibration.yaml is of a depth camera; expected a stereo pair")
    reference = folder / "reference.csv"
    return WearableFiles(
        mcap, calibration, _ground(folder / "ground.csv"), _reference(reference) if reference.exists() else None
    )


def read_samples(files: WearableFiles) -> list[ImuSample]:
    """Return the IMU's samples."""
    return [message for message in McapRecording(files.mcap).inputs() if isinstance(message, ImuSample)]


def read_frames(files: WearableFiles) -> Iterator[StereoFrame]:
    """Yield the stereo frames, one in memory at a time."""
    shift_ns = round(1e9 * files.stamp_shift_s)
    for message in McapRecording(files.mcap).inputs():
        if isinstance(message, StereoFrame):
            t_ns = message.header.t_exposure_ns + shift_ns
            header = msgspec.structs.replace(message.header, t_exposure_ns=t_ns)
            yield msgspec.structs.replace(message, header=header)


def with_calibration(files: WearableFiles, calibration: Calibration) -> WearableFiles:
    """Return the files as they would be with another calibration of the unit. Raises UserError for another size."""
    before, after = files.calibration.stereo, calibration.stereo
    sizes = [(each.left.width_px, each.left.height_px) for each in (before, after)]
    if sizes[0] != sizes[1]:
        raise UserError(
            f"{files.mcap}: frames are {sizes[0]} px, calibration '{calibration.unit}' is for {sizes[1]} px"
        )
    shift_s = after.stamp_to_mid_exposure_s - before.stamp_to_mid_exposure_s
    return replace(files, calibration=calibration, stamp_shift_s=files.stamp_shift_s + shift_s)


def _only_mcap(folder: Path) -> Path:
    if not folder.is_dir():
        raise UserError(f"{folder}: is no folder and no MCAP file")
    found = sorted(folder.glob("*.mcap"))
    if len(found) != 1:
        raise UserError(f"{folder}: holds {len(found)} MCAP files; expected one")
    return found[0]


def _ground(path: Path) -> Track:
    track = _track(path, GROUND_COLUMNS)
    length = np.linalg.norm(track.values[:, :3], axis=1)
    _check(path, np.abs(length - 1.0) > _UNIT_LENGTH, "nx, ny, nz", "is no unit vector; allowed length 0.99 to 1.01")
    _check(path, track.values[:, 2] < _UPRIGHT, "nz", f"is below {_UPRIGHT}; expected a normal that points up")
    height_m = track.values[:, 3]
    wrong = (height_m < _HEIGHT_M[0]) | (height_m > _HEIGHT_M[1])
    _check(path, wrong, "height_m", f"is outside {_HEIGHT_M[0]} to {_HEIGHT_M[1]} m")
    return _long_enough(path, track)


def _reference(path: Path) -> Track:
    track = _track(path, REFERENCE_COLUMNS)
    length = np.linalg.norm(track.values[:, :4], axis=1)
    _check(path, np.abs(length - 1.0) > _UNIT_LENGTH, "qw, qx, qy, qz", "is no unit quaternion")
    return _long_enough(path, track)


def _track(path: Path, columns: tuple[str, ...]) -> Track:
    rows = enumerate(read_table(path, columns), start=2)
    table = np.array([[_number(path, row, *cell) for cell in zip(columns, texts, strict=True)] for row, texts in rows])
    _check(path, ~np.isfinite(table[:, 0]), "t_s", "is missing")
    _check(path, np.diff(table[:, 0], prepend=-np.inf) <= 0.0, "t_s", "does not rise")
    return Track(table[:, 0], table[:, 1:])


def _long_enough(path: Path, track: Track) -> Track:
    if np.isfinite(track.values).all(axis=1).sum() < LEAST_ROWS:
        raise UserError(f"{path}: has fewer than {LEAST_ROWS} whole rows")
    return track


def _number(path: Path, row: int, column: str, text: str) -> float:
    try:
        return float(text) if text else math.nan
    except ValueError as error:
        raise UserError(f"{path}: row {row}, column {column} is '{text}', no number") from error


def _check(path: Path, wrong: BoolArray, column: str, problem: str) -> None:
    if wrong.any():
        raise UserError(f"{path}: row {int(np.argmax(wrong)) + 2}, column {column} {problem}")
