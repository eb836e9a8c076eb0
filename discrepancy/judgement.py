"""Both recordings judged: is the model adequate before and after, and what does the extension gain, frozen?"""

from dataclasses import dataclass, replace

import numpy as np

from discrepancy.evidence.adequacy import Left, adequacy, grown, left
from discrepancy.evidence.gain import gain
from discrepancy.evidence.noise import known_noise, repeated
from discrepancy.evidence.probe import Predictable, Probe
from discrepancy.evidence.signature import coherence, power_density
from discrepancy.evidence.whitening import whitening
from discrepancy.explanation import Adequacy, Spectrum, View
from discrepancy.problem import Part, Problem
from discrepancy.search.candidates import Candidate
from discrepancy.search.fit import Fit, Intervals
from discrepancy.simulation import Simulation, TakesLibrary
from discrepancy.verdict import Gain
from messages.arrays import FloatArray

_FIT_SHARE = 0.7
"""Of a recording that has no other beside it: what is fitted; the rest judges."""

LEAST_REMOVED = 0.5
"""Of the held-out error's power above the noise: what causes must remove, frozen, to be named."""


@dataclass(frozen=True)
class Recordings:
    """The recording that is fitted and the one held out, which may be the last part of the same."""

    fit: Problem
    held_out: Problem
    held_out_is_own: bool

    @classmethod
    def of(cls, fit: Simulation, held_out: Simulation | None) -> "Recordings":
        """Return both; raises UserError where too little of one can be compared."""
        if held_out is not None:
            if isinstance(held_out, TakesLibrary):
                held_out = held_out.like(fit)
            told = repeated(fit.channels, held_out.channels)
            return cls(Problem(fit, told), Problem(held_out, told), True)
        n = len(fit.channels.t_s)
        cut = round(_FIT_SHARE * n)
        told = known_noise(fit.channels)
        return cls(Problem(Part(fit, 0, cut), told), Problem(Part(fit, cut, n), told), False)


@dataclass(frozen=True)
class Models:
    """The base model's fit and the extended one with its `causes`, each with the intervals of all that was fitted."""

    base: Fit
    base_intervals: Intervals
    extended: Fit
    extended_intervals: Intervals
    causes: tuple[Candidate, ...]

    def withdrawn(self) -> "Models":
        """Return the base model alone."""
        return replace(self, extended=self.base, extended_intervals=self.base_intervals, causes=())


@dataclass(frozen=True)
class Judgement:
    """Adequacy before and after, both recordings as a report shows them, and the gain on the one held out.

    `structured_before` and `structured_after` are what of the fit recording's residuals follows from the inputs. A
    model is adequate only if it is so on both recordings. `good_enough` tells whether the base model is within the
    tolerance that was stated, in all channels of both.
    """

    before: Adequacy
    after: Adequacy
    structured_before: Predictable
    structured_after: Predictable
    fit: View
    held_out: View
    gain: Gain
    good_enough: bool

    def withdrawn(self) -> "Judgement":
        """Return the judgement of the base model alone."""
        nrmse = self.gain.held_out_nrmse_before
        return replace(
            self,
            after=self.before,
            structured_after=self.structured_before,
            fit=_unextended(self.fit),
            held_out=_unextended(self.held_out),
            gain=Gain(nrmse, nrmse, self.gain.noise_floor_nrmse, 0.0),
        )


def judged(recordings: Recordings, models: Models, seed: int) -> Judgement:
    """Return what both recordings say of both models; `seed` draws the bootstrap."""
    problem, other = recordings.fit, recordings.held_out
    base, extended = other.predicted(models.base.values), other.predicted(models.extended.values)
    other.narrow(np.isfinite(base) & np.isfinite(extended))
    r_base, r_extended = other.difference(base), other.difference(extended)
    white_held = whitening(r_extended, other.valid)
    probe_held = Probe(other, white_held, extended, r_extended, seed)
    left_held = left(other, white_held, probe_held, r_extended)
    base_held = left(other, white_held, probe_held, r_base) if models.causes else left_held

    white = whitening(models.extended.residual, problem.valid)
    predicted, fit_extended = (problem.predicted(each.values) for each in (models.base, models.extended))
    probe = Probe(problem, white, fit_extended, models.extended.residual, seed)
    left_fit = left(problem, white, probe, models.extended.residual)
    base_fit = left(problem, white, probe, models.base.residual) if models.causes else left_fit
    before, structured = _on_both(base_fit, base_held)
    after, structured_after = _on_both(left_fit, left_held) if models.causes else (before, structured)
    return Judgement(
        before=before,
        after=after,
        structured_before=structured,
        structured_after=structured_after,
        fit=_view(problem, predicted, fit_extended, models.base.residual, models.extended.residual),
        held_out=_view(other, base, extended, r_base, r_extended),
        gain=gain(other, r_base, r_extended, left_held.predictable.signal, bool(models.causes)),
        good_enough=bool(np.all(base_fit.good_enough & base_held.good_enough)),
    )


def _on_both(fitted: Left, held_out: Left) -> tuple[Adequacy, Predictable]:
    """Return the adequacy on the recording fitted, with what the one held out has against it, and what of the first
    follows from its inputs.
    """
    here, structured = adequacy(fitted, held_out)
    there, _ = adequacy(held_out, fitted)
    more = grown(fitted, held_out)
    reasons = [*here.reasons, *(f"held out: {each}" for each in (*there.reasons, *([more] if more else [])))]
    doubts = [*here.doubts, *(f"held out: {each}" for each in there.doubts)]
    return replace(here, adequate=not reasons, reasons=tuple(reasons), doubts=tuple(doubts)), structured


def _view(problem: Problem, base: FloatArray, extended: FloatArray, before: FloatArray, after: FloatArray) -> View:
    f_hz, first = power_density(before, problem.rate_hz)
    _, second = power_density(after, problem.rate_hz)
    noise = whitening(after, problem.valid).noise_density(f_hz, problem.rate_hz)
    spectrum = Spectrum(f_hz, first, second, noise, coherence(problem, before, f_hz))
    return View(problem.channels, base.T, extended.T, spectrum)


def _unextended(view: View) -> View:
    return replace(view, extended=view.base, spectrum=replace(view.spectrum, after=view.spectrum.before))
