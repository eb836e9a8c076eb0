"""The platform's library, continued: what acts on plate or foot above the sensor, and jumps that are sampled."""

from math import inf

from discrepancy.simulation import Effect, Parameter

_TAPE_STARTS_HZ = (32.0, 55.0, 95.0)
"""Resonances where fits begin, about √3 apart: the band's middle, its end, and beyond it."""
_TAPE_BOTH_HZ = 60.0
"""Likewise, about both axes at once: one start, as each pair costs a fit."""
_TAPE_START = {"zeta": 0.08, "seen": 0.5}
"""The rest where fits begin: damping light enough for a resonance to show, markers half way between none and all."""
_MASS_KG, _MASS_X_M = 0.3, (-0.1, 0.1)
"""A hidden mass where fits begin, on either side of the joint: a clamp's weight, within the plate."""


def above_sensor(foot: bool) -> tuple[Effect, ...]:
    """Return the effects of cables, straps, loose masses and the foot's fixing; the last only if there is a foot."""
    effects = (
        Effect(
            "parallel_spring",
            (
                Parameter("z_nmprad", "N·m/rad", 0.0, 0.0, 5e4, 3.0),
                Parameter("x_nmprad", "N·m/rad", 0.0, 0.0, 5e4, 3.0),
            ),
            "Something elastic between plate or foot and the laboratory, above the sensor, pulls back towards level.",
            "Lead cables away slack, and keep straps off the plate.",
            "Tilt slowly and hold: a spring holds a moment at rest that no mass makes.",
            choices=(("z_nmprad",), ("x_nmprad",), ("z_nmprad", "x_nmprad")),
        ),
        Effect(
            "parallel_damping",
            (
                Parameter("z_nmsprad", "N·m·s/rad", 0.0, 0.0, 2e3, 0.05),
                Parameter("x_nmsprad", "N·m·s/rad", 0.0, 0.0, 2e3, 0.05),
            ),
            "Something viscous between plate or foot and the laboratory, above the sensor, brakes as fast as it moves.",
            "Look for a damper, thick cable or hose on the plate and take it off.",
            "Shake at one frequency with two amplitudes: viscous moment follows speed, friction does not.",
            choices=(("z_nmsprad",), ("x_nmsprad",), ("z_nmsprad", "x_nmsprad")),
        ),
        Effect(
            "coulomb_friction",
            (Parameter("z_nm", "N·m", 0.0, 0.0, 200.0, 0.02), Parameter("x_nm", "N·m", 0.0, 0.0, 200.0, 0.02)),
            "Something rubs on plate or foot above the sensor: a constant moment against the motion.",
            "Look for a cable or cover that touches the plate, and free it.",
            "Shake at one frequency with two amplitudes: friction stays the same, viscous moment grows.",
            choices=(("z_nm",), ("x_nm",), ("z_nm", "x_nm")),
        ),
        Effect(
            "hidden_mass",
            (
                Parameter("mass_kg", "kg", 0.0, 0.0, 50.0, 0.01),
                Parameter("x_m", "m", 0.0, -1.0, 1.0, 0.005),
                Parameter("y_m", "m", 0.0, -1.0, 1.0, 0.005),
                Parameter("z_m", "m", 0.0, -1.0, 1.0, 0.005),
            ),
            "A mass rides on the plate that nobody counted, like a cable clamp or a strap's buckle.",
            "Weigh everything that is on the plate, or identify the plate anew with it.",
            "Weigh the plate with all that hangs on it.",
            choices=(("mass_kg", "x_m", "y_m", "z_m"),),
            starts=tuple({"mass_kg": _MASS_KG, "x_m": x_m, "y_m": 0.0, "z_m": 0.0} for x_m in _MASS_X_M),
        ),
    )
    if not foot:
        return effects
    return (
        *effects,
        Effect(
            "tape_compliance",
            (
                Parameter("z_hz", "Hz", inf, 12.0, 400.0, 0.2, inexact=5e-3),
                Parameter("x_hz", "Hz", inf, 12.0, 400.0, 0.2, inexact=5e-3),
                Parameter("zeta", "1", 0.0, 0.0, 2.0, 0.005),
                Parameter("seen", "1", 0.0, -0.5, 1.5, 0.005),
            ),
            "The foot rocks on the tape that holds it, about z or x: a resonance with damping; "
            "`seen` is the share of it that the foot's markers show.",
            "Clamp the foot, or use a thinner and stiffer tape and a larger base.",
            "Tap the foot: it rings at the resonance. Clamped, the effect goes; a delay or lag stays.",
            choices=(("z_hz", "zeta", "seen"), ("x_hz", "zeta", "seen"), ("z_hz", "x_hz", "zeta", "seen")),
            starts=(
                *({axis: hz, **_TAPE_START} for axis in ("z_hz", "x_hz") for hz in _TAPE_STARTS_HZ),
                {"z_hz": _TAPE_BOTH_HZ, "x_hz": _TAPE_BOTH_HZ, **_TAPE_START},
            ),
        ),
    )


def sampling(update_hz: float, offset_s: float) -> tuple[Effect, ...]:
    """Return the effect of sampling a wrench that jumps; a fit begins at these jumps."""
    return (
        Effect(
            "aliasing",
            (
                Parameter("share", "1", 0.0, 0.0, 2.0, 0.02),
                Parameter("update_hz", "Hz", update_hz, 5.0, 120.0, 3e-4),
                Parameter("offset_s", "s", offset_s, -0.2, 0.2, 3e-5),
            ),
            "The actuators' torque jumps `update_hz` times a second and the wrench is sampled without an anti-alias "
            "filter: what lies above half the rate folds down. `offset_s` is the first jump after the first sample.",
            "Sample faster and filter before sampling, and smooth the torque.",
            "Repeat with the torque smoothed: the misfit at the jumps goes.",
        ),
    )
