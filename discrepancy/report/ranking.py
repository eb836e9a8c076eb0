"""What each candidate leaves, as rows of the report's table: beside the simulation as it is and what was named."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from discrepancy.explanation import Evidence, Explanation
from discrepancy.report.wording import chi2_text, parameters_text, words
from discrepancy.verdict import Verdict
from reports.drawing import AFTER, BEFORE

_EQUIVALENT, _REJECTED = "#7fa6c0", "#b9c0c5"
_SAME = 0.01
"""Of a misfit: where the one cause by itself leaves no more beyond it, all that is named needs no row of its own."""
_THOUSAND = 1000.0


@dataclass(frozen=True)
class Row:
    """One row: `left` in times the noise, `above` the χ² beyond the least, drawn as a bar of `width` percents."""

    status: str
    name: str
    parameters: str
    left: str
    above: str
    width: str
    colour: str
    told: str


@dataclass(frozen=True)
class Ranking:
    """The rows that are shown, first those to compare with, and the `more` that stand behind them."""

    rows: list[Row]
    more: list[Row]


def ranking(explanation: Explanation) -> Ranking:
    """Return all candidates, each effect's strongest ahead of its others."""
    every, misfit = explanation.evidence, explanation.misfit
    least = min((misfit.after, *(one.left for one in every)))
    scale = _Scale(least, max((misfit.before, *(one.left for one in every))), misfit.count)
    best = {one.effect: one for one in reversed(every)}
    rows = [(best[one.effect] is one, _row(one, scale, named=bool(explanation.verdict.causes))) for one in every]
    beside = [_simulated("the simulation as it is", misfit.before, scale, BEFORE)]
    if _differs(explanation.verdict, every, misfit.after):
        beside.append(_simulated("with all that is named", misfit.after, scale, AFTER))
    return Ranking([*beside, *(row for is_best, row in rows if is_best)], [row for is_best, row in rows if not is_best])


def chance_text(every: Sequence[Evidence]) -> str:
    """Return by how much noise alone lowers χ² with the best of all candidates, by their number of parameters."""
    by_count = {len(one.choice): one.threshold for one in every}
    if not by_count:
        return ""
    few, many = min(by_count), max(by_count)
    least = f"{chi2_text(by_count[few])} with {few} parameter{'' if few == 1 else 's'}"
    return least if few == many else f"{least}, {chi2_text(by_count[many])} with {many}"


@dataclass(frozen=True)
class _Scale:
    """The `least` and the `most` χ² of a table, and how many samples of noise they are of."""

    least: float
    most: float
    count: int

    def left(self, chi2: float) -> str:
        times = math.sqrt(max(chi2, 0.0) / max(self.count, 1))
        return f"{times:.0f}" if times >= _THOUSAND else f"{times:.3g}"

    def above(self, chi2: float) -> str:
        return chi2_text(max(chi2 - self.least, 0.0))

    def width(self, chi2: float) -> str:
        reach = math.log10(1.0 + max(self.most - self.least, 0.0))
        return f"{100.0 * math.log10(1.0 + max(chi2 - self.least, 0.0)) / reach:.1f}" if reach > 0.0 else "0.0"


def _differs(verdict: Verdict, every: Sequence[Evidence], after: float) -> bool:
    """Return whether what is named leaves less than the one cause does by itself."""
    if len(verdict.causes) != 1:
        return bool(verdict.causes)
    alone = [one.left for one in every if one.effect == verdict.causes[0].name]
    return not alone or min(alone) > (1.0 + _SAME) * after


def _simulated(name: str, chi2: float, scale: _Scale, colour: str) -> Row:
    return Row("", name, "", scale.left(chi2), scale.above(chi2), scale.width(chi2), colour, "")


def _row(one: Evidence, scale: _Scale, *, named: bool) -> Row:
    about = "" if one.refitted else "≈ "
    told = {"accepted": "named", "equivalent": "alternative", "rejected": "fits worse" if named else "not enough"}
    by_chance = one.status == "rejected" and one.chi2 < one.threshold
    return Row(
        status=one.status,
        name=words(one.effect),
        parameters=parameters_text(one.choice, one.units, one.parameters),
        left=about + scale.left(one.left),
        above=about + scale.above(one.left),
        width=scale.width(one.left),
        colour={"accepted": AFTER, "equivalent": _EQUIVALENT}.get(one.status, _REJECTED),
        told="no better than noise" if by_chance else told[one.status],
    )
