"""The recipe of docs/hardware.md: a recording beside a laboratory whose clock is wrong, to a millisecond."""

import json
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from calib.files import format_calibration
from cli.replay import replay
from daemon.recorder import Recorder, RecordingInfo
from discrepancy import explain
from impedance.recording.table import write_columns
from messages import Source, StereoFrame
from perception import so3
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer, WornCamera
from systems import imu
from systems.imu.recording import REFERENCE_COLUMNS, REFERENCE_FILE

START_NS = 10_000_000_000
UTC_OFFSET_NS = 1_795_000_000_123_456_789
SECONDS = 20.0
TRIED = ("time_offset", "gyro_bias", "acc_bias", "frame_rotation", "lever_arm")


@pytest.mark.long
@pytest.mark.parametrize("lab_ahead_s", [0.137, -0.032])
def test_a_laboratory_s_clock_is_found_from_the_motion(tmp_path: Path, lab_ahead_s: float) -> None:
    wearer = SimulatedWearer(1003, scenario("turns"), START_NS)
    _record(wearer, tmp_path / "walk.mcap")
    replay(tmp_path / "walk.mcap", imu=tmp_path / "lab", json=tmp_path / "summary.json")
    told = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    first_utc_s = datetime.fromisoformat(told["imu_start_utc"]).timestamp()
    _write_reference(wearer, tmp_path / "lab" / REFERENCE_FILE, first_utc_s, lab_ahead_s)
    verdict = explain(imu.load(tmp_path / "lab"), None, seed=1, only=TRIED).verdict
    causes = {cause.name: cause for cause in verdict.causes}
    found = causes["time_offset"].parameters["value_s"]
    assert found.value == pytest.approx(-lab_ahead_s, abs=1e-3)


class _NoCamera:
    """Takes no picture."""

    def __init__(self) -> None:
        self.shutter = self

    def due_ns(self, _k: int) -> int:
        return 2**62

    def frames(self, _count: int) -> Iterator[tuple[StereoFrame, object]]:
        return iter(())


def _record(wearer: SimulatedWearer, path: Path) -> None:
    info = RecordingInfo(
        device="bench",
        source=Source.SIMULATED,
        calibration_text=format_calibration(wearer.calibration),
        configuration_text="",
        utc_offset_ns=UTC_OFFSET_NS,
    )
    recorder = Recorder(path, info)
    for message in wearer.offline_inputs(SECONDS, cast(WornCamera, _NoCamera())):
        recorder.offer(message)
        recorder.drain(timeout_s=0.0)
    recorder.close()


def _write_reference(wearer: SimulatedWearer, path: Path, first_utc_s: float, lab_ahead_s: float) -> None:
    """Write what cameras of a laboratory saw of the unit at 120 Hz, with their noise, on their clock."""
    t_ns = START_NS + np.arange(0, round(1e9 * SECONDS), round(1e9 / 120))
    pose = wearer.gait.at(t_ns)
    random = np.random.default_rng(1003)
    turned = [so3.quaternion_from_matrix(R @ so3.exp(random.normal(0.0, 5e-4, 3))) for R in pose.R_WB]
    seen_m = pose.p_WB_m + random.normal(0.0, 2e-4, pose.p_WB_m.shape)
    lab_utc_s = 1e-9 * (t_ns + UTC_OFFSET_NS - round(1e9 * first_utc_s)) + lab_ahead_s
    write_columns(path, REFERENCE_COLUMNS, np.column_stack((lab_utc_s, turned, seen_m)))
