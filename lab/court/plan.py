"""The cases of a court, which tests the finder on hidden effects: kinds, effects, order. Only the seeds are random."""

import secrets
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TypeVar, cast

from lab.hidden.case import Case, Kind, System
from lab.hidden.five.cases import FIVE, RECORDING

SYSTEMS = ("platform", "imu", "wearable")
PORTED = tuple(FIVE)
"""Systems that the finder is handed as a user's own, with ports and the generic library."""
FEWEST_CASES = 120
FEWEST_OF_PORTED = 44
FEWEST_OF_AN_EFFECT = 4
DEVELOPMENT_SEEDS = range(1, 1000)
"""Seeds that development may look at. Judging seeds are drawn at run time and lie above."""

_JUDGING_SEEDS = 2**62
_GOLDEN = 0.382  # of a list: steps of the golden section spread any part of it evenly

T = TypeVar("T")


@dataclass(frozen=True)
class Slot:
    """The place of a case in the court, before it has a seed. `left_out` is what the finder's library lacks in it."""

    system: str
    number: int
    kind: Kind
    effects: tuple[str, ...]
    left_out: tuple[str, ...]

    @property
    def file_name(self) -> str:
        """Return the name of its result file."""
        return f"{self.system}-{self.number:04d}.json"

    def case(self, *, development: bool) -> Case:
        """Return the case with a seed that nobody has seen, or of the development list."""
        if development:
            place = (*SYSTEMS, *PORTED).index(self.system)
            seed = DEVELOPMENT_SEEDS[(place * 331 + self.number) % len(DEVELOPMENT_SEEDS)]
        else:
            seed = DEVELOPMENT_SEEDS.stop + secrets.randbelow(_JUDGING_SEEDS)
        return Case(self.system, seed, self.kind, self.effects)


def hidden_system(name: str) -> System:
    """Return what writes a system's cases."""
    return FIVE[name] if name in FIVE else cast(System, import_module(f"lab.hidden.{name}"))


def asked(name: str, folder: Path, held_out: Path) -> list[str]:
    """Return the command that explains a system's recordings, which lie in two folders."""
    if name in FIVE:
        own = ["own", f"lab.undeclared.five_systems:{name}"]
        return ["explain", *own, str(folder / RECORDING), "--held-out", str(held_out / RECORDING)]
    return ["explain", name, str(folder), "--held-out", str(held_out)]


def slots(name: str, system: System, cases: int | None = None) -> list[Slot]:
    """Return a system's slots: `cases` of them, or at least 120 with at least four of every effect; 44 of one with
    ports.

    The kinds are spread through the list, so that a court that was stopped has seen some of each.
    """
    total = cases if cases is not None else FEWEST_OF_PORTED if name in FIVE else FEWEST_CASES
    counts = _counts(system, total)
    whole = cases is None and name not in FIVE
    while whole and total - sum(counts.values()) < FEWEST_OF_AN_EFFECT * len(system.EFFECTS):
        total += 1
        counts = _counts(system, total)
    wanted: list[tuple[Kind, tuple[str, ...]]] = [(Kind.CLEAN, ())] * counts[Kind.CLEAN]
    wanted += [(Kind.PAIR, pair) for pair in _spread(system.PAIRS, counts[Kind.PAIR])]
    wanted += [(Kind.OUTSIDE, (mechanism,)) for mechanism in _spread(system.OUTSIDE, counts[Kind.OUTSIDE])]
    wanted += [(Kind.WITHHELD, (effect,)) for effect in _spread(system.WITHHELD, counts[Kind.WITHHELD])]
    wanted += [(Kind.SINGLE, (effect,)) for effect in _spread(system.EFFECTS, total - len(wanted))]
    stride = _stride(len(wanted))
    order = [wanted[place * stride % len(wanted)] for place in range(len(wanted))]
    return [
        Slot(name, number, kind, effects, look_alikes(system, effects[0]) if kind is Kind.WITHHELD else ())
        for number, (kind, effects) in enumerate(order)
    ]


def look_alikes(system: System, effect: str) -> tuple[str, ...]:
    """Return an effect and all that its recordings can hardly tell from it."""
    alike = {name for group in system.LOOK_ALIKES if effect in group for name in group}
    return tuple(sorted(alike | {effect}))


def _counts(system: System, total: int) -> dict[Kind, int]:
    return {kind: round(share * total) for kind, share in system.SHARES.items()}


def _spread(items: Sequence[T], count: int) -> Iterable[T]:
    """Return `count` of the items, each equally often, and of a part of them those that lie evenly."""
    if not items:
        return []
    whole, part = divmod(count, len(items))
    return [*items] * whole + [items[place * len(items) // part] for place in range(part)]


def _stride(length: int) -> int:
    """Return a step that visits all of `length` places, far apart."""
    step = max(1, round(_GOLDEN * length))
    while any(step % prime == 0 and length % prime == 0 for prime in range(2, length + 1)):
        step += 1
    return step
