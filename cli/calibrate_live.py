"""The service run on the devices that a configuration names, for a command that calibrates; nothing is published."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from daemon.outgoing import Observer
    from daemon.pipeline import Pipeline
    from daemon.recorder import Recorder
    from messages import Learnt, UnitCalibration
    from perception.ground.foothold import FootholdSettings


def run_live(
    config: Path,
    seconds: float,
    known: "UnitCalibration",
    observer: "Observer | None" = None,
    record: Path | None = None,
) -> None:
    """Run the devices for some seconds, show what is seen, and give `observer` each estimate.

    All inputs go into `record`, if that is named. Raises UserError where a device is not there.
    """
    from cli.devices import build_imu, camera_opener, next_step_named
    from cli.live import LiveStatus
    from cli.wiring import open_recorder, stopped_by_signals, tell_recording
    from daemon.config import load_configuration
    from daemon.replaceable_camera import ReplaceableCamera
    from daemon.service import Devices, Service
    from daemon.stamping import Stamper
    from daemon.state_file import StateKeeper, state_path
    from daemon.summary import Tally
    from drivers.boot_id import read_boot_id
    from messages import Source

    configuration = load_configuration(config)
    learnt = StateKeeper(state_path(config, configuration), known).load()
    imu, camera = build_imu(configuration.imu), ReplaceableCamera(camera_opener(configuration.camera, known))
    with next_step_named():
        imu.open()
        camera.open()
    recorder: Recorder | None = None
    if record is not None:
        recorder = open_recorder(record, configuration, known, Source.LIVE, None, learnt)
    tally = Tally()
    observers: list[Observer] = [tally] if observer is None else [tally, observer]
    service = Service(
        pipeline_without_wearer(known, configuration.foothold, learnt),
        Devices(imu=imu, camera=camera),
        [],
        Stamper(configuration.device, read_boot_id(), Source.LIVE),
        recorder=recorder,
        observers=observers,
    )
    with stopped_by_signals(service), LiveStatus(tally) as live:
        service.run(seconds, status=lambda: live.refresh(service.problems))
    if recorder is not None and record is not None:
        tell_recording(recorder, record)


def pipeline_without_wearer(
    known: "UnitCalibration", foothold: "FootholdSettings", learnt: "Learnt | None"
) -> "Pipeline":
    """Return the pipeline of a unit that knows its wearer not yet; what it has learnt of its sensors still holds."""
    import msgspec

    from daemon.pipeline import Pipeline

    bare = msgspec.structs.replace(known, wearer=msgspec.UNSET)
    if learnt is not None:
        learnt = msgspec.structs.replace(learnt, calibration_id=bare.id)
    return Pipeline(bare, foothold, learnt)
