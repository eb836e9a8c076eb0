"""What resists motion at a port that knows a velocity: viscous, Coulomb, Stribeck and asymmetric friction, drag, a lag
of force behind displacement, and inertia that the model leaves out.

All are counted positive where they act against the motion. A force that is constant but for its sign is taken up within
a small speed v₀, since an integrator takes no jump:

    sgn v ≈ tanh(v / v₀)                                                                                           (1)
"""

from functools import partial

import numpy as np

from discrepancy.ports.declared import Arrays, PortTerm, Rows
from discrepancy.ports.placed import at_port
from discrepancy.ports.ranges import PortSpan, Span
from discrepancy.ports.sizes import MOST, SHARE, both, half, over
from discrepancy.simulation import Parameter
from messages.arrays import FloatArray

_STILL = 0.002
"""Of a velocity's size: v₀ of (1) at least."""
_JUMPS = 0.25
"""Likewise, of what a velocity changes in a step: the integrator looks twice in each."""
_STOPPED = 0.4
"""Likewise, of what friction itself changes of a velocity in a step: or it would turn motion round instead of stopping
it."""
_SLOW = (0.05, 0.15, 0.4)
"""Of a velocity's size: speeds at which a raised friction at low speed may fade."""
_YIELDS = (0.05, 0.2)
"""Of a position's size: displacements within which a hysteretic force may build up."""
_HARDER = 4.0
"""Of the largest force otherwise: one that hardens is not reached, or that yields far beyond the travel."""
_HARDENS = 3.0
"""Of γ in (2), either way."""
_FOLLOWS = 2.0
"""Samples in which a velocity is differentiated: with fewer the integrator would be unstable."""
_SLOW_MOTION = "Move at several constant speeds both ways, from creeping to full speed, and plot force over speed."


def friction(span: PortSpan, step_s: float, steps: float) -> list[PortTerm]:
    """Return what may resist motion at a port, integrated in steps of `step_s`, `steps` to a sample; nothing where no
    velocity is at hand.
    """
    place = span.port.place("velocity")
    if place is None:
        return []
    term = partial(at_port, span)
    speed, speed_unit, unit = span.signals[place], span.port.signals[place].unit, span.port.unit
    per_speed, per_square = over(unit, speed_unit), f"{unit}/({speed_unit})^2"
    least = max(_STILL * speed.size, _JUMPS * speed.jump / steps)

    def sign(v: FloatArray, most: FloatArray) -> FloatArray:
        out: FloatArray = np.tanh(v / np.maximum(least, _STOPPED * span.response * step_s * np.abs(most)))
        return out

    def viscous(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        return -p["value"] * signals[place], ()

    def coulomb(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        return -p["value"] * sign(signals[place], p["value"]), ()

    def stribeck(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        v = signals[place]
        return -p["value"] * sign(v, p["value"]) * np.exp(-np.abs(v) / p["fades_at"]), ()

    def asymmetric(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        return -p["value"] * np.abs(sign(signals[place], p["value"])), ()

    def drag(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        v = signals[place]
        return -p["value"] * v * np.abs(v), ()

    most = MOST * span.size
    force = SHARE * span.size
    size = speed.size
    fading = Parameter("fades_at", speed_unit, _SLOW[1] * size, 0.01 * size, 0.7 * size, 0.01 * size)
    return [
        term(
            "viscous_friction",
            viscous,
            (Parameter("value", per_speed, 0.0, -most / speed.size, most / speed.size, force / speed.size),),
            "A damping is missing: a force proportional to speed acts against the motion.",
            "Add the damping to the model, or look for oil, eddy currents or a hose that drags.",
            _SLOW_MOTION,
        ),
        term(
            "coulomb_friction",
            coulomb,
            (half("value", unit, span.size),),
            "Dry friction is missing: a force of constant size acts against the motion.",
            "Add dry friction to the model, or look at bearings, seals and guides.",
            _SLOW_MOTION,
        ),
        term(
            "stribeck_friction",
            stribeck,
            (half("value", unit, span.size), fading),
            "Friction is higher at low speed and fades as the parts begin to slide on a film.",
            "Add the Stribeck term to the model, or use a lubricant that breaks away more easily.",
            _SLOW_MOTION,
            starts=tuple({"fades_at": share * speed.size} for share in _SLOW),
        ),
        term(
            "asymmetric_friction",
            asymmetric,
            (both("value", unit, span.size),),
            "Dry friction is stronger forward than backward, by twice this value.",
            "Add friction with a value for each direction, or look for a load or a seal that pulls one way.",
            _SLOW_MOTION,
        ),
        term(
            "quadratic_drag",
            drag,
            (Parameter("value", per_square, 0.0, 0.0, most / speed.size**2, force / speed.size**2),),
            "A drag is missing that grows with the square of speed, as of air or water.",
            "Add the drag to the model, or shield the moving part.",
            _SLOW_MOTION,
        ),
        _inertia(span, place, speed, step_s),
        *_hysteresis(span, place),
    ]


def _inertia(span: PortSpan, place: int, speed: Span, step_s: float) -> PortTerm:
    """Return the missing inertia: −M dv/dt, where a term's own state u follows v and dv/dt ≈ (v − u) / τ."""
    tau = _FOLLOWS * step_s
    own = 1.0 / span.response
    acceleration = max(speed.jump / step_s, np.finfo(float).tiny)
    scale = min(SHARE * span.size / acceleration, SHARE * own)

    def inertia(signals: Rows, own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        rate = (signals[place] - own[0]) / tau
        return -p["value"] * rate, (rate,)

    def begun(signals: Rows, _p: Arrays) -> Rows:
        return (signals[place],)

    per_s = span.port.signals[place].unit
    unit = over(span.port.unit, f"{per_s}^2" if per_s.endswith("/s") else f"{per_s}/s")
    return at_port(
        span,
        "missing_inertia",
        inertia,
        (Parameter("value", unit, 0.0, -0.5 * own, 2.0 * own, scale),),
        "Inertia is missing: a force proportional to acceleration acts against it.",
        "Weigh what moves along (cable, coupling, liquid) and add it to the model.",
        "Fasten a known mass and look whether the model with it is off by as much.",
        memory=1,
        begun=begun,
    )


def _hysteresis(span: PortSpan, place: int) -> list[PortTerm]:
    """Return a hysteretic force, −F z with Bouc's and Wen's z (n = 1, β = ½, α = 1; Wen 1976):

    ż = (v − ½ |v| z − γ v |z|) / x₀                                                                               (2)

    With γ = ½ it yields at F; with γ < −½ it hardens as it is loaded, and loses what it does as it is unloaded.
    """
    at = span.port.place("position")
    if at is None:
        return []
    travel = half_range(span.signals[at])

    def hysteresis(signals: Rows, own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        v, z = signals[place], own[0]
        return -p["value"] * z, ((v - 0.5 * np.abs(v) * z - p["softens"] * v * np.abs(z)) / p["within"],)

    unit = span.port.signals[at].unit
    return [
        at_port(
            span,
            "hysteresis",
            hysteresis,
            (
                Parameter("value", span.port.unit, 0.0, 0.0, _HARDER * MOST * span.size, SHARE * span.size),
                Parameter("within", unit, _YIELDS[0] * travel, 0.02 * travel, 2.0 * travel, 0.01 * travel),
                Parameter("softens", "1", 0.5, -_HARDENS, _HARDENS, 0.02),
            ),
            "A force is missing that builds up with displacement and then yields (`softens` 0.5), or hardens (−0.5 and "
            "below): loading and unloading differ.",
            "Add a hysteretic (Bouc-Wen) element, or replace the part that creeps (rubber, cable, joint).",
            "Cycle slowly with several amplitudes: the loop of force over position does not depend on speed.",
            choices=(("value", "within"), ("value", "within", "softens")),
            starts=tuple({"within": share * travel, "softens": -1.0} for share in _YIELDS),
            memory=1,
        )
    ]


def half_range(span: Span) -> float:
    """Return half of what a signal spans, or one unit where it stands still."""
    return 0.5 * (span.high - span.low) or 1.0
