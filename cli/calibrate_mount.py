"""`gaiteyes calibrate mount` and `calibrate apply`: what a walk, and what the finder, tell of a unit's calibration."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import CONFIG_FILE, ConfigFile, JsonFile

if TYPE_CHECKING:
    from calib.mount import Found, Mounted
    from calib.pair import PairErrors
    from messages import Calibration, StereoFrame

Recording = Annotated[
    Path | None, typer.Option("--from", help="Measure on this recording of the unit, instead of on its devices.")
]


def mount(
    file: Annotated[Path, typer.Argument(help="The unit's calibration file; the camera's place is written into it.")],
    recording: Recording = None,
    config: ConfigFile = CONFIG_FILE,
    seconds: Annotated[float, typer.Option(min=40.0, max=300.0, help="How long to measure on devices.")] = 60.0,
    json: JsonFile = None,
) -> None:
    """Find how the camera stands in the IMU's axes, and when its pictures are taken, over a minute of walking.

    Stand for some seconds, walk over ground that has texture, stop and go on, with turns. Biases of both sensors and
    the scale of distances are taken over too, as far as the walk tells them better than the file does.
    """
    import tempfile

    import cv2

    from calib.files import load_calibration, save_calibration
    from calib.mount import measured
    from cli.calibrate_live import run_live
    from cli.console import check_writable, console, write_json
    from messages import Calibration, UserError

    check_writable(json)
    cv2.setNumThreads(1)
    known = load_calibration(file)
    if not isinstance(known, Calibration):
        raise UserError(f"{file}: is of a depth camera, whose pictures tell no motion")
    where = str(recording if recording is not None else config)
    with tempfile.TemporaryDirectory(prefix=".walk-", dir=file.absolute().parent) as folder:
        walk = Path(folder) / "walk.mcap" if recording is None else recording
        if recording is None:
            run_live(config, seconds, known, record=walk)
        made = measured(known, lambda calibration, what: _walked(walk, calibration, where, what), where)
    save_calibration(file, made.calibration)
    _tell(made, file)
    console.print(f"Written to {file}: calibration {made.calibration.id}.", soft_wrap=True, highlight=False)
    if json is not None:
        write_json(json, {"file": str(file), "id": made.calibration.id} | _facts(made))


def apply(
    file: Annotated[Path, typer.Argument(help="The unit's calibration file to write into.")],
    extended: Annotated[Path, typer.Argument(help="extended.toml, or its folder, as `explain wearable` wrote it.")],
    next_recording: Annotated[
        Path | None,
        typer.Option("--next", help="Folder of another recording above known ground, to measure the gain on."),
    ] = None,
    json: JsonFile = None,
) -> None:
    """Take over into the calibration what the finder has found wrong of it, and measure the gain on the next recording.

    What is no calibration's, such as motion blur, is named and left. A gain below zero leaves the file as it is.
    """
    from calib.apply import applied
    from calib.files import check_calibration, load_calibration, save_calibration
    from cli.console import check_writable, console, table, write_json
    from discrepancy.report.extended import read_extended
    from messages import Calibration, UserError

    check_writable(json)
    if extended.is_dir():
        extended = extended / "extended.toml"
    known = load_calibration(file)
    if not isinstance(known, Calibration):
        raise UserError(f"{file}: is of a depth camera; the finder knows stereo units")
    told = read_extended(extended, "wearable")
    made = applied(known, told.effects, str(extended))
    check_calibration(made.calibration, str(extended))
    table(
        f"{extended}: into {file}",
        ["effect", "taken over", "by"],
        [[change.effect, change.what, change.by] for change in made.changes],
        words=True,
    )
    for name, why in made.left.items():
        console.print(f"not taken over: {name}: {why}", soft_wrap=True, highlight=False, markup=False)
    facts: dict[str, object] = {
        "changes": [change._asdict() for change in made.changes],
        "left": made.left,
    }
    if next_recording is not None:
        before, after = _misfit(next_recording, known, made.calibration)
        gain = 1.0 - after / before
        facts |= {"misfit_before": before, "misfit_after": after, "gain": gain}
        console.print(
            f"on {next_recording}: misfit {before:.2f} before, {after:.2f} after, in units of the noise: "
            f"{100 * gain:+.0f} % of it removed",
            soft_wrap=True,
            highlight=False,
        )
        if gain <= 0.0:
            if json is not None:
                write_json(json, facts)
            raise UserError(f"{next_recording}: gains nothing with {extended}; {file} stays as it is")
    save_calibration(file, made.calibration)
    console.print(f"Written to {file}: calibration {made.calibration.id}.", soft_wrap=True, highlight=False)
    if json is not None:
        write_json(json, facts | {"file": str(file), "id": made.calibration.id})


def _misfit(recording: Path, before: "Calibration", after: "Calibration") -> tuple[float, float]:
    """Return the root mean square of what the base model misses of a recording, in units of its channels' noise, with
    one calibration and with the other."""
    from systems.wearable.simulation import misfit

    return misfit(recording, before), misfit(recording, after)


def _walked(walk: Path, calibration: "Calibration", where: str, what: str) -> "Found | None":
    """Return what the motion filter has found at the end of a walk, None where camera and IMU do not agree.

    Raises UserError for a walk that is too short or of another camera.
    """
    import numpy as np

    from calib.mount import LEAST_S, RIGID, Course, Found
    from cli.progress import LiveLine
    from daemon.pipeline import Pipeline
    from daemon.replay_source import open_source
    from messages import Calibration, ImuSample, StereoFrame, UserError

    opened = open_source(walk, None)
    recorded = opened.calibration
    if not isinstance(recorded, Calibration) or recorded.stereo.left.width_px != calibration.stereo.left.width_px:
        raise UserError(f"{where}: is not of a pair with the size of calibration '{calibration.unit}'")
    shift_s = calibration.stereo.stamp_to_mid_exposure_s - recorded.stereo.stamp_to_mid_exposure_s
    pipeline = Pipeline(calibration, opened.configuration.foothold, None, RIGID, tells_terrain=False)
    temperatures, first_ns, last_ns, course = list[float](), 0, 0, Course()
    with LiveLine() as line:
        for message in opened.inputs():
            if isinstance(message, ImuSample):
                first_ns, last_ns = first_ns or message.t_sample_ns, message.t_sample_ns
                temperatures.append(message.temperature_degC)
                line.tell(f"{what}: {1e-9 * (last_ns - first_ns):.0f} s")
                if not course.add(last_ns, pipeline.mounting_errors):
                    return None
            elif isinstance(message, StereoFrame):
                message = _stamped(message, shift_s)
            for _ in pipeline.step(message):
                pass
    seconds = 1e-9 * (last_ns - first_ns)
    if seconds < LEAST_S:
        raise UserError(f"{where}: lasts {seconds:.0f} s, allowed from {LEAST_S:.0f} s of walking")
    mounting, sensors = pipeline.mounting_errors, pipeline.sensor_errors
    if mounting is None or sensors is None:
        return None
    return Found(mounting, sensors, course.halfway, float(np.mean(temperatures)))


def _stamped(frame: "StereoFrame", shift_s: float) -> "StereoFrame":
    """Return the frame as stamped with another offset to mid-exposure."""
    import msgspec

    t_ns = frame.header.t_exposure_ns + round(1e9 * shift_s)
    header = msgspec.structs.replace(frame.header, t_exposure_ns=t_ns)
    return msgspec.structs.replace(frame, header=header)


def _tell(made: "Mounted", file: Path) -> None:
    from cli.console import console, table
    from messages.constants import NORMAL_95

    degrees = math.degrees(1.0)
    rows = [
        [
            f"camera turned about the IMU's {axis}",
            f"{degrees * turn:+.3f}",
            f"± {NORMAL_95 * degrees * std:.3f}",
            "°",
        ]
        for axis, turn, std in zip("xyz", made.turn_B.tolist(), made.turn_std.tolist(), strict=True)
    ]
    half_ms, half_percent = 1e3 * NORMAL_95 * made.lag_std, 100.0 * NORMAL_95 * made.scale_std
    rows.append(["pictures later than stamped", f"{1e3 * made.lag_s:+.2f}", f"± {half_ms:.2f}", "ms"])
    rows.append(["distances too long", f"{100 * made.scale:+.2f}", f"± {half_percent:.2f}", "%"])
    if made.pair is not None:
        rows += _pair_rows(made.pair)
    table(f"{file}: against what it said before", ["", "value", "95 %", "unit"], rows)
    console.print(_WHY_SHARED if made.pair is not None else _WHY_LEFT, soft_wrap=True, highlight=False)


_WHY_SHARED = (
    "A walk tells the scale of distances, not a baseline from a toe-in: each takes its share of it by how far off the "
    "file says it may be."
)
_WHY_LEFT = (
    "Distances stay as they are: they are farther off than the file says of baseline and toe-in, and a walk does not "
    "tell which of the two it is: gaiteyes calibrate stereo."
)


def _pair_rows(pair: "PairErrors") -> list[list[str]]:
    from messages.constants import NORMAL_95

    return [
        [f"  of it {name}", f"{factor * value:+.3f}", f"± {NORMAL_95 * factor * std:.3f}", unit]
        for name, value, std, factor, unit in (
            ("the baseline, too long by", pair.baseline, pair.baseline_std, 100.0, "%"),
            ("the toe-in, off by", pair.toe_in_rad, pair.toe_in_std_rad, math.degrees(1.0), "°"),
        )
    ]


def _facts(made: "Mounted") -> dict[str, object]:
    return {
        "turn_B_rad": made.turn_B.tolist(),
        "turn_std_rad": made.turn_std.tolist(),
        "lag_s": made.lag_s,
        "lag_std_s": made.lag_std,
        "distance_scale": made.scale,
        "distance_scale_std": made.scale_std,
        "pair": None if made.pair is None else made.pair._asdict(),
        "X_RL": made.calibration.stereo.X_RL,
        "X_BL": made.calibration.X_BL,
        "imu": made.calibration.imu,
        "residual": made.calibration.residual,
    }
