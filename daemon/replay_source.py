"""What `gaiteyes replay` reads: a recording with its own calibration, or a folder with sensor files."""

from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec

from calib.asl_yaml import load_asl_calibration
from calib.files import check_frame_size, parse_calibration
from daemon.config import Configuration, parse_configuration
from daemon.state_file import parse_learnt
from drivers.recording.asl_folder import AslFolder, TruthTrack
from drivers.recording.recording import McapRecording
from messages import GroundTruth, Input, Learnt, UnitCalibration
from perception.ground.foothold import FootholdSettings

FLOOR_OF_A_FOLDER = FootholdSettings(ahead_m=1.5, half_length_m=0.75, half_width_m=0.75)
"""A folder's camera hangs nobody knows how: 0.75 to 2.25 m ahead is floor for most that look at one."""


class ReplaySource(msgspec.Struct, frozen=True, kw_only=True):
    """One opened source. `damage` tells, once `inputs` has ended, why it ended early, if it did.

    `utc_offset_ns` is UTC less the clock of all times, None where that is not known.
    """

    title: str
    calibration: UnitCalibration
    configuration: Configuration
    inputs: Callable[[], Iterator[Input]]
    learnt: Learnt | None = None
    utc_offset_ns: int | None = None
    rig_truth: Callable[[], dict[int, GroundTruth]] = dict
    poses: TruthTrack | None = None
    damage: Callable[[], str | None] = lambda: None


def open_source(path: Path, configuration: Configuration | None) -> ReplaySource:
    """Return the source at `path`; a given `configuration` takes the place of its own. Raises UserError."""
    return _folder(path, configuration) if path.is_dir() else _recording(path, configuration)


def _recording(path: Path, configuration: Configuration | None) -> ReplaySource:
    recording = McapRecording(path)
    learnt = recording.learnt_text
    return ReplaySource(
        title=f"{path}, {recording.source.value}, device {recording.device}",
        calibration=parse_calibration(recording.calibration_text, f"{path}: calibration"),
        configuration=configuration or parse_configuration(recording.configuration_text, f"{path}: configuration"),
        inputs=recording.inputs,
        utc_offset_ns=recording.utc_offset_ns,
        learnt=None if learnt is None else parse_learnt(learnt, f"{path}: learnt"),
        rig_truth=recording.truth,
        damage=lambda: recording.damage,
    )


def _folder(path: Path, configuration: Configuration | None) -> ReplaySource:
    folder = AslFolder(path)
    calibration = load_asl_calibration(folder.sensor_files, folder.unit)
    check_frame_size(calibration, folder.width_px, folder.height_px, str(path))
    return ReplaySource(
        title=f"{path}, {folder.width_px}×{folder.height_px}",
        calibration=calibration,
        configuration=configuration or Configuration(foothold=FLOOR_OF_A_FOLDER),
        inputs=folder.inputs,
        poses=folder.truth_attitude(),
    )
