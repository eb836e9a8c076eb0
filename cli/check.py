"""`gaiteyes check`: is this unit fit to be worn? Watches each device for some seconds and says what it finds."""

from typing import Annotated

import typer

from cli.options import CONFIG_FILE, ConfigFile, JsonFile


def check(
    config: ConfigFile = CONFIG_FILE,
    seconds: Annotated[float, typer.Option(min=1.0, max=60.0, help="How long to watch each device.")] = 3.0,
    self_test: Annotated[bool, typer.Option(help="Run the IMU's self-test; the unit must lie still.")] = True,
    json: JsonFile = None,
) -> None:
    """Check the devices that the configuration names, one after the other; exit code 1 if one is faulty."""
    from collections.abc import Callable, Iterator
    from datetime import datetime, timezone
    from functools import partial

    from calib.files import load_calibration
    from cli.console import check_writable, table, write_json
    from cli.devices import build_imu, camera_opener
    from cli.progress import progress
    from daemon import checkup
    from daemon.checkup import Finding, Verdict
    from daemon.config import load_configuration
    from daemon.state_file import state_path

    check_writable(json)
    configuration = load_configuration(config)
    calibration = load_calibration(config.parent / configuration.calibration)

    def imu() -> Iterator[Finding]:
        device = build_imu(configuration.imu)
        try:
            device.open()
            if self_test:
                yield from checkup.check_self_test(device.self_test())
            yield from checkup.check_imu(device, seconds)
        finally:
            device.close()

    def camera() -> Iterator[Finding]:
        device = camera_opener(configuration.camera, calibration)()
        try:
            yield from checkup.check_camera(device, seconds)
        finally:
            device.close()

    can = partial(checkup.check_can, configuration.can, seconds)
    looks: dict[str, Callable[[], Iterator[Finding]]] = {"IMU": imu, "camera": camera, "CAN": can}
    findings: list[Finding] = []
    for subject in progress(list(looks), "checking"):
        findings += checkup.guarded(subject, looks[subject])
    findings += checkup.check_learnt(state_path(config, configuration), calibration, datetime.now(timezone.utc))
    findings += checkup.check_host()
    table(
        f"{config}, device {configuration.device}, calibration {calibration.id} of unit {calibration.unit}",
        ["", "verdict", "found"],
        [[finding.subject, finding.verdict.value, finding.seen] for finding in findings],
        words=True,
    )
    if json is not None:
        write_json(json, findings)
    if checkup.worst(findings) is Verdict.FAULT:
        raise typer.Exit(1)
