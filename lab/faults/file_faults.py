"""Faults of files: calibration, configuration and recordings, broken or plausible, and a full disk."""

import shutil
from pathlib import Path

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from calib.files import format_calibration
from calib.seal import sealed
from daemon.config import Configuration, format_configuration
from daemon.recorder import Recorder, RecordingInfo
from drivers.can.settings import CanSettings
from drivers.zenoh.settings import SOCKET
from lab.faults.daemon_process import DaemonPlan
from lab.faults.fault import MOTION_FLAG_S, USB_RECOVERY_S, Command, Expect, Fault, Layer, Restart
from messages import Calibration, Source, matrix3, vec3
from messages.arrays import FloatArray

_FULL_AFTER_BYTES = 20_000_000
replace = msgspec.structs.replace


def _files(folder: Path, calibration: str, configuration: str) -> list[str]:
    (folder / "calibration.yaml").write_text(calibration, encoding="utf-8")
    (folder / "gaiteyes.toml").write_text(configuration, encoding="utf-8")
    return ["run", "--config", str(folder / "gaiteyes.toml"), "--seconds", "1"]


def _calibration_text(plan: DaemonPlan) -> str:
    return sealed(format_calibration(plan.calibration or plan.wearer().calibration))


def _damaged_calibration(plan: DaemonPlan, folder: Path) -> list[str]:
    text = _calibration_text(plan).replace("height_px: 7", "height_px: 8", 1)
    return _files(folder, text, format_configuration(Configuration()))


def _broken_calibration(plan: DaemonPlan, folder: Path) -> list[str]:
    return _files(folder, sealed(_calibration_text(plan)[:400] + "\n  - : ["), format_configuration(Configuration()))


def _impossible_calibration(plan: DaemonPlan, folder: Path) -> list[str]:
    text = sealed(_calibration_text(plan).replace("fx_px: ", "fx_px: -", 1))
    return _files(folder, text, format_configuration(Configuration()))


def _broken_configuration(plan: DaemonPlan, folder: Path) -> list[str]:
    return _files(folder, _calibration_text(plan), "[zenoh\nlisten = 7447")


def _unknown_setting(plan: DaemonPlan, folder: Path) -> list[str]:
    return _files(folder, _calibration_text(plan), format_configuration(Configuration()) + "\n[imo]\nbus = 1\n")


def _garbage_recording(_plan: DaemonPlan, folder: Path) -> list[str]:
    path = folder / "walk.mcap"
    path.write_bytes(np.random.default_rng(3).bytes(200_000))
    return ["replay", str(path)]


def _truncated_recording(plan: DaemonPlan, folder: Path) -> list[str]:
    path, wearer = folder / "walk.mcap", plan.wearer()
    info = RecordingInfo(
        device="campaign",
        source=Source.SIMULATED,
        calibration_text=format_calibration(wearer.calibration),
        configuration_text=format_configuration(Configuration()),
    )
    recorder = Recorder(path, info)
    for message in wearer.offline_inputs(1.0):
        recorder.offer(message)
        recorder.drain(timeout_s=0.0)
    recorder.close()
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size * 3 // 5)
    return ["replay", str(path)]


def _toed_in(plan: DaemonPlan, _folder: Path) -> DaemonPlan:
    found = plan.wearer().calibration
    turn = Rotation.from_rotvec([0.0, np.deg2rad(1.0), 0.0]).as_matrix()
    return replace(plan, calibration=_with_pair(found, turn @ np.array(found.stereo.X_RL.R), 1.0))


def _longer_baseline(plan: DaemonPlan, _folder: Path) -> DaemonPlan:
    found = plan.wearer().calibration
    return replace(plan, calibration=_with_pair(found, np.array(found.stereo.X_RL.R), 1.02))


def _with_pair(found: Calibration, R_RL: FloatArray, scale: float) -> Calibration:
    X_RL = replace(found.stereo.X_RL, R=matrix3(R_RL), p_m=vec3(scale * np.array(found.stereo.X_RL.p_m)))
    return replace(found, stereo=replace(found.stereo, X_RL=X_RL))


def _disk_full(plan: DaemonPlan, folder: Path) -> DaemonPlan:
    return replace(plan, record=folder / "walk.mcap", largest_file_bytes=_FULL_AFTER_BYTES)


def _folder_removed(plan: DaemonPlan, folder: Path) -> DaemonPlan:
    (folder / "removed").mkdir()
    return replace(plan, record=folder / "removed" / "walk.mcap")


def _remove_folder(folder: Path) -> None:
    shutil.rmtree(folder / "removed")


def _no_space(plan: DaemonPlan, folder: Path) -> DaemonPlan:
    """Return a plan that disturbs the daemon that runs in nothing."""
    return replace(plan, record=Path("/dev/full"), zenoh=f"{SOCKET}{folder / 'other.sock'}", can=CanSettings())


def _command(name: str, how: str, act: Command) -> Fault:
    return Fault(name=name, layer=Layer.FILES, how=how, act=act, expect=Expect.REFUSED)


FILE_FAULTS = (
    _command("file-calibration-damaged", "one digit of the calibration has changed", Command(_damaged_calibration)),
    _command("file-calibration-broken", "the calibration is not valid YAML", Command(_broken_calibration)),
    _command(
        "file-calibration-impossible", "the calibration has a negative focal length", Command(_impossible_calibration)
    ),
    _command("file-configuration-broken", "the configuration is not valid TOML", Command(_broken_configuration)),
    _command("file-configuration-unknown", "the configuration names an unknown table", Command(_unknown_setting)),
    _command("file-recording-garbage", "a replay of a file of 200 kB of random bytes", Command(_garbage_recording)),
    _command(
        "file-recording-truncated",
        "a replay of a recording that ends after three fifths of its bytes",
        Command(_truncated_recording, codes=(3,), work="replaying"),
    ),
    Fault(
        name="zenoh-port-taken",
        layer=Layer.ZENOH,
        how="a second daemon is started on the socket of the one that runs",
        act=Restart(lambda plan, _folder: plan),
        expect=Expect.REFUSED,
    ),
    Fault(
        name="file-calibration-toe-in",
        layer=Layer.FILES,
        how="the calibrated pair is toed in by 1°",
        act=Restart(_toed_in),
        expect=Expect.FLAGGED,
        limit_s=MOTION_FLAG_S,
        hold_s=10.0,
        recovery_s=USB_RECOVERY_S,
        in_motion=True,
    ),
    Fault(
        name="file-calibration-baseline",
        layer=Layer.FILES,
        how="the calibrated baseline is 2 % too long",
        act=Restart(_longer_baseline),
        expect=Expect.HONEST,
        hold_s=10.0,
        recovery_s=USB_RECOVERY_S,
        in_motion=True,
        reason="every pair of images agrees with it; some steps of walking tell the scale, until then 2 % of "
        "the height are within what counts as right",
    ),
    Fault(
        name="file-disk-full",
        layer=Layer.FILES,
        how="the recording reaches the largest size the file system allows (EFBIG) after half a second",
        act=Restart(_disk_full),
        expect=Expect.TOLERATED,
        hold_s=3.0,
        recovery_s=USB_RECOVERY_S,
        reason="recording stops, logs it and counts; ground estimates go on",
    ),
    Fault(
        name="file-no-space",
        layer=Layer.FILES,
        how="a daemon is started with a recording on a full disk (ENOSPC)",
        act=Restart(_no_space),
        expect=Expect.REFUSED,
    ),
    Fault(
        name="file-folder-removed",
        layer=Layer.FILES,
        how="the folder of the recording is removed while it is written",
        act=Restart(_folder_removed, _remove_folder),
        expect=Expect.TOLERATED,
        hold_s=3.0,
        recovery_s=USB_RECOVERY_S,
        reason="what is written is lost; ground estimates go on",
    ),
)
