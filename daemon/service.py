"""The running daemon: device threads, the pipeline's thread and the recorder's, supervised; the only threads there are.

    IMU thread ──────┐                                            ┌─ Zenoh
    camera thread ───┤            pipeline thread                 ├─ CAN (its own thread)
    ankle thread ────┼─ Inbox ─── Pipeline.step ──── estimates ───┼─ Recorder (its own thread)
    timer thread ────┘                                            └─ observers

The timer also tells the device counters once a second and decides the load level.
"""

import contextlib
import gc
import logging
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2

from daemon.inbox import Inbox
from daemon.latency import FrameTimes, LatencyLog
from daemon.pipeline import Pipeline
from daemon.recorder import Recorder
from daemon.stamping import Stamper
from daemon.watch import GroundWatch, LoadDecision, Outage
from drivers.protocols import AnkleSource, DeviceError, ImuSource, StereoSource
from messages import (
    CanBusHealth,
    DeviceCounters,
    Estimate,
    FrameHeader,
    GroundPlane,
    LoadLevel,
    ServiceError,
    Stamp,
    StereoFrame,
    Tick,
)

log = logging.getLogger("gaiteyes")

TICK_NS = 10_000_000
IMU_POLL_NS = 4_700_000
"""Off any simple ratio to the chip's 10 ms, so that polls fall at all phases of it: the sample clock lives on that."""
REOPEN_PAUSE_S = 0.2


class Publisher(Protocol):
    """Sends estimates away without ever blocking or raising into the pipeline's thread."""

    @property
    def name(self) -> str:
        """Return what is published on."""

    @property
    def errors(self) -> int:
        """Return how many estimates or frames did not get away."""

    def publish(self, estimate: Estimate, stamp: Stamp) -> None:
        """Send one estimate."""

    def close(self) -> None:
        """Stop sending."""


Observer = Callable[[Estimate, FrameHeader | None], None]
"""Told of every estimate in the pipeline's thread, with the header of its frame if it is a ground estimate."""


Background = Callable[[float], None]
"""Work with a thread of its own that is called over and over; it returns after at most the given seconds."""


@dataclass
class Devices:
    """What the service reads from. The camera and the IMU are needed; the ankle's state is welcome."""

    imu: ImuSource
    camera: StereoSource
    ankle: AnkleSource | None = None


class Service:
    """Runs the pipeline on `devices`. Every thread it starts has ended, and every device is closed, on return."""

    def __init__(
        self,
        pipeline: Pipeline,
        devices: Devices,
        publishers: Sequence[Publisher],
        stamper: Stamper,
        *,
        background: Mapping[str, Background] | None = None,
        recorder: Recorder | None = None,
        observers: Sequence[Observer] = (),
    ) -> None:
        self._pipeline = pipeline
        self._devices = devices
        self._publishers = tuple(publishers)
        self._background = dict(background or {})
        self._stamper = stamper
        self._recorder = recorder
        self._observers = observers
        self._inbox = Inbox()
        self._seen: OrderedDict[int, FrameHeader] = OrderedDict()
        self._ground_watch = GroundWatch()
        self._stopping = threading.Event()
        self._producers_ended = threading.Event()
        self._died: list[str] = []
        self.latency = LatencyLog()
        self.beats_skipped = {"imu": 0, "timer": 0}
        """Periods that came too late, of the loops that keep an absolute pace; each loop has its own count."""

    def stop(self) -> None:
        """Ask `run` to return; may be called from a signal handler."""
        self._stopping.set()

    def run(
        self, seconds: float | None = None, *, each_s: float = 0.25, status: Callable[[], None] | None = None
    ) -> None:
        """Run for `seconds` or until `stop`; `status` is called in this thread every `each_s`.

        Raises ServiceError if a thread died.
        """
        producers = [
            self._thread("imu", self._read_imu),
            self._thread("camera", self._read_camera),
            self._thread("timer", self._keep_time),
        ]
        if self._devices.ankle is not None:
            producers.append(self._thread("ankle", self._read_ankle, self._devices.ankle))
        consumers = [self._thread("pipeline", self._run_pipeline)]
        if self._recorder is not None:
            consumers.append(self._thread("recorder", self._write_recording, self._recorder))
        consumers += [self._thread(name, self._serve, work) for name, work in self._background.items()]
        end_s = time.monotonic() + seconds if seconds is not None else float("inf")
        with _paced_interpreter():
            try:
                for thread in consumers + producers:
                    thread.start()
                while not self._stopping.wait(min(each_s, max(0.0, end_s - time.monotonic()))):
                    if status is not None:
                        status()
                    if time.monotonic() >= end_s:
                        break
            finally:
                self._shut_down(producers, consumers)
        if self._died:
            raise ServiceError(f"thread {', '.join(self._died)} of the service died")

    def _shut_down(self, producers: Sequence[threading.Thread], consumers: Sequence[threading.Thread]) -> None:
        self._stopping.set()
        for thread in producers:
            thread.join()
        self._producers_ended.set()
        for thread in consumers:
            thread.join()
        if self._recorder is not None:
            self._recorder.close()
        for publisher in self._publishers:
            publisher.close()
        self._devices.imu.close()
        self._devices.camera.close()

    def _thread(self, name: str, work: Callable[..., None], *args: object) -> threading.Thread:
        def supervised() -> None:
            ended_well = False
            try:
                work(*args)
                ended_well = True
            finally:
                if not ended_well:
                    self._died.append(name)
                    self._stopping.set()
                    self._producers_ended.set()

        return threading.Thread(target=supervised, name=f"gaiteyes-{name}")

    def _read_imu(self) -> None:
        down = Outage("IMU")
        for _ in self._beats("imu", IMU_POLL_NS):
            try:
                samples = self._devices.imu.read()
            except DeviceError as error:
                down.began(error)
                self._stopping.wait(REOPEN_PAUSE_S)
                continue
            if samples:
                down.ended()
            for sample in samples:
                self._inbox.put(sample)

    def _read_camera(self) -> None:
        down = Outage("camera")
        while not self._stopping.is_set():
            try:
                frame = self._devices.camera.read(timeout_s=0.1)
            except DeviceError as error:
                down.began(error)
                self._stopping.wait(REOPEN_PAUSE_S)
                continue
            if frame is not None:
                down.ended()
                self._inbox.put(frame)

    def _read_ankle(self, ankle: AnkleSource) -> None:
        while not self._stopping.is_set():
            state = ankle.receive(timeout_s=0.1)
            if state is not None:
                self._inbox.put(state)

    def _keep_time(self) -> None:
        load = LoadDecision()
        for beat in self._beats("timer", TICK_NS):
            now_ns = time.monotonic_ns()
            self._inbox.put(Tick(t_ns=now_ns))
            if beat % (1_000_000_000 // TICK_NS) == 0:
                self._inbox.put(self._counters(now_ns))
                changed = load.decide(self._inbox.frames_superseded, now_ns)
                if changed is not None:
                    log.warning("load level is now %s", changed.value)
                    self._inbox.put(LoadLevel(t_ns=now_ns, load=changed))

    def _beats(self, loop: str, period_ns: int) -> Iterator[int]:
        """Yield 0, 1, 2 … on an absolute grid until the service stops; on an overrun skip whole periods."""
        start_ns, beat = time.monotonic_ns(), 0
        while not self._stopping.is_set():
            yield beat
            due = (time.monotonic_ns() - start_ns) // period_ns + 1
            self.beats_skipped[loop] += due - beat - 1
            beat = due
            self._stopping.wait((start_ns + beat * period_ns - time.monotonic_ns()) * 1e-9)

    def _counters(self, now_ns: int) -> DeviceCounters:
        imu = self._devices.imu.counters
        return DeviceCounters(
            t_ns=now_ns,
            imu_bus_errors=imu.bus_errors,
            imu_fifo_overflows=imu.fifo_overflows,
            imu_resets=imu.resets,
            frames_dropped=dict(self._devices.camera.dropped),
            inbox_dropped=self._inbox.dropped,
            recorder_dropped=self._recorder.dropped if self._recorder is not None else 0,
            can_errors=sum(p.errors for p in self._publishers if p.name == "can"),
            can_bus=self._devices.ankle.bus_health if self._devices.ankle is not None else CanBusHealth(),
            zenoh_errors=sum(p.errors for p in self._publishers if p.name == "zenoh"),
        )

    def _run_pipeline(self) -> None:
        while True:
            message = self._inbox.get(timeout_s=0.1)
            if message is None:
                if self._producers_ended.is_set():
                    return
                continue
            taken_ns = time.monotonic_ns()
            if isinstance(message, StereoFrame):
                self._remember(message.header)
            if self._recorder is not None:
                self._recorder.offer(message)
            for estimate in self._pipeline.step(message):
                self._hand_out(estimate, taken_ns)

    def _remember(self, header: FrameHeader) -> None:
        self._seen[header.seq] = header
        while len(self._seen) > _FRAMES_IN_HAND:
            self._seen.popitem(last=False)

    def _hand_out(self, estimate: Estimate, taken_ns: int) -> None:
        computed_ns = time.monotonic_ns()
        stamp = self._stamper.stamp(estimate, computed_ns)
        for publisher in self._publishers:
            publisher.publish(estimate, stamp)
        header = None
        if isinstance(estimate, GroundPlane):
            header = self._seen.pop(estimate.frame_seq, None)
            self._ground_watch.saw(estimate.reason)
        if header is not None:
            self.latency.add(
                FrameTimes(
                    t_exposure_ns=header.t_exposure_ns,
                    t_arrival_ns=header.t_arrival_ns,
                    t_taken_ns=taken_ns,
                    t_computed_ns=computed_ns,
                    t_published_ns=time.monotonic_ns(),
                )
            )
        if self._recorder is not None:
            self._recorder.offer(estimate)
        for observe in self._observers:
            observe(estimate, header)

    def _serve(self, work: Background) -> None:
        while not self._producers_ended.is_set():
            work(0.1)

    def _write_recording(self, recorder: Recorder) -> None:
        while not (self._producers_ended.is_set() and recorder.idle):
            recorder.drain(timeout_s=0.1)


_FRAMES_IN_HAND = 4


@contextlib.contextmanager
def _paced_interpreter() -> Iterator[None]:
    """Set what keeps the threads punctual: one OpenCV thread, a short switch interval, no collector pauses."""
    threads, interval = cv2.getNumThreads(), sys.getswitchinterval()
    cv2.setNumThreads(1)
    sys.setswitchinterval(5e-4)
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
        sys.setswitchinterval(interval)
        cv2.setNumThreads(threads)
