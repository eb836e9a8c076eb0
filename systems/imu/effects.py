"""The library of what an ideal IMU leaves out: each cause with its parameters, its sentence, remedy and experiment."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from discrepancy.simulation import Effect, Parameter, Values
from messages.arrays import FloatArray
from messages.constants import STANDARD_GRAVITY_MPS2
from systems.imu.motion import Reading

AXES: Final = ("x", "y", "z")
_PAIRS: Final = tuple(a + b for a in AXES for b in AXES if a != b)
REFERENCE_DEGC: Final = 25.0
"""At which the bias by temperature is none: where data sheets state a bias."""
_SEARCHED_S: Final = 0.5
"""Of lag, either way: the bound of a time offset."""
_MOST_APART_S: Final = 0.05
"""Of the delays of a chip's two sensors: its narrowest filters, 5 Hz, delay by 33 ms."""
_TELLING_S: Final = 0.004
"""A lag beyond which the linear view from zero misleads."""
_DRIFTING_S: Final = 30.0
"""Over which a drift is judged by the lag that it adds up to."""
_CUT_OFFS_HZ: Final = (4.0, 12.0, 30.0)
"""Where fits of a low pass begin: below, within and at the end of what a limb's motion holds."""
_MOST_TILT_RAD: Final = 0.3
"""Of the reference's world: a frame laid on a floor by eye leans less."""
_SMOOTHED_HZ: Final = (20.0, 50.0)
"""Where fits of a smoothed reference begin: within what a limb's motion holds, and beyond its end."""
_LEAST_DAMPING: Final = 0.7
"""Of a low pass: filters of sensors are Butterworth's, 0.71, Bessel's, 0.87, or slower; less damping raises what is
fast, as a delay beside a smoothed reference does."""
_MOUNTS_HZ: Final = (9.0, 14.0, 22.0, 40.0)
"""Resonances where fits of a mount begin, a factor of about 1.6 apart: a fit begun further off finds none."""
_MOUNT_ZETA: Final = 0.25
"""Damping there: heavy enough for a broad peak that a fit sees from afar."""
_PINNED_LOW, _PINNED_START = 1.0 - 1e-3, 1.0 - 1e-4
"""Of the greatest reading, where readings pile up there: the limit's lower bound, and where its fit begins."""
_FREE_LOW, _FREE_START = 0.9, 0.97
"""Likewise where they do not: a filter or a calibration behind the limit may have blurred it by some per cent."""
_LIMIT_SCALE: Final = 5e-3
"""Of the greatest reading: the scale of a limit."""


@dataclass(frozen=True)
class Facts:
    """What a recording says at first sight, to start searches from.

    `most_radps` and `most_mps2` are the greatest raw readings, `pinned` where they pile up; `lag_s` and `lag_rate` how
    late the IMU's turning rate is against the reference's, and how that grows.
    """

    most_radps: float
    most_mps2: float
    pinned: tuple[bool, bool]
    lag_s: float
    lag_rate: float
    has_temperature: bool

    @staticmethod
    def of(reading: Reading) -> "Facts":
        """Return the facts of a reading."""
        t_s, measured, ideal = reading.t_s, reading.measured, reading.ideal
        rate_hz = (len(t_s) - 1) / float(t_s[-1] - t_s[0])
        told = np.isfinite(measured[:, 0])
        w = np.where(told, np.linalg.norm(np.nan_to_num(measured[:, :3]), axis=1), 0.0)
        w_ideal = np.where(told, np.linalg.norm(ideal[:, :3], axis=1), 0.0)
        half = len(t_s) // 2
        first, last = (_lag_s(w[part], w_ideal[part], rate_hz) for part in (slice(0, half), slice(half, None)))
        return Facts(
            most_radps=reading.most[0],
            most_mps2=reading.most[1],
            pinned=reading.pinned,
            lag_s=_lag_s(w, w_ideal, rate_hz),
            lag_rate=2.0 * (last - first) / float(t_s[-1] - t_s[0]),
            has_temperature=reading.temperature_degC is not None,
        )


def library(facts: Facts) -> tuple[Effect, ...]:
    """Return all effects, with starts for one recording."""
    return (
        *_clock(facts),
        *_gyroscope(),
        *_accelerometer(),
        *_seat(),
        *_reference(),
        *_dynamics(facts),
        _temperature(facts),
    )


def _clock(facts: Facts) -> Iterable[Effect]:
    far = abs(facts.lag_s) > _TELLING_S
    drifts = abs(facts.lag_rate) * _DRIFTING_S > _TELLING_S
    return (
        Effect(
            "time_offset",
            (
                Parameter("value_s", "s", 0.0, -0.5, 0.5, 5e-5),
                Parameter("acc_s", "s", 0.0, -_MOST_APART_S, _MOST_APART_S, 5e-5),
            ),
            "The IMU's stamps are late (positive) or early against the reference's by a constant time, the "
            "accelerometer's by acc_s more than the gyroscope's: each has a filter of its own.",
            "Subtract the offset from the IMU's stamps, and from each sensor's the delay of its filter, which the data "
            "sheet states; trigger IMU and reference by one hardware line.",
            "Move faster: an offset errs with the rate of change of every channel, at all frequencies alike.",
            choices=(("value_s",), ("acc_s",), ("value_s", "acc_s")),
            starts=({}, {"value_s": facts.lag_s}) if far else (),
        ),
        Effect(
            "clock_drift",
            (Parameter("rate", "1", 0.0, -0.02, 0.02, 3e-6),),
            "The IMU's clock runs at another rate than the reference's: its stamps gain or lose steadily.",
            "Divide the time since the first stamp by 1 + rate; stamp by the host or by a common clock.",
            "Record longer: the error of a drift grows with time, that of an offset does not.",
            starts=({}, {"rate": facts.lag_rate}) if drifts else (),
        ),
    )


def _gyroscope() -> Iterable[Effect]:
    return (
        Effect(
            "gyro_bias",
            _each("{}_radps", "rad/s", 1.0, 1e-4),
            "The gyroscope reads a turning rate at rest.",
            "Average it over a few resting seconds and subtract it.",
            "Rest: a bias stays, a scale or a misalignment goes.",
            choices=_axes("{}_radps"),
        ),
        Effect(
            "gyro_bias_drift",
            _each("{}_radps2", "rad/s²", 0.02, 3e-6),
            "The gyroscope's bias changes steadily from the first stamp on.",
            "Estimate the bias while running, or let the chip warm up before it is calibrated.",
            "Rest at the beginning and at the end; log the temperature.",
            choices=_axes("{}_radps2"),
        ),
        Effect(
            "gyro_scale",
            _each("{}", "1", 0.3, 4e-4),
            "The gyroscope's sensitivity is off by this share.",
            "Divide by 1 + the share; calibrate by full turns about each axis.",
            "Turn about one axis at several rates: the error grows with the rate.",
            choices=_axes("{}"),
        ),
        Effect(
            "gyro_misalignment",
            tuple(Parameter(pair, "1", 0.0, -0.3, 0.3, 4e-4) for pair in _PAIRS),
            "A gyroscope's axis leans: xy is the share of the turning rate about y that x reads.",
            "Multiply by the inverse of the sensitivity matrix.",
            "Turn about each axis alone: a leaning axis reads although it should not, the accelerometer does not.",
            choices=(*((pair,) for pair in _PAIRS), _PAIRS),
        ),
        Effect(
            "g_sensitivity",
            tuple(Parameter(a + b, "rad/s/(m/s²)", 0.0, -0.05, 0.05, 2e-5) for a in AXES for b in AXES),
            "Acceleration, gravity included, makes the gyroscope read: xy is what x reads per acceleration along y.",
            "Subtract the matrix times the acceleration, or choose a gyroscope with better rejection.",
            "Rest with each axis up and down in turn: what changes with the pose is no bias.",
            choices=(*((a + b,) for a in AXES for b in AXES), tuple(a + b for a in AXES for b in AXES)),
        ),
    )


def _accelerometer() -> Iterable[Effect]:
    return (
        Effect(
            "acc_bias",
            _each("{}_mps2", "m/s²", 5.0, 3e-3),
            "The accelerometer reads this much too much along an axis.",
            "Subtract it; calibrate in six resting poses.",
            "Rest with the axis up and down: half the sum of both is the bias.",
            choices=_axes("{}_mps2"),
        ),
        Effect(
            "acc_scale",
            _each("{}", "1", 0.3, 4e-4),
            "The accelerometer's sensitivity is off by this share.",
            "Divide by 1 + the share; calibrate in six resting poses.",
            "Rest with the axis up and down: half the difference of both, over gravity, is the scale.",
            choices=_axes("{}"),
        ),
        Effect(
            "acc_misalignment",
            tuple(Parameter(pair, "1", 0.0, -0.3, 0.3, 4e-4) for pair in _PAIRS),
            "An accelerometer's axis leans: xy is the share of the acceleration along y that x reads.",
            "Multiply by the inverse of the sensitivity matrix.",
            "Rest with each axis up in turn: a leaning axis reads although it is level, the gyroscope does not.",
            choices=(*((pair,) for pair in _PAIRS), _PAIRS),
        ),
        Effect(
            "gravity_magnitude",
            (Parameter("value_mps2", "m/s²", STANDARD_GRAVITY_MPS2, 9.3, 10.3, 2e-3),),
            f"Gravity has another size than the standard {STANDARD_GRAVITY_MPS2} m/s².",
            "Use the local value, which latitude and height tell to 0.001 m/s².",
            "Look up the local value; accelerate strongly: a scale of all axes errs with that too, gravity does not.",
        ),
    )


def _seat() -> Iterable[Effect]:
    return (
        Effect(
            "lever_arm",
            _each("{}_m", "m", 0.5, 5e-4),
            "The accelerometer does not sit where the reference's position is: this far from it, in the sensor's axes.",
            "Enter the lever arm, or move the reference's point to the sensor.",
            "Turn fast about each axis without moving the point: what the accelerometer then reads is the lever arm.",
            choices=_axes("{}_m"),
        ),
        Effect(
            "frame_rotation",
            _each("{}_rad", "rad", 0.8, 4e-4),
            "The sensor's axes are turned against the reference's: exp(θ×) takes ideal readings to measured ones.",
            "Turn the readings back, or align the marker frame with the sensor's.",
            "Rest in two poses and turn about two axes: gyroscope and accelerometer err by the same rotation.",
            choices=_axes("{}_rad"),
        ),
    )


def _reference() -> Iterable[Effect]:
    return (
        Effect(
            "world_tilt",
            (
                Parameter("x_rad", "rad", 0.0, -_MOST_TILT_RAD, _MOST_TILT_RAD, 4e-4),
                Parameter("y_rad", "rad", 0.0, -_MOST_TILT_RAD, _MOST_TILT_RAD, 4e-4),
            ),
            "The reference's world is not level: the true vertical is its z axis turned by this about its x and y.",
            "Level the frame that the cameras were given, or turn the reference by what a pendulum or a liquid shows.",
            "Rest in several headings: a tilt of the world turns with the heading, a bias stays with the sensor.",
            choices=(("x_rad", "y_rad"),),
        ),
        Effect(
            "reference_smoothing",
            (Parameter("cut_off_hz", "Hz", np.inf, 12.0, 500.0, 1.0),),
            "The reference was smoothed or interpolated: fast motion is weaker in it than it was, and not later; −3 dB "
            "at the cut-off.",
            "Take the cameras' own frames before smoothing; derive rates and accelerations from them.",
            "Shake fast: a smoothed reference falls short of both sensors alike, and by the square of the frequency.",
            starts=tuple({"cut_off_hz": f_hz} for f_hz in _SMOOTHED_HZ),
        ),
    )


def _dynamics(facts: Facts) -> Iterable[Effect]:
    shakes: list[Values] = [{**{f"{axis}_hz": f_hz for axis in AXES}, "zeta": _MOUNT_ZETA} for f_hz in _MOUNTS_HZ]
    return (
        _clipping(facts),
        Effect(
            "low_pass",
            (
                Parameter("gyro_hz", "Hz", np.inf, 0.5, 500.0, 0.2),
                Parameter("acc_hz", "Hz", np.inf, 0.5, 500.0, 0.2),
                Parameter("zeta", "1", float(np.sqrt(0.5)), _LEAST_DAMPING, 3.0, 0.05),
            ),
            "A low pass in the sensor weakens and delays what is fast; −3 dB at the cut-off.",
            "Choose a wider filter of the chip, or undo its delay.",
            "Move faster: a filter weakens what is fast, a late stamp does not.",
            choices=(
                *((name,) for name in ("gyro_hz", "acc_hz")),
                *((name, "zeta") for name in ("gyro_hz", "acc_hz")),
                ("gyro_hz", "acc_hz"),
                ("gyro_hz", "acc_hz", "zeta"),
            ),
            starts=tuple({"gyro_hz": f_hz, "acc_hz": f_hz, "zeta": float(np.sqrt(0.5))} for f_hz in _CUT_OFFS_HZ),
        ),
        Effect(
            "vibration",
            (
                *(Parameter(f"{axis}_hz", "Hz", np.inf, 3.0, 300.0, 0.1, inexact=0.02) for axis in AXES),
                Parameter("zeta", "1", 0.1, 0.005, 1.0, 0.01),
            ),
            "The sensor shakes on its mount: near the mount's resonance its acceleration is amplified.",
            "Fix it more firmly; filter below the resonance.",
            "Tap the sensor at rest: a mount rings on at its own frequency.",
            choices=(*((f"{axis}_hz", "zeta") for axis in AXES), (*(f"{axis}_hz" for axis in AXES), "zeta")),
            starts=tuple(shakes),
        ),
    )


def _clipping(facts: Facts) -> Effect:
    """Return the effect with limits not below what was read: readings that pile up at the greatest are the limit."""
    limits = []
    starts: list[Values] = []
    for name, unit, high, most, pinned in (
        ("gyro_radps", "rad/s", 200.0, facts.most_radps, facts.pinned[0]),
        ("acc_mps2", "m/s²", 4000.0, facts.most_mps2, facts.pinned[1]),
    ):
        low = (_PINNED_LOW if pinned else _FREE_LOW) * most
        limits.append(Parameter(name, unit, np.inf, low, high, _LIMIT_SCALE * most, own_bounds=True))
        starts.append({name: (_PINNED_START if pinned else _FREE_START) * most})
    return Effect(
        "clipping",
        tuple(limits),
        "Readings end at the limit of the sensor's range.",
        "Choose a wider range; until then leave out what touches the limit.",
        "Look at the histogram of raw readings: a clipped one has its last bin full.",
        choices=tuple((each.name,) for each in limits),
        starts=tuple(starts),
    )


def _temperature(facts: Facts) -> Effect:
    explanation = "The gyroscope's bias follows the chip's temperature"
    remedy = "Calibrate the bias over temperature, or wait until the chip is warm."
    experiment = "Log the temperature (column temperature_degC of imu.csv), and warm the resting chip."
    if facts.has_temperature:
        form, unit, most, scale = "{}_radps_per_degC", "rad/s/°C", 0.1, 1e-5
        explanation += f", from {REFERENCE_DEGC:g} °C on."
    else:
        form, unit, most, scale = "{}_radps2", "rad/s²", 0.02, 3e-6
        explanation += ": without a log of it a steady rise is supposed, which no drift of the bias can be told from."
    return Effect("temperature", _each(form, unit, most, scale), explanation, remedy, experiment, choices=_axes(form))


def _each(form: str, unit: str, most: float, scale: float) -> tuple[Parameter, ...]:
    return tuple(Parameter(form.format(axis), unit, 0.0, -most, most, scale) for axis in AXES)


def _axes(form: str) -> tuple[tuple[str, ...], ...]:
    """Return each axis alone, then all three."""
    every = tuple(form.format(axis) for axis in AXES)
    return (*((name,) for name in every), every)


def _lag_s(late: FloatArray, early: FloatArray, rate_hz: float) -> float:
    """Return by how much `late` (n,) is best delayed against `early` (n,), up to half a second, by correlation."""
    most = round(_SEARCHED_S * rate_hz)
    length = len(late) + most
    product = np.fft.rfft(late - late.mean(), length) * np.conj(np.fft.rfft(early - early.mean(), length))
    correlation = np.fft.irfft(product, length)
    near = np.concatenate((correlation[-most:], correlation[: most + 1]))
    best = int(np.argmax(near[1:-1])) + 1
    before, there, after = near[best - 1 : best + 2]
    vertex = 0.5 * (before - after) / (before - 2.0 * there + after)  # of the parabola through the three
    return float(best - most + vertex) / rate_hz
