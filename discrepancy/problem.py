"""One recording as the finder sees it: residuals by channel, what is missing filled by one linear rule, calls counted.

Arrays are (c, n), time last, so that transforms run along contiguous memory. A missing sample of a residual or of a
column is the line between its neighbours: the same linear map for all, so that columns remain derivatives of residuals.
"""

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from discrepancy.evidence.noise import Noise, known_noise
from discrepancy.evidence.whitening import LOADING, White, whitening
from discrepancy.restricted import Restricted
from discrepancy.simulation import Channels, Effect, Parameter, SideBySide, Simulation, Values, predicted_many
from discrepancy.values import Complete, Neutral
from messages.arrays import BoolArray, FloatArray
from messages.errors import UserError

LEAST_SAMPLES = 200
THIS = "recording"
"""How an error names a recording that nobody has given a name here."""
_EDGE_SHARE = 0.005
"""Of the record at either end: filters and shifts in a simulation have no past or future there."""
MOST_LOST = 0.05
"""Of the samples compared: a model that gives fewer has diverged, and what it does give is not compared instead."""
_MOST_KEPT_BYTES = 2**26
"""Of the latest predictions, which a search asks for again: a third of all, where sets of causes differ by one."""
_FAR = 1e6
"""Times what was measured at most: a prediction further out is of a model that has diverged."""
_MOST_CHANGED = 1e12
"""Likewise, by one scale of a parameter."""

Asked = tuple[Values, FloatArray, str]
"""A column that is asked for: the values it is taken at, the prediction (c, n) there, and a parameter."""


class Problem:
    """Residuals of one simulation against its recording; `noise` is what is known of its noise beside any model.

    `continued` says that it is the rest of a recording whose beginning is fitted. `own` are the keys of what belongs to
    this recording alone, `reach` (c, 1) is what was measured at most. Raises UserError where fewer than 200 samples of
    any channel can be compared.
    """

    def __init__(self, simulation: Simulation, noise: Noise | None = None, *, continued: bool = False) -> None:
        self.continued = continued
        self.simulation = simulation
        self.channels: Channels = simulation.channels
        self.noise = noise or known_noise(self.channels)
        self.rate_hz = self.channels.rate_hz
        self.parameters: dict[str, Parameter] = {p.name: p for p in simulation.parameters}
        self.base = tuple(self.parameters)
        self.own = tuple(p.name for p in simulation.parameters if p.per_recording)
        self.effects: dict[str, Effect] = {effect.name: effect for effect in simulation.effects}
        for effect in simulation.effects:
            self.parameters |= {effect.qualified(p.name): p for p in effect.parameters}
        self.measured = np.ascontiguousarray(self.channels.values.T)
        self._neutral = Neutral(simulation)
        self._kept: OrderedDict[frozenset[tuple[str, float]], FloatArray] = OrderedDict()
        neutral = self.predicted({})
        self.c, self.n = self.measured.shape
        inside = np.zeros(self.n, bool)
        edge = max(round(_EDGE_SHARE * self.n), 2)
        inside[edge : self.n - edge] = True
        self._accept(np.isfinite(self.measured) & np.isfinite(neutral) & inside)
        few = [name for name, kept in zip(self.channels.names, self.valid.sum(axis=1), strict=True) if 0 < kept < 50]
        if few or int(self.valid.sum()) < LEAST_SAMPLES:
            raise UserError(
                f"{THIS}: {', '.join(few) or 'all channels'}: too few samples that can be compared, at least "
                f"{LEAST_SAMPLES} are needed"
            )

    @property
    def parts(self) -> "tuple[Problem, ...]":
        """Return the recordings one by one: this one."""
        return (self,)

    @property
    def side_by_side(self) -> bool:
        """Return whether many sets of parameters are predicted at once faster than one after another."""
        simulation = self.simulation
        while isinstance(simulation, (Part, Restricted)):
            simulation = simulation.whole
        return isinstance(simulation, SideBySide)

    @property
    def edges(self) -> tuple[int, ...]:
        """Return where each recording begins, and where the last one ends."""
        return (0, self.n)

    def values_of(self, _part: int, values: Values) -> Values:
        """Return `values` as a recording of this problem, the only one, takes them."""
        return values

    def whitening(self, residual: FloatArray, loading: float = LOADING) -> White:
        """Return the whitening under which `residual` (c, n) is unit noise, with white noise of the share `loading` of
        its power beside it.
        """
        return whitening(residual, self.valid, loading)

    def start(self) -> dict[str, float]:
        """Return the base model's parameters where its fit begins."""
        return {name: self.parameters[name].neutral for name in self.base}

    def residual(self, values: Values) -> FloatArray:
        """Return measured minus predicted, (c, n), filled where missing."""
        return self.difference(self.predicted(values))

    def difference(self, predicted: FloatArray) -> FloatArray:
        """Return measured minus `predicted` (c, n), filled where missing; a prediction missing elsewhere counts as
        right.
        """
        with np.errstate(invalid="ignore"):
            residual = self.measured - predicted
        return self.filled(np.where(np.isfinite(residual), residual, 0.0))

    def predicted(self, values: Values) -> FloatArray:
        """Return what should have been measured, (c, n), to be read only; raises UserError where `values` hold an
        unknown key.
        """
        mark = self._neutral.mark(values)
        found = self._kept.pop(mark, None)
        if found is None:
            found = np.array(self.simulation.predicted(self.completed(values)).T, order="C")
            found.flags.writeable = False
        self._kept[mark] = found
        if len(self._kept) * found.nbytes > _MOST_KEPT_BYTES:
            self._kept.popitem(last=False)
        return found

    def completed(self, values: Values) -> Complete:
        """Return `values` with all that they leave out at neutral; raises UserError for an unknown key."""
        return self._neutral.completed(values)

    def value(self, values: Values, key: str) -> float:
        """Return one of the `values`, neutral where they leave it out."""
        return values.get(key, self.parameters[key].neutral)

    def predicted_many(self, sets: Sequence[Values]) -> Iterator[FloatArray]:
        """Yield what should have been measured, (c, n), from each of the `sets`, side by side where that is faster."""
        if not isinstance(self.simulation, SideBySide):
            yield from map(self.predicted, sets)
            return
        for each in predicted_many(self.simulation, [self.completed(values) for values in sets]):
            yield np.ascontiguousarray(each.T)

    def column(self, values: Values, before: FloatArray, key: str) -> tuple[FloatArray, float]:
        """Return how the prediction changes with a parameter by one `scale`, (c, n), and the step taken in scales.

        `before` is the prediction at `values`. The step is away from the nearer bound.
        """
        step = self._step(values, key)
        return self.columns([(values, before, key)])[0], step

    def columns(self, asked: Sequence[Asked]) -> list[FloatArray]:
        """Return how the prediction changes by one `scale`, (c, n), for each of `asked`: values, the prediction there
        and a parameter. All are predicted side by side where that is faster.
        """
        return self.changes(asked, self.predicted_many(self.moved(asked)))

    def moved(self, asked: Sequence[Asked]) -> list[Values]:
        """Return the values at which to predict for the columns `asked`."""
        return [
            {**values, key: self.value(values, key) + self._sign(values, key) * self.parameters[key].difference}
            for values, _, key in asked
        ]

    def changes(self, asked: Sequence[Asked], after: Iterable[FloatArray]) -> list[FloatArray]:
        """Return the columns `asked` from what is predicted where a parameter is moved."""
        out = []
        with np.errstate(invalid="ignore", over="ignore"):
            for there, (values, before, key) in zip(after, asked, strict=True):
                change = (there - before) / self._step(values, key)
                out.append(self.filled(np.where(np.abs(change) < _MOST_CHANGED * self.reach, change, 0.0)))
        return out

    def _step(self, values: Values, key: str) -> float:
        """Return the step of differentiation in scales, away from the nearer bound."""
        parameter = self.parameters[key]
        return self._sign(values, key) * parameter.difference / parameter.scale

    def _sign(self, values: Values, key: str) -> float:
        parameter = self.parameters[key]
        return 1.0 if self.value(values, key) + parameter.difference <= parameter.high else -1.0

    def lost(self, predicted: FloatArray) -> float:
        """Return the share of the compared samples that a prediction (c, n) cannot give."""
        with np.errstate(invalid="ignore"):
            return 1.0 - float((np.abs(predicted) < _FAR * self.reach)[self.valid].mean())

    def filled(self, values: FloatArray) -> FloatArray:
        """Return `values` (c, n) with what is missing on the line between its neighbours."""
        if self._whole:
            return values
        flat = values.reshape(-1)
        flat[self._gap] = self._from_left * flat[self._left] + self._from_right * flat[self._right]
        return values

    def narrow(self, finite: BoolArray) -> None:
        """Take samples (c, n) out that some prediction could not give."""
        if not np.all(finite | ~self.valid):
            self._accept(self.valid & finite)

    def key_bounds(self, key: str) -> tuple[float, float]:
        """Return the bounds of a parameter."""
        return self.parameters[key].low, self.parameters[key].high

    def shifted(self, values: Values, keys: Iterable[str], steps: FloatArray) -> dict[str, float]:
        """Return `values` moved by `steps` scales along `keys`, kept within the bounds."""
        moved = dict(values)
        for key, step in zip(keys, steps, strict=True):
            p = self.parameters[key]
            moved[key] = float(np.clip(self.value(moved, key) + step * p.scale, p.low, p.high))
        return moved

    def _accept(self, valid: BoolArray) -> None:
        self.valid = valid
        most = np.abs(np.where(valid, self.measured, 0.0)).max(axis=1, keepdims=True)
        self.reach: FloatArray = np.where(most > 0.0, most, 1.0)
        self._whole = bool(valid.all())
        gap, left, right, weight = [], [], [], []
        for row, present in enumerate(valid):
            at, there = np.flatnonzero(~present), np.flatnonzero(present)
            if len(at) and len(there):
                after = np.searchsorted(there, at)
                lower = there[np.maximum(after - 1, 0)]
                upper = there[np.minimum(after, len(there) - 1)]
                gap.append(row * self.n + at)
                left.append(row * self.n + lower)
                right.append(row * self.n + upper)
                weight.append((at - lower) / np.maximum(upper - lower, 1))
        self._gap, self._left, self._right = (
            np.concatenate(each).astype(np.intp) if each else np.zeros(0, np.intp) for each in (gap, left, right)
        )
        self._from_right = np.clip(np.concatenate(weight), 0.0, 1.0) if weight else np.zeros(0)
        self._from_left = 1.0 - self._from_right


class Part:
    """A stretch of another simulation's recording: samples `first` up to `last`."""

    def __init__(self, whole: Simulation, first: int, last: int) -> None:
        self.whole = whole
        self._here = slice(first, last)
        all_ = whole.channels
        self._channels = Channels(
            all_.t_s[self._here],
            all_.values[self._here],
            all_.names,
            all_.inputs[self._here],
            all_.input_names,
            all_.noise_std,
            all_.tolerance,
            all_.shared_noise,
        )

    @property
    def system(self) -> str:
        """Return the system's name."""
        return self.whole.system

    @property
    def channels(self) -> Channels:
        """Return what was measured in the stretch."""
        return self._channels

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return the base model's own parameters."""
        return self.whole.parameters

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Return the library."""
        return self.whole.effects

    def predicted(self, values: Values) -> FloatArray:
        """Return what should have been measured in the stretch."""
        return self.whole.predicted(values)[self._here]

    def predicted_many(self, sets: Sequence[Values]) -> FloatArray:
        """Return what should have been measured in the stretch from each of the `sets`, (k, n, c)."""
        return np.stack([each[self._here] for each in predicted_many(self.whole, sets)])
