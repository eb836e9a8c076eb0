"""Columns of made terms: how the prediction changes, to first order, with each amount at each of its starts."""

from collections.abc import Callable, Sequence

import numpy as np

from discrepancy.construct.signals import Given, responses, signals_at_ports
from discrepancy.construct.terms import MadeTerm, Motion, curves, made_terms, scaled
from discrepancy.ports.declared import Port
from discrepancy.ports.simulation import PortedSimulation
from discrepancy.simulation import Values
from messages.arrays import FloatArray

_OF_OUTPUT = 1e-3
"""Of an output's deviation: the change that an amount's scale makes, where it makes most."""
_SMALL = 1e-5
"""Likewise, of the change by which columns are taken: small enough to be linear, far above rounding."""
_ROUNDS = 6
"""Trials of how large a signal at a port makes such a change."""
_ENOUGH = 30.0
"""Times by which a trial may be off."""
_BY_CHANCE = 1e-12
"""Of an output's deviation: a smaller change says that nothing arrives there."""


class Ports:
    """The ports of a simulation, and how large a signal makes a small change there, measured at complete `values`."""

    def __init__(self, simulation: PortedSimulation, values: Values) -> None:
        self.simulation = simulation
        self._amplitudes = _amplitudes(simulation, values)
        self._step_s = 1.0 / simulation.channels.rate_hz

    def terms(self, values: Values) -> tuple[MadeTerm, ...]:
        """Return all terms that can be made there, from the motion at complete `values`."""
        t_s = self.simulation.channels.t_s
        length_s = float(t_s[-1] - t_s[0])
        return self._made(values, lambda port, motions: made_terms(port, motions, length_s, self._step_s))

    def curves(self, values: Values) -> tuple[MadeTerm, ...]:
        """Return a learned curve of every signal that moves there."""
        return self._made(values, curves)

    def _made(
        self, values: Values, of_port: Callable[[Port, Sequence[Motion | None]], list[MadeTerm]]
    ) -> tuple[MadeTerm, ...]:
        simulation = self.simulation
        signals = signals_at_ports(simulation, values)
        made: list[MadeTerm] = []
        for port in simulation.ports:
            if port.name in self._amplitudes and port.name in signals:
                made += of_port(port, [Motion.of(each) for each in signals[port.name]])
        spread = _spread(simulation)
        out: list[MadeTerm] = []
        for each, rows in zip(made, self._by_term(values, made, signals), strict=True):
            change = np.sqrt(np.mean(rows**2, axis=-1)) / spread  # (starts, amounts, c)
            most = change.max(axis=(0, 2))
            if np.all(np.isfinite(most)) and np.all(most > 0.0):
                out.append(scaled(each, [float(_OF_OUTPUT / m) for m in most]))
        return tuple(out)

    def columns(self, simulation: PortedSimulation, values: Values, made: Sequence[MadeTerm]) -> FloatArray:
        """Return the change of the prediction by one scale of each amount of the terms at each start, (m, c, n), in the
        same simulation with a library.
        """
        signals = signals_at_ports(simulation, values)
        out = [np.zeros((0, simulation.channels.values.shape[1], len(simulation.channels.t_s)))]
        for each, rows in zip(made, self._by_term(values, made, signals, simulation), strict=True):
            scales = np.array([p.scale for p in each.effect.parameters[: len(each.form.amounts)]])
            out.append((rows * scales[None, :, None, None]).reshape(-1, *rows.shape[2:]))
        return np.concatenate(out)

    def _by_term(
        self,
        values: Values,
        made: Sequence[MadeTerm],
        signals: dict[str, list[FloatArray]],
        simulation: PortedSimulation | None = None,
    ) -> list[FloatArray]:
        """Return for each term the change of the prediction by an amount of one, (starts, amounts, c, n)."""
        simulation = simulation or self.simulation
        step_s = 1.0 / simulation.channels.rate_hz
        n = len(simulation.channels.t_s)
        before = simulation.predicted(values)
        given: list[Given] = []
        wanted: list[tuple[int, tuple[int, ...], float]] = []
        out: list[FloatArray] = []
        for k, each in enumerate(made):
            series = each.series(signals[each.port.name], step_s)
            series = np.nan_to_num(np.broadcast_to(series, (*series.shape[:2], n)))
            out.append(np.zeros((*series.shape[:2], before.shape[1], n)))
            for place in np.ndindex(*series.shape[:2]):
                size = float(np.sqrt(np.mean(series[place] ** 2)))
                if size > 0.0:
                    factor = self._amplitudes[each.port.name] / size
                    given.append(Given(each.port.name, factor * series[place]))
                    wanted.append((k, place, factor))
        for (term, place, factor), there in zip(wanted, responses(simulation, values, given), strict=True):
            change = np.where(np.isfinite(there), there - before, 0.0)
            out[term][place] = change.T / factor
        return out


def _spread(simulation: PortedSimulation) -> FloatArray:
    spread = np.nanstd(simulation.channels.values, axis=0)
    return np.asarray(np.where(spread > 0.0, spread, np.inf))


def _amplitudes(simulation: PortedSimulation, values: Values) -> dict[str, float]:
    """Return for each port how large a signal makes a small change of the outputs; a port that makes none is left out.

    The signal tried is a slow tone, as a constant would act where nothing holds against it.
    """
    n = len(simulation.channels.t_s)
    tone = np.sin(np.linspace(0.0, 20.0 * np.pi, n))
    before = simulation.predicted(values)
    spread = _spread(simulation)
    found = {port.name: 1.0 for port in simulation.ports}
    for _ in range(_ROUNDS):
        given = [Given(name, size * tone) for name, size in found.items()]
        after = responses(simulation, values, given)
        off = {}
        for (name, size), there in zip(list(found.items()), after, strict=True):
            change = float(np.max(np.sqrt(np.nanmean((there - before) ** 2, axis=0)) / spread))
            if not np.isfinite(change) or change > 1e3:
                found[name] = 1e-6 * size
                off[name] = np.inf
            elif change < _BY_CHANCE:
                found[name] = 1e6 * size
                off[name] = np.inf
            else:
                found[name] = size * _SMALL / change
                off[name] = max(change / _SMALL, _SMALL / change)
        if all(each < _ENOUGH for each in off.values()):
            break
    return {name: size for name, size in found.items() if np.isfinite(off[name])}
