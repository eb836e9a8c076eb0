"""`gaiteyes calibrate`: calibration files from what is known of a unit."""

import enum
import math
from pathlib import Path
from typing import Annotated

import typer

from messages.constants import STANDARD_GRAVITY_MPS2

calibrate = typer.Typer(help="Make a unit's calibration file.", no_args_is_help=True)

JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the same facts for a program.")]


class Mode(str, enum.Enum):
    """The resolutions of a ZED."""

    TWO_K = "2K"
    FHD = "FHD"
    HD = "HD"
    VGA = "VGA"


@calibrate.command()
def zed(
    conf: Annotated[Path, typer.Argument(help="The maker's file SNxxxxxxxx.conf of this camera.")],
    mode: Annotated[Mode, typer.Option(help="Resolution the camera will run at; HD is 1280x720.")] = Mode.HD,
    into: Annotated[Path | None, typer.Option(help="Take all but the stereo pair from this calibration file.")] = None,
    out: Annotated[Path, typer.Option(help="File to write; it may be the one of --into.")] = Path("calibration.yaml"),
    unit: Annotated[str | None, typer.Option(help="Name of the unit; by default made of the file's name.")] = None,
    json: JsonFile = None,
) -> None:
    """Import a ZED's factory calibration; without --into the rest is nominal, not fit to walk on."""
    from calib.files import load_calibration, save_calibration
    from calib.nominal import uncalibrated_unit
    from calib.zed_conf import load_zed_conf, with_factory_pair
    from cli.console import check_writable, console, table, write_json
    from messages import Calibration, UserError

    check_writable(json)
    if out.exists() and (into is None or not out.samefile(into)):
        raise UserError(f"--out {out}: exists already; name another file, or change this one with --into {out}")
    stereo = load_zed_conf(conf, mode.value)
    if into is None:
        made = uncalibrated_unit(unit or f"{conf.stem} {mode.value}, rest nominal", stereo)
    else:
        known = load_calibration(into)
        if not isinstance(known, Calibration):
            raise UserError(f"--into {into}: is of a depth camera, which a ZED's pair cannot replace")
        made = with_factory_pair(known, stereo, unit)
    save_calibration(out, made)

    lens, residual = made.stereo.left, made.residual
    table(
        f"{out}: unit '{made.unit}', calibration {made.id}",
        ["", "value"],
        [
            ["each camera", f"{lens.width_px}x{lens.height_px} px, f {lens.fx_px:.1f} px"],
            ["baseline", f"{-1e3 * made.stereo.X_RL.p_m[0]:.2f} mm"],
            ["row time, not verified", f"{1e6 * made.stereo.row_time_s:.1f} µs"],
            ["time stamp to mid-exposure, not verified", f"{1e3 * made.stereo.stamp_to_mid_exposure_s:+.1f} ms"],
            ["time error, one σ", f"{1e3 * residual.time_s:.1f} ms"],
            ["camera to IMU rotation error, one σ", f"{math.degrees(residual.camera_to_imu_rad):.2f}°"],
            ["accelerometer error, one σ", f"{1e3 * residual.specific_force_mps2 / STANDARD_GRAVITY_MPS2:.1f} mg"],
        ],
    )
    if into is None:
        console.print(
            "IMU and mounting are nominal: calibrate them before anybody walks with this unit.", soft_wrap=True
        )
    if json is not None:
        write_json(json, {"file": str(out), "id": made.id, "calibration": made})
