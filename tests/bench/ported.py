"""A small system with ports for the tests: a mass on a damper, driven by a force, its place and speed measured."""

from dataclasses import replace

import numpy as np

from discrepancy.ports.declared import Act, Arrays, Port, Rows, Signal, Term
from discrepancy.ports.ode import Ode
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.simulation import Channels, Parameter, Values
from messages.arrays import FloatArray

RATE_HZ = 50.0
MASS_KG, DAMPING = 2.0, 1.5
SLED = Port("sled", "N", "the sled", (Signal("place", "m", "position"), Signal("speed", "m/s", "velocity")))


def derivative(state: Rows, inputs: Rows, values: Arrays, act: Act) -> tuple[FloatArray, ...]:
    place, speed = state
    (force,) = inputs
    pull = force - 3.0 * place - values["damping"] * speed + act("sled", place, speed)
    return speed, pull / values["mass_kg"]


MODEL = Ode(start=(0.0, 0.0), derivative=derivative, output=(0, 1))
PARAMETERS = (
    Parameter("mass_kg", "kg", 1.9, 0.5, 10.0, 0.01),
    Parameter("damping", "N s/m", 1.4, 0.0, 20.0, 0.01),
)


def sled(seed: int, n: int = 1000, terms: tuple[Term, ...] | None = None) -> PortedSimulation:
    """Return the sled held against what it would measure itself, with noise."""
    random = np.random.default_rng(seed)
    t_s = np.arange(n) / RATE_HZ
    force = sum(4.0 * np.sin(2.0 * np.pi * f * t_s + random.uniform(0.0, 6.0)) for f in (0.11, 0.23, 0.37, 0.61))
    channels = Channels(t_s, np.zeros((n, 2)), ("place_m", "speed_mps"), np.asarray(force)[:, None], ("force_N",))
    found = PortedSimulation("sled", channels, MODEL, (SLED,), PARAMETERS, terms)
    return measuring(found, {}, seed)


def measuring(sled: PortedSimulation, hidden: Values, seed: int, terms: tuple[Term, ...] = ()) -> PortedSimulation:
    """Return the sled held against what it measures with `hidden` values of `terms`, and noise of 0.2 %."""
    clean = sled.with_terms(terms).predicted({"mass_kg": MASS_KG, "damping": DAMPING, **hidden})
    noise = 0.002 * clean.std(axis=0) * np.random.default_rng(seed + 100).standard_normal(clean.shape)
    return replace(sled, channels=replace(sled.channels, values=clean + noise))


def hiding(hidden: Values, seed: int) -> tuple[PortedSimulation, PortedSimulation]:
    """Return two recordings with `hidden` values of the generic library's effects, the simulations without."""
    first, second = sled(seed), sled(seed + 1)
    library = first.library
    return measuring(first, hidden, seed, library), measuring(second, hidden, seed + 1, library)
