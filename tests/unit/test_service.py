"""The service: devices that fail and return, threads that die, an end that leaves nothing behind."""

import logging
import threading
import time
from collections.abc import Sequence

import numpy as np
import pytest

from daemon.pipeline import Pipeline
from daemon.service import Devices, Service
from daemon.stamping import Stamper
from drivers.mpu6050 import Mpu6050Counters
from drivers.protocols import DeviceError
from messages import (
    Calibration,
    DropCause,
    Estimate,
    FrameHeader,
    GroundPlane,
    Health,
    ImuSample,
    Reason,
    ServiceError,
    Source,
    Stamp,
    StereoFrame,
)
from perception.foothold import FootholdSettings
from sim_rig.unit import draw_unit

SIZE = (720, 1280)


class QuietImu:
    """A device at rest; `failure` is raised by every read while it is set."""

    def __init__(self) -> None:
        self.counters = Mpu6050Counters()
        self.failure: Exception | None = None
        self.closed = False
        self._seq = 0
        self._due_ns = time.monotonic_ns()

    def read(self) -> Sequence[ImuSample]:
        if self.failure is not None:
            raise self.failure
        samples = []
        while self._due_ns <= time.monotonic_ns():
            self._seq += 1
            samples.append(
                ImuSample(
                    seq=self._seq,
                    t_sample_ns=self._due_ns,
                    t_arrival_ns=time.monotonic_ns(),
                    sf_B_mps2=(-6.9, 0.0, 6.9),
                    w_WB_B_radps=(0.0, 0.0, 0.0),
                    temperature_degC=30.0,
                )
            )
            self._due_ns += 10_000_000
        return samples

    def close(self) -> None:
        self.closed = True


class GreyCamera:
    """A camera that sees fog, 20 times a second; `failure` is raised by every read while it is set."""

    def __init__(self) -> None:
        self.dropped: dict[DropCause, int] = {}
        self.failure: Exception | None = None
        self.closed = False
        self._seq = 0
        self._grey = np.full(SIZE, 100, np.uint8)

    def read(self, timeout_s: float) -> StereoFrame | None:
        if self.failure is not None:
            raise self.failure
        time.sleep(min(timeout_s, 0.05))
        self._seq += 1
        now_ns = time.monotonic_ns()
        header = FrameHeader(
            seq=self._seq,
            t_exposure_ns=now_ns - 35_000_000,
            t_arrival_ns=now_ns,
            exposure_s=0.005,
            width_px=SIZE[1],
            height_px=SIZE[0],
        )
        return StereoFrame(header=header, left=self._grey, right=self._grey)

    def close(self) -> None:
        self.closed = True


class Listener:
    """A publisher that keeps what it is given."""

    name = "listener"
    errors = 0

    def __init__(self) -> None:
        self.heard: list[tuple[Estimate, Stamp]] = []
        self.closed = False

    def publish(self, estimate: Estimate, stamp: Stamp) -> None:
        self.heard.append((estimate, stamp))

    def close(self) -> None:
        self.closed = True

    def reasons(self) -> list[Reason]:
        return [estimate.reason for estimate, _ in self.heard if isinstance(estimate, GroundPlane)]


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return draw_unit(1).exact_calibration()


class Rig:
    """One service on fakes."""

    def __init__(self, calibration: Calibration) -> None:
        self.imu, self.camera, self.listener = QuietImu(), GreyCamera(), Listener()
        self.service = Service(
            Pipeline(calibration, FootholdSettings()),
            Devices(imu=self.imu, camera=self.camera),
            [self.listener],
            Stamper("test", "boot", Source.LIVE),
        )

    def until(self, happened: str, condition: object) -> None:
        """Run the service in this thread until `condition()` holds; fail after 20 s."""
        assert callable(condition)
        self.service.run(20.0, each_s=0.02, status=lambda: self.service.stop() if condition() else None)
        assert condition(), happened


@pytest.fixture
def rig(calibration: Calibration) -> Rig:
    return Rig(calibration)


def test_estimates_are_published_and_everything_is_closed_at_the_end(rig: Rig) -> None:
    threads = threading.active_count()
    rig.until("fog is seen", lambda: Reason.LOW_TEXTURE in rig.listener.reasons())
    assert threading.active_count() == threads
    assert rig.imu.closed
    assert rig.camera.closed
    assert rig.listener.closed
    seqs = [stamp.seq for estimate, stamp in rig.listener.heard if isinstance(estimate, GroundPlane)]
    assert seqs == list(range(len(seqs)))
    assert all(stamp.source is Source.LIVE and stamp.age_s > 0.0 for _, stamp in rig.listener.heard)


def test_latency_is_taken_of_each_frame(rig: Rig) -> None:
    rig.until("fog is seen", lambda: rig.listener.reasons().count(Reason.LOW_TEXTURE) > 5)
    spread = rig.service.latency.summary()
    assert spread["sensor"].p50_ms == pytest.approx(35.0, abs=0.1)
    total = spread["exposure_to_publish"].max_ms
    assert total >= max(spread[stage].max_ms for stage in ("sensor", "wait", "compute", "publish"))


def test_a_camera_that_goes_and_returns_is_said_to_be_silent_in_between(
    rig: Rig, caplog: pytest.LogCaptureFixture
) -> None:
    def story() -> bool:
        reasons = rig.listener.reasons()
        if Reason.NO_FRAME in reasons:
            rig.camera.failure = None
        elif Reason.LOW_TEXTURE in reasons:
            rig.camera.failure = DeviceError("/dev/video0: unplugged")
        return Reason.NO_FRAME in reasons and reasons[-1] is Reason.LOW_TEXTURE

    with caplog.at_level(logging.WARNING, "gaiteyes"):
        rig.until("the camera came back", story)
    told = [record.message for record in caplog.records if record.message.startswith("camera")]
    assert told == ["camera lost: /dev/video0: unplugged", "camera is back"]


def test_an_imu_that_goes_makes_frames_invalid_and_returns(rig: Rig) -> None:
    def story() -> bool:
        reasons = rig.listener.reasons()
        if Reason.NO_IMU in reasons:
            rig.imu.failure = None
        elif Reason.LOW_TEXTURE in reasons:
            rig.imu.failure = DeviceError("IMU at I2C address 0x68: bus stuck")
        return Reason.NO_IMU in reasons and reasons[-1] is Reason.LOW_TEXTURE

    rig.until("the IMU came back", story)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize("device", ["imu", "camera"])
def test_a_thread_that_dies_stops_the_service_and_is_named(rig: Rig, device: str) -> None:
    getattr(rig, device).failure = ZeroDivisionError("a bug")
    with pytest.raises(ServiceError, match=f"thread {device} of the service died"):
        rig.service.run(20.0)
    assert rig.imu.closed
    assert rig.camera.closed


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_observer_with_a_bug_stops_the_service(calibration: Calibration) -> None:
    rig = Rig(calibration)

    def observe(_estimate: Estimate, _header: FrameHeader | None) -> None:
        raise ZeroDivisionError("a bug")

    service = Service(
        Pipeline(calibration, FootholdSettings()),
        Devices(imu=rig.imu, camera=rig.camera),
        [],
        Stamper("test", "boot", Source.LIVE),
        observers=[observe],
    )
    with pytest.raises(ServiceError, match="pipeline"):
        service.run(20.0)


def test_health_tells_the_devices_counters(rig: Rig) -> None:
    rig.imu.counters.bus_errors = 7
    rig.camera.dropped = {DropCause.CAMERA_GAP: 3}

    def told() -> bool:
        return any(isinstance(e, Health) and e.imu_bus_errors == 7 for e, _ in rig.listener.heard)

    rig.until("health told", told)
    health = [e for e, _ in rig.listener.heard if isinstance(e, Health)][-1]
    assert health.frames_dropped[DropCause.CAMERA_GAP] == 3


def test_background_work_runs_until_the_end(calibration: Calibration) -> None:
    rig, calls = Rig(calibration), []

    def work(timeout_s: float) -> None:
        calls.append(timeout_s)
        time.sleep(0.005)

    service = Service(
        Pipeline(calibration, FootholdSettings()),
        Devices(imu=rig.imu, camera=rig.camera),
        [],
        Stamper("test", "boot", Source.LIVE),
        background={"work": work},
    )
    service.run(0.3)
    count = len(calls)
    time.sleep(0.05)
    assert count > 3
    assert len(calls) == count
