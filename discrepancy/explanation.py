"""Everything a report needs of an explained discrepancy. Made by `explain`, written by the report."""

from dataclasses import dataclass
from typing import Literal

from discrepancy.simulation import Channels, Effect
from discrepancy.verdict import Quantity, Verdict
from messages.arrays import FloatArray

Status = Literal["accepted", "equivalent", "rejected"]


@dataclass(frozen=True)
class Spectrum:
    """Power densities (k, c), unit² / Hz, of the residuals at `f_hz` (k,): before, after, and of the estimated noise.

    `coherence` (k, c) is the multiple coherence of the base residual with the inputs: the share of its power that
    follows linearly from them.
    """

    f_hz: FloatArray
    before: FloatArray
    after: FloatArray
    noise: FloatArray
    coherence: FloatArray


@dataclass(frozen=True)
class View:
    """One recording (or its part) with what base and extended model predict, (n, c); NaN where nothing can be said."""

    channels: Channels
    base: FloatArray
    extended: FloatArray
    spectrum: Spectrum

    @property
    def residual_before(self) -> FloatArray:
        """Return measured minus base model, (n, c)."""
        return self.channels.values - self.base

    @property
    def residual_after(self) -> FloatArray:
        """Return measured minus extended model, (n, c)."""
        return self.channels.values - self.extended


@dataclass(frozen=True)
class Evidence:
    """One candidate, alone: an effect with one choice of its parameters.

    `chi2` is by how much it lowers χ² (whitened by the estimated noise), of which `threshold` is what chance reaches;
    `chance` is the probability that the best of all candidates does as well on data of the base model. `refitted` tells
    a nonlinear fit from a linear score. `parameters` are its best values, where it was fitted or begun, `units`
    those of all of the choice. `left` is the χ² that it leaves alone; without a refit that is an estimate from the
    linear score.
    """

    effect: str
    choice: tuple[str, ...]
    chi2: float
    threshold: float
    chance: float
    refitted: bool
    status: Status
    parameters: dict[str, float]
    units: tuple[str, ...]
    left: float


@dataclass(frozen=True)
class Misfit:
    """χ² of the fitted recording under the noise that the search settled on: of the base model and of the extended one;
    `count` whitened samples are in it, which is the χ² of noise alone.
    """

    before: float
    after: float
    count: int


@dataclass(frozen=True)
class Adequacy:
    """Whether a model leaves nothing in the recording that follows from the inputs.

    `predictable` (c,) is the share of each channel's whitened residual power that the inputs predict out of sample;
    `chance` the probability of the whole under noise alone; `level` (c,) the residual over the known noise, NaN
    where none is known; `whiteness` (c,) the largest autocorrelation left after whitening; `heteroscedasticity`
    (c,) the correlation of its magnitude with the inputs' level. `reasons` say in words what failed, `doubts` what may
    be noise or not, `remarks` what is there beside.
    """

    adequate: bool
    chance: float
    predictable: FloatArray
    level: FloatArray
    whiteness: FloatArray
    heteroscedasticity: FloatArray
    reasons: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Explanation:
    """What was found on one recording and how it holds on another.

    `values_before` and `values_after` hold every parameter, as `Simulation.predicted` takes them; `quantities_after`
    those of the causes by `effect.parameter`. `causes` are the library's entries of the verdict's causes and `rivals`
    those of their equivalents, by name. `evidence` is of all candidates, strongest first, beside the `misfit`.
    `held_out_is_own` is False where the last part of the fit recording was held out. Of several recordings `fit` is the
    first and `held_out` the one with the largest error left, whose name is `held_out_name`.
    """

    verdict: Verdict
    fit: View
    held_out: View
    held_out_is_own: bool
    evidence: tuple[Evidence, ...]
    misfit: Misfit
    before: Adequacy
    after: Adequacy
    values_before: dict[str, float]
    values_after: dict[str, float]
    quantities_after: dict[str, Quantity]
    causes: tuple[Effect, ...]
    rivals: dict[str, Effect]
    notes: tuple[str, ...]
    seed: int
    held_out_name: str = ""
