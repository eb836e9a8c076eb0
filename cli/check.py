"""`gaiteyes check`: is this unit fit to be worn? Watches each device for some seconds and says what it finds."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import CONFIG_FILE, ConfigFile, JsonFile

if TYPE_CHECKING:
    from daemon.checkup import Finding
    from daemon.config import Configuration
    from daemon.replaceable_camera import OpenCamera
    from drivers.discovery.devices import FoundDevices
    from messages import UnitCalibration


def check(
    config: ConfigFile = CONFIG_FILE,
    seconds: Annotated[float, typer.Option(min=1.0, max=60.0, help="How long to watch each device.")] = 3.0,
    self_test: Annotated[bool, typer.Option(help="Run the IMU's self-test; the unit must lie still.")] = True,
    json: JsonFile = None,
) -> None:
    """Is this unit fit to be worn? Look at each device and at the calibration.

    Where a file is missing, what is plugged in is looked at. Each line that is not fine says what to do next. Exit code
    1 if something is faulty.
    """
    from collections.abc import Callable
    from datetime import datetime, timezone
    from functools import partial

    from cli.console import check_writable, table, write_json
    from cli.devices import build_imu
    from cli.progress import progress
    from daemon import checkup
    from daemon.checkup import Finding, Verdict
    from daemon.state_file import state_path

    check_writable(json)
    findings: list[Finding] = []
    configuration = _configuration(config, findings)
    calibration = _calibration(config.parent / configuration.calibration, findings)

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
        device = _camera_opener(configuration, calibration)()
        try:
            yield from checkup.check_camera(device, seconds)
        finally:
            device.close()

    can = partial(checkup.check_can, configuration.can, seconds)
    looks: dict[str, Callable[[], Iterator[Finding]]] = {"IMU": imu, "camera": camera, "CAN": can}
    for subject in progress(list(looks), "checking"):
        findings += checkup.guarded(subject, looks[subject], partial(_cure, subject, config))
    if calibration is not None:
        findings += checkup.check_calibration(calibration)
        findings += checkup.check_learnt(state_path(config, configuration), calibration, datetime.now(timezone.utc))
    findings += checkup.check_host()
    of_unit = "" if calibration is None else f", calibration {calibration.id} of unit {calibration.unit}"
    table(
        f"{config}, device {configuration.device}{of_unit}",
        ["", "verdict", "found", "next"],
        [[finding.subject, finding.verdict.value, finding.seen, finding.next] for finding in findings],
        words=True,
    )
    if json is not None:
        write_json(json, findings)
    if checkup.worst(findings) is Verdict.FAULT:
        raise typer.Exit(1)


def _configuration(config: Path, findings: "list[Finding]") -> "Configuration":
    """Return what the file says; without a file what is plugged in, and that there is none is a fault."""
    from daemon.checkup import Finding, Verdict
    from daemon.config import load_configuration
    from daemon.proposal import proposed

    if config.exists():
        return load_configuration(config)
    seen = f"{config} is not there; looked at is what is plugged in"
    cure = "gaiteyes init" if config == CONFIG_FILE else f"gaiteyes init --config {config}"
    findings.append(Finding(subject="configuration", verdict=Verdict.FAULT, seen=seen, next=cure))
    return proposed(_found())


def _calibration(file: Path, findings: "list[Finding]") -> "UnitCalibration | None":
    """Return what the file says; None where it cannot be used, which is a fault."""
    from calib.files import load_calibration
    from daemon.checkup import Finding, Verdict
    from messages import UserError

    try:
        return load_calibration(file)
    except UserError as error:
        cure = "see docs/hardware.md, The camera" if file.exists() else "gaiteyes init"
        findings.append(Finding(subject="calibration", verdict=Verdict.FAULT, seen=str(error), next=cure))
        return None


def _camera_opener(configuration: "Configuration", calibration: "UnitCalibration | None") -> "OpenCamera":
    """Return what opens the camera; without a calibration with the size and kind that it has by itself.

    Raises DeviceError where then no camera is found.
    """
    from calib.nominal import NominalOptics
    from cli.devices import camera_opener
    from daemon.proposal import nominal_calibration
    from drivers.protocols import DeviceError

    if calibration is None:
        settings = configuration.camera
        camera = _found().camera_at(settings.left or settings.device)
        if camera is None:
            raise DeviceError(f"camera {settings.left or settings.device}: no camera is found there")
        calibration = nominal_calibration(camera, NominalOptics(baseline_m=0.1, view_rad=1.5), "opened for a look")
    return camera_opener(configuration.camera, calibration)


def _cure(subject: str, config: Path) -> str:
    """Return what to do about a device that cannot be used."""
    found = _found()
    there = {"IMU": found.imu, "camera": found.camera, "CAN": found.can}[subject]
    if subject == "CAN" and found.can is not None and not found.can.is_up:
        return f"sudo ip link set {found.can.channel} up type can bitrate 500000 restart-ms 100"
    if there is not None:
        return f"found is {there}: name it in {config}, or gaiteyes init --force"
    wires = {
        "IMU": "check 3.3 V, SDA and SCL, and that I2C is switched on",
        "camera": "plug it in; `v4l2-ctl --list-devices` lists what Linux sees",
        "CAN": "plug the adapter in; `ip link set can0 up type can bitrate 500000` starts a link",
    }[subject]
    return f"{wires}; then gaiteyes check"


def _found() -> "FoundDevices":
    from drivers.discovery.devices import find_devices

    return find_devices()
