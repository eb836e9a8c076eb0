"""What a position or a level at a port may call forth: springs, stops, overflow, leaks, cogging; and a constant.

Counted positive where it drives back. Position and level count from the model's own zero.
"""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from discrepancy.ports.declared import Arrays, Port, PortTerm, Role, Rows
from discrepancy.ports.friction import half_range
from discrepancy.ports.placed import at_port
from discrepancy.ports.ranges import PortSpan
from discrepancy.ports.sizes import MOST, SHARE, both, over
from discrepancy.simulation import Parameter
from messages.arrays import FloatArray

_GAPS = (0.2, 0.5)
"""Of a position's size: free play in which a spring may not act."""
_STOPS = (0.6, 0.8, 0.95)
"""Of the way from lowest to highest: where an end stop or an overflow may begin."""
_HARD = (1.0, 0.03)
"""Of the hardest: where the stiffness of a stop or an overflow begins; a soft one is not found from a hard one."""
_STIFFEST = 0.5
"""Of what the integrator stands: an end stop or an overflow as hard as that is hard."""
_MOST_INTO = 5.0
"""Times what runs over: what may arrive in another tank, whose level may rise faster for being narrower."""
_PER_TURN = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14, 15, 16, 18, 20, 24)
"""Cogging torques in a turn: poles and slots of small motors."""
_PER_TRAVEL = (2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16)
"""Periods in the travel of a linear drive."""
_LOAD = "Hold the part still at several places, and plot the force that holds it over the place."
_PUSH = "Move against the stop slowly, and note where the force begins to rise."


def restoring(span: PortSpan, step_s: float, others: Sequence[Port] = ()) -> list[PortTerm]:
    """Return what may drive back at a port, by the signals at hand there; what runs over may arrive at `others`."""
    found = [_constant(span)]
    for role in ("position", "level"):
        place = span.port.place(role)
        if place is not None:
            found += _springs(span, role, place, step_s) + _limits(span, role, place, step_s, others)
            found += [_cogging(span, place)] if role == "position" else []
    return found


def _constant(span: PortSpan) -> PortTerm:
    def constant(_signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        return p["value"], ()

    return at_port(
        span,
        "constant",
        constant,
        (both("value", span.port.unit, span.size),),
        "Something constant is missing, such as a weight, a leak or an amplifier's zero.",
        "Level the machine, or set the zero of what drives it.",
        "Switch all inputs off and look where it goes by itself.",
    )


def _springs(span: PortSpan, role: Role, place: int, step_s: float) -> list[PortTerm]:
    term = partial(at_port, span)
    unit, size = span.port.signals[place].unit, span.signals[place].size
    most, force = MOST * span.size, SHARE * span.size

    def linear(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        return -p["value"] * signals[place], ()

    def cubic(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        return -p["value"] * signals[place] ** 3, ()

    def dead_band(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        x = signals[place]
        return -p["value"] * (x - np.clip(x, -p["gap"], p["gap"])), ()

    softest = most / size
    if role == "level":
        softest = max(softest, _STIFFEST / (span.response * step_s))  # what flows in and out may all but balance
    stiffness = Parameter("value", over(span.port.unit, unit), 0.0, -softest, softest, force / size)
    if role == "level":
        return [
            term(
                "leak",
                linear,
                (stiffness,),
                "A loss is missing that grows with the level, as through a leak or a wall.",
                "Close the leak or insulate, or add it to the model.",
                "Fill, switch the inputs off and watch the level for a long time.",
            )
        ]
    return [
        term(
            "spring",
            linear,
            (stiffness,),
            "A spring is missing: a force proportional to displacement drives back.",
            "Look for a cable, a hose or gravity that pulls, and add it to the model.",
            _LOAD,
        ),
        term(
            "cubic_spring",
            cubic,
            (Parameter("value", over(span.port.unit, f"{unit}^3"), 0.0, *_cube(10.0 * most, size), force / size**3),),
            "A spring hardens, or softens, with displacement.",
            "Add the cubic term to the spring of the model, or stay within smaller amplitudes.",
            _LOAD,
        ),
        term(
            "dead_band_spring",
            dead_band,
            (
                Parameter("value", over(span.port.unit, unit), 0.0, 0.0, 10.0 * most / size, force / size),
                Parameter("gap", unit, 0.0, 0.0, size, SHARE * size),
            ),
            "A spring is missing that acts only beyond a free play to either side.",
            "Tighten what is loose, or add the play and the spring behind it to the model.",
            _LOAD,
            starts=tuple({"gap": share * size} for share in _GAPS),
        ),
    ]


def _cube(most: float, size: float) -> tuple[float, float]:
    return -most / size**3, most / size**3


def _limits(span: PortSpan, role: Role, place: int, step_s: float, others: Sequence[Port]) -> list[PortTerm]:
    term = partial(at_port, span)
    unit, signal = span.port.signals[place].unit, span.signals[place]
    travel = 2.0 * half_range(signal)
    speeds = span.port.place("velocity") is not None
    stiffest = _STIFFEST / (span.response * (step_s**2 if speeds else step_s))
    stiff = min(stiffest, MOST * span.size / (0.05 * travel))

    def beyond(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        return -p["stiffness"] * np.maximum(signals[place] - p["limit"], 0.0), ()

    def below(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        return p["stiffness"] * np.maximum(p["limit"] - signals[place], 0.0), ()

    def limit(neutral: float) -> tuple[Parameter, Parameter]:
        low, high = signal.low - 0.1 * travel, signal.high + 0.1 * travel
        return (
            Parameter("limit", unit, neutral, low, high, SHARE * travel, own_bounds=True),
            Parameter("stiffness", over(span.port.unit, unit), stiff, 0.001 * stiff, stiffest, 0.02 * stiff),
        )

    def starts(shares: tuple[float, ...]) -> tuple[dict[str, float], ...]:
        places = [signal.low + share * travel for share in shares]
        return tuple({"limit": place, "stiffness": hard * stiff} for hard in _HARD for place in places)

    if role == "level":
        words = (
            "It runs over: above a level, what is too much leaves by another way, and may arrive elsewhere.",
            "Add the overflow to the model, or stay below the rim.",
            _PUSH,
        )
        below_it = [port for port in others if port.unit == span.port.unit and port.place("level") is not None]
        shares = [Parameter(f"into_{port.name}", "1", 0.0, 0.0, _MOST_INTO, SHARE) for port in below_it]
        own = ("limit", "stiffness")

        def arriving(signals: Rows, p: Arrays, share: str) -> FloatArray:
            return -p[share] * beyond(signals, (), p)[0]

        return [
            term(
                "overflow",
                beyond,
                (*limit(math.inf), *shares),
                *words,
                choices=(own, *((*own, each.name) for each in shares)),
                starts=starts(_STOPS),
                elsewhere={
                    port.name: partial(arriving, share=each.name) for port, each in zip(below_it, shares, strict=True)
                },
            )
        ]
    words = (
        "It reaches an end stop that the model does not have.",
        "Add the stop to the model, or stay clear of it.",
        _PUSH,
    )
    return [
        term("upper_stop", beyond, limit(math.inf), *words, starts=starts(_STOPS)),
        term("lower_stop", below, limit(-math.inf), *words, starts=starts(tuple(1.0 - share for share in _STOPS))),
    ]


def _cogging(span: PortSpan, place: int) -> PortTerm:
    unit = span.port.signals[place].unit
    travel = 2.0 * half_range(span.signals[place])
    per = 2.0 * np.pi
    turn = per if unit == "rad" else 360.0 if unit in ("deg", "°") else 0.0
    periods = [count / turn for count in _PER_TURN] if turn else [count / travel for count in _PER_TRAVEL]
    scale = 0.02 / travel

    def cogging(signals: Rows, _own: Rows, p: Arrays) -> tuple[FloatArray, Rows]:
        angle = per * p["periods"] * signals[place]
        return p["sine"] * np.sin(angle) + p["cosine"] * np.cos(angle), ()

    return at_port(
        span,
        "cogging",
        cogging,
        (
            both("sine", span.port.unit, span.size),
            both("cosine", span.port.unit, span.size),
            Parameter("periods", f"1/{unit}", periods[0], 0.2 * periods[0], 4.0 * periods[-1], scale),
        ),
        "A force is missing that repeats itself along the way, as of a motor's magnets, a gear's teeth or a screw.",
        "Measure it once at creeping speed and feed it forward, or add it to the model.",
        "Turn slowly by hand and count the detents.",
        starts=tuple({"periods": each} for each in periods),
    )
