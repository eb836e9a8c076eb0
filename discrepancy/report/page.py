"""The report: one page by itself, for who treats people and for who does research.

What it says stands in `report.html`; here are the facts that the template is given, as text.
"""

import math
from collections.abc import Sequence
from pathlib import Path

from discrepancy.explanation import Adequacy, Explanation
from discrepancy.report.figures import compared_drawn, residuals_drawn, shown_channels, spectra_drawn
from discrepancy.report.ranking import chance_text, ranking
from discrepancy.report.wording import (
    NOT_TOLD,
    channel_name,
    chi2_text,
    headline,
    key_text,
    listed,
    parameter_words,
    quantity_text,
    recording_row,
    seen_text,
    share_text,
    where_text,
    words,
)
from discrepancy.simulation import Effect
from discrepancy.verdict import Cause, Quantity, Verdict
from reports.drawing import AFTER, BEFORE, FLOOR, INK
from reports.page import rendered

_TEMPLATE = Path(__file__).with_name("report.html")
_BEFORE = "Before"


def page(explanation: Explanation, files: Sequence[Path] = ()) -> str:
    """Return the page as HTML, made of the recordings `files`; draws with matplotlib."""
    verdict, view = explanation.verdict, explanation.held_out
    effects = {effect.name: effect for effect in explanation.causes}
    formulas = {term.name: term.formula for term in verdict.constructed}
    ranked = ranking(explanation)
    named = bool(verdict.causes)
    remains = verdict.remainder.present and verdict.causes
    return rendered(
        _TEMPLATE,
        f"What the simulation of {words(verdict.system)} gets wrong",
        files,
        {"share": share_text},
        headline=headline(verdict),
        first=explanation.causes[0].explanation if explanation.causes else _signature_text(explanation),
        verdict=verdict,
        gain=verdict.gain,
        seen=seen_text(verdict),
        held_out_is_own=explanation.held_out_is_own,
        causes=[
            _cause(cause, effects[cause.name], explanation.rivals, formulas.get(cause.name, ""))
            for cause in verdict.causes
        ],
        missing=where_text(verdict.remainder.signature) if remains else "",
        recordings=[recording_row(each, removed=True) for each in verdict.recordings],
        alone=_alone(verdict),
        held_out_name=explanation.held_out_name,
        left_out=len(view.channels.names) - len(shown_channels(view)),
        keys=((BEFORE, "before"), *(((AFTER, "after"),) if named else ()), (FLOOR, "noise")),
        sides=((INK, "measured"), (BEFORE, "simulated"), *(((AFTER, "extended simulation"),) if named else ())),
        compared=compared_drawn(view, named=named),
        residuals=residuals_drawn(view, named=named),
        spectra=spectra_drawn(view, named=named),
        evidence=ranked.rows if explanation.evidence else [],
        more_evidence=ranked.more,
        chance=chance_text(explanation.evidence),
        adequacy=[
            (when, "; ".join(one.reasons) or _no_reason(when, named))
            for when, one in ((_BEFORE, explanation.before), ("After", explanation.after))
        ],
        channels=[
            (
                channel_name(name)[0],
                *_adequacy_cells(explanation.before, place),
                *_adequacy_cells(explanation.after, place),
            )
            for place, name in enumerate(explanation.fit.channels.names)
        ],
        own=[
            _own(_key(verdict, name), quantity, verdict.parameters_after.get(name, quantity))
            for name, quantity in verdict.parameters_before.items()
        ],
        notes=explanation.notes,
        seed=explanation.seed,
    )


def _no_reason(when: str, named: bool) -> str:
    """Return what is said of a model that nothing is held against."""
    if named and when == _BEFORE:
        return "by itself what is left could pass for slow noise; that a cause explains it is what speaks against that"
    return "what is left is noise"


def _signature_text(explanation: Explanation) -> str:
    if explanation.verdict.verdict == "nothing":
        return "No effect of the library is needed, and what is left does not follow from the inputs: it is noise."
    if explanation.verdict.verdict == "cannot_tell":
        return "Nothing was found, but this recording would not show what it is looked at for. What would: see below."
    return f"What is not explained shows {where_text(explanation.verdict.remainder.signature)}."


def _cause(cause: Cause, effect: Effect, rivals: dict[str, Effect], formula: str) -> dict[str, object]:
    evidence = cause.evidence
    told = [f"without it the misfit χ² rises by {chi2_text(evidence.get('chi2'))}"]
    if evidence.get("threshold") is not None:
        told.append(f"noise alone would make up to {chi2_text(evidence['threshold'])}")
    if evidence.get("rival_chi2") is not None:
        told.append(f"the best other candidate in its place fits worse by {chi2_text(evidence['rival_chi2'])}")
    return {
        "name": words(cause.name),
        "formula": formula,
        "effect": effect,
        "quantities": [(parameter_words(name), *quantity_text(found)) for name, found in cause.parameters.items()],
        "alike": listed([words(name) for name in cause.equivalents], "or") if cause.equivalents else "",
        "rivals": [(words(name), rivals[name].explanation) for name in cause.equivalents if name in rivals],
        "evidence": "; ".join(told),
    }


def _adequacy_cells(adequacy: Adequacy, place: int) -> tuple[str, str, str]:
    whiteness, level = (
        f"{number:.2f}" if math.isfinite(number) else NOT_TOLD
        for number in (float(adequacy.whiteness[place]), float(adequacy.level[place]))
    )
    return share_text(float(adequacy.predictable[place])), whiteness, level


def _own(name: str, before: Quantity, after: Quantity) -> tuple[str, ...]:
    value, interval, unit = quantity_text(before)
    value_after, interval_after, _ = quantity_text(after)
    return name, value, interval, value_after, interval_after, unit


def _key(verdict: Verdict, name: str) -> str:
    """Return a parameter in words, of one that belongs to a recording with the recording's name."""
    names = [each.name for each in verdict.recordings]
    return key_text(f"{name}@1" if f"{name}@2" in verdict.parameters_before else name, names)


def _alone(verdict: Verdict) -> list[tuple[str, ...]]:
    """Return what each fitted recording tells of each parameter by itself, as rows."""
    fitted = [each for each in verdict.recordings if each.parameters]
    keys = dict.fromkeys(key for each in fitted for key in each.parameters)
    return [
        (key_text(key), each.name, *quantity_text(each.parameters[key]))
        for key in keys
        for each in fitted
        if key in each.parameters
    ]
