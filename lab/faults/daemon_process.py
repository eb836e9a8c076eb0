"""The process of the daemon under test: the real service, drivers and outlets on the simulated hardware.

The campaign's end of the pipe sends `Order`s, or None to hear how the rig does; each is answered with `Done`. A start
that fails is answered with `Refused`.
"""

import logging
import multiprocessing
import os
import resource
import signal
from collections.abc import Callable
from contextlib import ExitStack
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec

from calib.files import format_calibration
from calib.seal import sealed
from daemon.config import Configuration, format_configuration
from daemon.pipeline import Pipeline
from daemon.publish_can import CanPublisher
from daemon.publish_zenoh import ZenohPublisher
from daemon.recorder import Recorder, RecordingInfo
from daemon.service import Devices, Service
from daemon.stamping import Stamper
from drivers.boot_id import read_boot_id
from drivers.camera.side_by_side import V4l2StereoCamera
from drivers.can.link import CanLink
from drivers.can.settings import CanSettings
from drivers.imu.mpu6050 import Mpu6050
from drivers.imu.settings import Mpu6050Settings
from drivers.zenoh.settings import ZenohSettings
from lab.faults.hardware import FaultyHardware
from messages import Calibration, Source, UserError
from sim_rig.camera.film import Film
from sim_rig.walk.scenario import repeating, scenario
from sim_rig.wearer import SimulatedWearer

DEVICE = "campaign"
_ORDERS_EVERY_S = 0.01
_POOL_FRAMES = 16


class DaemonPlan(msgspec.Struct, frozen=True, kw_only=True):
    """All that one start of the daemon depends on; the wearer's walk goes on from start to start.

    `calibration` takes the place of the unit's own; the faults `from_start` are there before the daemon runs.
    `largest_file_bytes` limits what the process may write to a file. The wearer walks laps of the `film`, if any.
    """

    seed: int
    scenario: str
    start_ns: int
    zenoh: str
    can: CanSettings
    log: Path
    calibration: Calibration | None = None
    from_start: tuple[str, ...] = ()
    record: Path | None = None
    largest_file_bytes: int | None = None
    film: Film | None = None

    def wearer(self) -> SimulatedWearer:
        """Return the wearer of this plan."""
        walk = scenario(self.scenario)
        return SimulatedWearer(self.seed, walk if self.film is None else repeating(walk), self.start_ns, film=self.film)


class Order(msgspec.Struct, frozen=True):
    """Inject, or clear, the fault of this name."""

    fault: str
    inject: bool


class Done(msgspec.Struct, frozen=True):
    """An order was carried out; `rig_late` frames were not rendered in time since the start."""

    rig_late: int = 0


class Refused(msgspec.Struct, frozen=True):
    """The daemon did not start, and said so in this line."""

    line: str


Carry = Callable[[FaultyHardware, Order], None]
"""Carries an order out on the simulated hardware; module level, so that it reaches another process."""


class DaemonProcess:
    """One start of the daemon. Raises UserError, its own line, where it refuses to start."""

    def __init__(self, plan: DaemonPlan, carry: Carry) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, childs_end = context.Pipe()
        self._process = context.Process(target=_run, args=(childs_end, plan, carry), name="gaiteyes-under-test")
        self._process.start()
        childs_end.close()
        answer = self._answer()
        if isinstance(answer, Refused):
            self._process.join()
            raise UserError(answer.line)

    @property
    def pid(self) -> int:
        """Return the process's number."""
        if self._process.pid is None:
            raise RuntimeError("the daemon's process was not started")
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Return whether the process runs."""
        return self._process.is_alive()

    def order(self, order: Order | None) -> Done:
        """Have a fault injected or cleared on the simulated hardware, or with None nothing; returns when it is.

        Raises UserError if the daemon is gone.
        """
        try:
            self._pipe.send(order)
            answer = self._answer()
        except (BrokenPipeError, ConnectionResetError) as error:
            raise UserError("the daemon under test has ended") from error
        if not isinstance(answer, Done):
            raise UserError(answer.line)
        return answer

    def stop(self, timeout_s: float = 15.0) -> bool:
        """End the daemon as a service manager would; return whether it ended by itself within `timeout_s`."""
        self._process.terminate()
        self._process.join(timeout_s)
        ended = not self._process.is_alive()
        if not ended:
            self._process.kill()
            self._process.join()
        self._pipe.close()
        return ended

    def _answer(self) -> Done | Refused:
        try:
            answer = self._pipe.recv()
        except EOFError as error:
            self._process.join()
            raise UserError(f"the daemon under test died (exit code {self._process.exitcode})") from error
        if not isinstance(answer, Done | Refused):
            raise TypeError(f"unexpected answer of the daemon under test: {answer!r}")
        return answer


def _run(pipe: Connection, plan: DaemonPlan, carry: Carry) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the campaign ends it
    logging.basicConfig(filename=plan.log, format="%(relativeCreated)9.0f %(message)s")
    with ExitStack() as undo:
        hardware = FaultyHardware(wearer := plan.wearer())
        undo.callback(hardware.close)
        for fault in plan.from_start:
            carry(hardware, Order(fault, inject=True))
        if plan.largest_file_bytes is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (plan.largest_file_bytes, plan.largest_file_bytes))
        try:
            service = _service(plan, hardware, plan.calibration or wearer.calibration)
        except UserError as refusal:
            pipe.send(Refused(str(refusal)))
            return
        signal.signal(signal.SIGTERM, lambda _number, _frame: service.stop())
        pipe.send(Done())

        def obey() -> None:
            try:
                while pipe.poll():
                    if (order := pipe.recv()) is not None:
                        carry(hardware, order)
                    pipe.send(Done(hardware.camera.rig_late))
            except (EOFError, BrokenPipeError, ConnectionResetError):  # the campaign is gone
                service.stop()

        service.run(each_s=_ORDERS_EVERY_S, status=obey)


def _service(plan: DaemonPlan, hardware: FaultyHardware, calibration: Calibration) -> Service:
    configuration = Configuration(device=DEVICE, zenoh=ZenohSettings(listen=plan.zenoh), can=plan.can)
    imu = Mpu6050(hardware.wires.open, settings=Mpu6050Settings(), open_data_ready=hardware.data_ready.open)
    imu.open()
    stereo = calibration.stereo
    camera = V4l2StereoCamera(
        hardware.camera.node.path,
        stereo.left.width_px,
        stereo.left.height_px,
        pool_frames=_POOL_FRAMES,
        stamp_to_mid_exposure_s=stereo.stamp_to_mid_exposure_s,
        kernel=hardware.camera.kernel,
    )
    zenoh = ZenohPublisher(configuration.zenoh, DEVICE, calibration=calibration, configuration=configuration)
    link = CanLink(plan.can)
    can = CanPublisher(link)
    recorder = None
    if plan.record is not None:
        info = RecordingInfo(
            device=DEVICE,
            source=Source.SIMULATED,
            calibration_text=sealed(format_calibration(calibration)),
            configuration_text=format_configuration(configuration),
        )
        recorder = Recorder(plan.record, info)
    return Service(
        Pipeline(calibration, configuration.foothold),
        Devices(imu=imu, camera=camera, ankle=link),
        [zenoh, can],
        Stamper(DEVICE, read_boot_id(), Source.SIMULATED),
        background={"can": can.drain},
        recorder=recorder,
    )


def resident_mb(pid: int) -> float:
    """Return the resident memory of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def open_files(pid: int) -> int:
    """Return how many descriptors a process has open."""
    return len(os.listdir(f"/proc/{pid}/fd"))


def threads(pid: int) -> int:
    """Return how many threads a process has."""
    return len(os.listdir(f"/proc/{pid}/task"))
