"""The one call: a simulation held against its recording, or several against theirs, gives an explanation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.construct.construction import Construction, constructed, ported
from discrepancy.explanation import Explanation
from discrepancy.findings import Alternatives, Findings
from discrepancy.judgement import LEAST_REMOVED, Judgement, Models, beside_alone, judged
from discrepancy.problem import MOST_LOST, Problem
from discrepancy.recordings import Recordings
from discrepancy.search.agreement import Alone, each_alone
from discrepancy.search.carried import carried
from discrepancy.search.equivalents import better, equivalents
from discrepancy.search.pruning import intervals_of, kept
from discrepancy.search.search import Found, Search
from discrepancy.simulation import Simulation
from discrepancy.together import Together, little_explained, together
from discrepancy.verdict import Gain
from messages.errors import UserError

__all__ = ["Explanation", "explain"]

_LEAST_COMPARED = 0.95
"""Of what was measured: where less can be compared, it is told."""
_BEYOND = 0.1
"""Of what an input spans where it is fitted: what lies further out is not known."""
_MOST_EXCHANGED = 2
"""Causes that are exchanged at the end for a rival that fits better: the search itself has offered each to two."""


Simulations = Simulation | Sequence[Simulation]
"""One system held against one recording, or against several."""


def explain(
    fit: Simulations,
    held_out: Simulations | None,
    *,
    seed: int,
    only: tuple[str, ...] = (),
    names: Sequence[str] = (),
) -> Explanation:
    """Return what `fit` gets wrong, why, and what knowing it gains on `held_out`.

    Several recordings of one system, of any rates and lengths, are fitted jointly: with one set of parameters, but for
    those that belong to each recording (`Parameter.per_recording`), each under its own noise; each is also judged by
    itself, and where they disagree it is told. `names` are those of all recordings, fitted ones first, for that.
    Without `held_out` the last 30 % of each recording is held out. `seed` draws the bootstrap: equal seeds give equal
    bytes. `only` fits exactly those effects of the library, whether they are needed or not. Raises UserError where a
    name of `only` is not in the library, where two parameters share a key, where too little can be compared, or where
    the recordings are not of one system.
    """
    every = _Given.of(fit, held_out, names)
    first = every.fit[0]
    known = [effect.name for effect in first.effects]
    unknown = [name for name in only if name not in known]
    if unknown:
        raise UserError(f"effect {unknown[0]}: not in the library of {first.system}, which has {', '.join(known)}")
    recordings = every.recordings()
    search = Search(recordings.fit, only or known, seed)
    if only:
        found = search.forced(only)
        return _explained(_judged(recordings, found, _all_found(recordings, found), seed), search, rivals=False)
    found = search.found()
    told = _believed(_judged(recordings, found, _kept(recordings, search, found), seed))
    if told.judgement.after.adequate or told.judgement.good_enough:
        return _explained(told, search)
    left = told.judgement.gain.held_out_nrmse_after if told.models.causes else None
    made = constructed(every.fit, every.held_out, every.names, found.base.values, seed, left)
    if made is not None and made.outdoes(left or 0.0):
        return _constructed(made, seed, told.notes)
    more: Together | None = None
    if ported(first) is not None and little_explained(recordings.fit, told.models):
        more = together(recordings, search, found, told.models, known, seed)
    if made is not None and not (more is not None and more.likelier(made.models.extended)):
        return _constructed(made, seed, told.notes)
    if more is not None and more.likelier(told.models.extended):
        told = _Told.of(recordings, more.found, more.models, more.judgement, seed)
        return _explained(told, search, more.alternatives())
    return _explained(told, search)


@dataclass(frozen=True)
class _Told:
    """What a search of the library `found`, as models and their judgement; what each of several recordings tells
    `alone`, and `notes` on what was withdrawn.
    """

    recordings: Recordings
    found: Found
    models: Models
    judgement: Judgement
    alone: Sequence[Alone]
    seed: int
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        recordings: Recordings,
        found: Found,
        models: Models,
        judgement: Judgement,
        seed: int,
    ) -> "_Told":
        """Return it with what each recording tells alone, and judged beside that."""
        alone = _alone(recordings, models)
        return cls(recordings, found, models, beside_alone(judgement, alone) if alone else judgement, alone, seed)

    def withdrawn(self, note: str) -> "_Told":
        """Return it without its causes, and with a note why."""
        return replace(self, models=self.models.withdrawn(), judgement=self.judgement.withdrawn(), notes=(note,))


def _judged(recordings: Recordings, found: Found, models: Models, seed: int) -> _Told:
    """Return what was found, judged; without its causes where the simulation diverges with them."""
    diverges = bool(models.causes) and _diverges(recordings.held_out, models)
    kept = models.withdrawn() if diverges else models
    told = _Told.of(recordings, found, kept, judged(recordings, kept, seed), seed)
    if not diverges:
        return told
    note = f"{_fits_best(recordings, models)}, but the simulation diverges with it on the one held out"
    return replace(told, notes=(note,))


def _believed(told: _Told) -> _Told:
    """Return what was told without causes that do not hold, or that nobody needs."""
    if told.models.causes and not _holds(told.judgement.gain):
        best = _fits_best(told.recordings, told.models)
        return told.withdrawn(f"{best}, but does not hold on {_failing(told.judgement)}")
    if told.judgement.good_enough:
        return told.withdrawn("the simulation as it is meets the stated tolerance in every channel")
    return told


def _fits_best(recordings: Recordings, models: Models) -> str:
    """Return the beginning of a note on causes that are withdrawn."""
    causes = ", ".join(dict.fromkeys(each.effect for each in models.causes))
    return f"{causes}: fits {'this recording' if len(recordings.fit.parts) == 1 else 'the recordings'} best"


def _explained(
    told: _Told, search: Search, alternatives: Alternatives | None = None, *, rivals: bool = True
) -> Explanation:
    """Return the explanation by the library's effects; `rivals` asks for what fits as well, and for what would be too
    small to be seen.
    """
    recordings, models = told.recordings, told.models
    alternatives = alternatives or _alternatives(search, models, rivals=rivals)
    quiet = told.judgement.after.adequate and not models.causes and rivals
    smallest = search.smallest(told.found.chance) if quiet else None
    notes = (*told.notes, *_compared(recordings), *_beyond(recordings))
    return Findings(
        recordings, told.found, models, told.judgement, alternatives, smallest, notes, told.seed, alone=told.alone
    ).explanation()


@dataclass(frozen=True)
class _Given:
    """What is to be explained: the simulations that are fitted and held out, and all their names."""

    fit: tuple[Simulation, ...]
    held_out: tuple[Simulation, ...]
    names: tuple[str, ...]

    @classmethod
    def of(cls, fit: Simulations, held_out: Simulations | None, names: Sequence[str]) -> "_Given":
        first = tuple(fit) if isinstance(fit, Sequence) else (fit,)
        rest = () if held_out is None else tuple(held_out) if isinstance(held_out, Sequence) else (held_out,)
        if not first:
            raise UserError("no recording to fit; expected one or more")
        if names and len(names) != len(first) + len(rest):
            raise UserError(f"{len(names)} names; expected one for each of {len(first) + len(rest)} recordings")
        return cls(first, rest, tuple(names))

    def recordings(self) -> Recordings:
        return Recordings.of(self.fit, self.held_out, self.names)


def _alone(recordings: Recordings, models: Models) -> Sequence[Alone]:
    """Return what each of several fitted recordings tells by itself."""
    return each_alone(recordings.fit, models.extended) if len(recordings.fit.parts) > 1 else ()


def _diverges(other: Problem, models: Models) -> bool:
    """Return whether the extended model cannot simulate what was held out."""
    return other.lost(other.predicted(carried(other, models.extended.values))) > MOST_LOST


def _failing(judgement: Judgement) -> str:
    """Return in words the recordings held out on which the extension does not remove enough."""
    if len(judgement.held_out) == 1:
        return "the one held out"
    return "those held out: " + ", ".join(each.name for each in judgement.held_out if not _holds(each.gain))


def _constructed(made: Construction, seed: int, notes: tuple[str, ...]) -> Explanation:
    """Return the explanation by terms made at the simulation's ports."""
    recordings, causes = made.recordings, made.models.causes
    as_good, rival = made.alike()
    rise = {cause.effect: made.rise(cause) for cause in causes}
    notes += (*_compared(recordings), *_beyond(recordings))
    found = Alternatives(rise, as_good, rival)
    alone = _alone(recordings, made.models)
    judgement = beside_alone(made.judgement, alone) if alone else made.judgement
    return Findings(
        recordings, made.found, made.models, judgement, found, None, notes, seed, made.made, alone
    ).explanation()


def _all_found(recordings: Recordings, found: Found) -> Models:
    """Return the base model and its extension by all causes found."""
    problem = recordings.fit
    return Models(
        found.base, intervals_of(problem, found.base), found.best, intervals_of(problem, found.best), found.causes
    )


def _kept(recordings: Recordings, search: Search, found: Found) -> Models:
    """Return the base model and its extension by those causes that stand on something."""
    problem = recordings.fit
    best, causes, intervals = kept(problem, recordings.held_out, search, found)
    for _ in range(_MOST_EXCHANGED if causes else 0):
        exchanged = better(search, best, causes)
        if exchanged is None:
            break
        fit, proposed = exchanged
        again = kept(problem, recordings.held_out, search, replace(found, best=fit, causes=proposed))
        if len(again[1]) < len(causes):
            break
        best, causes, intervals = again
    return Models(found.base, intervals_of(problem, found.base), best, intervals, causes)


def _compared(recordings: Recordings) -> tuple[str, ...]:
    """Return a note for each recording of which much could not be compared."""
    out = []
    sides = (
        (recordings.fit, recordings.fitted_names, "fitted"),
        (recordings.held_out, recordings.held_out_names, "held out"),
    )
    for problem, names, which in sides:
        for part, name in zip(problem.parts, names, strict=True):
            share = float(part.valid.sum() / max(np.isfinite(part.measured).sum(), 1))
            told = f"the recording {which}" if len(problem.parts) == 1 else name
            if share < _LEAST_COMPARED:
                out.append(f"{told}: the simulation gives {100.0 * share:.1f} % of what was measured; only that counts")
    return tuple(out)


def _beyond(recordings: Recordings) -> tuple[str, ...]:
    """Return a note for each input of a model with ports that reaches further where it is held out than where it is
    fitted.
    """
    out = []
    fitted = np.concatenate([part.channels.inputs for part in recordings.fit.parts])
    for part, name in zip(recordings.held_out.parts, recordings.held_out_names, strict=True):
        if ported(part.simulation) is None:
            continue
        told = name if len(recordings.held_out.parts) > 1 else "the recording held out"
        for channel, known, judged_on in zip(part.channels.input_names, fitted.T, part.channels.inputs.T, strict=True):
            low, high = float(known.min()), float(known.max())
            margin = _BEYOND * (high - low)
            share = float(np.mean((judged_on < low - margin) | (judged_on > high + margin)))
            if share > 0.0:
                out.append(
                    f"{told}: {channel}: {100.0 * share:.2g} % of the samples lie beyond what was fitted, {low:.3g} to "
                    f"{high:.3g}: nothing fitted tells what holds there"
                )
    return tuple(out)


def _holds(gain: Gain) -> bool:
    """Return whether the extension, frozen, removes enough on the recording held out."""
    removed = gain.share_of_excess_removed
    return removed is not None and removed >= LEAST_REMOVED


def _alternatives(search: Search, models: Models, *, rivals: bool) -> Alternatives:
    """Return what the fit loses without each cause and, if asked, with `rivals` in its place."""
    as_good, rival = equivalents(search, models.extended, models.causes) if rivals and models.causes else ({}, {})
    best = search.rated(models.extended)
    rise: dict[str, float] = {}
    for cause in models.causes:
        if cause.effect not in rise:
            rise[cause.effect] = search.without(best, cause).chi2 - best.chi2
    return Alternatives(rise, as_good, rival)
