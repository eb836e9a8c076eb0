"""The report: one page by itself, for who treats people and for who does research."""

import math
from collections.abc import Sequence
from html import escape

from discrepancy.explanation import Adequacy, Evidence, Explanation
from discrepancy.report.figures import AFTER, BEFORE, FLOOR, channel_name, residuals_svg, shown_channels, spectra_svg
from discrepancy.report.wording import (
    NOT_TOLD,
    chi2_text,
    headline,
    listed,
    number_text,
    parameter_words,
    quantity_text,
    seen_text,
    share_text,
    words,
)
from discrepancy.simulation import Effect
from discrepancy.verdict import Cause, Quantity, Signature

_STYLE = f"""
:root {{ --ink: #22262a; --soft: #667078; --rule: #dde1e4; --paper: #fff; --before: {BEFORE}; --after: {AFTER}; }}
* {{ box-sizing: border-box; }}
body {{ margin: 0; background: #f5f6f6; color: var(--ink);
  font: 15px/1.55 Helvetica, Arial, "DejaVu Sans", sans-serif; }}
main {{ max-width: 60rem; margin: 2rem auto; padding: 2.5rem 3rem; background: var(--paper);
  border: 1px solid var(--rule); }}
h1 {{ font-size: 1.75rem; line-height: 1.25; margin: 0.2rem 0 0.6rem; font-weight: 600; }}
h2 {{ font-size: 1.12rem; margin: 2.4rem 0 0.6rem; padding-top: 1.1rem; border-top: 1px solid var(--rule); }}
h3 {{ font-size: 1rem; margin: 1.6rem 0 0.3rem; }}
p {{ margin: 0.4rem 0; max-width: 46rem; }}
.soft, .kicker, figcaption {{ color: var(--soft); font-size: 0.87rem; }}
.kicker {{ letter-spacing: 0.04em; text-transform: uppercase; font-size: 0.78rem; }}
.lead {{ font-size: 1.1rem; }}
table {{ border-collapse: collapse; margin: 0.7rem 0; width: 100%; font-variant-numeric: tabular-nums; }}
th {{ text-align: left; font-weight: 600; font-size: 0.82rem; color: var(--soft);
  border-bottom: 1px solid var(--ink); }}
th, td {{ padding: 0.28rem 0.9rem 0.28rem 0; vertical-align: top; }}
td {{ border-bottom: 1px solid var(--rule); }}
.number {{ text-align: right; white-space: nowrap; }}
.accepted td {{ font-weight: 600; }}
.bar {{ display: block; height: 0.85rem; background: var(--rule); }}
.bar i {{ display: block; height: 100%; }}
.bars {{ min-width: 7rem; }}
.figures {{ display: grid; grid-template-columns: repeat(3, 1fr); gap: 1.5rem; margin: 1.3rem 0 0.5rem; }}
.figures b {{ display: block; font-size: 1.7rem; font-weight: 600; line-height: 1.2; }}
.cause {{ border-left: 3px solid var(--after); padding-left: 1.2rem; margin: 1.3rem 0; }}
.key {{ display: inline-block; width: 0.75rem; height: 0.75rem; margin: 0 0.35rem 0 1rem; }}
summary {{ cursor: pointer; color: var(--soft); }}
.scroll {{ overflow-x: auto; }}
figure {{ margin: 0.6rem 0; }}
svg {{ width: 100%; height: auto; }}
svg text {{ font-family: Helvetica, Arial, "DejaVu Sans", sans-serif !important; }}
@media print {{ body {{ background: none; }} main {{ border: 0; margin: 0; padding: 0; }} }}
@media (max-width: 45rem) {{ main {{ margin: 0; padding: 1.2rem; }} .figures {{ grid-template-columns: 1fr; }} }}
"""


_FLOOR_WORDS = {
    True: "noise, which no simulation can go below",
    False: "noise, estimated from what the extended simulation leaves",
}
_EVIDENCE_HEAD = (
    "<tr><th>candidate</th><th>parameters</th><th class='number'>χ² lowered by</th><th></th>"
    "<th class='number'>noise alone reaches</th><th>verdict</th></tr>"
)


def page(explanation: Explanation) -> str:
    """Return the page as HTML; draws with matplotlib."""
    title = f"What the simulation of {words(explanation.verdict.system)} gets wrong"
    body = "\n".join(
        (
            _summary(explanation, title),
            _causes(explanation),
            _next(explanation),
            _residuals(explanation),
            _evidence(explanation),
            _adequacy(explanation),
            _base(explanation),
            _method(explanation),
        )
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<style>{_STYLE}</style>\n</head>\n'
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def _summary(explanation: Explanation, title: str) -> str:
    verdict, gain = explanation.verdict, explanation.verdict.gain
    first = explanation.causes[0].explanation if explanation.causes else _signature_text(explanation)
    source = "another one" if explanation.held_out_is_own else "the last part of the same one"
    figures = "".join(
        f'<div><b style="color:{colour}">{value}</b>{what}</div>'
        for value, colour, what in (
            (share_text(gain.held_out_nrmse_before), BEFORE, "error of the simulation as it was"),
            (share_text(gain.held_out_nrmse_after), AFTER, "error of the extended simulation"),
            (share_text(gain.noise_floor_nrmse), "#5d656c", _FLOOR_WORDS[verdict.noise_from is not None]),
        )
    )
    removed = gain.share_of_excess_removed
    told = ""
    if verdict.causes:
        told = (
            f"The extension removes <b>{share_text(removed)}</b> of the error's power above the noise. "
            if removed is not None
            else "Which share of the error above the noise that is cannot be told, as the noise was not stated. "
        )
    seen = seen_text(verdict)
    told += f"Effects would have been seen from: {escape(seen)}. " if seen else ""
    return (
        f'<p class="kicker">{escape(title)}</p>\n<h1>{escape(headline(explanation.verdict))}</h1>\n'
        f'<p class="lead">{escape(first)}</p>\n<div class="figures">{figures}</div>\n'
        f'<p class="soft">{told}Judged on the held-out recording ({source}), which no parameter was fitted to. '
        f"Errors are RMS, relative to the standard deviation of what was measured.</p>"
    )


def _signature_text(explanation: Explanation) -> str:
    if explanation.verdict.verdict == "nothing":
        return "No effect of the library is needed, and what is left does not follow from the inputs: it is noise."
    if explanation.verdict.verdict == "cannot_tell":
        return "Nothing was found, but this recording would not show what it is looked at for. What would: see below."
    return f"What is not explained shows {_where(explanation.verdict.remainder.signature)}."


def _where(signature: Signature) -> str:
    names = [channel_name(name)[0] for name in signature.channels]
    low, high = signature.band_hz
    parts = [f"in {listed(names)}" if names else "in no single channel"]
    if low is not None and high is not None:
        parts.append(f"between {low:.3g} and {high:.3g} Hz")
    if signature.when_s is not None:
        parts.append(f"from {signature.when_s[0]:.1f} to {signature.when_s[1]:.1f} s")
    return ", ".join(parts)


def _causes(explanation: Explanation) -> str:
    verdict = explanation.verdict
    effects = {effect.name: effect for effect in explanation.causes}
    parts = [_cause(cause, effects[cause.name], explanation.rivals) for cause in verdict.causes]
    if verdict.remainder.present and verdict.causes:
        parts.append(
            f"<h3>What is not explained</h3><p>The extended simulation is still missing something: "
            f"{share_text(verdict.remainder.share)} of the error above the noise is left, "
            f"{escape(_where(verdict.remainder.signature))}.</p>"
        )
    if not parts:
        return ""
    return f"<h2>{'The cause' if len(verdict.causes) == 1 else 'The causes, strongest first'}</h2>\n" + "\n".join(parts)


def _cause(cause: Cause, effect: Effect, rivals: dict[str, Effect]) -> str:
    evidence = cause.evidence
    told = [f"without it the misfit χ² rises by {chi2_text(evidence.get('chi2'))}"]
    if evidence.get("threshold") is not None:
        told.append(f"noise alone would make up to {chi2_text(evidence['threshold'])}")
    if evidence.get("rival_chi2") is not None:
        told.append(f"the best other candidate in its place fits worse by {chi2_text(evidence['rival_chi2'])}")
    alike = ""
    if cause.equivalents:
        names = listed([words(name) for name in cause.equivalents], "or")
        alike = f"<p><b>Alternatives.</b> This recording cannot tell it from {escape(names)}. "
        alike += escape(effect.experiment) + "</p>"
        alike += "".join(
            f'<p class="soft">{escape(words(name))}: {escape(rivals[name].explanation)}</p>'
            for name in cause.equivalents
            if name in rivals
        )
    return (
        f'<div class="cause"><h3>{escape(words(cause.name))}</h3>\n<p>{escape(effect.explanation)}</p>\n'
        f"{_quantities(cause.parameters)}<p><b>What to do.</b> {escape(effect.remedy)}</p>\n{alike}"
        f'<p class="soft">{escape("; ".join(told))}.</p></div>'
    )


def _quantities(parameters: dict[str, Quantity]) -> str:
    rows = [(parameter_words(name), *quantity_text(quantity)) for name, quantity in parameters.items()]
    return _table(("parameter", "value", "95 % interval", "unit"), rows, numbers=(1, 2))


def _next(explanation: Explanation) -> str:
    experiment = explanation.verdict.next_experiment
    return f"<h2>Next experiment</h2>\n<p>{escape(experiment)}</p>" if experiment else ""


def _residuals(explanation: Explanation) -> str:
    view = explanation.held_out
    left_out = len(view.channels.names) - len(shown_channels(view))
    only = f" Channels not shown, whose error stands out of the noise least: {left_out}." if left_out else ""
    keys = "".join(
        f'<span class="key" style="background:{colour}"></span>{what}'
        for colour, what in ((BEFORE, "before"), (AFTER, "after"), (FLOOR, "noise"))
    )
    return (
        "<h2>Measured minus simulated, before and after</h2>\n"
        f"<p class='soft'>The held-out recording.{only}{keys}</p>\n"
        f"<figure>{residuals_svg(view)}</figure>\n"
        f"<h3>The same over frequency</h3>\n<figure>{spectra_svg(view)}</figure>"
    )


def _evidence(explanation: Explanation) -> str:
    if not explanation.evidence:
        return ""
    strongest = max(math.log10(1.0 + max(0.0, one.chi2)) for one in explanation.evidence) or 1.0
    best = {one.effect: one for one in reversed(explanation.evidence)}  # strongest first: it comes last here
    others = [one for one in explanation.evidence if best[one.effect] is not one]
    rows = "".join(_evidence_row(one, strongest) for one in explanation.evidence if best[one.effect] is one)
    more = "".join(_evidence_row(one, strongest) for one in others)
    closed = (
        f"<details><summary>{len(others)} more choices of the same causes' parameters, or of where to begin</summary>"
        f"<div class='scroll'><table>{_EVIDENCE_HEAD}{more}</table></div></details>"
    )
    return (
        "<h2>All candidates, each by itself</h2>\n"
        "<p class='soft'>A candidate is an effect with some of its parameters. By how much each alone lowers the "
        "misfit χ² (squared error over noise; bars logarithmic), beside what noise alone would make of the best of "
        "them all. One that explains much by itself may only resemble another that explains more: it is rejected.</p>\n"
        f"<div class='scroll'><table>{_EVIDENCE_HEAD}{rows}</table></div>\n{closed if others else ''}"
    )


def _evidence_row(one: Evidence, strongest: float) -> str:
    width = 100.0 * math.log10(1.0 + max(0.0, one.chi2)) / strongest
    colour = {"accepted": AFTER, "equivalent": "#7fa6c0"}.get(one.status, "#b9c0c5")
    told = {"accepted": "named", "equivalent": "alternative", "rejected": "rejected"}[one.status]
    values = ", ".join(f"{parameter_words(name)} {number_text(value)}" for name, value in one.parameters.items())
    return (
        f'<tr class="{one.status}"><td>{escape(words(one.effect))}</td><td>{escape(values)}</td>'
        f'<td class="number">{chi2_text(one.chi2)}</td>'
        f'<td class="bars"><span class="bar"><i style="width:{width:.1f}%;background:{colour}"></i></span></td>'
        f'<td class="number">{chi2_text(one.threshold)}</td><td>{told}</td></tr>'
    )


def _adequacy(explanation: Explanation) -> str:
    before, after = explanation.before, explanation.after
    rows = [
        (channel_name(name)[0], *_adequacy_cells(before, place), *_adequacy_cells(after, place))
        for place, name in enumerate(explanation.fit.channels.names)
    ]
    columns = ("channel", "predictable", "autocorrelation", "over noise")
    heads = (*columns, *columns[1:])
    reasons = "".join(
        f"<p><b>{when}:</b> {escape('; '.join(one.reasons) or 'what is left is noise')}.</p>"
        for when, one in (("Before", before), ("After", after))
    )
    return (
        f"<h2>Is anything not explained?</h2>\n{reasons}<p class='soft'>Left three columns before, right three after: "
        "the share of the residual's power that the inputs predict in parts of the recording not fitted, its largest "
        "autocorrelation, and its RMS over the declared noise.</p>\n"
        f"<div class='scroll'>{_table(heads, rows, numbers=tuple(range(1, 7)))}</div>"
    )


def _adequacy_cells(adequacy: Adequacy, place: int) -> tuple[str, str, str]:
    whiteness, level = (
        f"{number:.2f}" if math.isfinite(number) else NOT_TOLD
        for number in (float(adequacy.whiteness[place]), float(adequacy.level[place]))
    )
    return share_text(float(adequacy.predictable[place])), whiteness, level


def _base(explanation: Explanation) -> str:
    before, after = explanation.verdict.parameters_before, explanation.verdict.parameters_after
    if not before:
        return ""
    rows = []
    for name, quantity in before.items():
        value, interval, unit = quantity_text(quantity)
        value_after, interval_after, _ = quantity_text(after.get(name, quantity))
        rows.append((parameter_words(name), value, interval, value_after, interval_after, unit))
    heads = ("parameter", "before", "95 %", "after", "95 %", "unit")
    return f"<h2>The simulation's own parameters</h2>\n{_table(heads, rows, numbers=(1, 2, 3, 4))}"


def _method(explanation: Explanation) -> str:
    notes = "".join(f"<p>{escape(note)}</p>" for note in explanation.notes)
    return (
        "<h2>How this was decided</h2>\n<p>The simulation is fitted, and what it leaves (the residual) is "
        "filtered so that its noise is alike at all frequencies. Each candidate is scored, the best are fitted "
        "together; one is kept only if noise alone would not do as well for any of them, and named only if it removes "
        "at least half of the error above the noise on the held-out recording, which no parameter was fitted to.</p>\n"
        f"{notes}<p class='soft'>Seed of the bootstrap: {explanation.seed}. The "
        "same facts for a program: verdict.json; every gain can be recomputed from held_out.csv; extended.toml holds "
        "the extended model.</p>"
    )


def _table(heads: tuple[str, ...], rows: Sequence[tuple[str, ...]], numbers: tuple[int, ...]) -> str:
    def cells(tag: str, row: tuple[str, ...]) -> str:
        return "".join(
            f"<{tag}{' class=number' if place in numbers else ''}>{escape(cell)}</{tag}>"
            for place, cell in enumerate(row)
        )

    lines = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<table><tr>{cells('th', heads)}</tr>{lines}</table>"
