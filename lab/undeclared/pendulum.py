"""The pendulum as somebody models it: inertia, damping and weight, and a few effects that may be missing."""

import math

import numpy as np

from discrepancy.own_simulation import OwnSimulation
from discrepancy.simulation import Channels, Effect, Parameter, Values
from lab.hidden.pendulum import RATE_HZ, TEETH, Recorded
from messages.arrays import FloatArray

PARAMETERS = (
    Parameter("inertia_kgm2", "kg·m²", 0.048, 0.01, 0.2, 1e-4),
    Parameter("damping_nms", "N·m·s", 0.05, 0.0, 0.5, 1e-4),
    Parameter("weight_nm", "N·m", 1.15, 0.5, 3.0, 1e-3),
)
_STEPS = 4
"""Of integration in a sample."""
_MOST_RAD = 50.0
"""Beyond it a pendulum has been driven round and round: no such recording is there."""


def _effect(name: str, unit: str, high: float, scale: float, low: float | None = None) -> Effect:
    parameter = Parameter("value", unit, 0.0, -high if low is None else low, high, scale)
    return Effect(name, (parameter,), f"{name} acts.", f"Remove {name}.", "Swing wider, and slower.")


EFFECTS = (
    _effect("cogging", "N·m", 0.5, 1e-3),
    _effect("coulomb", "N·m", 0.3, 1e-3, 0.0),
    _effect("drag", "N·m·s²", 0.1, 1e-4, 0.0),
    _effect("torque_offset", "N·m", 0.3, 1e-3),
    _effect("angle_offset", "rad", 0.3, 1e-3),
    _effect("angle_gain", "1", 0.3, 1e-3),
)


def simulation(recorded: Recorded, withheld: tuple[str, ...] = ()) -> OwnSimulation:
    """Return the simulation of a recording, its noise undeclared, without the effects `withheld`."""
    effects = tuple(each for each in EFFECTS if each.name not in withheld)
    torque = recorded.torque_nm

    def model(values: Values) -> FloatArray:
        told = {each.name: values[f"{each.name}.value"] if each in effects else 0.0 for each in EFFECTS}
        own = {p.name: values[p.name] for p in PARAMETERS}
        angle = _angle(torque + told["torque_offset"], own, told["cogging"], told["coulomb"], told["drag"])
        return ((1.0 + told["angle_gain"]) * angle + told["angle_offset"])[:, None]

    channels = Channels(recorded.t_s, recorded.angle_rad[:, None], ("angle_rad",), torque[:, None], ("torque_nm",))
    return OwnSimulation("pendulum", channels, model, effects, PARAMETERS)


def _angle(torque: FloatArray, own: dict[str, float], cogging: float, coulomb: float, drag: float) -> FloatArray:
    """Return the angle (n,), at rest in the beginning, by a leapfrog of four steps a sample."""
    h = 1.0 / RATE_HZ / _STEPS
    inertia, damping, weight = own["inertia_kgm2"], own["damping_nms"], own["weight_nm"]
    lost = 0.5 * h * damping / inertia
    q = w = 0.0
    out = np.full(len(torque), np.nan)
    sin = math.sin
    for k, tau in enumerate(torque.tolist()):
        if abs(q) > _MOST_RAD:
            break
        out[k] = q
        for _ in range(_STEPS):
            q += 0.5 * h * w
            force = tau - weight * sin(q) - cogging * sin(TEETH * q) - drag * abs(w) * w
            # Friction stops within a step what it would otherwise turn round.
            driven = (w * (1.0 - lost) + h * force / inertia) / (1.0 + lost)
            braked = h * coulomb / inertia
            w = driven - math.copysign(min(abs(driven), braked), driven) if braked else driven
            q += 0.5 * h * w
    return out
