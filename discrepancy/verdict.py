"""What is told of a discrepancy: exactly the fields of verdict.json. A number that does not apply is null, never
NaN.
"""

import math
from typing import Literal

import msgspec

from messages.constants import NORMAL_95

MOST_EQUIVALENTS = 3

Kind = Literal["named", "nothing", "unknown", "cannot_tell", "constructed"]
"""Verdicts, in words of `docs/discrepancy.md`."""


class Quantity(msgspec.Struct, frozen=True):
    """A parameter with its 95 % interval."""

    value: float | None
    low: float | None
    high: float | None
    unit: str


class Cause(msgspec.Struct, frozen=True):
    """A named cause: `name` is one of the library, `evidence` what speaks for it, `equivalents` what says the same.

    `evidence` holds `chi2` (what χ² rises without the cause, all else refitted), `parameters` (how many), `threshold`
    (what chance reaches once in a hundred, over all candidates), `chance` (its probability under the bootstrap) and
    `rival_chi2` (how much worse the best rival that is no equivalent fits), and for each equivalent `worse_by.<name>`
    (how much worse it fits in the cause's place).
    """

    name: str
    parameters: dict[str, Quantity]
    evidence: dict[str, float | None]
    equivalents: list[str]


class Signature(msgspec.Struct, frozen=True):
    """Where a remainder is: channels, frequencies, and the times if it is confined to some."""

    channels: list[str]
    band_hz: tuple[float | None, float | None]
    when_s: tuple[float, float] | None


class Remainder(msgspec.Struct, frozen=True):
    """Whether the extended model still fails; `share` of what the base model misses beyond noise is left, null where
    the noise is not known.
    """

    present: bool
    share: float | None
    signature: Signature


class Gain(msgspec.Struct, frozen=True):
    """Held-out NRMSE with frozen parameters: the RMS over channels, each divided by its measured standard deviation.

    `share_of_excess_removed` is null where the noise is not known beside the models: a share of what lies above a
    floor that was taken from the extended model's own residual says nothing.
    """

    held_out_nrmse_before: float | None
    held_out_nrmse_after: float | None
    noise_floor_nrmse: float | None
    share_of_excess_removed: float | None


class Constructed(msgspec.Struct, frozen=True):
    """A cause that no library names: the term of a `form` from `signals` that acts at a `port`, as a `formula` with its
    sizes filled in, and in words. `constants` are what the formula holds beside its parameters.
    """

    name: str
    port: str
    form: str
    signals: list[str]
    formula: str
    words: str
    constants: dict[str, float]


class RecordingTold(msgspec.Struct, frozen=True):
    """One of several recordings by itself, fitted or held out: the NRMSE of both models and of the noise there, and
    what the extended model still misses. `parameters` are those that the recordings share, as this one alone tells
    them, causes' as `effect.parameter`; none for one that is held out.
    """

    name: str
    held_out: bool
    nrmse_before: float | None
    nrmse_after: float | None
    noise_floor_nrmse: float | None
    share_of_excess_removed: float | None
    remainder: Remainder
    parameters: dict[str, Quantity]


class Verdict(msgspec.Struct, frozen=True):
    """The whole verdict, strongest cause first.

    `noise_from` tells what the noise is known from beside any model; null where it had to be estimated from what the
    models leave. `seen_above` tells, where nothing was named, from which size on each parameter would have been seen;
    a null value means that none within its bounds would have been. `notes` say what a reader should know beside.
    `constructed` are those causes, of a verdict of that name, that were made at the simulation's ports. `recordings`
    tells each by itself where several are fitted, or held out, and `disagreements` on what those fitted disagree.
    """

    system: str
    verdict: Kind
    causes: list[Cause]
    remainder: Remainder
    gain: Gain
    parameters_before: dict[str, Quantity]
    parameters_after: dict[str, Quantity]
    next_experiment: str | None
    noise_from: Literal["stated", "repeats", "period", "rest"] | None = None
    seen_above: dict[str, Quantity] = {}
    notes: list[str] = []
    constructed: list[Constructed] = []
    recordings: list[RecordingTold] = []
    disagreements: list[str] = []


def number(value: float) -> float | None:
    """Return `value`, None in place of what is not finite."""
    return float(value) if math.isfinite(value) else None


def quantity(value: float, deviation: float, unit: str, interval: tuple[float, float] | None = None) -> Quantity:
    """Return a quantity with `interval`, or with the 95 % one of its `deviation`; what is not finite becomes null."""
    low, high = interval if interval is not None else (value - NORMAL_95 * deviation, value + NORMAL_95 * deviation)
    return Quantity(number(value), number(low), number(high), unit)


def to_json(verdict: Verdict) -> bytes:
    """Return verdict.json, indented, fields in the order of the structs."""
    return msgspec.json.format(msgspec.json.encode(verdict), indent=2) + b"\n"


def from_json(data: bytes | str) -> Verdict:
    """Return the verdict that `data` holds; raises msgspec.ValidationError, naming the field, where it does not fit."""
    return msgspec.json.decode(data, type=Verdict)
