"""What is hidden in the five systems of `five_systems`, and how large: kinds that a generic library holds, kinds that
none does, or nothing.

Each kind is a force, torque or flow f of its system's states, written out in `f`; sizes are log-uniform within the
ranges that stand here.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from lab.hidden.five_systems import (
    AMBIENT_K,
    CLEAN,
    MORE,
    NOISE_SHARE,
    SYSTEMS,
    Recorded,
    State,
    System,
    recorded,
    sign,
)

Constants = Mapping[str, float]
Formula = Callable[[tuple[float, ...], float, Constants], float]

_NOISE = (1e-3, 2e-2)
"""Of each reading's deviation: the noise that is drawn."""


@dataclass(frozen=True)
class Kind:
    """What is hidden: the name of the library's `effect`, empty where there is none, the ranges of its constants, and
    its formula from states, input and constants.
    """

    effect: str
    sizes: Mapping[str, tuple[float, float]]
    f: Formula


KINDS: Final[Mapping[str, Mapping[str, Kind]]] = {
    "pendulum": {
        "coulomb": Kind("coulomb_friction_at_joint", {"c": (0.008, 0.05)}, lambda x, _u, c: c["c"] * sign(x[1])),
        "drag": Kind("quadratic_drag_at_joint", {"c": (0.003, 0.03)}, lambda x, _u, c: c["c"] * abs(x[1]) * x[1]),
        "cubic": Kind("cubic_spring_at_joint", {"c": (0.01, 0.2)}, lambda x, _u, c: c["c"] * x[0] ** 3),
        "cogging": Kind(
            "cogging_at_joint",
            {"c": (0.02, 0.1), "teeth": (5.0, 12.0)},
            lambda x, _u, c: c["c"] * math.sin(round(c["teeth"]) * x[0]),
        ),
        "magnet": Kind(
            "",
            {"c": (0.05, 0.2), "w": (0.15, 0.4)},
            lambda x, _u, c: c["c"] * x[0] / c["w"] * math.exp(0.5 - 0.5 * (x[0] / c["w"]) ** 2),
        ),
        "damping_with_angle": Kind("", {"c": (0.02, 0.2)}, lambda x, _u, c: c["c"] * x[0] ** 2 * x[1]),
    },
    "geared_motor": {
        "coulomb": Kind("coulomb_friction_at_shaft", {"c": (0.005, 0.04)}, lambda x, _u, c: c["c"] * sign(x[1])),
        "asymmetric": Kind(
            "asymmetric_friction_at_shaft", {"c": (0.004, 0.03)}, lambda x, _u, c: c["c"] * abs(sign(x[1]))
        ),
        "drag": Kind("quadratic_drag_at_shaft", {"c": (2e-4, 4e-3)}, lambda x, _u, c: c["c"] * abs(x[1]) * x[1]),
        "cogging": Kind(
            "cogging_at_shaft",
            {"c": (0.01, 0.06), "teeth": (5.0, 12.0)},
            lambda x, _u, c: c["c"] * math.sin(round(c["teeth"]) * x[0]),
        ),
        "gear_friction": Kind("", {"c": (0.05, 0.25)}, lambda x, u, c: c["c"] * abs(u) * sign(x[1])),
        "eccentric_gear": Kind("", {"c": (0.1, 0.4)}, lambda x, u, c: c["c"] * u * math.sin(x[0])),
    },
    "quarter_car": {
        "coulomb": Kind(
            "coulomb_friction_at_suspension", {"c": (5.0, 60.0)}, lambda x, _u, c: c["c"] * sign(x[1] - x[3])
        ),
        "cubic": Kind("cubic_spring_at_suspension", {"c": (2e6, 4e7)}, lambda x, _u, c: c["c"] * (x[0] - x[2]) ** 3),
        "drag": Kind(
            "quadratic_drag_at_suspension",
            {"c": (200.0, 3000.0)},
            lambda x, _u, c: c["c"] * abs(x[1] - x[3]) * (x[1] - x[3]),
        ),
        "dead_band": Kind(
            "dead_band_spring_at_suspension",
            {"c": (8e3, 4e4), "gap": (0.006, 0.015)},
            lambda x, _u, c: c["c"] * (x[0] - x[2] - min(max(x[0] - x[2], -c["gap"]), c["gap"])),
        ),
        "one_way_damper": Kind("", {"c": (100.0, 700.0)}, lambda x, _u, c: c["c"] * abs(x[1] - x[3])),
        "damping_with_travel": Kind(
            "", {"c": (5e5, 8e6)}, lambda x, _u, c: c["c"] * (x[0] - x[2]) ** 2 * (x[1] - x[3])
        ),
    },
    "two_tanks": {
        "leak": Kind("leak_at_upper", {"c": (2e-4, 6e-3)}, lambda x, _u, c: c["c"] * max(x[0], 0.0)),
        "overflow": Kind(
            "overflow_at_upper",
            {"c": (0.02, 0.08), "rim": (1.3, 1.8)},
            lambda x, _u, c: c["c"] * max(x[0] - c["rim"], 0.0),
        ),
        "constant": Kind("constant_at_upper", {"c": (5e-4, 5e-3)}, lambda _x, _u, c: c["c"]),
        "sloping_wall": Kind("", {"c": (1e-3, 6e-3)}, lambda x, _u, c: c["c"] * max(x[0], 0.0) ** 2),
        "siphon": Kind("", {"c": (2e-3, 1e-2)}, lambda x, u, c: c["c"] * max(u, 0.0) / 0.055 * max(x[0], 0.0)),
    },
    "heater": {
        "constant": Kind("constant_at_body", {"c": (0.03, 0.6)}, lambda _x, _u, c: c["c"]),
        "lost_power": Kind("gain_of_power_w", {"c": (0.01, 0.1)}, lambda _x, u, c: c["c"] * u),
        "radiation": Kind("", {"c": (1e-10, 8e-10)}, lambda x, _u, c: c["c"] * (x[0] ** 4 - AMBIENT_K**4)),
        "convection": Kind(
            "", {"c": (2e-4, 2e-3)}, lambda x, _u, c: c["c"] * max(x[0] - AMBIENT_K, 0.0) * abs(x[0] - AMBIENT_K)
        ),
    },
}


def _geared(x: State, u: float, c: Constants) -> State:
    _angle, w = x
    return w, (u - 0.02 * w - c.get(MORE, 0.0)) / 0.01


FIVE: Final[Mapping[str, System]] = {
    **{name: each for name, each in SYSTEMS.items() if name != "motor"},
    "geared_motor": System(100.0, 20.0, (0.1, 4.0), 0.0, 0.15, (0.0, 0.0), _geared, lambda x: x, {}),
}


@dataclass(frozen=True)
class Case:
    """One case: a system, what is hidden in it, or `CLEAN`, with its constants, the noise as a share of each reading's
    deviation, and its seed.
    """

    system: str
    hidden: str
    constants: Constants
    noise_share: float
    seed: int

    @property
    def kind(self) -> Kind | None:
        """Return what is hidden, None for nothing."""
        return None if self.hidden == CLEAN else KINDS[self.system][self.hidden]

    def recorded(self, other: int = 0, strength: float = 1.0, longer: float = 1.0) -> Recorded:
        """Return a recording of the case, or an `other` one, with inputs `strength` times as strong and `longer` times
        as long; its sensors' noise is the same.
        """
        told, kind, constants = FIVE[self.system], self.kind, self.constants

        def hidden(x: State, u: float) -> Constants:
            return {} if kind is None else {MORE: kind.f(x, u, constants)}

        std = self.noise_share / NOISE_SHARE * recorded(told, self.seed, hidden).noise
        seconds = longer * told.seconds
        return recorded(told, self.seed + other, hidden, seconds=seconds, strength=strength, std=std)


def case(system: str, hidden: str, seed: int) -> Case:
    """Return a case with constants and noise drawn from its seed."""
    rng = np.random.default_rng([seed, len(hidden)])

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    sizes = {} if hidden == CLEAN else KINDS[system][hidden].sizes
    return Case(system, hidden, {name: between(*ends) for name, ends in sizes.items()}, between(*_NOISE), seed)
