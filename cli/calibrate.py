"""`gaiteyes calibrate`: calibration files from what is known of a unit and measured on it, each with its seal."""

import enum
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.calibrate_formats import export, kalibr
from cli.calibrate_imu import imu, noise
from cli.calibrate_mount import apply, mount
from cli.calibrate_rows import rows
from cli.calibrate_stereo import stereo
from cli.calibrate_target import Into, Out, Unit, target
from cli.options import JsonFile

if TYPE_CHECKING:  # every command imports what it needs when it is called
    from calib.wearer import WearerMeasurement
    from messages import UnitCalibration

calibrate = typer.Typer(help="Make a unit's calibration file.", no_args_is_help=True)

calibrate.command()(imu)
calibrate.command()(noise)
calibrate.command()(stereo)
calibrate.command()(rows)
calibrate.command()(kalibr)
calibrate.command()(export)
calibrate.command()(mount)
calibrate.command()(apply)


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
    into: Into = None,
    out: Out = None,
    unit: Unit = None,
    json: JsonFile = None,
) -> None:
    """Import a ZED's factory calibration; without --into the rest is nominal, not fit to walk on."""
    from calib.files import save_calibration
    from calib.nominal import uncalibrated_unit
    from calib.zed_conf import load_zed_conf, with_factory_pair
    from cli.console import check_writable, console, write_json

    check_writable(json)
    file, known = target(out, into)
    stereo = load_zed_conf(conf, mode.value)
    if known is None:
        made = uncalibrated_unit(unit or f"{conf.stem} {mode.value}, rest nominal", stereo)
    else:
        made = with_factory_pair(known, stereo, unit)
    save_calibration(file, made)

    _tell(file, made)
    console.print("Row time and time stamps are not verified.", soft_wrap=True)
    if known is None:
        console.print(
            "IMU and mounting are nominal: calibrate them before anybody walks with this unit.", soft_wrap=True
        )
    if json is not None:
        write_json(json, {"file": str(file), "id": made.id, "calibration": made})


@calibrate.command()
def seal(
    file: Annotated[Path, typer.Argument(help="The calibration file, edited by hand or older than seals.")],
    json: JsonFile = None,
) -> None:
    """Check a calibration file that was not written by these commands, show what it says, and seal it for use."""
    from calib.files import seal_file
    from cli.console import check_writable, console, write_json

    check_writable(json)
    calibration = seal_file(file)
    _tell(file, calibration)
    console.print("Sealed as it stands. Compare these values with what was meant.", soft_wrap=True)
    if json is not None:
        write_json(json, {"file": str(file), "id": calibration.id, "calibration": calibration})


@calibrate.command()
def wearer(
    file: Annotated[Path, typer.Argument(help="The unit's calibration file; the wearer's height is written into it.")],
    recording: Annotated[
        Path | None, typer.Option("--from", help="Measure on this recording of the unit, instead of on its devices.")
    ] = None,
    config: Annotated[
        Path, typer.Option(help="Configuration (TOML) that names the devices; the service must not be using them.")
    ] = Path("gaiteyes.toml"),
    seconds: Annotated[float, typer.Option(min=10.0, max=300.0, help="How long to measure on devices.")] = 30.0,
    json: JsonFile = None,
) -> None:
    """Measure how high the wearer carries the camera, over half a minute of standing and walking, and keep it.

    Stand upright for some seconds, walk on over level ground, stand again, in the shoes worn most.
    """
    import cv2
    import msgspec

    from calib.files import load_calibration, save_calibration
    from calib.wearer import WearerMeasurement
    from cli.calibrate_live import run_live
    from cli.console import check_writable, table, write_json
    from messages import DepthUnitCalibration, UserError

    check_writable(json)
    cv2.setNumThreads(1)
    known = load_calibration(file)
    if isinstance(known, DepthUnitCalibration):
        raise UserError(f"{file}: is of a depth camera, with which nobody sees whether its wearer stands or walks")
    measured = WearerMeasurement()
    if recording is not None:
        _measure_recorded(recording, known, file, measured)
    else:
        run_live(config, seconds, known, lambda estimate, _header: measured.add(estimate))
    height = measured.height(str(recording if recording is not None else config))
    made = msgspec.structs.replace(known, wearer=height)
    save_calibration(file, made)
    table(
        f"{file}: unit '{made.unit}', calibration {made.id}",
        ["", "value"],
        [
            ["camera above the ground", f"{height.camera_height_m:.3f} ± {height.std_m:.3f} m"],
            ["frames", str(measured.frames)],
        ],
    )
    if json is not None:
        write_json(json, {"file": str(file), "id": made.id, "frames": measured.frames, "wearer": height})


def _measure_recorded(recording: Path, known: "UnitCalibration", file: Path, measured: "WearerMeasurement") -> None:
    """Give `measured` what the pipeline makes of a recording. Raises UserError if it is of another calibration."""
    from cli.calibrate_live import pipeline_without_wearer
    from daemon.replay_source import open_source
    from messages import UserError

    opened = open_source(recording, None)
    if _without_wearer(opened.calibration).id != _without_wearer(known).id:
        raise UserError(
            f"{recording}: was recorded with calibration {opened.calibration.id} of unit '{opened.calibration.unit}', "
            f"{file} is {known.id} of '{known.unit}': measure on a recording made with this file"
        )
    pipeline = pipeline_without_wearer(known, opened.configuration.foothold, opened.learnt)
    for message in opened.inputs():
        for estimate in pipeline.step(message):
            measured.add(estimate)


def _without_wearer(calibration: "UnitCalibration") -> "UnitCalibration":
    import msgspec

    return msgspec.structs.replace(calibration, wearer=msgspec.UNSET)


def _tell(file: Path, calibration: "UnitCalibration") -> None:
    """Print what a person can compare with the unit in the hand."""
    from cli.console import table
    from messages import StereoCalibration
    from messages.constants import STANDARD_GRAVITY_MPS2

    camera, imu, residual = calibration.camera, calibration.imu, calibration.residual
    if isinstance(camera, StereoCalibration):
        lenses, baseline_m = [camera.left, camera.right], math.hypot(*camera.X_RL.p_m)
    else:
        lenses, baseline_m = [camera.lens], camera.baseline_m
    ahead, across, up = (row[2] for row in calibration.X_BE.R)
    bias_mg = ", ".join(f"{1e3 * bias / STANDARD_GRAVITY_MPS2:+.1f}" for bias in imu.sf_bias_mps2)
    bias_degps = ", ".join(f"{math.degrees(bias):+.2f}" for bias in imu.w_bias_radps)
    table(
        f"{file}: unit '{calibration.unit}', calibration {calibration.id}",
        ["", "value"],
        [
            ["camera", f"{camera.lens.width_px}x{camera.lens.height_px} px"],
            ["focal lengths", ", ".join(f"{lens.fx_px:.1f}" for lens in lenses) + " px"],
            ["baseline", f"{1e3 * baseline_m:.2f} mm"],
            ["row time", f"{1e6 * camera.row_time_s:.1f} µs"],
            ["time stamp to mid-exposure", f"{1e3 * camera.stamp_to_mid_exposure_s:+.1f} ms"],
            ["optical axis, in the IMU's axes", f"{ahead:+.3f}, {across:+.3f}, {up:+.3f}"],
            ["accelerometer bias", f"{bias_mg} mg"],
            ["gyroscope bias", f"{bias_degps} °/s"],
            ["time error, one σ", f"{1e3 * residual.time_s:.1f} ms"],
            ["camera to IMU rotation error, one σ", f"{math.degrees(residual.camera_to_imu_rad):.2f}°"],
            ["accelerometer error, one σ", f"{1e3 * residual.specific_force_mps2 / STANDARD_GRAVITY_MPS2:.1f} mg"],
            ["its change with the die, one σ", f"{1e3 * residual.sf_per_K_std_mps2 / STANDARD_GRAVITY_MPS2:.2f} mg/K"],
            ["focal length error, one σ", f"{1e2 * residual.focal_length_std:.3f} %"],
            ["baseline error, one σ", f"{1e2 * residual.baseline_std:.2f} %"],
        ],
    )
