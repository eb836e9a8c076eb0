"""The check-up: what it says of sound devices, and of each thing that is wrong with them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from daemon import checkup
from daemon.checkup import Finding, Verdict
from daemon.state_file import write_state
from drivers.can.settings import CanSettings
from drivers.imu.mpu6050 import Mpu6050Counters
from drivers.imu.self_test import AxisTest, SelfTest
from drivers.protocols import DeviceError
from messages import DepthScale, DropCause, Frame, FrameHeader, ImuSample, Learnt, StereoFrame
from sim_rig.unit import draw_unit


@dataclass
class LyingImu:
    """Samples 10 ms apart at rest, a few with every read."""

    rate_hz: float = 100.0
    lose: int = 0
    sway_radps: float = 0.0
    gravity_mps2: float = 9.81
    counters: Mpu6050Counters = field(default_factory=Mpu6050Counters)
    filter_delay_s: float = 0.005
    seq: int = 0

    def read(self, timeout_s: float) -> Sequence[ImuSample]:
        return [self._next() for _ in range(5)] if timeout_s > 0.0 else []

    def _next(self) -> ImuSample:
        lost = self.lose if self.seq == 100 else 0
        self.seq += 1 + lost
        return ImuSample(
            seq=self.seq,
            t_sample_ns=round(self.seq * 1e9 / self.rate_hz),
            t_arrival_ns=round(self.seq * 1e9 / self.rate_hz),
            sf_B_mps2=(0.0, 0.0, self.gravity_mps2 + 0.01 * (self.seq % 3)),
            w_WB_B_radps=(self.sway_radps * (-1) ** self.seq, 0.0, 0.0),
            temperature_degC=31.0,
            lost_before=lost,
        )

    def close(self) -> None:
        pass


class SteadyCamera:
    """A frame with every read, as fast as it is asked."""

    def __init__(self, grey: int = 120, dropped: dict[DropCause, int] | None = None, latency_ms: float = 38.0) -> None:
        self.dropped = dropped or {}
        self._image = np.full((48, 64), grey, np.uint8)
        self._latency_ns = round(latency_ms * 1e6)
        self._seq = 0

    def read(self, timeout_s: float) -> Frame | None:
        self._seq += timeout_s > 0.0
        header = FrameHeader(
            seq=self._seq,
            t_exposure_ns=self._seq * 50_000_000,
            t_arrival_ns=self._seq * 50_000_000 + self._latency_ns,
            exposure_s=0.004,
            width_px=64,
            height_px=48,
        )
        return StereoFrame(header=header, left=self._image, right=self._image)

    def close(self) -> None:
        pass


def verdicts(findings: Iterator[Finding]) -> dict[str, Verdict]:
    return {finding.subject: finding.verdict for finding in findings}


@pytest.mark.parametrize(
    ("imu", "stream", "rest"),
    [
        (LyingImu(), Verdict.FINE, Verdict.FINE),
        (LyingImu(rate_hz=90.0), Verdict.FAULT, Verdict.FINE),
        (LyingImu(lose=3), Verdict.FAULT, Verdict.FINE),
        (LyingImu(counters=Mpu6050Counters(bus_errors=2)), Verdict.NOTICE, Verdict.FINE),
        (LyingImu(sway_radps=0.5), Verdict.FINE, Verdict.NOTICE),
        (LyingImu(gravity_mps2=4.9), Verdict.FINE, Verdict.FAULT),
    ],
)
def test_the_imu_is_judged_by_rate_losses_and_gravity(imu: LyingImu, stream: Verdict, rest: Verdict) -> None:
    assert verdicts(checkup.check_imu(imu, 0.05)) == {"IMU stream": stream, "IMU at rest": rest}


@pytest.mark.parametrize(
    ("camera", "stamps", "eye"),
    [
        (SteadyCamera(), Verdict.FINE, Verdict.FINE),
        (SteadyCamera(grey=3), Verdict.FINE, Verdict.FAULT),
        (SteadyCamera(grey=250), Verdict.FINE, Verdict.FAULT),
        (SteadyCamera(latency_ms=-5.0), Verdict.FAULT, Verdict.FINE),
    ],
)
def test_the_camera_is_judged_by_stamps_and_brightness(camera: SteadyCamera, stamps: Verdict, eye: Verdict) -> None:
    found = verdicts(checkup.check_camera(camera, 0.05))
    assert (found["camera stream"], found["camera stamps"]) == (Verdict.FINE, stamps)
    assert found["left eye"] is found["right eye"] is eye


def test_dropped_frames_are_told() -> None:
    stream = next(iter(checkup.check_camera(SteadyCamera(dropped={DropCause.CORRUPT: 2}), 0.05)))
    assert stream.verdict is Verdict.NOTICE
    assert "2 corrupt" in stream.seen


def test_a_failed_axis_is_named() -> None:
    axes = tuple(
        AxisTest(axis=axis, response_lsb=100.0, factory_trim_lsb=100.0, change_share=change, passed=change == 0.0)
        for axis, change in (("accelerometer x", 0.0), ("gyroscope z", 0.6))
    )
    (found,) = checkup.check_self_test(SelfTest(chip="MPU-6050", axes=axes, passed=False))
    assert found.verdict is Verdict.FAULT
    assert found.seen.endswith("failed: gyroscope z")


def test_an_open_bus_without_an_ankle_is_a_notice() -> None:
    (found,) = checkup.check_can(CanSettings(channel="checkup"), 0.05)
    assert found.verdict is Verdict.NOTICE
    assert "nothing is heard of the ankle" in found.seen


NOW = datetime(2026, 11, 22, tzinfo=timezone.utc)


def test_what_the_unit_has_learnt_is_told_with_its_age(tmp_path: Path) -> None:
    calibration, path = draw_unit(1).calibration(np.random.default_rng(1)), tmp_path / "learnt.json"

    def found() -> Finding:
        (finding,) = checkup.check_learnt(path, calibration, NOW)
        return finding

    assert found().verdict is Verdict.FINE
    assert found().seen == f"{path}: nothing yet, the unit has not been used"
    scale = DepthScale(scale=0.0031, std=0.0004, seen_s=7000.0)
    learnt = Learnt(calibration_id=calibration.id, used_s=7200.0, depth_scale=scale)
    write_state(path, learnt, NOW - timedelta(days=3))
    assert found().verdict is Verdict.FINE
    assert found().seen == (f"{learnt.id}: no bias, depth scale +0.31 ± 0.04 %, in 2.0 h of use, written 3.0 days ago")
    path.write_bytes(path.read_bytes()[:-9])
    assert found().verdict is Verdict.NOTICE
    assert found().seen == f"{path}: does not match its checksum"
    assert found().next == "nothing: the unit will learn anew"
    assert path.exists()


def test_a_device_that_fails_is_a_finding() -> None:
    def broken() -> Iterator[Finding]:
        yield Finding(subject="IMU", verdict=Verdict.FINE, seen="so far")
        raise DeviceError("IMU at I2C address 0x68: gone")

    found = list(checkup.guarded("IMU", broken, lambda: "plug it in"))
    assert [finding.verdict for finding in found] == [Verdict.FINE, Verdict.FAULT]
    assert checkup.worst(found) is Verdict.FAULT
    assert found[-1].seen == "IMU at I2C address 0x68: gone"


def test_the_host_is_looked_at() -> None:
    assert {finding.subject for finding in checkup.check_host()} == {"real-time priorities", "locked memory"}
