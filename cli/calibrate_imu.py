"""`gaiteyes calibrate imu` and `calibrate noise`: what resting in several poses, and resting for long, tell."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import CONFIG_FILE, ConfigFile, JsonFile

if TYPE_CHECKING:
    from calib.imu.allan import AxisNoise, Estimate
    from calib.imu.fit import ImuFit
    from calib.imu.log import ImuLog, Units
    from messages import ImuSample

Sources = Annotated[
    list[Path] | None,
    typer.Option(
        "--from",
        help="Recording, EuRoC folder, CSV or NPZ log, or a folder of logs, instead of the device; may be repeated.",
    ),
]
AccPerG = Annotated[float | None, typer.Option(help="Counts of a log's accelerometer for one g.")]
GyroPerDps = Annotated[float | None, typer.Option(help="Counts of a log's gyroscope for one °/s.")]
AccZero = Annotated[float | None, typer.Option(help="Counts of a log's accelerometer that mean 0.")]
GyroZero = Annotated[float | None, typer.Option(help="Counts of a log's gyroscope that mean 0.")]
AccAxes = Annotated[str, typer.Option(help="Signs of a log's accelerometer axes, where they mirror the gyroscope's.")]


def imu(
    file: Annotated[
        Path | None, typer.Argument(help="The unit's calibration file to write into; without it, only tell.")
    ] = None,
    sources: Sources = None,
    config: ConfigFile = CONFIG_FILE,
    seconds: Annotated[float, typer.Option(min=20.0, max=900.0, help="How long to measure on the device.")] = 180.0,
    gravity: Annotated[
        float | None, typer.Option(help="Gravity at this place, m/s²; known to 0.15 % if not told.")
    ] = None,
    acc_per_g: AccPerG = None,
    gyro_per_dps: GyroPerDps = None,
    acc_zero: AccZero = None,
    gyro_zero: GyroZero = None,
    acc_axes: AccAxes = "x,y,z",
    json: JsonFile = None,
) -> None:
    """Calibrate accelerometer and gyroscope: rest the unit in six and more poses, turning it by hand between them.

    Each face up in turn, some seconds each, and some poses between; that is about two minutes. What the poses do not
    tell stays as it is in the file.
    """
    import msgspec

    from calib.files import load_calibration, save_calibration
    from calib.imu.fit import fit_imu, with_imu
    from cli.console import check_writable, console, write_json

    check_writable(json)
    known = None if file is None else load_calibration(file)
    units = _units(acc_per_g, gyro_per_dps, acc_zero, gyro_zero, acc_axes)
    where = _where(sources, config)
    logs = _logs(sources, units, config, seconds, lambda log: _pose_line(log, gravity))
    fit = fit_imu(logs, where, gravity_mps2=gravity)
    _tell(fit, where)
    facts = _facts(fit)
    if json is not None:
        write_json(json, facts)
    if file is not None and known is not None:
        made_imu, residual = with_imu(known.imu, known.residual, fit, where)
        made = msgspec.structs.replace(known, imu=made_imu, residual=residual)
        save_calibration(file, made)
        console.print(
            f"Written to {file}: unit '{made.unit}', calibration {made.id}. The camera's place in the IMU's axes may "
            "have changed with them: gaiteyes calibrate mount",
            soft_wrap=True,
            highlight=False,
        )
        if json is not None:
            write_json(json, facts | {"file": str(file), "id": made.id})


def noise(
    sources: Sources = None,
    config: ConfigFile = CONFIG_FILE,
    seconds: Annotated[float, typer.Option(min=60.0, max=86400.0, help="How long to measure on the device.")] = 600.0,
    acc_per_g: AccPerG = None,
    gyro_per_dps: GyroPerDps = None,
    json: JsonFile = None,
) -> None:
    """Measure the IMU's noise at rest (Allan deviation) and compare it with what the attitude filter assumes.

    Leave the unit alone on something that does not shake, for ten minutes or more.
    """
    from calib.imu.allan import noise_of
    from cli.console import check_writable, console, write_json

    check_writable(json)
    where = _where(sources, config)
    logs = _logs(
        sources,
        _units(acc_per_g, gyro_per_dps, None, None, "x,y,z"),
        config,
        seconds,
        lambda log: f"{log.t_s[-1] - log.t_s[0]:.0f} of {seconds:.0f} s",
    )
    axes, rest_s = noise_of(logs, where)
    _tell_noise(axes, rest_s, where, in_counts={log.acc_is_scaled for log in logs} != {True})
    for note in dict.fromkeys(note for log in logs for note in log.notes):
        console.print(note, soft_wrap=True, highlight=False, markup=False)
    if json is not None:
        write_json(json, {"source": where, "rest_s": rest_s, "axes": [_noise_facts(axis) for axis in axes]})


def _units(
    acc_per_g: float | None, gyro_per_dps: float | None, acc_zero: float | None, gyro_zero: float | None, axes: str
) -> "Units":
    from calib.imu.log import Units
    from messages import UserError

    for name, value in (("--acc-per-g", acc_per_g), ("--gyro-per-dps", gyro_per_dps)):
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise UserError(f"{name} {value:g}: allowed above 0")
    signs = tuple(-1.0 if part.strip().startswith("-") else 1.0 for part in axes.split(","))
    if [part.strip().lstrip("-+") for part in axes.split(",")] != ["x", "y", "z"]:
        raise UserError(f"--acc-axes {axes}: expected x,y,z with signs, as x,y,-z")
    return Units(acc_per_g, gyro_per_dps, acc_zero, gyro_zero, (signs[0], signs[1], signs[2]))


def _where(sources: list[Path] | None, config: Path) -> str:
    return ", ".join(map(str, sources)) if sources else str(config)


def _logs(
    sources: list[Path] | None, units: "Units", config: Path, seconds: float, line: Callable[["ImuLog"], str]
) -> list["ImuLog"]:
    from calib.imu.log import log_of_samples, read_logs

    if sources:
        return read_logs(sources, units)
    return [log_of_samples(_measured(config, seconds, line), str(config))]


def _measured(config: Path, seconds: float, line: Callable[["ImuLog"], str]) -> list["ImuSample"]:
    """Return the samples of the device that the configuration names, telling once a second how far it is.

    `seconds` count on the samples' own clock, so that a busy host measures no less. A device that falls silent ends it,
    which is told.
    """
    import time

    from calib.imu.log import log_of_samples
    from cli import devices
    from cli.console import console
    from cli.progress import LiveLine
    from daemon.config import load_configuration

    device = devices.build_imu(load_configuration(config).imu)
    with devices.next_step_named():
        device.open()
    samples = list["ImuSample"]()
    try:
        with LiveLine() as shown:
            told_s, measured_s, empty_reads = time.monotonic(), 0.0, 0
            while measured_s < seconds and empty_reads < _SILENT_READS:
                new = device.read(timeout_s=_READ_S)
                samples += new
                empty_reads = 0 if new else empty_reads + 1
                if samples:
                    measured_s = 1e-9 * (samples[-1].t_sample_ns - samples[0].t_sample_ns)
                if (now_s := time.monotonic()) - told_s >= 1.0 and len(samples) > 200:
                    told_s = now_s
                    shown.tell(f"{measured_s:5.0f} s  " + line(log_of_samples(samples, str(config))))
    finally:
        device.close()
    if measured_s < seconds:
        console.print(f"{config}: the IMU fell silent after {measured_s:.0f} of {seconds:.0f} s", soft_wrap=True)
    return samples


_READ_S = 0.1
_SILENT_READS = 50
"""Reads in a row without a sample, after which none is awaited any more. Not a time: a host may be held up."""


def _pose_line(log: "ImuLog", gravity_mps2: float | None) -> str:
    """Return what is covered by now: which faces were up, and what is still missing."""
    from calib.imu.fit import LEAST_RESTS, fit_imu
    from calib.imu.rests import find_rests

    rests = find_rests([log])
    if len(rests) < LEAST_RESTS:
        return f"{len(rests)} rests; lay the unit on another face, hold still for some seconds"
    fit = fit_imu([log], log.name, gravity_mps2=gravity_mps2)
    faces = " ".join(f"{face}{'✓' if count else '·'}" for face, count in fit.accelerometer.faces.items())
    missing = fit.unsupported
    return f"{len(rests)} rests  {faces}  " + (
        f"next: {missing[0]}" if missing else "all is told; more only sharpens it"
    )


def _tell(fit: "ImuFit", where: str) -> None:
    from calib.imu.accelerometer import rms_g
    from cli.console import console, table

    rows = []
    for name, value in fit.values.items():
        digits, unit = (4, "") if value.unit == "1" else (2, value.unit)
        half = 0.5 * (value.high - value.low)
        told = "yes" if value.supported else "no: not used"
        rows.append([name, f"{value.value:+.{digits}f}", f"± {half:.{digits}f}", unit, told])
    table(f"{where}: {len(fit.rests)} rests", ["", "value", "95 %", "unit", "told by the poses"], rows)
    acc = fit.accelerometer
    faces = ", ".join(f"{face} {count}" for face, count in acc.faces.items())
    on = acc.on_supported_axes
    lines = [
        f"faces up, in rests: {faces}",
        f"length of gravity at rest: off by {1e3 * rms_g(acc.norm_before):.1f} mg before, "
        f"{1e3 * rms_g(acc.norm):.2f} mg after (RMS of {len(acc.norm)} rests), "
        f"{1e3 * rms_g(acc.norm_left_out):.2f} mg where a rest is left out",
    ]
    if on.any() and not on.all():
        lines.append(f"on the axes that are told: {1e3 * rms_g(acc.norm[on]):.2f} mg (RMS of {on.sum()} rests)")
    gyro = fit.gyroscope
    if gyro is not None and len(gyro.carried_rad):
        lines.append(
            f"the gyroscope carries the vertical over {len(gyro.carried_rad)} turns to "
            f"{math.degrees(rms_g(gyro.carried_rad)):.2f}° (RMS), {math.degrees(rms_g(gyro.before_rad)):.2f}° before"
        )
    for text in (*lines, *fit.notes, *(f"NOT TOLD  {each}" for each in fit.unsupported)):
        console.print(text, soft_wrap=True, highlight=False, markup=False)


def _facts(fit: "ImuFit") -> dict[str, object]:
    acc, gyro = fit.accelerometer, fit.gyroscope
    return {
        "rests": len(fit.rests),
        "faces": acc.faces,
        "temperature_degC": fit.temperature_degC,
        "gravity": fit.gravity,
        "in_counts": fit.in_counts,
        "values": {name: value._asdict() for name, value in fit.values.items()},
        "axes_supported": dict(zip("xyz", acc.axes_supported.tolist(), strict=True)),
        "sf_matrix": acc.matrix.tolist(),
        "sf_bias": acc.bias.tolist(),
        "w_matrix": None if gyro is None else gyro.matrix.tolist(),
        "w_bias_radps": None if gyro is None else gyro.bias.tolist(),
        "rest_norm_error_g": {
            "before": acc.norm_before.tolist(),
            "after": acc.norm.tolist(),
            "left_out": acc.norm_left_out.tolist(),
            "on_supported_axes": acc.on_supported_axes.tolist(),
        },
        "rest_directions": acc.directions.tolist(),
        "carried_rad": None if gyro is None else gyro.carried_rad.tolist(),
        "not_told": fit.unsupported,
        "notes": list(fit.notes),
    }


def _tell_noise(axes: list["AxisNoise"], rest_s: float, where: str, *, in_counts: bool) -> None:
    from calib.imu.allan import COMPARED_S
    from cli.console import console, table
    from messages.constants import STANDARD_GRAVITY_MPS2
    from perception.attitude.filter import AttitudeSettings

    settings = AttitudeSettings()
    rows, apart, noisier = [], [], []
    for axis in axes:
        gyro = axis.name.startswith("gyro")
        unit = math.degrees(1.0) if gyro else 1.0 if in_counts else 1e3 / STANDARD_GRAVITY_MPS2
        name = "°/s" if gyro else "counts" if in_counts else "mg"
        rows.append(
            [
                axis.name,
                name,
                *(_number(axis.at(tau_s).value * unit) for tau_s in COMPARED_S),
                _number(axis.density.value * unit) + "/√Hz",
                ("≤ " if axis.still_falls else "") + _number(axis.instability.value * unit),
                _number(axis.walk.value * unit) + ("/√s" if math.isfinite(axis.walk.value) else ""),
            ]
        )
        apart.append([axis.name, name, *(_number(axis.apart[tau_s].value * unit) for tau_s in COMPARED_S)])
        assumed = settings.gyro_noise_radps_rthz if gyro else settings.sf_noise_mps2_rthz
        if axis.density.low > assumed and not (in_counts and not gyro):
            noisier.append(
                f"{axis.name} is noisier than the attitude filter assumes ({_number(assumed * unit)} {name}/√Hz)"
            )
    # how well a deviation is known depends on the record's length alone, so that one row says it of all axes
    rows.append(["95 %", "", *(_share(axes[0].at(tau_s)) for tau_s in COMPARED_S), "", "", ""])
    apart.append(["95 %", "", *(_share(axes[0].apart[tau_s]) for tau_s in COMPARED_S)])
    columns = ["axis", "unit", *(f"at {tau_s:g} s" for tau_s in COMPARED_S)]
    title = f"{where}: Allan deviation over {rest_s:.0f} s at rest"
    table(title, [*columns, "white noise", "bias instability", "random walk"], rows)
    table("the same of periods that do not overlap, as some publish it; it tells less", columns, apart)
    for line in noisier or ["no axis is noisier than the attitude filter assumes"]:
        console.print(line, soft_wrap=True, highlight=False)


def _share(estimate: "Estimate") -> str:
    """Return how far a 95 % interval reaches below and above its value."""
    if not math.isfinite(estimate.value):
        return ""
    below, above = (100.0 * (edge / estimate.value - 1.0) for edge in (estimate.low, estimate.high))
    return f"{below:+.0f} to {above:+.0f} %"


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "not told"


def _noise_facts(axis: "AxisNoise") -> dict[str, object]:
    return {
        "name": axis.name,
        "unit": "rad/s" if axis.name.startswith("gyro") else "m/s²",
        "std": axis.std,
        "tau_s": axis.tau_s.tolist(),
        "deviation": axis.deviation.tolist(),
        "low": axis.low.tolist(),
        "high": axis.high.tolist(),
        "white_noise_per_rthz": axis.density._asdict(),
        "bias_instability": axis.instability._asdict() | {"is_upper_bound": axis.still_falls},
        "random_walk_per_rts": axis.walk._asdict(),
        "without_overlap": [{"tau_s": tau_s} | each._asdict() for tau_s, each in axis.apart.items()],
    }
