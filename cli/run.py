"""`gaiteyes run`: the daemon on hardware. It never falls back to simulation."""

from pathlib import Path
from typing import Annotated

import typer


def run(
    config: Annotated[Path, typer.Option(help="Configuration file (TOML).")] = Path("gaiteyes.toml"),
    seconds: Annotated[float | None, typer.Option(min=1.0, help="Stop after so long; runs on without.")] = None,
    record: Annotated[Path | None, typer.Option(help="Record all inputs and outputs to this MCAP file.")] = None,
    last: Annotated[float | None, typer.Option(min=1.0, help="Record only the newest seconds.")] = None,
    json: Annotated[Path | None, typer.Option(help="Write the summary for a program.")] = None,
) -> None:
    """Run the daemon on the IMU and the camera that the configuration names."""
    from functools import partial

    from smbus2 import SMBus

    from calib.files import load_calibration
    from cli.console import check_writable, write_json
    from cli.live import LiveStatus
    from cli.wiring import build_service, open_outlets, open_recorder, stopped_by_signals, summary_tables
    from daemon.config import load_configuration
    from daemon.summary import Tally
    from drivers.mpu6050 import Mpu6050
    from drivers.mpu6050_settings import Mpu6050Settings
    from drivers.v4l2 import V4l2StereoCamera
    from messages import Source

    check_writable(json)
    configuration = load_configuration(config)
    calibration = load_calibration(config.parent / configuration.calibration)
    imu = Mpu6050(partial(SMBus, configuration.imu.bus), address=configuration.imu.address, settings=Mpu6050Settings())
    imu.open()
    stereo = calibration.stereo
    camera = V4l2StereoCamera(
        configuration.camera.device,
        stereo.left.width_px,
        stereo.left.height_px,
        pool_frames=POOL_FRAMES,
        stamp_to_mid_exposure_s=stereo.stamp_to_mid_exposure_s,
        rate_hz=configuration.camera.rate_hz,
    )
    outlets = open_outlets(configuration, calibration)
    recorder = open_recorder(record, configuration, calibration, Source.LIVE, last) if record is not None else None
    tally = Tally()
    service = build_service(configuration, calibration, Source.LIVE, imu, camera, outlets, recorder, [tally])
    with stopped_by_signals(service), LiveStatus(tally) as live:
        service.run(seconds, status=live.refresh)
    facts = tally.summary(service.latency, service.beats_skipped)
    summary_tables(facts)
    if json is not None:
        write_json(json, facts)


POOL_FRAMES = 16
"""One being filled, one waiting, one in the pipeline, eight in the recorder's queue, and some to spare."""
