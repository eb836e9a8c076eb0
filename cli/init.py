"""`gaiteyes init`: the first command on new hardware. Finds the devices and writes the files to begin with."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.calibrate import Mode
from cli.options import CONFIG_FILE, JsonFile

if TYPE_CHECKING:
    from daemon.config import Configuration
    from drivers.discovery.cameras import FoundCamera
    from drivers.discovery.devices import FoundDevices
    from messages import UnitCalibration


def init(
    config: Annotated[Path, typer.Option(help="Configuration file (TOML) to write.")] = CONFIG_FILE,
    device: Annotated[str | None, typer.Option(help="Name under which the unit publishes.")] = None,
    imu: Annotated[
        str | None, typer.Option(help="The IMU as BUS:ADDRESS, 1:0x68 say; by default the first found.")
    ] = None,
    data_ready: Annotated[
        str | None,
        typer.Option(help="GPIO line that the IMU's INT is wired to, as /dev/gpiochip0:17; by default it is polled."),
    ] = None,
    camera: Annotated[
        str | None, typer.Option(help="Node of the camera, both eyes or depth; by default the first found.")
    ] = None,
    left: Annotated[str | None, typer.Option(help="Of two separate cameras, the left one's node.")] = None,
    right: Annotated[str | None, typer.Option(help="Of two separate cameras, the right one's node.")] = None,
    can: Annotated[
        str | None, typer.Option(help="CAN bus as INTERFACE:CHANNEL, socketcan:can0 say; by default the first found.")
    ] = None,
    conf: Annotated[
        Path | None, typer.Option(help="A ZED's factory calibration SNxxxxxxxx.conf, which knows its lenses.")
    ] = None,
    mode: Annotated[Mode, typer.Option(help="With --conf, the resolution; HD is 1280x720.")] = Mode.HD,
    baseline_mm: Annotated[
        float | None, typer.Option(min=20.0, max=500.0, help="Without --conf: distance of the two lenses, mm.")
    ] = None,
    view_deg: Annotated[
        float | None, typer.Option(min=20.0, max=135.0, help="Without --conf: what a picture shows across, degrees.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write a configuration that is there already anew.")] = False,
    json: JsonFile = None,
) -> None:
    """Find this unit's devices, and write the files to begin with.

    gaiteyes.toml names the devices. calibration.yaml beside it is nominal: it says what is known from data sheets, and
    how little that is; `gaiteyes check` refuses to call such a unit fit to be worn. One that is there is kept.
    """
    from calib.files import load_calibration, save_calibration
    from cli.console import check_writable, console, table, write_json
    from cli.progress import working
    from daemon.config import format_choices, load_configuration
    from drivers.discovery.devices import find_devices
    from messages import UserError

    check_writable(json)
    known = load_configuration(config) if config.exists() and not force else None
    with working("looking for devices"):
        found = find_devices()
    chosen = known or _chosen(found, device, imu, data_ready, camera, left, right, can)
    file = config.parent / chosen.calibration
    kept = file.exists()
    if known is not None and (kept or any((device, imu, data_ready, camera, left, right, can))):
        raise UserError(f"{config}: exists already; `gaiteyes check` looks at what it names, --force writes it anew")
    calibration = load_calibration(file) if kept else _nominal(found, chosen, conf, mode, baseline_mm, view_deg)
    if known is None:
        try:
            config.write_text(_HEADING + format_choices(chosen), encoding="utf-8")
        except OSError as error:
            raise UserError(f"{config}: {error.strerror}") from error
    if calibration is not None and not kept:
        save_calibration(file, calibration)

    rows = [["IMU", str(each)] for each in found.imus] or [["IMU", "none; are SDA, SCL and 3.3 V wired, and I2C on?"]]
    rows += [["camera", str(each)] for each in found.cameras] or [["camera", "none"]]
    rows += [["CAN", str(each)] for each in found.cans] or [["CAN", "none; [can] is virtual until one is named"]]
    table("Found", ["", ""], [*rows, *(["not looked at", remark] for remark in found.remarks)], words=True)
    console.print(f"{config}: {'written' if known is None else 'kept'}", soft_wrap=True)
    what = "none: without a camera nothing is known of it; plug it in, then gaiteyes init"
    if calibration is not None:
        what = f"{'kept' if kept else 'written'}, unit '{calibration.unit}', id {calibration.id}"
    named = "" if config == CONFIG_FILE else f" --config {config}"
    console.print(f"{file}: {what}\nnext: gaiteyes check{named}", soft_wrap=True)
    if json is not None:
        made_id = None if calibration is None else calibration.id
        write_json(json, {"found": found, "configuration": chosen, "calibration_id": made_id, "kept": kept})


_HEADING = """\
# What this unit is made of; `gaiteyes check` tells whether it is right. Further settings: docs/hardware.md.
"""


def _chosen(
    found: "FoundDevices",
    device: str | None,
    imu: str | None,
    data_ready: str | None,
    camera: str | None,
    left: str | None,
    right: str | None,
    can: str | None,
) -> "Configuration":
    """Return the configuration of what was found, where the person has not said otherwise."""
    import msgspec

    from daemon.config import CameraSettings, Configuration
    from daemon.proposal import proposed
    from drivers.can.settings import parse_can
    from messages import UserError
    from messages.checked import checked

    known = proposed(found)
    settings = msgspec.to_builtins(known.imu) | {"data_ready": data_ready or ""}
    if imu is not None:
        try:
            bus, address = (int(part, 0) for part in imu.split(":"))
        except ValueError as error:
            raise UserError(f"--imu {imu}: expected BUS:ADDRESS, 1:0x68 say") from error
        settings |= {"bus": bus, "address": address}
    eyes = known.camera
    if left is not None or right is not None:
        if left is None or right is None or camera is not None:
            raise UserError("--left and --right belong together, each with the node of a camera, without --camera")
        eyes = checked({"left": left, "right": right}, CameraSettings, "--left, --right")
    elif camera is not None:
        eyes = CameraSettings(device=camera)
    chosen = {
        "device": known.device if device is None else device,
        "imu": settings,
        "camera": msgspec.to_builtins(eyes),
        "can": msgspec.to_builtins(known.can if can is None else parse_can(can)),
    }
    return checked(chosen, Configuration, "gaiteyes init")


def _nominal(
    found: "FoundDevices",
    chosen: "Configuration",
    conf: Path | None,
    mode: Mode,
    baseline_mm: float | None,
    view_deg: float | None,
) -> "UnitCalibration | None":
    """Return a calibration to begin with; None where no camera is there to make one for."""
    import math

    from calib.nominal import NominalOptics, known_optics, uncalibrated_unit
    from calib.zed_conf import load_zed_conf
    from daemon.proposal import nominal_calibration
    from messages import UserError

    if conf is not None:
        return uncalibrated_unit(f"{conf.stem} {mode.value}, rest nominal", load_zed_conf(conf, mode.value))
    seen = _seen(found, chosen)
    if seen is None:
        return None
    optics = known_optics(seen.card)
    if baseline_mm is not None and view_deg is not None:
        optics = NominalOptics(1e-3 * baseline_mm, math.radians(view_deg))
    if optics is None:
        raise UserError(
            f"{seen}: is not known here; its data sheet tells --baseline-mm and --view-deg, a ZED's maker has --conf"
        )
    return nominal_calibration(seen, optics, f"{seen.card.split(':')[0]}, nominal"[:64])


def _seen(found: "FoundDevices", chosen: "Configuration") -> "FoundCamera | None":
    """Return the camera that was chosen, as it was found; None where it is the default and there is none.

    Raises UserError where one was asked for that is not there.
    """
    from drivers.discovery.cameras import CameraKind
    from messages import UserError

    settings = chosen.camera
    apart = settings.left is not None
    path = settings.left or settings.device
    seen = found.camera_at(path)
    if seen is not None and apart is (seen.kind is CameraKind.SINGLE):
        return seen
    singles = [each for each in found.cameras if each.kind is CameraKind.SINGLE]
    there = "; ".join(map(str, found.cameras)) or "none was found"
    if path == type(settings)().device and not found.cameras:
        return None
    if not apart and singles and len(singles) == len(found.cameras):
        there += "; two that belong together are named with --left and --right"
    raise UserError(f"camera {path}: is not there, or is of another kind; {there}")
