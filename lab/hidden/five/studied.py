"""The five systems with something of a fixed size hidden, as the construction of causes is studied on them."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from lab.hidden.five.acting import Force, Hidden, Own
from lab.hidden.five.hidden import NAMED, OUTSIDE
from lab.hidden.five.systems import Recorded, drawn

CLEAN: Final = "clean"
_STICK = 0.01
"""Of a unit of velocity: within it the motor's friction changes its sign."""


def _peak_at_rest() -> Force:
    """(c + s exp(−(ω / v)²)) sign ω against the motion, with Gauss's peak in place of the library's exponential one."""

    def force(signals: Sequence[float], _own: Own) -> tuple[float, Own]:
        speed = signals[0]
        return -0.03 * (1.0 + math.exp(-((speed / 0.6) ** 2))) * math.tanh(speed / _STICK), ()

    return force


STUDIED: Final[Mapping[str, Mapping[str, Hidden]]] = {
    "pendulum": {
        "cogging": NAMED["pendulum"]["cogging_at_joint"].makes(
            {"sine": -0.08, "cosine": 0.0, "periods": 8.0 / (2.0 * math.pi)}
        ),
        "drag": NAMED["pendulum"]["quadratic_drag_at_joint"].makes({"value": 0.012}),
    },
    "motor": {"stribeck": Hidden(port="shaft", force=_peak_at_rest())},
    "quarter_car": {
        "dead_band": NAMED["quarter_car"]["dead_band_spring_at_suspension"].makes({"value": 3e4, "gap": 0.012}),
        "cubic": NAMED["quarter_car"]["cubic_spring_at_suspension"].makes({"value": 3e7}),
    },
    "two_tanks": {"overflow": NAMED["two_tanks"]["overflow_at_upper"].makes({"stiffness": 0.05, "limit": 1.6})},
    "heater": {"radiation": OUTSIDE["heater"]["radiation"].makes({"c": 5e-10})},
}


def studied(system: str, hidden: str, seed: int, *, seconds: float | None = None) -> Recorded:
    """Return a recording of a system in which `hidden` acts, or `CLEAN`."""
    rng = np.random.default_rng(seed)
    return drawn(system, STUDIED[system].get(hidden, Hidden()), rng, rng, seconds=seconds)
