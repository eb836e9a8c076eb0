"""What `run` and `demo` put around the pipeline: publishers, recorder, signals and the summary for a person."""

import logging
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import NamedTuple

import typer

from calib.files import format_calibration
from calib.seal import sealed
from cli.console import RECORDING_CUT, console, table
from daemon.config import Configuration, format_configuration
from daemon.outgoing import Observer
from daemon.pictures import Greeting, Pictures
from daemon.pipeline import Pipeline
from daemon.publish_can import CanPublisher
from daemon.publish_zenoh import ZenohPublisher
from daemon.recorder import Recorder, RecordingInfo
from daemon.recording_file import check_recordable
from daemon.service import Background, Devices, Service
from daemon.setpoints import modulator
from daemon.stamping import Stamper
from daemon.state_file import StateKeeper
from daemon.summary import RunSummary
from drivers.boot_id import read_boot_id
from drivers.can.link import CanLink
from drivers.picture_socket import PictureServer
from drivers.protocols import FrameSource, ImuSource
from drivers.utc import read_utc_offset_ns
from messages import Learnt, Source, UnitCalibration, UserError

log = logging.getLogger("gaiteyes")


def open_recorder(
    path: Path,
    configuration: Configuration,
    calibration: UnitCalibration,
    source: Source,
    last_s: float | None,
    learnt: Learnt | None = None,
    *,
    outputs_only: bool = False,
) -> Recorder:
    """Return a recorder that writes to `path`, or keeps the newest `last_s` seconds for it; raises RecordingError."""
    info = RecordingInfo(
        device=configuration.device,
        source=source,
        calibration_text=sealed(format_calibration(calibration)),
        configuration_text=format_configuration(configuration),
        learnt=learnt,
        utc_offset_ns=read_utc_offset_ns(),
    )
    return Recorder(path, info, last_s=last_s, outputs_only=outputs_only)


def check_recording(record: Path | None, last_s: float | None, outputs_only: bool) -> None:
    """Raise UserError where options ask for a part of a recording that is not made, or where it cannot be made."""
    if record is not None:
        check_recordable(record)
    elif last_s is not None or outputs_only:
        raise UserError("--last and --outputs-only choose a part of what --record FILE records: no file is named")


def tell_recording(recorder: Recorder, path: Path) -> None:
    """Say what became of a recording; raises typer.Exit with RECORDING_CUT if it stopped before its end."""
    console.print(recorder.failed or f"recorded to {path}, {recorder.dropped} messages dropped", soft_wrap=True)
    if recorder.failed is not None:
        raise typer.Exit(RECORDING_CUT)


class Outlets(NamedTuple):
    """Where estimates go, opened and ready; `link` also receives the ankle's state."""

    zenoh: ZenohPublisher
    can: CanPublisher
    link: CanLink

    def close(self) -> None:
        """Close both; for outlets that no service has taken over."""
        self.zenoh.close()
        self.can.close()

    @contextmanager
    def closed_on_failure(self) -> Iterator[None]:
        """Close both if an error comes before a service, which closes them itself, runs."""
        try:
            yield
        except BaseException:
            self.close()
            raise


def open_outlets(configuration: Configuration, calibration: UnitCalibration, *, retry_opening: bool = False) -> Outlets:
    """Open Zenoh and CAN as configured; raises UserError, and leaves nothing open, if either cannot be.

    A `retry_opening` CAN link may be absent for now.
    """
    zenoh = ZenohPublisher(
        configuration.zenoh, configuration.device, calibration=calibration, configuration=configuration
    )
    try:
        link = CanLink(configuration.can, retry_opening=retry_opening)
    except UserError:
        zenoh.close()
        raise
    return Outlets(zenoh, CanPublisher(link, fd=configuration.can.fd), link)


def build_service(
    configuration: Configuration,
    calibration: UnitCalibration,
    source: Source,
    imu: ImuSource,
    camera: FrameSource,
    outlets: Outlets,
    recorder: Recorder | None,
    observers: Sequence[Observer],
    background: Mapping[str, Background] | None = None,
    *,
    priorities: bool = False,
    learnt: Learnt | None = None,
    state_keeper: StateKeeper | None = None,
    folder: Path = Path(),
) -> Service:
    """Return the service on these devices and outlets, which begins with what the unit has `learnt`.

    `folder` is that of the configuration's file. Raises UserError where its tables of set-points cannot be used.
    """
    setpoints = modulator(configuration.setpoint, folder)
    pipeline = Pipeline(calibration, configuration.foothold, learnt, setpoints=setpoints)
    return Service(
        pipeline,
        Devices(imu=imu, camera=camera, ankle=outlets.link),
        [outlets.zenoh, outlets.can],
        Stamper(configuration.device, read_boot_id(), source),
        background={"can": outlets.can.drain, **(background or {})},
        recorder=recorder,
        observers=observers,
        pictures=_pictures(configuration, calibration, source, pipeline),
        priorities=priorities,
        state_keeper=state_keeper,
        zenoh_health=lambda: outlets.zenoh.health,
    )


def _pictures(
    configuration: Configuration, calibration: UnitCalibration, source: Source, pipeline: Pipeline
) -> Pictures | None:
    """Return what gives `gaiteyes view` its pictures; None, with one warning, where it cannot be reached."""
    try:
        server = PictureServer(configuration.device)
    except UserError as error:
        log.warning("%s", error)
        return None
    greeting = Greeting(
        source=source,
        calibration_text=sealed(format_calibration(calibration)),
        configuration_text=format_configuration(configuration),
    )
    surfaces_only = not configuration.view.pictures
    return Pictures(server, greeting, lambda: pipeline.surfaces, surfaces_only=surfaces_only)


@contextmanager
def stopped_by_signals(service: Service, farewell: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Let Ctrl-C and SIGTERM end `service.run` cleanly; `farewell` is called when one has come."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        farewell()
        service.stop()

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def summary_tables(facts: RunSummary) -> None:
    """Print rates, losses, latency and load."""
    dropped = facts.health.frames_dropped if facts.health is not None else {}
    lost = ", ".join(f"{count} {cause.value}" for cause, count in dropped.items()) or "none"
    table(
        f"{facts.seconds:.1f} s",
        ["", ""],
        [
            ["ground estimates per second", f"{facts.planes_per_s:.2f}"],
            ["of these valid", f"{100 * facts.valid_share:.1f} %"],
            ["IMU samples per second", f"{facts.imu_samples_per_s:.2f}"],
            ["IMU samples lost", str(facts.imu_lost)],
            ["frames dropped", lost],
            ["processor, of one core", f"{100 * facts.cpu_share:.0f} %"],
            ["memory, settled → end", f"{facts.memory_settled_mb:.0f} → {facts.memory_end_mb:.0f} MB"],
        ],
    )
    table(
        "Latency, ms",
        ["step", "p50", "p99", "max"],
        [
            [name.replace("_", " "), f"{spread.p50_ms:.1f}", f"{spread.p99_ms:.1f}", f"{spread.max_ms:.1f}"]
            for name, spread in facts.latency.items()
        ],
    )
