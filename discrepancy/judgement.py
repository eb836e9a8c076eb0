"""Both recordings judged: is the model adequate before and after, and what does the extension gain, frozen?"""

from dataclasses import dataclass, replace

import numpy as np

from discrepancy.evidence.adequacy import adequacy
from discrepancy.evidence.gain import gain
from discrepancy.evidence.probe import Predictable, Probe
from discrepancy.evidence.signature import coherence, power_density
from discrepancy.evidence.whitening import whitening
from discrepancy.explanation import Adequacy, Spectrum, View
from discrepancy.problem import Part, Problem
from discrepancy.search.candidates import Candidate
from discrepancy.search.fit import Fit, Intervals
from discrepancy.simulation import Simulation
from discrepancy.verdict import Gain
from messages.arrays import FloatArray

_FIT_SHARE = 0.7
"""Of a recording that has no other beside it: what is fitted; the rest judges."""


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
            return cls(Problem(fit), Problem(held_out), True)
        n = len(fit.channels.t_s)
        cut = round(_FIT_SHARE * n)
        return cls(Problem(Part(fit, 0, cut)), Problem(Part(fit, cut, n)), False)


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

    `structured_before` and `structured_after` are what of the fit recording's residuals follows from the inputs.
    """

    before: Adequacy
    after: Adequacy
    structured_before: Predictable
    structured_after: Predictable
    fit: View
    held_out: View
    gain: Gain

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
    probe_held = Probe(other, whitening(r_extended, other.valid), extended, r_extended, seed)
    left_held = probe_held.predictable(r_extended)
    base_held = probe_held.predictable(r_base) if models.causes else left_held

    white = whitening(models.extended.residual, problem.valid)
    predicted = problem.predicted(models.base.values)
    fit_extended = problem.predicted(models.extended.values)
    probe = Probe(problem, white, fit_extended, models.extended.residual, seed)
    before, structured = adequacy(problem, white, probe, models.base.residual, base_held.chance)
    after, left = before, structured
    if models.causes:
        after, left = adequacy(problem, white, probe, models.extended.residual, left_held.chance)
    return Judgement(
        before=before,
        after=after,
        structured_before=structured,
        structured_after=left,
        fit=_view(problem, predicted, fit_extended, models.base.residual, models.extended.residual),
        held_out=_view(other, base, extended, r_base, r_extended),
        gain=gain(other, r_base, r_extended, left_held.signal, bool(models.causes)),
    )


def _view(problem: Problem, base: FloatArray, extended: FloatArray, before: FloatArray, after: FloatArray) -> View:
    f_hz, first = power_density(before, problem.rate_hz)
    _, second = power_density(after, problem.rate_hz)
    noise = whitening(after, problem.valid).noise_density(f_hz, problem.rate_hz)
    spectrum = Spectrum(f_hz, first, second, noise, coherence(problem, before, f_hz))
    return View(problem.channels, base.T, extended.T, spectrum)


def _unextended(view: View) -> View:
    return replace(view, extended=view.base, spectrum=replace(view.spectrum, after=view.spectrum.before))
