"""How right the finder is on the systems with ports: what a generic library names, and what it constructs.

Scored is what the truth says there is to be found: an effect whose loss raises χ² by 25 at least, a mechanism of no
library that holds half of the held-out excess at least.
"""

from collections.abc import Callable, Sequence

import msgspec

from lab.court.result import Result
from lab.court.score import first_name, first_two, in_interval
from lab.hidden.case import Kind

LEAST_CHI2 = 25.0
LEAST_OF_EXCESS = 0.5
ENOUGH_OF_GAIN = 0.8


class Count(msgspec.Struct, frozen=True):
    """`k` of `n`, in words, and the share that it must reach, or not exceed if `at_most`; null: only told."""

    words: str
    k: float
    n: int
    wanted: float | None = None
    at_most: bool = False

    @property
    def reached(self) -> bool | None:
        """Return whether the goal is reached, None where there is none or nothing to count."""
        if self.wanted is None or not self.n:
            return None
        share = self.k / self.n
        return share <= self.wanted if self.at_most else share >= self.wanted


def counts(results: Sequence[Result]) -> list[Count]:
    """Return the figures of all systems with ports together; none where there are no results."""
    if not results:
        return []
    of = {kind: [each for each in results if each.truth.kind is kind] for kind in Kind}
    single = [each for each in of[Kind.SINGLE] if (each.truth.chi2_beyond_base or 0.0) >= LEAST_CHI2]
    outside = [each for each in of[Kind.OUTSIDE] + of[Kind.WITHHELD] if _excess(each) >= LEAST_OF_EXCESS]
    made = [each for each in outside if _verdict(each) == "constructed"]
    told = [share for each in single if (share := in_interval(each)) is not None]
    return [
        _count("the first name is right", single, lambda each: first_name(each) == 1.0, 0.90),
        _count("one of the first two names is right", single, lambda each: first_two(each) == 1.0),
        Count("parameters within their 95 % intervals", sum(told), len(told)),
        _count(
            "nothing hidden: something is named or constructed", of[Kind.CLEAN], _says_something, 0.05, at_most=True
        ),
        _count("not in the library: constructed", outside, lambda each: _verdict(each) == "constructed", 0.60),
        _count("of these, 80 % of what there is to be gained", made, lambda each: gained(each) >= ENOUGH_OF_GAIN, 0.70),
        _count("not in the library: named as something else", outside, lambda each: _verdict(each) == "named"),
        _count("cannot tell", results, lambda each: _verdict(each) == "cannot_tell", 0.10, at_most=True),
        _count("no verdict", results, lambda each: each.told is None, 0.0, at_most=True),
    ]


def gained(result: Result) -> float:
    """Return which share of the held-out error's power above the noise was removed; 0 where nothing was measured."""
    noise, errors = result.truth.nuisance["noise_nrmse"], result.errors
    if errors is None or errors.before is None or errors.after is None:
        return 0.0
    above = errors.before**2 - float(noise) ** 2
    return (errors.before**2 - errors.after**2) / above if above > 0.0 else 0.0


def _excess(result: Result) -> float:
    """Return which share of the base model's held-out error, as power, is above the noise."""
    noise, errors = result.truth.nuisance["noise_nrmse"], result.errors
    if errors is None or not errors.before:
        return 0.0
    return 1.0 - (float(noise) / errors.before) ** 2


def _verdict(result: Result) -> str:
    return "" if result.told is None else result.told.verdict


def _says_something(result: Result) -> bool:
    return _verdict(result) in ("named", "constructed")


def _count(
    words: str,
    results: Sequence[Result],
    holds: Callable[[Result], bool],
    wanted: float | None = None,
    *,
    at_most: bool = False,
) -> Count:
    return Count(words, sum(map(holds, results)), len(results), wanted, at_most)
