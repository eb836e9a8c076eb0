"""What the signals at a simulation's places span in its recording: from it come the sizes that effects there may have.

The base model is fitted first, so that its own trajectory is near the measured one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft
from scipy.interpolate import CubicSpline

from discrepancy.ports.acting import check_port
from discrepancy.ports.declared import Port, PortTerm, Role, Rows
from discrepancy.ports.ode import Ode
from discrepancy.problem import Problem
from discrepancy.search.refits import base_of
from discrepancy.simulation import Channels, Effect, Parameter, Values
from messages.arrays import FloatArray
from messages.errors import UserError

if TYPE_CHECKING:
    from discrepancy.ports.simulation import PortedSimulation

_ALMOST_ALL = 98.0
"""Percent of a signal's samples that are within what is called its size: peaks are left out."""
_UNIT = 1.0
"""Of a port: what is added there to see what it does."""
_PUSHED = 1e-3
"""Of what would move a system as much as it moves: a push that shows which way it goes."""
_PUSHED_SAMPLES = 3
"""After which that is looked for: a position follows a force two integrations later."""
_LINE, _BESIDE = 4.0, 2
"""Times that a line of a tapered spectrum is above it so many bins to either side."""
_MOVED: tuple[Role, ...] = ("velocity", "position", "level")
"""What a port may drive, that which follows first before others."""


@dataclass(frozen=True)
class Span:
    """Of one signal: lowest and highest value, `size` that its magnitude seldom exceeds, `jump` that it makes from one
    sample to the next (RMS).
    """

    low: float
    high: float
    size: float
    jump: float

    @classmethod
    def of(cls, signal: FloatArray) -> "Span":
        """Return the span of a signal's finite samples; one that stands still at zero spans one unit."""
        there = signal[np.isfinite(signal)]
        size = float(np.percentile(np.abs(there), _ALMOST_ALL)) if len(there) else 0.0
        if size == 0.0:
            size = float(np.abs(there).max(initial=0.0)) or 1.0
        jump = float(np.sqrt(np.mean(np.diff(there) ** 2))) if len(there) > 1 else 0.0
        return cls(float(there.min(initial=0.0)), float(there.max(initial=0.0)), size, jump)


@dataclass(frozen=True)
class PortSpan:
    """Of one port: the spans of its signals, and the `size` of what, added there, would move the system as much as it
    moves.

    `response` is by how much a unit there changes the rate of the state that it changes most, in that state's unit;
    `along` whether what is added drives what is moved there the way that its signals count, 1, or against it, −1.
    """

    port: Port
    signals: tuple[Span, ...]
    size: float
    response: float
    along: float = 1.0


@dataclass(frozen=True)
class Spans:
    """Of a whole recording: its ports, inputs and measured outputs by name, `step_s` between samples, `substep_s` of
    the integrator, its length, what the base model leaves of each output, whether it predicts one that `jumps`, whether
    its inputs are `held` until the next sample, which outputs go a `bent` way between samples, and at which bins of the
    spectrum inputs have `lines`.
    """

    ports: tuple[PortSpan, ...]
    inputs: dict[str, Span]
    outputs: dict[str, Span]
    step_s: float
    substep_s: float
    seconds: float
    left: dict[str, FloatArray]
    jumps: bool
    held: bool
    bent: frozenset[str]
    lines: frozenset[int]


class PortNotes:
    """Stands in for what acts at the ports: adds `amount` at one of them, and notes the signals handed over."""

    def __init__(self, ports: Sequence[Port], where: str = "", amount: float = 0.0) -> None:
        self._count = {port.name: len(port.signals) for port in ports}
        self._where, self._amount = where, amount
        self.signals: dict[str, Rows] = {}

    def __call__(self, port: str, *signals: FloatArray) -> FloatArray:
        """Return the amount; raises UserError for an unknown port or another number of signals."""
        check_port(self._count, port, signals)
        self.signals[port] = signals
        return np.array(self._amount if port == self._where else 0.0)


def spans(simulation: "PortedSimulation") -> Spans:
    """Return what a simulation's recording spans.

    Raises UserError where the base model diverges with its own starting values, or never calls a port of its own.
    """
    plain = simulation.with_terms(())
    channels = plain.channels
    first = plain.predicted({})
    if not np.isfinite(first).all():
        lost = channels.t_s[int(np.argmax(~np.isfinite(first).all(axis=1)))] - channels.t_s[0]
        raise UserError(
            f"{simulation.system}: the model gives no finite output from {lost:.4g} s on with its parameters' neutral "
            "values; expected neutral values near the truth, and `steps` enough for its fastest motion"
        )
    fit, _ = base_of(Problem(plain))
    batch = plain.batch([fit.values])
    trace = plain.model.traced(batch)
    quiet = PortNotes(plain.ports)
    rates = trace(quiet)
    for port in plain.ports:
        if port.name not in quiet.signals:
            raise UserError(f"{simulation.system}: port {port.name}: the model never calls act there")
    ports = [_port(port, plain.ports, quiet.signals[port.name], rates, trace) for port in plain.ports]
    return Spans(
        tuple(replace(each, along=_along(plain, each, fit.values, quiet.signals)) for each in ports),
        {name: Span.of(row) for name, row in zip(channels.input_names, channels.inputs.T, strict=True)},
        {name: Span.of(row) for name, row in zip(channels.names, channels.values.T, strict=True)},
        batch.step_s,
        batch.step_s / plain.model.steps,
        float(channels.t_s[-1] - channels.t_s[0]),
        dict(zip(channels.names, fit.residual, strict=True)),
        any(_jumps(row) for row in plain.predicted(fit.values).T),
        plain.model.held,
        _bent(plain, fit.values),
        _lines(channels.inputs),
    )


def _jumps(signal: FloatArray) -> bool:
    """Return whether a signal's change from sample to sample changes by more than it is: no line between two samples
    tells what is there.
    """
    change = np.diff(signal[np.isfinite(signal)])
    return float(np.mean(np.diff(change) ** 2)) > float(np.mean(change**2)) if len(change) > 1 else False


def _along(simulation: "PortedSimulation", span: PortSpan, values: Values, before: dict[str, Rows]) -> float:
    """Return 1 where a constant that is added at a port begins to move its signal up, −1 where down; `before` are the
    signals at all ports without it.
    """
    port = span.port
    place = next((k for role in _MOVED if (k := port.place(role)) is not None), None)
    if place is None:
        return 1.0
    push = Effect("push", (Parameter("value", port.unit, 0.0, -np.inf, np.inf, 1.0),), "", "", "")
    pushed = simulation.with_terms((PortTerm(port.name, push, lambda _signals, _own, p: (p["value"], ())),))
    notes = PortNotes(simulation.ports)
    pushed.model.traced(pushed.batch([{**values, push.qualified("value"): _PUSHED * span.size}]))(notes)
    n = len(simulation.channels.t_s)
    there, here = (np.broadcast_to(np.asarray(each[port.name][place]), (1, n))[0] for each in (notes.signals, before))
    return -1.0 if there[_PUSHED_SAMPLES] < here[_PUSHED_SAMPLES] else 1.0


def _bent(simulation: "PortedSimulation", values: Values) -> frozenset[str]:
    """Return the outputs whose way between two samples is nearer to a cubic spline than to a straight line.

    That hangs on the model: an input that is held bends a speed at each sample, and a position hardly. A model of whole
    signals tells no more of it than whether they jump.
    """
    channels = simulation.channels
    coarse = simulation.predicted(values)
    if not isinstance(simulation.model, Ode):
        return frozenset(name for name, row in zip(channels.names, coarse.T, strict=True) if not _jumps(row))
    n = len(channels.t_s)
    whole, between = channels.t_s, 0.5 * (channels.t_s[1:] + channels.t_s[:-1])
    fine_s = np.sort(np.concatenate((whole, between)))
    inputs = channels.inputs
    middle = inputs[:-1] if simulation.model.held else 0.5 * (inputs[1:] + inputs[:-1])
    fine_inputs = np.empty((2 * n - 1, inputs.shape[1]))
    fine_inputs[::2], fine_inputs[1::2] = inputs, middle
    unread = np.zeros((2 * n - 1, len(channels.names)))
    fine = replace(simulation, channels=Channels(fine_s, unread, channels.names, fine_inputs, channels.input_names))
    there = fine.predicted(values)[1::2]
    with np.errstate(invalid="ignore"):
        straight = ((there - 0.5 * (coarse[1:] + coarse[:-1])) ** 2).sum(axis=0)
        bent = [
            np.sum((each - CubicSpline(whole, row)(between)) ** 2) if np.isfinite(row).all() else np.inf
            for each, row in zip(there.T, coarse.T, strict=True)
        ]
    return frozenset(name for name, line, curve in zip(channels.names, straight, bent, strict=True) if curve < line)


def _lines(inputs: FloatArray) -> frozenset[int]:
    """Return the bins at which an input (n, i) has a line of its own, or beside which: nothing tells a hum there from
    what follows from it.
    """
    spectra = np.abs(fft.rfft((inputs - inputs.mean(axis=0)).T * np.hanning(len(inputs)), axis=1))
    there = np.pad(spectra, ((0, 0), (_BESIDE, _BESIDE)))
    around = np.maximum(there[:, : -2 * _BESIDE], there[:, 2 * _BESIDE :])
    found = np.flatnonzero((spectra > _LINE * around).any(axis=0))
    return frozenset(int(k + beside) for k in found for beside in (-1, 0, 1))


Trace = Callable[[PortNotes], FloatArray]
"""From what stands in at the ports: what they change along the base model's trajectory, (rows, n)."""


def _port(port: Port, ports: Sequence[Port], signals: Rows, rates: FloatArray, trace: Trace) -> PortSpan:
    n = rates.shape[1]
    change = np.abs(trace(PortNotes(ports, port.name, _UNIT)) - rates).mean(axis=1) / _UNIT
    felt = change > 0.0
    if not felt.any():
        raise UserError(f"port {port.name}: what is added there changes nothing in the model")
    moves = np.sqrt((rates[felt] ** 2).mean(axis=1)) / change[felt]
    own = tuple(Span.of(np.broadcast_to(np.asarray(signal), (1, n))[0]) for signal in signals)
    return PortSpan(port, own, float(moves.min()) or 1.0, float(change.max()))
