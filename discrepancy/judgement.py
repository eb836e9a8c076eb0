"""All recordings judged: is the model adequate before and after, and what does the extension gain, frozen?"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from discrepancy.evidence.adequacy import LEVEL, Left, adequacy, grown, left
from discrepancy.evidence.gain import gain, pooled
from discrepancy.evidence.probe import Predictable, Probe
from discrepancy.evidence.signature import coherence, power_density, signature
from discrepancy.evidence.whitening import whitening
from discrepancy.explanation import Adequacy, Spectrum, View
from discrepancy.problem import Problem
from discrepancy.recordings import Recordings
from discrepancy.search.agreement import Alone
from discrepancy.search.candidates import Candidate
from discrepancy.search.carried import carried
from discrepancy.search.fit import Fit, Intervals
from discrepancy.verdict import Gain, Signature
from messages.arrays import FloatArray

LEAST_REMOVED = 0.5
"""Of the held-out error's power above the noise: what causes must remove, frozen, to be named."""
LEAST_SMALLER = 0.67
"""Of the base model's held-out error: what many causes, or forms, must bring it below; they fit anything a little."""


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
class JudgedRecording:
    """One recording, fitted or held out: what base and extended model leave of it (c, n), whether that is adequate by
    itself and what of it follows from the inputs, as a report shows it, and what the extension gains there.
    """

    name: str
    problem: Problem
    residual_before: FloatArray
    residual_after: FloatArray
    before: Adequacy
    after: Adequacy
    structured_before: Predictable
    structured_after: Predictable
    view: View
    gain: Gain
    good_enough: bool

    def withdrawn(self) -> "JudgedRecording":
        """Return the judgement of the base model alone."""
        return replace(
            self,
            residual_after=self.residual_before,
            after=self.before,
            structured_after=self.structured_before,
            view=_unextended(self.view),
            gain=_without_gain(self.gain),
        )

    def signature(self) -> Signature:
        """Return where and when the extended model still misses something."""
        white = whitening(self.residual_after, self.problem.valid)
        return signature(self.problem, white, self.structured_after.signal)


@dataclass(frozen=True)
class Judgement:
    """Adequacy before and after over all recordings, each of them by itself, and the gain on those held out.

    A model is adequate only if it is so on all. `good_enough` tells whether the base model is within the tolerance that
    was stated, in all channels of all.
    """

    before: Adequacy
    after: Adequacy
    fitted: tuple[JudgedRecording, ...]
    held_out: tuple[JudgedRecording, ...]
    gain: Gain

    @property
    def several(self) -> bool:
        """Return whether more than one recording is fitted, or held out."""
        return len(self.fitted) > 1 or len(self.held_out) > 1

    @property
    def good_enough(self) -> bool:
        """Return whether the base model is within the stated tolerance everywhere."""
        return all(each.good_enough for each in (*self.fitted, *self.held_out))

    def withdrawn(self) -> "Judgement":
        """Return the judgement of the base model alone."""
        return replace(
            self,
            after=self.before,
            fitted=tuple(each.withdrawn() for each in self.fitted),
            held_out=tuple(each.withdrawn() for each in self.held_out),
            gain=_without_gain(self.gain),
        )


def far_better(gain: Gain) -> bool:
    """Return whether an extension removes half of the held-out excess, as any cause must, and makes the error smaller
    by a third.
    """
    before, after, removed = gain.held_out_nrmse_before, gain.held_out_nrmse_after, gain.share_of_excess_removed
    if before is None or after is None or removed is None:
        return False
    return removed >= LEAST_REMOVED and after < LEAST_SMALLER * before


def judged(recordings: Recordings, models: Models, seed: int) -> Judgement:
    """Return what all recordings say of both models; `seed` draws the bootstrap."""
    fit, other, named = recordings.fit, recordings.held_out, bool(models.causes)
    base, extended = (other.predicted(carried(other, each.values)) for each in (models.base, models.extended))
    other.narrow(np.isfinite(base) & np.isfinite(extended))
    there = _sides(other, base, extended, other.difference(base), other.difference(extended), seed, named)
    base, extended = (fit.predicted(each.values) for each in (models.base, models.extended))
    here = _sides(fit, base, extended, models.base.residual, models.extended.residual, seed, named)
    names = (recordings.fitted_names, recordings.held_out_names)
    before = _adequate([each.left_before for each in here], [each.left_before for each in there], names)
    after = before
    if named:
        after = _adequate([each.left_after for each in here], [each.left_after for each in there], names)

    def told(
        sides: Sequence[_Side], of: Sequence[str], first: Sequence[_Own], last: Sequence[_Own]
    ) -> tuple[JudgedRecording, ...]:
        every = zip(sides, of, first, last, strict=True)
        return tuple(side.judged(name, one, two, named) for side, name, one, two in every)

    held_out = told(there, names[1], before.held_out, after.held_out)
    return Judgement(
        before=before.over_all,
        after=after.over_all,
        fitted=told(here, names[0], before.fitted, after.fitted),
        held_out=held_out,
        gain=pooled([each.gain for each in held_out]),
    )


def beside_alone(judgement: Judgement, alone: Sequence[Alone]) -> Judgement:
    """Return the judgement with what the joint model leaves of a fitted recording beyond what that leaves by itself:
    the same noise is in both.
    """
    fitted, reasons = [], list(judgement.after.reasons)
    for each, own in zip(judgement.fitted, alone, strict=True):
        valid = each.problem.valid
        rms = np.sqrt((each.residual_after**2 * valid).sum(axis=1) / np.maximum(valid.sum(axis=1), 1))
        times = rms / np.maximum(own.rms, np.finfo(float).tiny)
        row = int(np.argmax(times))
        if times[row] > LEVEL and not each.good_enough:
            channel = each.problem.channels.names[row]
            more = f"{channel}: {times[row]:.1f} times what is left where this recording is fitted by itself"
            after = replace(each.after, adequate=False, reasons=(*each.after.reasons, more))
            reasons.append(f"{each.name}: {more}")
            each = replace(each, after=after)
        fitted.append(each)
    after = replace(judgement.after, adequate=not reasons, reasons=tuple(reasons))
    return replace(judgement, after=after, fitted=tuple(fitted))


_Own = tuple[Adequacy, Predictable]
"""Whether a model is adequate on one recording, and what of what it leaves there follows from the inputs."""


@dataclass(frozen=True)
class _Side:
    """What both models predict and leave (c, n) of one recording."""

    problem: Problem
    base: FloatArray
    extended: FloatArray
    before: FloatArray
    after: FloatArray
    left_before: Left
    left_after: Left

    def judged(self, name: str, before: _Own, after: _Own, named: bool) -> JudgedRecording:
        signal = self.left_after.predictable.signal
        return JudgedRecording(
            name=name,
            problem=self.problem,
            residual_before=self.before,
            residual_after=self.after,
            before=before[0],
            after=after[0],
            structured_before=before[1],
            structured_after=after[1],
            view=_view(self.problem, self.base, self.extended, self.before, self.after),
            gain=gain(self.problem, self.before, self.after, signal, named),
            good_enough=bool(np.all(self.left_before.good_enough)),
        )


def _sides(
    problem: Problem,
    base: FloatArray,
    extended: FloatArray,
    before: FloatArray,
    after: FloatArray,
    seed: int,
    named: bool,
) -> list[_Side]:
    """Return each recording of a problem, from predictions and residuals (c, n) of all of them."""
    out = []
    for part, (a, b) in zip(problem.parts, pairwise(problem.edges), strict=True):
        shown, told, r_base, r_extended = (
            np.ascontiguousarray(each[:, a:b]) for each in (base, extended, before, after)
        )
        white = whitening(r_extended, part.valid)
        probe = Probe(part, white, told, r_extended, seed)
        left_after = left(part, white, probe, r_extended)
        left_before = left(part, white, probe, r_base) if named else left_after
        out.append(_Side(part, shown, told, r_base, r_extended, left_before, left_after))
    return out


@dataclass(frozen=True)
class _Adequate:
    """Whether a model is adequate over all recordings, and on each of them."""

    over_all: Adequacy
    fitted: list[_Own]
    held_out: list[_Own]


def _adequate(here: Sequence[Left], there: Sequence[Left], names: tuple[Sequence[str], Sequence[str]]) -> _Adequate:
    """Return whether a model is adequate by what it leaves of the recordings fitted and of those held out: what little
    is found on one of them is held against one of the others.
    """
    fitted = [adequacy(each, _beside(there, place)) for place, each in enumerate(here)]
    held_out = []
    for place, each in enumerate(there):
        own, structured = adequacy(each, _beside(here, place))
        more = grown(_beside(here, place), each)
        reasons = (*own.reasons, *((more,) if more else ()))
        held_out.append((replace(own, adequate=not reasons, reasons=reasons), structured))
    several = len(here) > 1 or len(there) > 1
    first = [f"{name}: " if several else "" for name in names[0]]
    last = [f"{name}: " if several else "held out: " for name in names[1]]
    every = [*zip(first, fitted, strict=True), *zip(last, held_out, strict=True)]
    reasons = tuple(f"{name}{each}" for name, (own, _) in every for each in own.reasons)
    doubts = tuple(f"{name}{each}" for name, (own, _) in every for each in own.doubts)
    remarks = tuple(f"{name}{each}" for name, (own, _) in zip(first, fitted, strict=True) for each in own.remarks)
    whole = replace(fitted[0][0], adequate=not reasons, reasons=reasons, doubts=doubts, remarks=remarks)
    return _Adequate(whole, fitted, held_out)


def _beside(others: Sequence[Left], place: int) -> Left:
    """Return the recording on the other side that one is held against: the one of its own place, or the last."""
    return others[min(place, len(others) - 1)]


def _view(problem: Problem, base: FloatArray, extended: FloatArray, before: FloatArray, after: FloatArray) -> View:
    f_hz, first = power_density(before, problem.rate_hz)
    _, second = power_density(after, problem.rate_hz)
    noise = whitening(after, problem.valid).noise_density(f_hz, problem.rate_hz)
    spectrum = Spectrum(f_hz, first, second, noise, coherence(problem, before, f_hz))
    return View(problem.channels, base.T, extended.T, spectrum)


def _unextended(view: View) -> View:
    return replace(view, extended=view.base, spectrum=replace(view.spectrum, after=view.spectrum.before))


def _without_gain(found: Gain) -> Gain:
    nrmse = found.held_out_nrmse_before
    return Gain(nrmse, nrmse, found.noise_floor_nrmse, 0.0)
