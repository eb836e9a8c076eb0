"""The service: devices that fail and return, threads that die, an end that leaves nothing behind."""

import itertools
import logging
import re
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import pytest

from daemon import service as service_module
from daemon.pipeline import Pipeline
from daemon.recorder import Recorder
from daemon.service import LATE_NS, Devices, Service, tick_time_ns
from daemon.stamping import Stamper
from daemon.state_file import StateKeeper
from drivers.protocols import DeviceError
from drivers.recording.recording import McapRecording
from messages import (
    Attitude,
    Calibration,
    DepthScale,
    DropCause,
    Estimate,
    FrameHeader,
    GroundPlane,
    Health,
    ImuSample,
    Input,
    Learnt,
    Reason,
    ServiceError,
    Source,
    Stamp,
    Status,
    StereoFrame,
    Terrain,
    ZenohHealth,
)
from perception.ground.foothold import FootholdSettings
from perception.motion.watch import MotionWatch
from perception.terrain import estimator
from perception.terrain.path_matching import MatchedBand
from sim_rig.unit import draw_unit
from tests.bench.quiet_devices import GreyCamera, QuietImu
from tests.bench.recorded import INFO


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

    def __init__(self, calibration: Calibration, recorder: Recorder | None = None) -> None:
        self.imu, self.camera, self.listener = QuietImu(), GreyCamera(), Listener()
        self.service = Service(
            Pipeline(calibration, FootholdSettings()),
            Devices(imu=self.imu, camera=self.camera),
            [self.listener],
            Stamper("test", "boot", Source.LIVE),
            recorder=recorder,
            zenoh_health=lambda: ZenohHealth(insecure=True, malformed=1, refused=2),
        )

    def until(self, happened: str, condition: object) -> None:
        """Run the service in this thread until `condition()` holds; fail after 20 s."""
        assert callable(condition)
        self.service.run(20.0, each_s=0.02, status=lambda: self.service.stop() if condition() else None)
        assert condition(), happened

    def play(self, story: Iterator[str]) -> None:
        """Run the service in this thread until `story`, which yields what it waits for, ends; fail after 60 s."""
        awaited = "the start"

        def step() -> None:
            nonlocal awaited
            awaited = next(story, "")
            if not awaited:
                self.service.stop()

        self.service.run(60.0, each_s=0.02, status=step)
        assert not awaited, f"{awaited} did not come, but {self.listener.reasons()[-20:]}"

    def outage(self, device: QuietImu | GreyCamera, error: str, silence: Reason) -> Iterator[str]:
        """Unplug `device` when fog is seen, plug it in when the service says `silence`, wait until fog is seen again.

        Each stage counts only what came after the one before: a stalled machine is silent at other times as well.
        """
        yield from self._hears(Reason.LOW_TEXTURE)
        device.failure = DeviceError(error)
        while not self.service.problems:
            yield "the failure"
        yield from self._hears(silence)
        device.failure = None
        while self.service.problems:
            yield "the return"
        yield from self._hears(Reason.LOW_TEXTURE)

    def _hears(self, reason: Reason) -> Iterator[str]:
        """Wait until `reason` is published after now."""
        before = len(self.listener.reasons())
        while reason not in self.listener.reasons()[before:]:
            yield reason.value


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
    with caplog.at_level(logging.WARNING, "gaiteyes"):
        rig.play(rig.outage(rig.camera, "/dev/video0: unplugged", Reason.NO_FRAME))
    told = [r.message for r in caplog.records if r.message.startswith(("camera lost", "camera is back"))]
    assert len(told) == 2, told
    assert told[0] == "camera lost: /dev/video0: unplugged"
    assert re.fullmatch(r"camera is back: outage_s=[0-9.]+ attempts=[0-9]+", told[1])


def test_an_imu_that_goes_makes_frames_invalid_and_returns(rig: Rig) -> None:
    rig.play(rig.outage(rig.imu, "IMU at I2C address 0x68: bus stuck", Reason.NO_IMU))


@pytest.mark.parametrize(
    ("back_ms_ago", "behind_ms"), [(0.0, 0.0), (12.5, 0.0), (20.0, 7.5), (27.5, 15.0), (60.0, 15.0), (5000.0, 15.0)]
)
def test_a_tick_stays_behind_while_the_thread_of_the_imu_waits_for_a_processor_but_not_for_long(
    back_ms_ago: float, behind_ms: float
) -> None:
    now_ns = 10_000_000_000
    assert now_ns - tick_time_ns(now_ns - round(1e6 * back_ms_ago), now_ns) == round(1e6 * behind_ms)


def test_time_does_not_run_back_from_tick_to_tick_however_late_the_imu_s_thread_is() -> None:
    backs_ns = np.cumsum(np.random.default_rng(4).exponential(12e6, 2000)).astype(np.int64)
    ticks_ns = [
        tick_time_ns(int(backs_ns[np.searchsorted(backs_ns, now_ns) - 1]), now_ns)
        for now_ns in range(int(backs_ns[0]) + 1, int(backs_ns[-1]), 10_000_000)
    ]
    assert all(later >= before for before, later in itertools.pairwise(ticks_ns))


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


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_bug_in_what_the_path_thread_does_stops_the_service(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def match(*_args: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(estimator, "match_path", match)
    with pytest.raises(ServiceError, match="thread pipeline of the service died"):
        rig.service.run(20.0)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_bug_there_stops_the_service_even_where_no_frame_asks_for_its_path(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def match(*_args: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(service_module, "_CORES", 2)
    monkeypatch.setattr(estimator, "match_path", match)
    monkeypatch.setattr(Pipeline, "_placed", lambda *_: Reason.IMU_INCONSISTENT)
    with pytest.raises(ServiceError, match="thread pipeline of the service died"):
        rig.service.run(20.0)


def test_samples_that_come_before_a_frame_is_done_with_are_told_before_its_terrain(
    calibration: Calibration, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(MotionWatch, "judge_clock", lambda _: time.sleep(0.03))
    rig = Rig(calibration, Recorder(tmp_path / "walk.mcap", INFO))
    letters: dict[type, str] = {GroundPlane: "g", Attitude: "a", Terrain: "t"}

    def told() -> str:
        return "".join(letters.get(type(each), "") for each, _ in rig.listener.heard)

    rig.until("samples between a ground and its terrain", lambda: re.search("ga+t", told()) is not None)
    recorded = [each for each in McapRecording(tmp_path / "walk.mcap").inputs() if isinstance(each, ImuSample)]
    assert len(recorded) == told().count("a") > 0


def test_no_more_than_one_path_waits_for_the_thread(rig: Rig) -> None:
    running, free, matched = threading.Event(), threading.Event(), list[int]()

    def match(number: int) -> tuple[MatchedBand, ...]:
        running.set()
        free.wait(20.0)
        matched.append(number)
        return ()

    with ThreadPoolExecutor(1) as path_thread:
        for number in range(50):
            rig.service._begin_path(path_thread, partial(match, number))
            running.wait(20.0)
        free.set()
    assert matched == [0, 49]


@pytest.mark.parametrize("cores", [1, 2])
def test_the_path_has_a_thread_where_there_is_a_processor_for_it(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, cores: int
) -> None:
    monkeypatch.setattr(service_module, "_CORES", cores)
    names = set[str]()

    def look() -> None:
        names.update(thread.name.rstrip("_0") for thread in threading.enumerate())
        if any(isinstance(e, Terrain) and e.reason is Reason.LOW_TEXTURE for e, _ in rig.listener.heard):
            rig.service.stop()

    rig.service.run(20.0, each_s=0.02, status=look)
    assert "gaiteyes-pipeline" in names
    assert ("gaiteyes-path" in names) is (cores == 2)


def test_health_tells_the_devices_counters(rig: Rig) -> None:
    rig.imu.counters.bus_errors = 7
    rig.camera.dropped = {DropCause.CAMERA_GAP: 3}

    def told() -> bool:
        return any(isinstance(e, Health) and e.imu_bus_errors == 7 for e, _ in rig.listener.heard)

    rig.until("health told", told)
    health = [e for e, _ in rig.listener.heard if isinstance(e, Health)][-1]
    assert health.frames_dropped[DropCause.CAMERA_GAP] == 3
    assert health.zenoh == ZenohHealth(insecure=True, malformed=1, refused=2)


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
    service.run(20.0, each_s=0.02, status=lambda: service.stop() if len(calls) > 3 else None)
    count = len(calls)
    time.sleep(0.05)
    assert count > 3
    assert len(calls) == count


def test_what_was_learnt_is_kept_while_running_and_at_the_end(
    calibration: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "learnt.json"
    first = Learnt(calibration_id=calibration.id, depth_scale=DepthScale(scale=0.0, std=1e-3, seen_s=0.0))

    def service(learnt: Learnt, every_s: float) -> Service:
        monkeypatch.setattr("daemon.service.STATE_EVERY_S", every_s)
        monkeypatch.setattr(Pipeline, "learnt", property(lambda _: learnt))
        rig = Rig(calibration)
        return Service(
            Pipeline(calibration, FootholdSettings()),
            Devices(imu=rig.imu, camera=rig.camera),
            [],
            Stamper("test", "boot", Source.LIVE),
            state_keeper=StateKeeper(path, calibration),
        )

    running, kept = service(first, 0.05), list[bool]()

    def watch() -> None:
        kept.append(path.exists())
        if kept[-1]:
            running.stop()

    running.run(20.0, each_s=0.05, status=watch)
    assert kept[-1], "kept while running"
    later = msgspec.structs.replace(first, used_s=9.0)
    service(later, 60.0).run(0.1)
    assert StateKeeper(path, calibration).load() == later


class Hang:
    """Blocks every call until the test ends."""

    def __init__(self, answer: object) -> None:
        self.began, self.over = threading.Event(), threading.Event()
        self._answer = answer

    def __call__(self, *_args: object, **_options: object) -> object:
        self.began.set()
        self.over.wait()
        return self._answer


@pytest.mark.parametrize("where", ["imu", "camera", "pipeline", "can"])
def test_a_thread_that_hangs_starves_the_watchdog_and_is_given_up(
    calibration: Calibration, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.service.LONGEST_JOIN_S", 1.0)
    rig, hang = Rig(calibration), Hang(() if where == "imu" else None)
    if where in ("imu", "camera"):
        monkeypatch.setattr(getattr(rig, where), "read", hang)
    if where == "pipeline":
        monkeypatch.setattr(rig.listener, "publish", hang)

    def background(timeout_s: float) -> None:
        hang() if where == "can" else time.sleep(timeout_s)

    service = Service(
        Pipeline(calibration, FootholdSettings()),
        Devices(imu=rig.imu, camera=rig.camera),
        [rig.listener],
        Stamper("test", "boot", Source.LIVE),
        background={"can": background},
    )
    fed: list[bool] = []

    def feed() -> None:
        if hang.began.is_set():
            fed.append(service.progress.all_advanced())
            if len(fed) > 3 and service.progress.stuck == (where,):
                service.stop()

    try:
        with pytest.raises(ServiceError, match=f"thread {where} of the service hangs"):
            service.run(20.0, each_s=0.25, status=feed)
    finally:
        hang.over.set()
    assert service.progress.stuck == (where,)
    assert not any(fed[1:]), "fed after the round in which it began to hang"
    assert rig.imu.closed is (where != "imu")
    assert rig.camera.closed is (where != "camera")
    assert rig.listener.closed is (where in ("imu", "camera"))


@pytest.mark.realtime
def test_after_a_standstill_nothing_old_is_published_as_valid(rig: Rig, calibration: Calibration) -> None:
    standstill_s = 1.0

    class Sleepy(Pipeline):
        """Sleeps once inside a step, when the attitude is known."""

        slept = False

        def step(self, message: Input) -> Iterator[Estimate]:
            for estimate in super().step(message):
                known = isinstance(estimate, Attitude) and estimate.status is Status.VALID
                if known and not self.slept:
                    self.slept = True
                    time.sleep(standstill_s)
                yield estimate

    inputs = Sleepy(calibration, FootholdSettings())
    service = Service(
        inputs, Devices(imu=rig.imu, camera=rig.camera), [rig.listener], Stamper("test", "boot", Source.LIVE)
    )

    def over() -> bool:
        said = [e.reason for e, _ in rig.listener.heard if isinstance(e, Attitude)]
        return Reason.LATE in said and said[-1] is Reason.NONE

    service.run(30.0, each_s=0.02, status=lambda: service.stop() if over() else None)
    assert over()
    dated = [(e, s) for e, s in rig.listener.heard if isinstance(e, Attitude | GroundPlane)]
    assert max(stamp.age_s for _, stamp in dated) > 0.9 * standstill_s
    assert all(stamp.age_s <= 0.15 for estimate, stamp in dated if estimate.status is Status.VALID)


def test_a_frame_that_waited_too_long_for_its_turn_is_dropped_as_late(rig: Rig) -> None:
    def late_frame(timeout_s: float) -> StereoFrame | None:
        frame = GreyCamera.read(rig.camera, timeout_s)
        assert frame is not None
        arrived_ns = frame.header.t_arrival_ns - LATE_NS - 1
        return msgspec.structs.replace(frame, header=msgspec.structs.replace(frame.header, t_arrival_ns=arrived_ns))

    rig.camera.read = late_frame  # type: ignore[method-assign]

    def told() -> bool:
        return any(isinstance(e, Health) and e.frames_dropped.get(DropCause.LATE, 0) > 2 for e, _ in rig.listener.heard)

    rig.until("late frames are counted", told)
    assert set(rig.listener.reasons()) <= {Reason.STARTING, Reason.NO_FRAME, Reason.NO_IMU}
    assert all(e.frame_seq < 0 for e, _ in rig.listener.heard if isinstance(e, GroundPlane))
