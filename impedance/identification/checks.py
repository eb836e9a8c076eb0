"""What the misfit and the markers say of the instruments, for a person: before any parameter is believed."""

import math

import numpy as np

from impedance.identification.considered import Found
from impedance.identification.pose_fusion import JointTest
from messages.constants import NORMAL_95

HEADING = ("", "found", "95 % interval", "stated ±", "unit", "")
_SHOWN = {
    "delay": ("force_delay", "delay_s", 1e3, "ms"),
    "gain": ("gain", "gain_share", 100.0, "%"),
    "crosstalk": ("crosstalk", "crosstalk_share", 100.0, "%"),
    "axes": ("axes", "axes_rad", float(np.rad2deg(1.0)), "°"),
    "reference": ("reference of moments", "reference_m", 1e3, "mm"),
}
_CLEAR = 3.0
_MOST = 0.5


def rows(found: Found, test: JointTest, joint_std_m: float) -> list[list[str]]:
    """Return one row for the joint along each axis, and one for each kind of error, of which the least likely is told.

    `joint_std_m` is what `[uncertainty]` says of the joint's place.
    """
    shown = []
    for axis in range(3):
        value, half = test.seen_m[axis], NORMAL_95 * test.seen_deviation_m[axis]
        verdict = "refuted" if test.stated_sigmas[axis] > _CLEAR else "agrees"
        if test.seen_sigmas[axis] > _CLEAR and verdict == "agrees":
            verdict = "elsewhere, used"
        shown.append(_row(f"joint to surface {'xyz'[axis]}", value, half, joint_std_m, 1e3, "mm", verdict))
    for kind, (name, _, scale, unit) in _SHOWN.items():
        k = found.worst(kind)
        value, half = found.value[k], NORMAL_95 * found.deviation[k]
        verdict = "refuted" if found.sigmas[k] > _CLEAR else "agrees"
        of = "" if kind == "delay" else f" {found.errors.of[k]}"
        shown.append(_row(name + of, value, half, found.errors.deviation[k], scale, unit, verdict))
    return shown


def facts(found: Found, test: JointTest) -> dict[str, object]:
    """Return the same for a program, every error, in SI units."""
    errors = found.errors
    return {
        "joint_to_surface_m": test.seen_m.tolist(),
        "joint_to_surface_deviation_m": test.seen_deviation_m.tolist(),
        "errors": [
            {
                "kind": kind,
                "of": of,
                "found": float(found.value[k]),
                "deviation": float(found.deviation[k]),
                "stated_deviation": float(errors.deviation[k]),
                "sigmas": float(found.sigmas[k]),
            }
            for k, (kind, of) in enumerate(zip(errors.kind, errors.of, strict=True))
            if kind in _SHOWN
        ],
    }


def refutation(first: Found, found: Found) -> str:
    """Return one line that says which error the misfit shows, how large, and what to do.

    `first` are the quick checks of the fit that took all instruments for exact: where one error alone explains most of
    that misfit, it is named; else the one that agrees least once all are looked for at once.
    """
    k, value, deviation = int(np.argmax(found.sigmas)), found.value, found.deviation
    alone = int(np.argmax(first.explains))
    stated = first.errors.deviation[alone]
    if first.explains[alone] > _MOST * first.misfit_chi2 and abs(first.alone[alone]) > _CLEAR * stated:
        k, value, deviation = alone, first.alone, first.alone_deviation
    kind, of = found.errors.kind[k], found.errors.of[k]
    name, field, scale, unit = _SHOWN[kind]
    half = scale * NORMAL_95 * deviation[k]
    told = f"{name} of {scale * value[k]:+.3g} ± {half:.2g} {unit}" + ("" if kind == "delay" else f" ({of})")
    return (
        f"the misfit shows a {told}, uncertainty.{field} is {found.errors.deviation[k]:g}: correct it, or state what "
        "the laboratory knows"
    )


def digits_of(half: float) -> int:
    """Return the decimals that show two digits of an interval's half."""
    if not math.isfinite(half) or half <= 0.0:
        return 3
    return int(np.clip(1 - math.floor(math.log10(half)), 0, 6))


def _row(name: str, value: float, half: float, stated: float, scale: float, unit: str, verdict: str) -> list[str]:
    digits = digits_of(scale * half)
    return [
        name,
        f"{scale * value:+.{digits}f}",
        f"{scale * (value - half):+.{digits}f} … {scale * (value + half):+.{digits}f}",
        f"{scale * stated:.3g}",
        unit,
        verdict,
    ]
