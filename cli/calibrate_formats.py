"""`gaiteyes calibrate kalibr` and `calibrate export`: the pair from and into other programs' files."""

from pathlib import Path
from typing import Annotated

import typer

from cli.calibrate_target import Into, Out, Unit, target
from cli.options import JsonFile


def kalibr(
    camchain: Annotated[Path, typer.Argument(help="Kalibr's camchain.yaml: cam0 left, cam1 right.")],
    into: Into = None,
    out: Out = None,
    unit: Unit = None,
    json: JsonFile = None,
) -> None:
    """Import a pair from Kalibr, with the IMU's place where that stands in the file."""
    import msgspec

    from calib.files import save_calibration
    from calib.nominal import uncalibrated_unit
    from calib.stereo.pair_files import imu_pose, parse_camchain
    from calib.zed_conf import with_factory_pair
    from cli.console import check_writable, console, write_json
    from messages.text_files import read_text

    check_writable(json)
    file, known = target(out, into)
    text = read_text(camchain)
    pair = parse_camchain(text, str(camchain))
    made = uncalibrated_unit(unit or camchain.stem, pair) if known is None else with_factory_pair(known, pair, unit)
    pose = imu_pose(text, str(camchain))
    if pose is not None:
        made = msgspec.structs.replace(made, X_BL=pose)
    save_calibration(file, made)
    told = "with the IMU's place" if pose is not None else "without the IMU's place, which is as it was"
    console.print(
        f"Written to {file}: unit '{made.unit}', calibration {made.id}, {told}.", soft_wrap=True, highlight=False
    )
    if json is not None:
        write_json(json, {"file": str(file), "id": made.id, "calibration": made})


def export(
    file: Annotated[Path, typer.Argument(help="The unit's calibration file.")],
    out: Annotated[Path, typer.Option(help="File to write: a ZED's .conf, or Kalibr's camchain as .yaml.")],
) -> None:
    """Write the pair in another program's format, told by the file's ending."""
    from calib.files import load_calibration
    from calib.stereo.pair_files import camchain_text
    from calib.zed_conf import ZED_MODES, zed_conf_text
    from cli.console import console
    from messages import Calibration, UserError

    calibration = load_calibration(file)
    if not isinstance(calibration, Calibration):
        raise UserError(f"{file}: is of a depth camera, which has no pair")
    if out.suffix.lower() == ".conf":
        size = (calibration.stereo.left.width_px, calibration.stereo.left.height_px)
        mode = next((mode for mode, known in ZED_MODES.items() if known[:2] == size), None)
        if mode is None:
            raise UserError(f"{file}: is for {size[0]}x{size[1]} px, which is no resolution of a ZED")
        text = zed_conf_text(calibration.stereo, mode)
    elif out.suffix.lower() in (".yaml", ".yml"):
        text = camchain_text(calibration)
    else:
        raise UserError(f"--out {out}: allowed endings .conf and .yaml")
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"{out}: {error.strerror}") from error
    console.print(f"written to {out}", highlight=False)
