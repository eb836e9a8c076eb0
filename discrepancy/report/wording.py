"""How numbers are shown to a person: in the unit that reads best, with the digits that its interval justifies."""

import math
from collections.abc import Mapping, Sequence

from discrepancy.joint import OF
from discrepancy.verdict import Cause, Quantity, RecordingTold, Signature, Verdict

_READ_AS = {
    "s": (1e3, "ms"),
    "m": (1e3, "mm"),
    "rad": (180.0 / math.pi, "°"),
    "rad/s": (180.0 / math.pi, "°/s"),
    "1": (1.0, ""),
}
_SMALL = 1.0
"""Seconds or metres: from it on they are read as they are, below in thousandths."""
_SMALL_SHARE = 0.1
"""Below it a share has a decimal of a percent: a whole percent would be a tenth of it."""
_UNITS = {
    "s": "s",
    "m": "m",
    "mm": "mm",
    "rad": "rad",
    "radps": "rad/s",
    "radps2": "rad/s²",
    "mps": "m/s",
    "mps2": "m/s²",
    "n": "N",
    "N": "N",
    "ns": "N·s",
    "nm": "N·m",
    "Nm": "N·m",
    "Nms": "N·m·s",
    "kg": "kg",
    "kgm": "kg·m",
    "kgm2": "kg·m²",
    "hz": "Hz",
    "Hz": "Hz",
    "px": "px",
    "deg": "°",
    "degc": "°C",
    "degC": "°C",
    "V": "V",
    "A": "A",
    "W": "W",
    "K": "K",
}
"""By the suffix of a name."""
_PER = "per"
_ONLY = "value"
"""The name of an effect's one parameter, which says nothing that the effect's own does not."""
_PLAIN = {"hz": "frequency", "zeta": "damping ratio"}
"""Parameters' names that are no words."""
_MOST_DECIMALS = 6
"""Of a number that is written out: with more it is written with an exponent."""
_WHOLE = 100.0
"""A rise of χ² from which on its decimals say nothing."""
_MOST_TOLD = 8
"""Parameters of one candidate that are told in a row of a table."""
NOT_TOLD = "–"


def headline(verdict: Verdict) -> str:
    """Return the verdict in a sentence."""
    if verdict.verdict == "nothing":
        return "Nothing is missing: what the simulation does not explain is noise."
    if verdict.verdict == "cannot_tell":
        return "This recording cannot tell: it would show no effect, or its noise may hide one."
    if verdict.verdict == "unknown":
        return "Not explained: the simulation is missing something that no effect of the library describes."
    if verdict.verdict == "constructed":
        formulas = "; ".join(term.formula for term in verdict.constructed)
        ports = listed(list(dict.fromkeys(words(term.port) for term in verdict.constructed)))
        named = [words(cause.name) for cause in verdict.causes if cause.name not in _names(verdict)]
        beside = f" beside {listed(named)}" if named else ""
        tail = " Something more is not explained." if verdict.remainder.present else ""
        return f"No effect of the library is it, but this term at {ports} explains it{beside}: {formulas}.{tail}"
    tail = " Something more is not explained." if verdict.remainder.present else ""
    return f"The simulation is missing: {listed([_or_equivalents(cause) for cause in verdict.causes])}.{tail}"


def _names(verdict: Verdict) -> list[str]:
    return [term.name for term in verdict.constructed]


def seen_text(verdict: Verdict) -> str:
    """Return from which size on effects would have been seen, the least visible parameter of each unit for all; empty
    where it does not apply.
    """
    least: dict[tuple[str, str], float] = {}
    for key, seen in verdict.seen_above.items():
        place = key.partition(".")[0], seen.unit
        least[place] = max(least.get(place, 0.0), math.inf if seen.value is None else seen.value)
    parts = []
    for (effect, unit), size in least.items():
        value, _, told = quantity_text(Quantity(size if math.isfinite(size) else None, None, None, unit))
        rounded = f"{float(value):.2g} {told}".strip() if math.isfinite(size) else "at no size within its bounds"
        parts.append(f"{words(effect)} {rounded}")
    return "; ".join(parts)


def key_text(key: str, names: Sequence[str] = ()) -> str:
    """Return a parameter's key as words: "force delay: value"; of one that belongs to a recording with its name."""
    name, at, place = key.partition(OF)
    effect, dot, parameter = name.rpartition(".")
    told = f"{words(effect)}: {parameter_words(parameter)}" if dot else parameter_words(name)
    return f"{told} ({names[int(place) - 1]})" if at and int(place) <= len(names) else told


def removed_text(verdict: Verdict) -> str:
    """Return what the extension removes, in words."""
    share = verdict.gain.share_of_excess_removed
    if share is None:
        return "how much of the error's power above the noise that is, is not known, as the noise is not"
    return f"{share_text(share)} of the error's power above the noise removed"


def quantity_text(quantity: Quantity) -> tuple[str, str, str]:
    """Return value, interval and unit as text: ("2.10", "2.05 to 2.15", "ms")."""
    factor, unit = _READ_AS.get(quantity.unit, (1.0, quantity.unit))
    if quantity.unit in ("s", "m") and quantity.value is not None and abs(quantity.value) >= _SMALL:
        factor, unit = 1.0, quantity.unit
    numbers = [None if n is None else factor * n for n in (quantity.value, quantity.low, quantity.high)]
    value, low, high = numbers
    half = 0.5 * (high - low) if low is not None and high is not None else None
    interval = NOT_TOLD if half is None else f"{number_text(low, half)} to {number_text(high, half)}"
    return number_text(value, half), interval, unit


def number_text(value: float | None, half: float | None = None) -> str:
    """Return `value` with two digits of its interval's `half`, or four digits without; a dash for nothing."""
    if value is None or not math.isfinite(value):
        return NOT_TOLD
    if half is None or not 0.0 < half < math.inf:
        return f"{value:.4g}"
    digits = 1 - math.floor(math.log10(half))
    if digits > _MOST_DECIMALS:
        lead = math.floor(math.log10(abs(value))) if value else -digits
        return f"{value:.{max(0, lead + digits)}e}".replace("-", "−")
    return f"{round(value, digits):.{max(0, digits)}f}".replace("-", "−")


def chi2_text(chi2: float | None) -> str:
    """Return a rise of χ², whole where it is large, with narrow spaces between thousands."""
    if chi2 is None or not math.isfinite(chi2):
        return NOT_TOLD
    return f"{chi2:,.{0 if abs(chi2) >= _WHOLE else 1}f}".replace(",", "\u202f").replace("-", "−")


def words(name: str) -> str:
    """Return a library name as words: of one that acts on a channel without the channel's unit."""
    effect, of, channel = name.partition("_of_")
    return f"{effect}{of}{channel_name(channel)[0]}".replace("_", " ")


def channel_name(name: str) -> tuple[str, str]:
    """Return a channel's name in words and its unit, which is the name's last part: ("fx", "N")."""
    stem, _, suffix = name.rpartition("_")
    return (stem.replace("_", " "), _UNITS[suffix]) if stem and suffix in _UNITS else (name.replace("_", " "), "")


def parameter_words(name: str) -> str:
    """Return a parameter's name as words without its unit (z of z_radps_per_degc), which stands beside its value."""
    parts = name.split("_")
    while len(parts) > 1 and (parts[-1] in _UNITS or parts[-1] == _PER):
        parts.pop()
    return " ".join(_PLAIN.get(part, part) for part in parts)


def parameters_text(choice: Sequence[str], units: Sequence[str], values: Mapping[str, float]) -> str:
    """Return the parameters of a choice with the values that some have: "x −0.276°, y, z"."""
    told = []
    for name, unit in zip(choice, units, strict=True):
        value, _, shown = quantity_text(Quantity(values.get(name), None, None, unit))
        number = f"{value} {shown}".replace(" °", "°").replace("-", "−").strip() if name in values else ""
        own = parameter_words(name)
        told.append(number if own == _ONLY else f"{own} {number}".strip())
    more = [f"and {len(told) - _MOST_TOLD} more"] if len(told) > _MOST_TOLD + 1 else []
    return ", ".join(each for each in (*(told[:_MOST_TOLD] if more else told), *more) if each)


def share_text(share: float | None) -> str:
    """Return a share as percents, with a decimal where it is small."""
    if share is None or not math.isfinite(share):
        return NOT_TOLD
    return f"{100.0 * share:.{1 if abs(share) < _SMALL_SHARE else 0}f} %".replace("-", "−")


def recording_row(told: RecordingTold, *, removed: bool = False) -> tuple[str, ...]:
    """Return one of several recordings as the cells of a row; with what was `removed` of the excess before the last."""
    shares = [told.nrmse_before, told.nrmse_after, told.noise_floor_nrmse]
    shares += [told.share_of_excess_removed] if removed else []
    left = where_text(told.remainder.signature) if told.remainder.present else "noise"
    return (told.name, "held out" if told.held_out else "fitted", *map(share_text, shares), left)


def where_text(signature: Signature) -> str:
    """Return where a remainder is, in words."""
    names = [channel_name(name)[0] for name in signature.channels]
    low, high = signature.band_hz
    parts = [f"in {listed(names)}" if names else "in no single channel"]
    if low is not None and high is not None:
        parts.append(f"between {low:.3g} and {high:.3g} Hz")
    if signature.when_s is not None:
        parts.append(f"from {signature.when_s[0]:.1f} to {signature.when_s[1]:.1f} s")
    return ", ".join(parts)


def listed(items: list[str], last: str = "and") -> str:
    """Return "a", "a and b" or "a, b and c"."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {last} {items[-1]}"


def _or_equivalents(cause: Cause) -> str:
    return listed([words(cause.name), *map(words, cause.equivalents)], "or")
