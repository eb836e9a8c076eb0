"""What a system must offer so that its simulation can be held against measured data. Knows no system by name.

A simulation is bound to one recording: it holds the inputs and what was measured, and predicts the latter from
parameters. Its effects are named physical causes, each an extension of the model whose neutral values are exactly the
base model.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from messages.arrays import FloatArray
from messages.errors import unknown_name

Values = Mapping[str, float]
"""Parameters by key: one of the base model by its name, one of an effect as `effect.parameter`."""


@dataclass(frozen=True)
class Parameter:
    """A number of the base model or of an effect.

    `neutral` is the value without the effect, or where the base fit starts; infinite where only that is neutral, as for
    a resonance. `scale` is a typical change, the unit in which the fits count; unless they are given it is the other
    two as well. `step` is the step of differentiation: well above what the simulation's own numerics are off by, and
    small enough that the prediction hardly bends over it. `matters` is the least size that matters to a person: an
    effect that is not surely larger is not named; 0 names whatever is surely there.
    `per_recording` says, of a parameter of the base model, that it belongs to the recording and not to the system, as
    an initial state or a tare: each has its own value, fitted on the recording held out too.
    `inexact` is the share of the value that the simulation's own formula may be off by, known from other recordings
    whose truth is known: an interval claims no less (GUM, evaluation of type B). `own_bounds` says that the effect took
    its bounds from the recording, as a limit from the greatest reading: a value on one of them is an answer, while on
    any other bound the truth may lie beyond.
    """

    name: str
    unit: str
    neutral: float
    low: float
    high: float
    scale: float
    inexact: float = 0.0
    own_bounds: bool = False
    step: float | None = None
    matters: float | None = None
    per_recording: bool = False

    def __post_init__(self) -> None:
        if not (self.low < self.high and self.scale > 0.0 and math.isfinite(self.scale)):
            raise ValueError(f"{self.name}: low < high and 0 < scale < ∞ are needed")
        if self.step is not None and not 0.0 < self.step < self.high - self.low:
            raise ValueError(f"{self.name}: step {self.difference:g}; expected more than 0 and less than high − low")
        if not 0.0 <= self.least < math.inf:
            raise ValueError(f"{self.name}: matters {self.least:g}; expected 0 or more")
        if not 0.0 <= self.inexact < 1.0:
            raise ValueError(f"{self.name}: 0 ≤ inexact < 1 is needed")

    @property
    def difference(self) -> float:
        """Return the step of differentiation."""
        return self.scale if self.step is None else self.step

    @property
    def least(self) -> float:
        """Return the least size that matters."""
        return self.scale if self.matters is None else self.matters


@dataclass(frozen=True)
class Effect:
    """A physical cause that the base model leaves out.

    `choices` are the sets of its parameters that are tried, the simplest first; empty means all together. A further
    choice of an effect that is in already may join it later. `starts` are where a fit begins, and where the effect is
    judged before it, if its neutral values tell no direction (a resonance, a threshold); empty means at neutral. Raises
    UserError where they name a parameter that the effect has not.
    """

    name: str
    parameters: tuple[Parameter, ...]
    explanation: str  # the cause, in a sentence to a person
    remedy: str  # what to do about it
    experiment: str  # what tells it from its look-alikes
    choices: tuple[tuple[str, ...], ...] = ()
    starts: tuple[Values, ...] = ()  # by the parameters' own names

    def __post_init__(self) -> None:
        known = [parameter.name for parameter in self.parameters]
        for place, sets in (("choices", self.choices), ("starts", self.starts)):
            for name in (name for each in sets for name in each):
                if name not in known:
                    raise unknown_name(f"effect {self.name}: {place}: {name}", name, known)

    def qualified(self, parameter: str) -> str:
        """Return the key of one of its parameters in `Values`."""
        return f"{self.name}.{parameter}"


@dataclass(frozen=True)
class Channels:
    """What was measured: `values` (n, c) at the uniform times `t_s` (n,), NaN where it is missing.

    `inputs` (n, k) is whatever drives the system, brought to the same times: residuals are searched for what follows
    from it. `names` and `input_names` carry units as suffixes.
    """

    t_s: FloatArray
    values: FloatArray
    names: tuple[str, ...]
    inputs: FloatArray
    input_names: tuple[str, ...]
    noise_std: FloatArray | None = field(default=None)
    """(c,) standard deviation of one sample of measured minus predicted under the right model, where it is known."""
    tolerance: FloatArray | None = field(default=None)
    """(c,) root mean square of measured minus predicted that is good enough, where less need not be explained."""
    shared_noise: bool = False
    """Whether predictions carry a noise that the residual carries too, as a differentiated reference does: functions of
    predictions would find that noise, so that only those of the inputs, which must be free of it, are searched with."""

    @property
    def rate_hz(self) -> float:
        """Return the samples per second."""
        return (len(self.t_s) - 1) / float(self.t_s[-1] - self.t_s[0])


class Simulation(Protocol):
    """A simulation bound to one recording. `predicted` is pure: equal values give equal bytes.

    It is always given every parameter of base model and effects (`discrepancy.values` fills in neutral ones), so that
    it needs no defaults of its own; an effect acts where its parameters differ from neutral.
    """

    @property
    def system(self) -> str:
        """Return the system's name."""

    @property
    def channels(self) -> Channels:
        """Return what was measured."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return the base model's own parameters, which are fitted in any case; may be empty."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Return the library of what may be missing."""

    def predicted(self, values: Values) -> FloatArray:
        """Return what should have been measured, (n, c), from all parameters; NaN where inputs are missing."""


@runtime_checkable
class SideBySide(Protocol):
    """A simulation that predicts from many sets of parameters at once faster than one after another; optional."""

    def predicted_many(self, sets: Sequence[Values]) -> FloatArray:
        """Return what should have been measured from each of k `sets`, (k, n, c), as `predicted` would."""


@runtime_checkable
class TakesLibrary(Protocol):
    """A simulation whose effects hold sizes and constants of its recording; optional."""

    def like(self, fitted: Simulation) -> Simulation:
        """Return the simulation with the effects of the one `fitted`, so that equal values mean the same in both."""


def predicted_many(simulation: Simulation, sets: Sequence[Values]) -> Iterable[FloatArray]:
    """Return what `simulation` predicts from each of the complete `sets`, (n, c) each, at once where it can."""
    if isinstance(simulation, SideBySide) and sets:
        return simulation.predicted_many(sets)
    return (simulation.predicted(values) for values in sets)
