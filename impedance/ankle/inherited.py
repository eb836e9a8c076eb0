"""The wrench's delay inherited from a recording of a known weight on the plate, which the same instruments made.

A weight's inertia answers to its own motion, so its delay is told to microseconds; an ankle's damping looks like a
delay, which a trial tells to some tens. Two files tell it: `extended.toml` of `gaiteyes explain platform`, where the
finder named `force_delay`, and the JSON file of `gaiteyes platform identify --json`, which always holds it.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import msgspec

from impedance.ankle.trial import AnkleTrial
from impedance.recording.plain_files import read_toml
from messages.constants import NORMAL_95
from messages.errors import UserError
from messages.text_files import read_text

_MOST_S: Final = 0.02
_LEAST_DEVIATION_S: Final = 1e-6


@dataclass(frozen=True)
class InheritedDelay:
    """The wrench's delay behind the motion and its standard deviation."""

    delay_s: float
    deviation_s: float


def read_delay(path: Path) -> InheritedDelay:
    """Return the delay in either file; raises UserError, one line, where there is none, or it cannot be."""
    found = _identified(path) if path.suffix == ".json" else _explained(path)
    if not abs(found.delay_s) <= _MOST_S or not 0.0 <= found.deviation_s <= _MOST_S:
        raise UserError(
            f"{path}: the delay is {found.delay_s:g} ± {found.deviation_s:g} s, allowed up to ±{_MOST_S:g} s"
        )
    return found


def with_delay(trial: AnkleTrial, inherited: InheritedDelay) -> AnkleTrial:
    """Return the trial with that delay stated instead of its own."""
    instruments = msgspec.structs.replace(
        trial.settings.instruments,
        delay_s=inherited.delay_s,
        delay_deviation_s=max(inherited.deviation_s, _LEAST_DEVIATION_S),
    )
    return replace(trial, settings=msgspec.structs.replace(trial.settings, instruments=instruments))


def _explained(path: Path) -> InheritedDelay:
    document = read_toml(path)
    if document.get("system") != "platform":
        raise UserError(f'{path}: system is {document.get("system")!r}; expected "platform", or a file ending in .json')
    entry = _within(document, "effects", "force_delay", "value_s")
    if entry is None:
        raise UserError(
            f"{path}: names no effects.force_delay: the explanation found no delay; take that of `gaiteyes platform "
            "identify --json` on the same recording"
        )
    value, low, high = (_number(path, f"effects.force_delay.value_s.{name}", entry, name) for name in _ENTRY)
    return InheritedDelay(value, (high - low) / (2.0 * NORMAL_95))


def _identified(path: Path) -> InheritedDelay:
    try:
        document = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path}: not JSON: {error}") from error
    errors = document.get("checks", {}).get("errors") if isinstance(document, dict) else None
    delays = [each for each in errors or () if isinstance(each, dict) and each.get("kind") == "delay"]
    if len(delays) != 1:
        raise UserError(f"{path}: holds no delay under checks.errors; expected what `platform identify --json` wrote")
    value, deviation = (_number(path, f"checks.errors: {name}", delays[0], name) for name in ("found", "deviation"))
    return InheritedDelay(value, deviation)


_ENTRY: Final = ("value", "low", "high")


def _within(document: object, *names: str) -> Mapping[str, object] | None:
    for name in names:
        document = document.get(name) if isinstance(document, dict) else None
    return document if isinstance(document, dict) else None


def _number(path: Path, field: str, entry: Mapping[str, object], name: str) -> float:
    value = entry.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise UserError(f"{path}: {field} is {value!r}; expected a number")
    return float(value)
