"""A constructed term in symbols and in words."""

from collections.abc import Mapping
from dataclasses import asdict

from discrepancy.construct.forms import LEARNED
from discrepancy.construct.terms import MadeTerm
from discrepancy.report.wording import number_text
from discrepancy.verdict import Constructed, Quantity


def told(made: MadeTerm, sizes: Mapping[str, Quantity]) -> Constructed:
    """Return a term with its sizes as a verdict tells it: "joint += −0.0800·sin(8.000·angle)"."""
    form, constants = made.form, made.constants
    names = [each.name for each in made.signals]
    held = asdict(constants)
    used = ["width"] if form.width else ["origin", "follow_s"] if form.memory is not None else []
    if form.one_signed:
        used = ["origin"]
    if form.name == LEARNED:
        used = ["low", "high"]
    place = {
        "x": _shifted(names[0], constants.origin if form.memory is not None else 0.0) if names else "",
        "y": names[1] if len(names) > 1 else "",
        "s": _number(sizes[form.shape.name]) if form.shape is not None and form.shape.name in sizes else "",
        "w": number_text(constants.width),
        "o": number_text(constants.origin),
    }
    parts = []
    for name, symbol in zip(form.amounts, form.symbols, strict=True):
        amount = _number(sizes[name]) if name in sizes else "0"
        basis = symbol.format(**place)
        parts.append(amount if basis == "1" else f"{amount}·{basis}")
    if form.name == LEARNED:
        low, high = number_text(constants.low), number_text(constants.high)
        parts = [f"a curve of {names[0]} from {low} to {high}, learned"]
    formula = f"{made.port.name} += {' + '.join(parts)}".replace("+ −", "− ").replace("+ -", "− ")
    return Constructed(
        name=made.effect.name,
        port=made.port.name,
        form=form.name,
        signals=names,
        formula=formula,
        words=made.effect.explanation,
        constants={name: held[name] for name in used},
    )


def _number(quantity: Quantity) -> str:
    half = None
    if quantity.low is not None and quantity.high is not None:
        half = 0.5 * (quantity.high - quantity.low)
    return number_text(quantity.value, half)


def _shifted(name: str, origin: float) -> str:
    return name if not origin else f"{name} − {number_text(origin)}".replace("− −", "+ ").replace("− -", "+ ")
