"""All that was decided about a recording, put into the words and numbers of an explanation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite

import numpy as np

from discrepancy.construct.formula import told
from discrepancy.construct.terms import MadeTerm
from discrepancy.evidence.gain import told as told_gain
from discrepancy.evidence.signature import nothing_left
from discrepancy.explanation import Evidence, Explanation, Misfit, Status
from discrepancy.judgement import JudgedRecording, Judgement, Models
from discrepancy.problem import Problem
from discrepancy.recordings import Recordings
from discrepancy.report.wording import key_text, quantity_text
from discrepancy.search.agreement import Alone, disagreements
from discrepancy.search.fit import Fit, Intervals
from discrepancy.search.scores import PENALTY, probability, threshold
from discrepancy.search.search import Found
from discrepancy.search.smallest import Smallest
from discrepancy.verdict import Cause, Kind, Quantity, RecordingTold, Remainder, Verdict, number, quantity


@dataclass(frozen=True)
class Alternatives:
    """By how much χ² rises, by cause: without it, with each effect in its place that fits `as_good`, and with the best
    `rival` that does not, where one came near.
    """

    rise: dict[str, float]
    as_good: dict[str, dict[str, float]]
    rival: dict[str, float]


@dataclass(frozen=True)
class Findings:
    """One recording or several explained: what the search found, the models kept, how they were judged, and what could
    stand in.

    `smallest` tells what would have been seen, where nothing was. `notes` are for a person, `seed` drew the
    bootstrap. `made` are the terms, by name, that were made for want of a library's effect. `alone` is what each of
    several fitted recordings tells by itself.
    """

    recordings: Recordings
    found: Found
    models: Models
    judgement: Judgement
    alternatives: Alternatives
    smallest: Smallest | None
    notes: tuple[str, ...]
    seed: int
    made: Mapping[str, MadeTerm] = field(default_factory=dict)
    alone: Sequence[Alone] = ()

    def explanation(self) -> Explanation:
        """Return the explanation."""
        problem, models, judgement = self.recordings.fit, self.models, self.judgement
        causes = self._causes()
        return Explanation(
            verdict=self._verdict(causes),
            fit=judgement.fitted[0].view,
            held_out=_shown(judgement).view,
            held_out_name=_shown(judgement).name if judgement.several else "",
            held_out_is_own=self.recordings.held_out_is_own,
            evidence=_evidence(problem, self.found, causes),
            misfit=_misfit(self.found, models),
            before=judgement.before,
            after=judgement.after,
            values_before=dict(problem.completed(models.base.values)),
            values_after=dict(problem.completed(models.extended.values)),
            quantities_after=_quantities(problem, models.extended, models.extended_intervals, models.extended.keys),
            causes=tuple(problem.effects[cause.name] for cause in causes),
            rivals={name: problem.effects[name] for cause in causes for name in cause.equivalents},
            notes=(*self.notes, *judgement.after.remarks),
            seed=self.seed,
        )

    def _verdict(self, causes: list[Cause]) -> Verdict:
        problem, models, judgement = self.recordings.fit, self.models, self.judgement
        present = not judgement.after.adequate
        noise = problem.noise
        return Verdict(
            system=problem.simulation.system,
            verdict=self._kind(causes, present),
            causes=causes,
            remainder=self._remainder() if present else Remainder(False, 0.0, nothing_left()),
            gain=told_gain(self.recordings.held_out, judgement.gain),
            parameters_before=_quantities(problem, models.base, models.base_intervals, problem.base),
            parameters_after=_quantities(problem, models.extended, models.extended_intervals, problem.base),
            next_experiment=self._next_experiment(causes),
            noise_from=None if noise is None else noise.source,
            seen_above=self._seen_above(),
            notes=[*self.notes, *judgement.after.remarks],
            recordings=self._recordings() if judgement.several else [],
            disagreements=self._disagreements(),
            constructed=[told(self.made[cause.name], cause.parameters) for cause in causes if cause.name in self.made],
        )

    def _kind(self, causes: Sequence[Cause], present: bool) -> Kind:
        if causes:
            return "constructed" if any(cause.name in self.made for cause in causes) else "named"
        return "unknown" if present else "cannot_tell" if self._doubts() else "nothing"

    def _doubts(self) -> list[str]:
        """Return in words why a recording in which nothing was found does not tell that nothing is there."""
        if self.judgement.good_enough:
            return []
        doubts = list(self.judgement.after.doubts)
        if self.smallest is not None and not self.smallest.telling:
            doubts.append(
                f"{100.0 * self.smallest.unseen:.0f} % of the effects could be there unseen, however large, beside the "
                "noise as it looks"
            )
        return doubts

    def _seen_above(self) -> dict[str, Quantity]:
        """Return from which size on each parameter would have been seen."""
        if self.smallest is None:
            return {}
        parameters = self.recordings.fit.parameters
        return {
            key: Quantity(number(size), None, None, parameters[key].unit) for key, size in self.smallest.sizes.items()
        }

    def _remainder(self) -> Remainder:
        """Return what the extended model still misses."""
        removed = told_gain(self.recordings.held_out, self.judgement.gain).share_of_excess_removed
        most = max(
            self.judgement.fitted, key=lambda each: (not each.after.adequate, float(each.structured_after.share.max()))
        )
        return Remainder(True, _share_left(removed), most.signature())

    def _recordings(self) -> list[RecordingTold]:
        """Return what each recording says by itself."""
        out = []
        for held_out, every in ((False, self.judgement.fitted), (True, self.judgement.held_out)):
            for place, each in enumerate(every):
                found = told_gain(each.problem, each.gain)
                removed, missing = found.share_of_excess_removed, not each.after.adequate
                remainder = Remainder(False, 0.0, nothing_left())
                if missing:
                    remainder = Remainder(True, _share_left(removed), each.signature())
                told_alone = self.alone[place] if self.alone and not held_out else None
                out.append(
                    RecordingTold(
                        name=each.name,
                        held_out=held_out,
                        nrmse_before=found.held_out_nrmse_before,
                        nrmse_after=found.held_out_nrmse_after,
                        noise_floor_nrmse=found.noise_floor_nrmse,
                        share_of_excess_removed=removed,
                        remainder=remainder,
                        parameters={} if told_alone is None else self._told_alone(told_alone),
                    )
                )
        return out

    def _told_alone(self, alone: Alone) -> dict[str, Quantity]:
        parameters = self.recordings.fit.parameters
        return {
            key: quantity(value, 0.0, parameters[key].unit, alone.bounds[key]) for key, value in alone.values.items()
        }

    def _disagreements(self) -> list[str]:
        """Return in sentences on what the recordings that were fitted disagree."""
        out = []
        for each in disagreements(self.recordings.fit, self.alone) if self.alone else []:
            sides = []
            for place in (each.first, each.second):
                value, interval, unit = quantity_text(self._told_alone(self.alone[place])[each.key])
                sides.append(f"{value} ({interval}) {unit}".rstrip() + f" in {self.recordings.fitted_names[place]}")
            out.append(f"{key_text(each.key)} is {', but '.join(sides)}")
        return out

    def _causes(self) -> list[Cause]:
        """Return the causes, the one first whose loss raises χ² most."""
        problem, models, alternatives = self.recordings.fit, self.models, self.alternatives
        chance = self.found.chance
        out = []
        for name, rise in alternatives.rise.items():
            keys = [key for key in models.extended.keys if key.split(".")[0] == name]
            quantities = _quantities(problem, models.extended, models.extended_intervals, keys)
            as_good = alternatives.as_good.get(name, {})
            evidence = {
                "chi2": number(rise),
                "parameters": float(len(keys)),
                "threshold": number(threshold(chance) + PENALTY * len(keys)),
                "chance": number(probability(chance, rise - PENALTY * len(keys))),
                "rival_chi2": number(alternatives.rival.get(name, float("nan"))),
                **{f"worse_by.{each}": number(worse) for each, worse in as_good.items()},
            }
            short = {key.split(".", 1)[1]: value for key, value in quantities.items()}
            out.append((rise, Cause(name, short, evidence, list(as_good))))
        return [cause for _, cause in sorted(out, key=lambda each: -each[0])]

    def _next_experiment(self, causes: Sequence[Cause]) -> str | None:
        """Return what to measure next: what separates the look-alikes, or what would show the unknown cause."""
        for cause in causes:
            if cause.equivalents:
                return self.recordings.fit.effects[cause.name].experiment
        if apart := self._disagreements():
            return f"Find out what was different when these were recorded, and record both again: {'; '.join(apart)}."
        if not self.judgement.after.adequate:
            where = "; ".join(self.judgement.after.reasons)
            return f"Repeat with one input moving at a time, at half and at twice the amplitude: {where}."
        if causes or not self._doubts():
            return None
        why = "; ".join(self._doubts())
        if self.smallest is not None and not self.smallest.telling:
            times = self.smallest.short
            strong = f"{times:.1f} times as strong" if isfinite(times) else "strong enough to move every channel"
            longer = f", or for {times**2:.0f} times as long" if isfinite(times) else ""
            return f"Record again with inputs {strong}{longer}: {why}."
        return (
            "Record the same inputs twice: what differs between the two is noise, and what is the same in both and not "
            f"simulated is missing: {why}."
        )


def _quantities(problem: Problem, fit: Fit, found: Intervals, keys: Sequence[str]) -> dict[str, Quantity]:
    out = {}
    for key in keys:
        low, high = found.of(key)
        out[key] = Quantity(number(fit.values[key]), number(low), number(high), problem.parameters[key].unit)
    return out


def _shown(judgement: Judgement) -> JudgedRecording:
    """Return the held-out recording that a report draws: the one with the largest error left."""
    return max(judgement.held_out, key=lambda each: each.gain.held_out_nrmse_after or 0.0)


def _share_left(removed: float | None) -> float | None:
    return 1.0 - min(max(removed, 0.0), 1.0) if removed is not None else None


def _misfit(found: Found, models: Models) -> Misfit:
    before, after = (float(np.sum(found.white(each.residual) ** 2)) for each in (found.base, models.extended))
    return Misfit(before, after, found.white.count)


def _evidence(problem: Problem, found: Found, causes: Sequence[Cause]) -> tuple[Evidence, ...]:
    names = [cause.name for cause in causes]
    same = {name for cause in causes for name in cause.equivalents}
    least = threshold(found.chance)
    base = float(np.sum(found.white(found.base.residual) ** 2))
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
                units=tuple(problem.parameters[key].unit for key in each.keys),
                left=single.left(found.white, base),
            )
        )
    return tuple(out)
