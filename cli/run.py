"""`gaiteyes run`: the daemon on hardware. It never falls back to simulation."""

from pathlib import Path
from typing import Annotated

import typer

from cli.options import CONFIG_FILE, ConfigFile, JsonFile


def run(
    config: ConfigFile = CONFIG_FILE,
    seconds: Annotated[
        float | None, typer.Option(min=1.0, help="Stop after this time; by default run until stopped.")
    ] = None,
    record: Annotated[Path | None, typer.Option(help="Record all inputs and outputs to this MCAP file.")] = None,
    last: Annotated[float | None, typer.Option(min=1.0, help="Keep only the last seconds of the recording.")] = None,
    outputs_only: Annotated[
        bool, typer.Option(help="Record estimates alone: no picture, no sample; it cannot be replayed.")
    ] = False,
    json: JsonFile = None,
) -> None:
    """Run the service on this unit's IMU and camera.

    Started by hand it ends at once, with one line, if a device is missing; started by a service manager it reports
    the missing device and keeps trying, because nobody is there to start it again.
    """
    from calib.files import load_calibration
    from cli.console import check_writable, write_json
    from cli.devices import build_imu, camera_opener, next_step_named
    from cli.live import LiveStatus
    from cli.reload import Reloader
    from cli.wiring import (
        build_service,
        check_recording,
        open_outlets,
        open_recorder,
        stopped_by_signals,
        summary_tables,
        tell_recording,
    )
    from daemon.config import load_configuration
    from daemon.realtime import lock_memory
    from daemon.replaceable_camera import ReplaceableCamera
    from daemon.sd_notify import ServiceManager
    from daemon.state_file import StateKeeper, state_path
    from daemon.summary import Tally
    from drivers.protocols import DeviceError
    from messages import ServiceError, Source

    check_writable(json)
    check_recording(record, last, outputs_only)
    configuration = load_configuration(config)
    calibration = load_calibration(config.parent / configuration.calibration)
    manager = ServiceManager()
    imu = build_imu(configuration.imu)
    camera = ReplaceableCamera(camera_opener(configuration.camera, calibration))
    if not manager.is_there:
        with next_step_named():
            imu.open()
            camera.open()
    try:
        outlets = open_outlets(configuration, calibration, retry_opening=manager.is_there)
    except DeviceError as error:
        if manager.is_there:  # no mistake to mend by hand: the manager tries again
            raise ServiceError(str(error)) from error
        raise
    keeper = StateKeeper(state_path(config, configuration), calibration)
    learnt = keeper.load()
    recorder = None
    tally = Tally()
    with outlets.closed_on_failure():
        if record is not None:
            recorder = open_recorder(
                record, configuration, calibration, Source.LIVE, last, learnt, outputs_only=outputs_only
            )
        service = build_service(
            configuration,
            calibration,
            Source.LIVE,
            imu,
            camera,
            outlets,
            recorder,
            [tally],
            priorities=configuration.realtime.priorities,
            learnt=learnt,
            state_keeper=keeper,
            folder=config.parent,
        )
    if configuration.realtime.lock_memory:
        lock_memory()
    reloader = Reloader(config, configuration, calibration, service, camera, outlets)
    with (
        stopped_by_signals(service, manager.stopping),
        reloader.listening(),
        LiveStatus(tally, manager=manager) as live,
    ):

        def turn() -> None:
            if reloader.asked:
                manager.reloading()
                reloader.reload()
                manager.ready()
            if service.progress.all_advanced():
                manager.feed_watchdog()
            live.refresh(service.problems)

        service.run(seconds, status=turn)
    facts = tally.summary(service.latency, service.beats_skipped)
    if not manager.is_there:
        summary_tables(facts)
    if json is not None:
        write_json(json, facts)
    if recorder is not None and record is not None:
        tell_recording(recorder, record)
