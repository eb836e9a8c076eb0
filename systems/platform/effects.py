"""The platform's library of what its simulation may leave out: motion capture, force plate and geometry.

What acts above the sensor stands in `effects_above`. Scales lie at a fifth or less of what matters in the laboratory.
"""

from collections.abc import Mapping
from itertools import permutations
from math import inf

from discrepancy.simulation import Effect, Parameter
from systems.platform.sensor import CHANNELS

FORCES, MOMENTS = CHANNELS[:3], CHANNELS[3:]
_N, _NM = "N", "N·m"
_STEP_SHARE = 0.02
"""Of a step of rounding: its scale."""
_LIMIT_SHARES = (0.1, 2.0)
"""Of a channel's largest reading, the bounds of its limit: a lower one would have left little, a higher one nothing."""
_LIMIT_SCALE_SHARE = 2e-3
"""Of the largest reading: the scale of a limit."""
_LIMIT_START_SHARE = 0.97
"""Of the largest reading, where a fit of the limit begins: just low enough to cut something off."""


def unit_of(channel: str) -> str:
    """Return a channel's unit."""
    return _N if channel in FORCES else _NM


def pair_unit(of: str, source: str) -> str:
    """Return the unit of the share of `source` that channel `of` shows."""
    return {(_N, _NM): "1/m", (_NM, _N): "m"}.get((unit_of(of), unit_of(source)), "1")


def timing() -> tuple[Effect, ...]:
    """Return the effects of clocks, filters and lost samples."""
    return (
        Effect(
            "force_delay",
            (Parameter("value_s", "s", 0.0, -0.02, 0.02, 2e-5),),
            "The force plate's samples are stamped later than the motion they belong to by a constant time.",
            "Measure the delay with a tap seen by both, and subtract it from the force stamps.",
            "Shake at one low and one high frequency: a delay turns the phase in proportion, a lag bends it.",
        ),
        Effect(
            "force_lag",
            (Parameter("value_s", "s", 0.0, 0.0, 0.02, 2e-5),),
            "The force channels pass a first-order low pass that the motion does not pass.",
            "Give motion and force the same anti-alias filter, or divide its response out.",
            "Shake at 10 and at 40 Hz: a lag loses amplitude at the higher one, a delay does not.",
        ),
        Effect(
            "clock_drift",
            (Parameter("rate", "1", 0.0, -5e-3, 5e-3, 2e-6),),
            "The force plate's clock runs at another rate than motion capture's: their stamps drift apart.",
            "Drive both from one clock, or tap the plate at beginning and end and stretch the stamps.",
            "Record for ten minutes: a drift makes the delay grow, a constant delay stays.",
        ),
        Effect(
            "motion_smoothing",
            (Parameter("value_hz", "Hz", inf, 15.0, 90.0, 0.5),),
            "Motion capture smooths its poses (Butterworth, second order, forth and back): fast motion comes out "
            "small.",
            "Switch the smoothing off, or raise its limit well above the excitation, and filter afterwards.",
            "Shake at 5 and at 40 Hz: smoothing takes amplitude from the motion at the higher one only.",
            starts=({"value_hz": 35.0}, {"value_hz": 55.0}),
        ),
        Effect(
            "dropped_samples",
            (Parameter("held", "1", 0.0, 0.0, 1.5, 0.02, inexact=0.02),),
            "The force recorder loses samples and writes the last one again in their place.",
            "Record over a faster link, or mark lost samples as missing.",
            "Count equal rows in a recording with noise on every channel: none may be equal to the one before.",
        ),
    )


def amplitudes(starts: Mapping[str, float], largest: Mapping[str, float]) -> tuple[Effect, ...]:
    """Return the effects of gains and of what is not linear in the force channels.

    `starts` are the steps of rounding that a fit begins with, `largest` each channel's largest reading. A channel that
    reads zero all the time has no limit to look for.
    """
    moving = [name for name in CHANNELS if largest[name] > 0.0]
    return (
        Effect(
            "force_gain",
            tuple(Parameter(name, "1", 0.0, -0.5, 0.5, 5e-4) for name in CHANNELS),
            "A force channel shows too much or too little by a constant factor.",
            "Load the channel with known weights and set its sensitivity anew.",
            "Weights of known mass at known places, plate at rest: they tell every gain without any motion.",
            choices=tuple((name,) for name in CHANNELS),
        ),
        Effect(
            "crosstalk",
            tuple(
                Parameter(f"{of}_from_{source}", pair_unit(of, source), 0.0, -0.5, 0.5, 5e-4)
                for of, source in permutations(CHANNELS, 2)
            ),
            "A force channel shows a share of another one.",
            "Calibrate all six channels together and use the whole matrix.",
            "Load one axis at a time with known weights and read the other five.",
            choices=tuple((f"{of}_from_{source}",) for of, source in permutations(CHANNELS, 2)),
        ),
        Effect(
            "backlash",
            tuple(Parameter(name, unit_of(name), 0.0, 0.0, 200.0, 0.05, inexact=0.05) for name in CHANNELS),
            "A force channel has play: after each reversal it stands still before it follows. The whole width is told.",
            "Tighten the mounting of the load cells and look for a worn or loose one.",
            "Load slowly up and down: play leaves a loop whose width does not depend on speed.",
            choices=tuple((name,) for name in CHANNELS),
        ),
        Effect(
            "saturation",
            tuple(
                Parameter(
                    name,
                    unit_of(name),
                    inf,
                    _LIMIT_SHARES[0] * most,
                    _LIMIT_SHARES[1] * most,
                    _LIMIT_SCALE_SHARE * most,
                    inexact=1e-3,
                    own_bounds=True,
                )
                for name, most in ((name, largest[name]) for name in moving)
            ),
            "A force channel is cut off at a limit, the same to either side of its tared zero.",
            "Choose a larger range, or shake less.",
            "Repeat with half the amplitude: nothing is cut off then.",
            choices=tuple((name,) for name in moving),
            starts=tuple({name: _LIMIT_START_SHARE * largest[name]} for name in moving),
        ),
        Effect(
            "quantisation",
            (
                Parameter("force_n", _N, 0.0, 0.0, 200.0, _STEP_SHARE * starts["force_n"]),
                Parameter("torque_nm", _NM, 0.0, 0.0, 50.0, _STEP_SHARE * starts["torque_nm"]),
            ),
            "The force plate's readings are rounded to coarse steps, equal for all forces and for all moments.",
            "Use a finer converter or a smaller range.",
            "List the values that a resting channel takes: they are multiples of one step.",
            choices=(("force_n",), ("torque_nm",), ("force_n", "torque_nm")),
            starts=({"force_n": starts["force_n"]}, {"torque_nm": starts["torque_nm"]}, starts),
        ),
        Effect(
            "tare_error",
            tuple(
                Parameter(name, unit_of(name), 0.0, -500.0, 500.0, 0.03 if name in FORCES else 0.01)
                for name in CHANNELS
            ),
            "The tare took away more or less than the rest weight: a constant is left in the wrench.",
            "Tare anew, level and at rest, for some seconds, before every recording.",
            "Compare the mean of a resting second before and after the run.",
            choices=(*((name,) for name in CHANNELS), CHANNELS),
        ),
    )


def geometry(foot: bool) -> tuple[Effect, ...]:
    """Return the effects of where things are; those of the foot only if there is one."""
    axes = ("x_m", "y_m", "z_m")
    single = tuple((axis,) for axis in axes)
    effects = (
        Effect(
            "reference_height",
            (Parameter("value_m", "m", 0.0, -0.3, 0.3, 1e-3),),
            "The moments are told about a point above (or below) the middle of the plate's surface.",
            "Take the load cells' plane from the maker's drawing and carry the moments to the surface.",
            "Press sideways at a known height, plate at rest: the moment over the force is the height.",
        ),
        Effect(
            "plate_rotation",
            tuple(Parameter(name, "rad", 0.0, -0.3, 0.3, 5e-4) for name in ("x_rad", "y_rad", "z_rad")),
            "The force plate's axes are turned against those of the plate's markers.",
            "Mount the marker frame along the plate's edges, or turn the wrench by the angle found.",
            "Tilt the plate by known angles at rest: the weight tells two angles; a push along x tells the third.",
            choices=(("x_rad",), ("y_rad",), ("z_rad",), ("x_rad", "y_rad", "z_rad")),
        ),
        Effect(
            "joint_offset",
            tuple(Parameter(name, "m", 0.0, -0.2, 0.2, 2e-4) for name in axes),
            "The plate's surface lies elsewhere above the joint than joint_to_surface_m says.",
            "Measure the joint's place anew, or take the one found.",
            "Turn the plate slowly through its range: the markers' arc has the joint as its centre.",
            choices=(*single, axes),
        ),
        Effect(
            "position_scale",
            (Parameter("value", "1", 0.0, -0.2, 0.2, 2e-4),),
            "Motion capture's positions are too large or too small by a constant factor.",
            "Calibrate the volume anew with a wand of known length.",
            "Measure the distance of two markers with a ruler.",
        ),
    )
    if not foot:
        return effects
    return (
        *effects,
        Effect(
            "foot_marker_offset",
            tuple(Parameter(name, "m", 0.0, -0.2, 0.2, 2e-4) for name in axes),
            "The foot's markers lie elsewhere on the plate than foot.origin_in_plate_m says.",
            "Measure where the foot's frame lies on the plate anew, or take the offset found.",
            "Measure from the plate's edge to the foot's frame with a ruler.",
            choices=(*single, axes),
        ),
    )
