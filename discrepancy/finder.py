"""The one call: a simulation held against its recording gives an explanation."""

from dataclasses import replace

import numpy as np

from discrepancy.construct.construction import constructed
from discrepancy.explanation import Explanation
from discrepancy.findings import Alternatives, Findings
from discrepancy.judgement import LEAST_REMOVED, Models, Recordings, judged
from discrepancy.problem import MOST_LOST, Problem
from discrepancy.search.equivalents import better, equivalents
from discrepancy.search.pruning import intervals_of, kept
from discrepancy.search.search import Found, Search
from discrepancy.simulation import Simulation
from discrepancy.verdict import Gain
from messages.errors import UserError

__all__ = ["Explanation", "explain"]

_LEAST_COMPARED = 0.95
"""Of what was measured: where less can be compared, it is told."""
_MOST_EXCHANGED = 2
"""Causes that are exchanged at the end for a rival that fits better: the search itself has offered each to two."""


def explain(fit: Simulation, held_out: Simulation | None, *, seed: int, only: tuple[str, ...] = ()) -> Explanation:
    """Return what `fit` gets wrong, why, and what knowing it gains on `held_out`.

    Without `held_out` the last 30 % of the recording is held out. `seed` draws the bootstrap: equal seeds give equal
    bytes. `only` fits exactly those effects of the library, whether they are needed or not. Raises UserError where a
    name of `only` is not in the library, where two parameters share a key, or where too little can be compared.
    """
    known = [effect.name for effect in fit.effects]
    unknown = [name for name in only if name not in known]
    if unknown:
        raise UserError(f"effect {unknown[0]}: not in the library of {fit.system}, which has {', '.join(known)}")
    recordings = Recordings.of(fit, held_out)
    search = Search(recordings.fit, only or known, seed)
    if only:
        found = search.forced(only)
        models = _all_found(recordings, found)
    else:
        found = search.found()
        models = _kept(recordings, search, found)
    notes: tuple[str, ...] = ()
    if models.causes and recordings.held_out.lost(recordings.held_out.predicted(models.extended.values)) > MOST_LOST:
        names = ", ".join(dict.fromkeys(each.effect for each in models.causes))
        notes = (f"{names}: fits this recording best, but the simulation diverges with it on the one held out",)
        models = models.withdrawn()
    judgement = judged(recordings, models, seed)
    if models.causes and not (only or _holds(judgement.gain)):
        names = ", ".join(dict.fromkeys(each.effect for each in models.causes))
        notes = (f"{names}: fits this recording best, but does not hold on the one held out",)
        models, judgement = models.withdrawn(), judgement.withdrawn()
    elif judgement.good_enough and not only:
        notes = ("the simulation as it is meets the stated tolerance in every channel",)
        models, judgement = models.withdrawn(), judgement.withdrawn()
    if not (models.causes or judgement.after.adequate or judgement.good_enough or only):
        found_more = _constructed(fit, held_out, models, seed, notes)
        if found_more is not None:
            return found_more
    notes += _compared(recordings.fit, "fitted") + _compared(recordings.held_out, "held out")
    alternatives = _alternatives(search, models, rivals=not only)
    quiet = judgement.after.adequate and not models.causes and not only
    smallest = search.smallest(found.chance) if quiet else None
    return Findings(recordings, found, models, judgement, alternatives, smallest, notes, seed).explanation()


def _constructed(
    fit: Simulation, held_out: Simulation | None, models: Models, seed: int, notes: tuple[str, ...]
) -> Explanation | None:
    """Return the explanation by terms made at the simulation's ports, None where none holds elsewhere."""
    made = constructed(fit, held_out, models.base.values, seed)
    if made is None:
        return None
    recordings, causes = made.recordings, made.models.causes
    as_good, rival = made.alike()
    rise = {cause.effect: made.rise(cause) for cause in causes}
    notes += _compared(recordings.fit, "fitted") + _compared(recordings.held_out, "held out")
    found = Alternatives(rise, as_good, rival)
    return Findings(
        recordings, made.found, made.models, made.judgement, found, None, notes, seed, made.made
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


def _compared(problem: Problem, which: str) -> tuple[str, ...]:
    """Return a note where much of what was measured could not be compared."""
    share = float(problem.valid.sum() / max(np.isfinite(problem.channels.values).sum(), 1))
    if share >= _LEAST_COMPARED:
        return ()
    return (
        f"the recording {which}: the simulation gives {100.0 * share:.1f} % of what was measured; only that counts",
    )


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
