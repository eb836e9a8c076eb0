"""The one call: a simulation held against its recording gives an explanation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.evidence.adequacy import Predictable, Probe, adequacy
from discrepancy.evidence.gain import gain
from discrepancy.evidence.signature import coherence, nothing_left, power_density, signature
from discrepancy.evidence.whitening import whitening
from discrepancy.explanation import Adequacy, Evidence, Explanation, Spectrum, Status, View
from discrepancy.problem import Part, Problem
from discrepancy.search.candidates import Candidate
from discrepancy.search.equivalents import equivalents
from discrepancy.search.fit import Fit, Intervals
from discrepancy.search.pruning import intervals_of, kept
from discrepancy.search.scores import PENALTY, probability, threshold
from discrepancy.search.search import Found, Search
from discrepancy.simulation import Simulation
from discrepancy.verdict import Cause, Gain, Quantity, Remainder, Verdict, number
from messages.arrays import FloatArray
from messages.errors import UserError

__all__ = ["Explanation", "explain"]

_FIT_SHARE = 0.7
_LEAST_REMOVED = 0.5


def explain(fit: Simulation, held_out: Simulation | None, *, seed: int, only: tuple[str, ...] = ()) -> Explanation:
    """Return what `fit` gets wrong, why, and what knowing it gains on `held_out`.

    Without `held_out` the last 30 % of the recording is held out. `seed` draws the bootstrap: equal seeds give equal
    bytes. `only` fits exactly those effects of the library, whether they are needed or not. Raises UserError where a
    name of `only` is not in the library, or where too little can be compared.
    """
    known = [effect.name for effect in fit.effects]
    unknown = [name for name in only if name not in known]
    if unknown:
        raise UserError(f"effect {unknown[0]}: not in the library of {fit.system}, which has {', '.join(known)}")
    if held_out is None:
        n = len(fit.channels.t_s)
        held: Simulation = Part(fit, round(_FIT_SHARE * n), n)
        trained: Simulation = Part(fit, 0, round(_FIT_SHARE * n))
    else:
        trained, held = fit, held_out
    problem, other = Problem(trained), Problem(held)
    search = Search(problem, only or known, seed)
    found = search.forced(only) if only else search.found()
    best, causes, interval = (
        (found.best, found.causes, intervals_of(problem, found.best)) if only else kept(problem, other, search, found)
    )
    told = _Told(found.base, best, causes, intervals_of(problem, found.base), interval)
    before, after, views = _judged(problem, other, told, seed)
    return _explained(problem, search, found, told, before, after, views, held_out is not None, seed, forced=bool(only))


@dataclass(frozen=True)
class _Told:
    """The set that is kept, with the intervals of all that was fitted, and those of the base model alone."""

    base: Fit
    best: Fit
    causes: tuple[Candidate, ...]
    intervals_before: Intervals
    intervals: Intervals


@dataclass(frozen=True)
class _Views:
    """Both recordings, and what of each residual follows from the inputs: of the base model's, of the extension's."""

    fit: View
    held_out: View
    structured_before: Predictable
    structured_after: Predictable
    gain: Gain


def _judged(problem: Problem, other: Problem, told: _Told, seed: int) -> tuple[Adequacy, Adequacy, _Views]:
    """Return adequacy before and after, and both recordings as a report shows them."""
    base, extended = other.predicted(told.base.values), other.predicted(told.best.values)
    other.narrow(np.isfinite(base) & np.isfinite(extended))
    r_base, r_extended = other.difference(base), other.difference(extended)
    probe_held = Probe(other, whitening(r_extended, other.valid), base, seed)
    left_held = probe_held.predictable(r_extended)
    base_held = probe_held.predictable(r_base) if told.causes else left_held

    white = whitening(told.best.residual, problem.valid)
    predicted = problem.predicted(told.base.values)
    probe = Probe(problem, white, predicted, seed)
    before, structured = adequacy(problem, white, probe, told.base.residual, base_held.chance)
    after, left = before, structured
    if told.causes:
        after, left = adequacy(problem, white, probe, told.best.residual, left_held.chance)
    views = _Views(
        fit=_view(problem, predicted, problem.predicted(told.best.values), told.base.residual, told.best.residual),
        held_out=_view(other, base, extended, r_base, r_extended),
        structured_before=structured,
        structured_after=left,
        gain=gain(other, r_base, r_extended, left_held.signal, bool(told.causes)),
    )
    return before, after, views


def _view(problem: Problem, base: FloatArray, extended: FloatArray, before: FloatArray, after: FloatArray) -> View:
    f_hz, first = power_density(before, problem.rate_hz)
    _, second = power_density(after, problem.rate_hz)
    noise = whitening(after, problem.valid).noise_density(f_hz, problem.rate_hz)
    spectrum = Spectrum(f_hz, first, second, noise, coherence(problem, before, f_hz))
    return View(problem.channels, base.T, extended.T, spectrum)


def _explained(
    problem: Problem,
    search: Search,
    found: Found,
    told: _Told,
    before: Adequacy,
    after: Adequacy,
    views: _Views,
    own: bool,
    seed: int,
    *,
    forced: bool,
) -> Explanation:
    """Return the explanation, in which causes that fail on held-out data are not named."""
    removed = views.gain.share_of_excess_removed
    named = bool(told.causes) and (forced or (removed is not None and removed >= _LEAST_REMOVED))
    notes = []
    same: dict[str, dict[str, float]] = {}
    rival: dict[str, float] = {}
    if named:
        same, rival = equivalents(search, told.best, told.causes) if not forced else ({}, {})
    elif told.causes:
        names = ", ".join(dict.fromkeys(each.effect for each in told.causes))
        notes.append(f"{names}: fits this recording best, but does not hold on the one held out")
        told = replace(told, best=told.base, causes=(), intervals=told.intervals_before)
        after = before
        views = replace(
            views,
            structured_after=views.structured_before,
            fit=_unextended(views.fit),
            held_out=_unextended(views.held_out),
            gain=_no_gain(views.gain),
        )
    causes = _causes(problem, search, found, told, same, rival)
    present = not after.adequate
    share = views.gain.share_of_excess_removed
    verdict = Verdict(
        system=problem.simulation.system,
        verdict="named" if causes else "unknown" if present else "nothing",
        causes=causes,
        remainder=Remainder(
            present,
            (1.0 - min(max(share, 0.0), 1.0) if share is not None else None) if present else 0.0,
            signature(problem, whitening(told.best.residual, problem.valid), views.structured_after.signal)
            if present
            else nothing_left(),
        ),
        gain=views.gain,
        parameters_before=_quantities(problem, told.base, told.intervals_before, problem.base),
        parameters_after=_quantities(problem, told.best, told.intervals, problem.base),
        next_experiment=_next_experiment(problem, causes, present, after),
    )
    rivals = {name: problem.effects[name] for cause in causes for name in cause.equivalents}
    return Explanation(
        verdict=verdict,
        fit=views.fit,
        held_out=views.held_out,
        held_out_is_own=own,
        evidence=_evidence(found, causes),
        before=before,
        after=after,
        values_before=dict(problem.completed(told.base.values)),
        values_after=dict(problem.completed(told.best.values)),
        quantities_after=_quantities(problem, told.best, told.intervals, told.best.keys),
        causes=tuple(problem.effects[cause.name] for cause in causes),
        rivals=rivals,
        notes=tuple(notes),
        seed=seed,
    )


def _causes(
    problem: Problem,
    search: Search,
    found: Found,
    told: _Told,
    same: dict[str, dict[str, float]],
    rival: dict[str, float],
) -> list[Cause]:
    """Return the causes, the one first whose loss raises χ² most."""
    best = search.rated(told.best)
    out = []
    for name in dict.fromkeys(each.effect for each in told.causes):
        cause = next(each for each in told.causes if each.effect == name)
        keys = [key for key in best.keys if key.split(".")[0] == name]
        rise = search.without(best, cause).chi2 - best.chi2
        quantities = _quantities(problem, best, told.intervals, keys)
        evidence = {
            "chi2": number(rise),
            "parameters": float(len(keys)),
            "threshold": number(threshold(found.chance) + PENALTY * len(keys)),
            "chance": number(probability(found.chance, rise - PENALTY * len(keys))),
            "rival_chi2": number(rival.get(name, float("nan"))),
            **{f"worse_by.{each}": number(worse) for each, worse in same.get(name, {}).items()},
        }
        short = {key.split(".", 1)[1]: value for key, value in quantities.items()}
        out.append((rise, Cause(name, short, evidence, list(same.get(name, {})))))
    return [cause for _, cause in sorted(out, key=lambda each: -each[0])]


def _quantities(problem: Problem, fit: Fit, found: Intervals, keys: Sequence[str]) -> dict[str, Quantity]:
    out = {}
    for key in keys:
        low, high = found.of(key)
        out[key] = Quantity(number(fit.values[key]), number(low), number(high), problem.parameters[key].unit)
    return out


def _evidence(found: Found, causes: Sequence[Cause]) -> tuple[Evidence, ...]:
    names = [cause.name for cause in causes]
    same = {name for cause in causes for name in cause.equivalents}
    least = threshold(found.chance)
    out = []
    for single in found.singles:
        each = single.candidate
        price = PENALTY * len(each.keys)
        status: Status = "accepted" if each.effect in names else "equivalent" if each.effect in same else "rejected"
        values = single.fit.values if single.fit is not None else each.start
        out.append(
            Evidence(
                effect=each.effect,
                choice=each.choice,
                chi2=single.drop,
                threshold=least + price,
                chance=probability(found.chance, single.drop - price),
                refitted=single.fit is not None,
                status=status,
                parameters={
                    name: values[key] for name, key in zip(each.choice, each.keys, strict=True) if key in values
                },
            )
        )
    return tuple(out)


def _next_experiment(problem: Problem, causes: Sequence[Cause], present: bool, after: Adequacy) -> str | None:
    """Return what to measure next: what separates the look-alikes, or what would show the unknown cause."""
    for cause in causes:
        if cause.equivalents:
            return problem.effects[cause.name].experiment
    if present:
        where = "; ".join(after.reasons)
        return f"Repeat with one input moving at a time, at half and at twice the amplitude: {where}."
    return None


def _unextended(view: View) -> View:
    return replace(view, extended=view.base, spectrum=replace(view.spectrum, after=view.spectrum.before))


def _no_gain(found: Gain) -> Gain:
    return Gain(found.held_out_nrmse_before, found.held_out_nrmse_before, found.noise_floor_nrmse, 0.0)
