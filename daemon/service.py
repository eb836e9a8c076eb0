"""The running daemon: threads of devices, of the pipeline and of what writes files, supervised; there are no others.

    IMU thread ──────┐                                            ┌─ Zenoh
    camera thread ───┤            pipeline thread                 ├─ CAN (its own thread)
    ankle thread ────┼─ Inbox ─── Pipeline.step ──── estimates ───┼─ Recorder (its own thread)
    timer thread ────┘                  │ ↑                       ├─ Pictures (its own thread, while somebody looks)
                                    path thread                   └─ observers

                            state thread: what the pipeline has learnt, once a minute and at the end ─ StateKeeper

The timer also tells the device counters once a second and decides the load level.
"""

import logging
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

from daemon.inbox import Inbox
from daemon.latency import LatencyLog
from daemon.load import LoadDecision
from daemon.outgoing import Observer, Outgoing, Publisher
from daemon.pictures import Pictures
from daemon.pipeline import Pipeline
from daemon.realtime import give_way, paced_interpreter, request_priorities, reset_priority, set_priority
from daemon.recorder import Recorder
from daemon.stamping import Stamper
from daemon.state_file import StateKeeper
from daemon.watch import Outage
from daemon.watchdog import Progress
from drivers.protocols import AnkleSource, DeviceError, FrameSource, ImuSource
from messages import (
    TOPICS,
    CanBusHealth,
    DeviceCounters,
    DropCause,
    DroppedFrame,
    Frame,
    ImuSample,
    Input,
    LoadLevel,
    RecordingState,
    ServiceError,
    Tick,
    ZenohHealth,
)
from perception.terrain.path_matching import MatchedBand, Work

log = logging.getLogger("gaiteyes")

TICK_NS = TOPICS["tick"].period_ns
REOPEN_PAUSE_S = 0.2
_THREAD = "gaiteyes-"
LATE_NS = 100_000_000
"""A frame that waited longer for its turn, because the process stood still, is not computed any more."""
STATE_EVERY_S = 60.0
"""What the unit has learnt is kept so often, and at the end."""
_CORES = min(2, len(os.sched_getaffinity(0)))
"""That the threads of the pipeline and of the path can keep busy."""
IMU_ROUND_S = 0.0125
"""So often the thread of the IMU comes back, with a sample or without."""
MOST_OVERDUE_NS = 15_000_000
"""So far ticks stay behind the clock while that thread does not: it waits for a processor, and what the chip has sent
meanwhile is no silence. One that hangs on the bus looks the same, and is told so much later, where it counts no error.
"""
LONGEST_JOIN_S = 2.0
"""How long a thread may take to end before the service gives it up: a device call may hang for ever."""


Background = Callable[[float], None]
"""Work with a thread of its own that is called over and over; it returns after at most the given seconds."""


@dataclass
class Devices:
    """What the service reads from. The camera and the IMU are needed; the ankle's state is welcome."""

    imu: ImuSource
    camera: FrameSource
    ankle: AnkleSource | None = None


def tick_time_ns(imu_back_ns: int, now_ns: int) -> int:
    """Return the instant of a tick: now, or as long ago as the thread of the IMU, which came back with what the chip
    had at `imu_back_ns`, is overdue, `MOST_OVERDUE_NS` at most."""
    overdue_ns = max(0, now_ns - imu_back_ns - round(1e9 * IMU_ROUND_S))
    return now_ns - min(overdue_ns, MOST_OVERDUE_NS)


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
        pictures: Pictures | None = None,
        priorities: bool = False,
        state_keeper: StateKeeper | None = None,
        zenoh_health: Callable[[], ZenohHealth] = ZenohHealth,
    ) -> None:
        self._pipeline = pipeline
        self._devices = devices
        self._pictures = pictures
        self._background = dict(background or {})
        if pictures is not None:
            observers = (*observers, pictures.add_estimate)
            self._background["view"] = pictures.serve
        self._outgoing = Outgoing(publishers, stamper, recorder, observers)
        self._recorder = recorder
        self._state_keeper = state_keeper
        self._zenoh_health = zenoh_health
        self._inbox = Inbox()
        self._stopping = threading.Event()
        self._producers_ended = threading.Event()
        self._imu_back_ns, self._imu_errors = time.monotonic_ns(), 0
        self._path_work: Future[tuple[MatchedBand, ...]] | None = None
        self._died: list[str] = []
        self._outages = {"imu": Outage("IMU"), "camera": Outage("camera")}
        self._priorities = priorities
        self._pipeline_busy_ns = self._path_busy_ns = 0  # processor time of the threads
        ankle = ("ankle",) if devices.ankle is not None else ()
        self.progress = Progress(("imu", "camera", "timer", "pipeline", *ankle, *self._background))
        """The rounds of the loops that must never hang; those that write files may: no estimate waits for a disk."""
        self.latency = LatencyLog()
        self.beats_skipped = {"timer": 0}
        """Periods that came too late, of the loops that keep an absolute pace; each loop has its own count."""

    def stop(self) -> None:
        """Ask `run` to return; may be called from a signal handler."""
        self._stopping.set()

    @property
    def problems(self) -> list[str]:
        """Return one line for each device that is absent now, and one for a recording that has stopped."""
        found = [outage.problem for outage in self._outages.values() if outage.problem]
        stopped = self._recorder.failed if self._recorder is not None else None
        return found if stopped is None else [*found, stopped]

    def put(self, message: Input) -> None:
        """Hand the pipeline a decision of the daemon's own, in the order of arrival."""
        self._inbox.put(message)

    def run(
        self, seconds: float | None = None, *, each_s: float = 0.25, status: Callable[[], None] | None = None
    ) -> None:
        """Run for `seconds` or until `stop`; `status` is called in this thread every `each_s`.

        Raises ServiceError if a thread died, or does not end because its device hangs.
        """
        producers = [
            self._thread("imu", self._read_imu),
            self._thread("camera", self._read_camera),
            self._thread("timer", self._run_timer),
        ]
        if self._devices.ankle is not None:
            producers.append(self._thread("ankle", self._read_ankle, self._devices.ankle))
        consumers = [self._thread("pipeline", self._run_pipeline)]
        if self._recorder is not None:
            consumers.append(self._thread("recorder", self._write_recording, self._recorder))
        if self._state_keeper is not None:
            consumers.append(self._thread("state", self._keep_state, self._state_keeper))
        consumers += [self._thread(name, self._run_background, name, work) for name, work in self._background.items()]
        end_s = time.monotonic() + seconds if seconds is not None else float("inf")
        with paced_interpreter():
            self._priorities = self._priorities and request_priorities()
            try:
                for thread in consumers + producers:
                    thread.start()
                while not self._stopping.wait(min(each_s, max(0.0, end_s - time.monotonic()))):
                    if status is not None:
                        status()
                    if time.monotonic() >= end_s:
                        break
            finally:
                if self._priorities:
                    reset_priority()
                self._shut_down(producers, consumers)
        if self._died:
            raise ServiceError(f"thread {', '.join(self._died)} of the service died")

    def _shut_down(self, producers: Sequence[threading.Thread], consumers: Sequence[threading.Thread]) -> None:
        """End all threads, then close what they used; what a hanging thread may still use is left to the kernel."""
        self._stopping.set()
        hanging = _join(producers)
        self._producers_ended.set()
        hanging |= _join(consumers)
        if self._recorder is not None and "recorder" not in hanging:
            self._recorder.close()
        if self._state_keeper is not None and not hanging & {"state", "pipeline"}:
            self._state_keeper.keep(self._pipeline.learnt)
        if not hanging & {"pipeline", "ankle", *self._background}:
            self._outgoing.close()
            if self._pictures is not None:
                self._pictures.close()
        for name, device in (("imu", self._devices.imu), ("camera", self._devices.camera)):
            if name not in hanging:
                device.close()
        if hanging:
            raise ServiceError(f"thread {', '.join(sorted(hanging))} of the service hangs and was given up")

    def _thread(self, name: str, work: Callable[..., None], *args: object) -> threading.Thread:
        def supervised() -> None:
            ended_well = False
            try:
                self._begin_thread(name)
                work(*args)
                ended_well = True
            finally:
                if not ended_well:
                    self._died.append(name)
                    self._stopping.set()
                    self._producers_ended.set()

        # a daemon thread: one that hangs in a device must not keep the process from ending
        return threading.Thread(target=supervised, name=_THREAD + name, daemon=True)

    def _begin_thread(self, name: str) -> None:
        if self._priorities:
            set_priority(name)

    def _read_imu(self) -> None:
        outage = self._outages["imu"]
        while not self._stopping.is_set():
            self.progress.count_round("imu")
            try:
                samples = self._devices.imu.read(timeout_s=IMU_ROUND_S)
            except DeviceError as error:
                self._imu_back_ns = time.monotonic_ns() + round(1e9 * REOPEN_PAUSE_S)
                outage.add_failure(error)
                self._stopping.wait(REOPEN_PAUSE_S)
                continue
            if samples:
                outage.add_success()
            delay_ns = round(1e9 * self._devices.imu.filter_delay_s)
            for sample in samples:
                self._inbox.put(sample)
                self.latency.add_sample(time.monotonic_ns() - (sample.t_sample_ns + delay_ns))
            self._imu_back_ns, self._imu_errors = time.monotonic_ns(), self._devices.imu.counters.bus_errors

    def _read_camera(self) -> None:
        outage = self._outages["camera"]
        while not self._stopping.is_set():
            self.progress.count_round("camera")
            try:
                frame = self._devices.camera.read(timeout_s=0.1)
            except DeviceError as error:
                outage.add_failure(error)
                self._stopping.wait(REOPEN_PAUSE_S)
                continue
            if frame is not None:
                outage.add_success()
                self._inbox.put(frame)

    def _read_ankle(self, ankle: AnkleSource) -> None:
        while not self._stopping.is_set():
            self.progress.count_round("ankle")
            state = ankle.receive(timeout_s=0.1)
            if state is not None:
                self._inbox.put(state)

    def _run_timer(self) -> None:
        load = LoadDecision(time.monotonic_ns())
        for beat in self._periods("timer", TICK_NS):
            self.progress.count_round("timer")
            now_ns = time.monotonic_ns()
            fails = self._devices.imu.counters.bus_errors != self._imu_errors
            self._inbox.put(Tick(t_ns=now_ns if fails else tick_time_ns(self._imu_back_ns, now_ns)))
            if beat % (1_000_000_000 // TICK_NS) == 0:
                self._inbox.put(self._counters(now_ns))
                busy_ns = max(self._pipeline_busy_ns, (self._pipeline_busy_ns + self._path_busy_ns) // _CORES)
                changed = load.decide(self._inbox.frames_superseded, busy_ns, now_ns)
                if changed is not None:
                    log.warning("load level is now %s", changed.value)
                    self._inbox.put(LoadLevel(t_ns=now_ns, load=changed))

    def _periods(self, loop: str, period_ns: int) -> Iterator[int]:
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
            imu_frames_refused=imu.frames_refused,
            imu_resets=imu.resets,
            imu_edges_missed=imu.edges_missed,
            frames_dropped=dict(self._devices.camera.dropped),
            inbox_dropped=self._inbox.dropped,
            recorder_dropped=self._recorder.dropped if self._recorder is not None else 0,
            recording=self._recorder.state if self._recorder is not None else RecordingState.OFF,
            can_errors=self._outgoing.errors("can"),
            can_bus=self._devices.ankle.bus_health if self._devices.ankle is not None else CanBusHealth(),
            zenoh_errors=self._outgoing.errors("zenoh"),
            zenoh=self._zenoh_health(),
        )

    def _run_pipeline(self) -> None:
        self._pipeline.let_first(self._samples_and_ticks)
        if _CORES == 1:
            self._run_steps()
            return
        with ThreadPoolExecutor(1, _THREAD + "path", self._begin_path_thread) as path_thread:
            self._pipeline.match_path_beside(partial(self._begin_path, path_thread))
            self._run_steps()

    def _begin_path(self, path_thread: ThreadPoolExecutor, work: Work) -> Work:
        """Begin `work` in the thread of the path, where one more waits at most: what no frame has asked for any more is
        left out, and its error is raised here."""
        before = self._path_work
        if before is not None and not before.cancel() and before.done():
            before.result()
        self._path_work = path_thread.submit(self._matched, work)
        return self._path_work.result

    def _begin_path_thread(self) -> None:
        self._begin_thread("path") if self._priorities else give_way()

    def _matched(self, work: Work) -> tuple[MatchedBand, ...]:
        matched = work()
        self._path_busy_ns = time.thread_time_ns()
        return matched

    def _run_steps(self) -> None:
        while True:
            self.progress.count_round("pipeline")
            message = self._inbox.get(timeout_s=0.1)
            if message is None:
                if self._producers_ended.is_set():
                    return
                continue
            taken_ns = time.monotonic_ns()
            if isinstance(message, Frame):
                if taken_ns - message.header.t_arrival_ns > LATE_NS:
                    message = DroppedFrame(header=message.header, cause=DropCause.LATE)
                else:
                    self._outgoing.expect_ground_of(message.header)
            self._record(message)
            if self._pictures is not None and isinstance(message, Frame):
                self._pictures.add_frame(message)
            for estimate in self._pipeline.step(message):
                self._outgoing.send(estimate, taken_ns, time.monotonic_ns, self.latency)
            self._pipeline_busy_ns = time.thread_time_ns()

    def _samples_and_ticks(self) -> Iterator[ImuSample | Tick]:
        """Yield what waits in the inbox before anything else does."""
        while (message := self._inbox.get_sample_or_tick()) is not None:
            self._record(message)
            yield message

    def _record(self, message: Input) -> None:
        if self._recorder is not None:
            self._recorder.offer(message)

    def _run_background(self, name: str, work: Background) -> None:
        while not self._producers_ended.is_set():
            self.progress.count_round(name)
            work(0.1)

    def _write_recording(self, recorder: Recorder) -> None:
        while not (self._producers_ended.is_set() and recorder.idle):
            recorder.drain(timeout_s=0.1)

    def _keep_state(self, keeper: StateKeeper) -> None:
        while not self._producers_ended.wait(STATE_EVERY_S):
            keeper.keep(self._pipeline.learnt)


def _join(threads: Sequence[threading.Thread]) -> set[str]:
    """Wait for all to end, `LONGEST_JOIN_S` together; return which did not."""
    end_s = time.monotonic() + LONGEST_JOIN_S
    for thread in threads:
        thread.join(max(0.0, end_s - time.monotonic()))
    return {thread.name.removeprefix(_THREAD) for thread in threads if thread.is_alive()}
