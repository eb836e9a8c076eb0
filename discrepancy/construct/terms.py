"""Terms made at a simulation's ports from the signals at hand there, each an effect like those of a library.

Where a term's shape begins follows from what its signals do in the simulation as it was fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import combinations, permutations

import numpy as np

from discrepancy.construct.forms import FORMS, WIDTH_SHARE, Form, Memory, curve, memory_rate
from discrepancy.ports.declared import Arrays, Port, PortTerm, Rows, Signal
from discrepancy.simulation import Effect, Parameter
from messages.arrays import FloatArray

_FOLLOW_STEPS = 2.0
"""Samples in which a play takes up what leaves it: an integrator of one step to a sample stays stable."""
_STEEPEST = 0.5
"""Radians of a wave between two samples, at most, at the signal's ordinary speed: a faster one is not sampled."""
_WIDEST = 1e6
"""Scales that an amount may have."""
_OF_SIGNS = frozenset(["signed_three_halves", "signed_square", "magnitude", "sign", "stribeck", "dead_band"])
"""Forms that say nothing else than others of a signal that keeps its sign."""


@dataclass(frozen=True)
class Motion:
    """What a signal does: its least and greatest value, root mean square, the one of its change from sample to sample,
    and its first value.
    """

    low: float
    high: float
    rms: float
    change: float
    first: float

    @classmethod
    def of(cls, values: FloatArray) -> "Motion | None":
        """Return what a signal (n,) does, None if it does not vary or is not finite."""
        there = values[np.isfinite(values)]
        if len(there) < 2 or float(np.ptp(there)) <= 1e-9 * float(np.max(np.abs(there))):
            return None
        low, high = np.quantile(there, (0.001, 0.999))
        change = float(np.sqrt(np.mean(np.diff(there) ** 2)))
        return cls(float(low), float(high), float(np.sqrt(np.mean(there**2))), change, float(there[0]))

    @property
    def reach(self) -> float:
        """Return its greatest magnitude."""
        return max(abs(self.low), abs(self.high))

    @property
    def span(self) -> float:
        """Return its greatest less its least value."""
        return self.high - self.low


@dataclass(frozen=True)
class Constants:
    """What a constructed term's formula holds beside its parameters: the `width` of a smoothed sign and the `origin` of
    a memory, in the signal's unit, and the time `follow_s` in which a play follows; a learned curve lies between `low`
    and `high`.
    """

    width: float = 1.0
    origin: float = 0.0
    follow_s: float = 0.0
    low: float = 0.0
    high: float = 1.0


CONSTANTS = tuple(each.name for each in fields(Constants))
"""Names of a formula's constants."""


@dataclass(frozen=True)
class MadeTerm:
    """A term of a form at a port, from the signals named; `effect` holds its parameters and words."""

    port: Port
    form: Form
    signals: tuple[Signal, ...]
    constants: Constants
    effect: Effect

    @property
    def keys(self) -> tuple[str, ...]:
        """Return the keys of its amounts."""
        return tuple(self.effect.qualified(name) for name in self.form.amounts)

    @property
    def all_keys(self) -> tuple[str, ...]:
        """Return the keys of all its parameters."""
        return tuple(self.effect.qualified(p.name) for p in self.effect.parameters)

    @property
    def starts(self) -> FloatArray:
        """Return where its shape parameter begins (m,), one number without meaning where it has none."""
        shape = self.form.shape
        return np.array([start[shape.name] for start in self.effect.starts]) if shape is not None else np.ones(1)

    def series(self, signals: Sequence[FloatArray], step_s: float) -> FloatArray:
        """Return its basis functions (m, a, n) at each of its starts for the port's signals (n,)."""
        form, told = self.form, self.constants
        n = len(signals[0]) if len(signals) else 1
        shape = self.starts[:, None]
        x = tuple(signals[place][None, :] for place in self._places())
        if form.memory is not None:
            x = (_followed(form.memory, x[0][0] - told.origin, self.starts, told.follow_s, step_s),)
        if form.one_signed:
            x = (*x, np.full((1, 1), told.origin))
        with np.errstate(all="ignore"):
            basis = form.basis(x, shape, told.width)
        return np.stack([np.broadcast_to(row, (len(shape), n)) for row in basis], axis=1)

    def _places(self) -> list[int]:
        names = [each.name for each in self.port.signals]
        return [names.index(each.name) for each in self.signals]

    def term(self) -> PortTerm:
        """Return it as what acts at the port."""
        places = self._places()
        form, told = self.form, self.constants
        shape_name = form.shape.name if form.shape is not None else None

        def formula(signals: Rows, own: Rows, values: Arrays) -> tuple[FloatArray, Rows]:
            amounts = [values[name] for name in form.amounts]
            shape = values[shape_name] if shape_name is not None else np.ones(1)
            x = tuple(signals[place] for place in places)
            rates: tuple[FloatArray, ...] = ()
            if form.memory is not None:
                rates = (memory_rate(form.memory, own[0], x[0] - told.origin, shape, told.follow_s),)
                x = (own[0],)
            if form.one_signed:
                x = (*x, np.array(told.origin))
            basis = form.basis(x, shape, told.width)
            return np.asarray(sum(a * each for a, each in zip(amounts, basis, strict=True))), rates

        return PortTerm(self.port.name, self.effect, formula, 1 if form.memory is not None else 0)


def _followed(memory: Memory, x: FloatArray, shape: FloatArray, follow_s: float, step_s: float) -> FloatArray:
    """Return the state (m, n) of a memory that follows a signal (n,) held from sample to sample, by Heun's method."""
    z = np.zeros((len(shape), len(x)))
    for k in range(len(x) - 1):
        first = memory_rate(memory, z[:, k], x[k], shape, follow_s)
        second = memory_rate(memory, z[:, k] + step_s * first, x[k + 1], shape, follow_s)
        z[:, k + 1] = z[:, k] + 0.5 * step_s * (first + second)
    return z


def made_terms(port: Port, motions: Sequence[Motion | None], length_s: float, step_s: float) -> list[MadeTerm]:
    """Return the terms of all forms at a port whose signals move as told, None for one that does not move."""
    moving = [(signal, motion) for signal, motion in zip(port.signals, motions, strict=True) if motion is not None]
    found = []
    for form in FORMS.values():
        if form.arity == 0:
            found.append(_made(port, form, (), (), length_s, step_s))
        elif form.arity == 1:
            found += [
                _made(port, form, (signal,), (motion,), length_s, step_s)
                for signal, motion in moving
                if _sensible(form, signal, motion)
            ]
        else:
            pairs = combinations(moving, 2) if form.name == "product" else permutations(moving, 2)
            found += [_made(port, form, (a[0], b[0]), (a[1], b[1]), length_s, step_s) for a, b in pairs]
    return [each for each in found if each is not None]


def scaled(made: MadeTerm, scales: Sequence[float]) -> MadeTerm:
    """Return a term with these scales of its amounts."""
    amounts = [
        replace(p, scale=scale, low=-_WIDEST * scale, high=_WIDEST * scale)
        for p, scale in zip(made.effect.parameters, scales, strict=False)
    ]
    shape = made.effect.parameters[len(amounts) :]
    return replace(made, effect=replace(made.effect, parameters=(*amounts, *shape)))


def rebuilt(port: Port, form: Form, signals: tuple[Signal, ...], constants: Constants) -> MadeTerm:
    """Return the term that an extended model names; its parameters may have any value."""
    any_ = (-np.inf, np.inf)
    return MadeTerm(port, form, signals, constants, _effect(port, form, signals, 1.0, any_, (), any_, 1.0))


def curves(port: Port, motions: Sequence[Motion | None]) -> list[MadeTerm]:
    """Return a learned curve of each signal at a port that moves."""
    any_ = (-np.inf, np.inf)
    found = []
    for signal, motion in zip(port.signals, motions, strict=True):
        if motion is not None:
            form = curve(motion.low, motion.high)
            effect = _effect(port, form, (signal,), 1.0, any_, (), any_, 1.0)
            found.append(MadeTerm(port, form, (signal,), Constants(low=motion.low, high=motion.high), effect))
    return found


def _sensible(form: Form, signal: Signal, motion: Motion) -> bool:
    """Return whether a form can be of a signal: a hysteresis turns round with a velocity, a magnitude asks for signs,
    a wave is of a position.
    """
    keeps_sign = motion.low > 0.0 or motion.high < 0.0
    if form.name in _OF_SIGNS:
        return not keeps_sign
    if form.memory == "hysteresis":
        return signal.role == "velocity"
    if form.name == "wave":
        return signal.role in ("position", "other")
    return keeps_sign or not form.one_signed


def _made(
    port: Port,
    form: Form,
    signals: tuple[Signal, ...],
    motions: tuple[Motion, ...],
    length_s: float,
    step_s: float,
) -> MadeTerm | None:
    scale = 1.0
    bounds = (-np.inf, np.inf)
    constants = Constants()
    starts: tuple[float, ...] = ()
    limits, shape_scale = (-np.inf, np.inf), 1.0
    if motions:
        first = motions[0]
        constants = Constants(WIDTH_SHARE * first.rms, first.first, _FOLLOW_STEPS * step_s)
        if form.memory == "hysteresis":
            constants = Constants(constants.width, 0.0, constants.follow_s)
        if form.shape is not None:
            starts, limits, shape_scale = _begun(form, first, length_s, step_s)
            if not starts:
                return None
    return MadeTerm(
        port, form, signals, constants, _effect(port, form, signals, scale, bounds, starts, limits, shape_scale)
    )


def _begun(
    form: Form, motion: Motion, length_s: float, step_s: float
) -> tuple[tuple[float, ...], tuple[float, float], float]:
    """Return where a shape parameter begins, its bounds, and its scale."""
    assert form.shape is not None
    kind, shares = form.shape.kind, form.shape.starts
    if kind == "frequency":
        per_turn = np.pi / motion.span
        most = _STEEPEST / motion.change
        return tuple(k * per_turn for k in shares if k * per_turn <= most), (0.1 * per_turn, most), 1e-3 * per_turn
    if kind == "time":
        times = tuple(share * length_s for share in shares if share * length_s > step_s)
        return times, (0.5 * step_s, length_s), 0.1 * step_s
    if kind == "place":
        return (
            tuple(motion.low + share * motion.span for share in shares),
            (motion.low, motion.high),
            1e-3 * motion.span,
        )
    reach = motion.reach
    if form.memory == "hysteresis":
        # The way over which it turns: of a velocity, shares of what is gone through in a quarter of a swing.
        reach = motion.rms * motion.rms / max(motion.change, 1e-300) * step_s
        least = 2.0 * step_s * motion.reach
        return tuple(s * reach for s in shares if s * reach > least), (least, 100.0 * reach), 1e-3 * reach
    return tuple(share * reach for share in shares), (1e-4 * reach, reach), 1e-3 * reach


def _effect(
    port: Port,
    form: Form,
    signals: tuple[Signal, ...],
    scale: float,
    bounds: tuple[float, float],
    starts: tuple[float, ...],
    limits: tuple[float, float],
    shape_scale: float,
) -> Effect:
    parameters = [
        Parameter(
            name,
            unit_over(port.unit, [(s.unit, p) for s, p in zip(signals, powers, strict=True)]),
            0.0,
            *bounds,
            scale,
        )
        for name, powers in zip(form.amounts, form.powers, strict=True)
    ]
    shape = form.shape
    if shape is not None:
        unit = shape_unit(form, signals[0])
        begin = starts[len(starts) // 2] if starts else 1.0
        parameters.append(Parameter(shape.name, unit, begin, *limits, shape_scale))
    what = form.words.format(x=in_words(signals, 0), y=in_words(signals, 1), w="a small width")
    return Effect(
        "_".join((port.name, form.name, *(each.name for each in signals))),
        tuple(parameters),
        f"At {port.words} something acts that the simulation leaves out: {what}.",
        "Look there for what does so, and put it into the simulation.",
        "Record again with that signal going further, and slower.",
        starts=tuple({shape.name: start} for start in starts) if shape is not None else (),
    )


def in_words(signals: Sequence[Signal], place: int) -> str:
    """Return a signal's name as words; empty where there is none."""
    return signals[place].name.replace("_", " ") if place < len(signals) else ""


def shape_unit(form: Form, signal: Signal) -> str:
    """Return the unit of a form's shape parameter."""
    assert form.shape is not None
    if form.shape.kind == "time":
        return "s"
    if form.shape.kind == "frequency":
        return unit_over("1", [(signal.unit, 1.0)])
    return unit_over(signal.unit, [("1/s", 1.0)]) if form.memory == "hysteresis" else signal.unit


_RAISED = {0.5: "^½", 1.5: "^1.5", 2.0: "²", 3.0: "³", 4.0: "⁴"}


def unit_over(unit: str, by: Sequence[tuple[str, float]]) -> str:
    """Return a unit divided by others, each raised to a power: ("N·m", [("rad/s", 2)]) gives "N·m/(rad/s)²"."""
    below = [(each, power) for each, power in by if power and each not in ("", "1")]
    for each, power in below:
        if power == 1.0 and each == "1/s":
            below = [pair for pair in below if pair != (each, power)]
            unit = unit[:-2] if unit.endswith("/s") else f"{unit}·s"
    told = "".join(
        f"/{f'({each})' if any(mark in each for mark in '/·') else each}{_RAISED.get(power, '')}"
        for each, power in below
    )
    return f"{unit or '1'}{told}"
