"""How right a system's results are: every rate is first taken per effect, then averaged over the effects."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import permutations

import msgspec
import numpy as np

from lab.court.result import Result, ToldCause
from lab.court.smallest import Smallest, smallest_found
from lab.hidden.case import Kind, Sizes

REQUIRED = {
    "first_name": 0.85,
    "first_two": 0.95,
    "exact_pair": 0.60,
    "clean_nothing": 0.95,
    "outside_unknown": 0.80,
    "interval": 0.90,
    "interval_and_narrow": 0.90,
    "share_of_oracle": 0.80,
}
"""The share that a rate must reach for the finder to pass. Intervals are of 95 %; 0.90 leaves room for their chance."""
MOST_CHI2_OF_AN_EQUIVALENT = 10.0
"""χ² by which a look-alike may fit worse and still count as told: three standard deviations, for one parameter."""
_LEAST_TO_GAIN = 0.01  # of the squared error: below, what the oracle gains is too little to be shared


class Rate(msgspec.Struct, frozen=True):
    """A rate averaged over effects, what it must reach (null: only told), and over how many cases; null: none."""

    share: float | None
    wanted: float | None
    cases: int


class SystemScore(msgspec.Struct, frozen=True):
    """All figures of one system.

    `confusion` tells, for each single effect, how often which name came first; `nothing`, `unknown` and `failed` are
    names too. `by_effect` are the rates of `first_name` alone.
    """

    system: str
    cases: int
    rates: dict[str, Rate]
    by_effect: dict[str, float]
    smallest: dict[str, Smallest]
    confusion: dict[str, dict[str, int]]
    failures: dict[str, str]
    longest_s: float
    median_s: float
    longest_cpu_s: float


def score(system: str, results: Sequence[Result], sizes: Mapping[str, Sizes]) -> SystemScore:
    """Return the figures of one system's results; `sizes` are the ranges that were stated for its effects."""
    of = {kind: [result for result in results if result.truth.kind is kind] for kind in Kind}
    single, pair = of[Kind.SINGLE], of[Kind.PAIR]
    strange = of[Kind.OUTSIDE] + of[Kind.WITHHELD]
    rates = {
        "first_name": _rate("first_name", single, first_name),
        "first_two": _rate("first_two", single, first_two),
        "exact_pair": _rate("exact_pair", pair, exact_pair),
        "clean_nothing": _rate("clean_nothing", of[Kind.CLEAN], lambda result: _verdict_is(result, "nothing")),
        "outside_unknown": _rate("outside_unknown", strange, lambda result: _verdict_is(result, "unknown")),
        "interval": _rate("interval", single, in_interval),
        "interval_and_narrow": _rate("interval_and_narrow", single, in_narrow_interval),
        "every_interval": _rate("every_interval", single, lambda result: _whole(in_interval(result))),
        "share_of_oracle": _rate("share_of_oracle", [*single, *pair], share_of_oracle),
    }
    found: dict[str, list[tuple[float, bool]]] = defaultdict(list)
    for result in single:
        found[result.truth.causes[0].name].append((result.truth.causes[0].size, first_name(result) == 1.0))
    seconds = [result.seconds for result in results] or [0.0]
    return SystemScore(
        system=system,
        cases=len(results),
        rates=rates,
        by_effect={name: float(np.mean([right for _, right in of_it])) for name, of_it in sorted(found.items())},
        smallest={name: smallest_found(of_it, sizes.get(name)) for name, of_it in sorted(found.items())},
        confusion=confusion(single),
        failures={result.truth.case_name: result.failure for result in results if result.failure},
        longest_s=max(seconds),
        median_s=float(np.median(seconds)),
        longest_cpu_s=max((result.cpu_seconds for result in results), default=0.0),
    )


def first_name(result: Result) -> float:
    """Return 1 if the cause told first is the true one, or has it as a look-alike that fits as well."""
    told = _causes(result)
    return float(bool(told) and result.truth.causes[0].name in names(told[0]))


def first_two(result: Result) -> float:
    """Return 1 if one of the two causes told first is the true one, or has it as a look-alike that fits as well."""
    return float(any(result.truth.causes[0].name in names(cause) for cause in _causes(result)[:2]))


def exact_pair(result: Result) -> float:
    """Return 1 if exactly both causes are told, in either order."""
    told, true = _causes(result), [cause.name for cause in result.truth.causes]
    return float(
        len(told) == len(true)
        and any(
            all(name in names(cause) for name, cause in zip(order, told, strict=True)) for order in permutations(true)
        )
    )


def in_interval(result: Result) -> float | None:
    """Return the share of true parameters in their told intervals; None where the cause was not named by its name."""
    return _right_parameters(result, lambda true, _, low, high: low <= true <= high)


def in_narrow_interval(result: Result) -> float | None:
    """Return the share of true parameters that lie in intervals narrower than the value; None as above."""
    return _right_parameters(result, lambda true, value, low, high: low <= true <= high and high - low < abs(value))


def share_of_oracle(result: Result) -> float | None:
    """Return which share of the oracle's gain in squared held-out error was reached; None where it gains nothing."""
    oracle, errors = result.oracle, result.errors
    if oracle is None or oracle.before is None or oracle.after is None:
        return None
    possible = 1.0 - (oracle.after / oracle.before) ** 2
    if possible < _LEAST_TO_GAIN:
        return None
    if not _causes(result) or errors is None or errors.before is None or errors.after is None:
        return 0.0
    return float(np.clip((1.0 - (errors.after / errors.before) ** 2) / possible, 0.0, 1.0))


def names(cause: ToldCause) -> list[str]:
    """Return what a told cause stands for: its name and the look-alikes whose best fit is proven to be as good."""
    worse_by = {name: cause.evidence.get(f"worse_by.{name}") for name in cause.equivalents}
    as_good = [name for name, chi2 in worse_by.items() if chi2 is not None and chi2 < MOST_CHI2_OF_AN_EQUIVALENT]
    return [cause.name, *as_good]


def confusion(single: Iterable[Result]) -> dict[str, dict[str, int]]:
    """Return how often which name came first, by true effect."""
    table: dict[str, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    for result in single:
        told = "failed" if result.told is None else result.told.verdict
        true = result.truth.causes[0].name
        causes = _causes(result)
        if causes:
            told = true if true in names(causes[0]) else causes[0].name
        table[true][told] += 1
    return {true: dict(sorted(row.items(), key=lambda item: -item[1])) for true, row in sorted(table.items())}


def _rate(name: str, results: Sequence[Result], judge: Callable[[Result], float | None]) -> Rate:
    by_effect: dict[tuple[str, ...], list[float]] = defaultdict(list)
    for result in results:
        judged = judge(result)
        if judged is not None:
            by_effect[tuple(cause.name for cause in result.truth.causes)].append(judged)
    share = float(np.mean([np.mean(rates) for rates in by_effect.values()])) if by_effect else None
    return Rate(share, REQUIRED.get(name), sum(map(len, by_effect.values())))


def _causes(result: Result) -> list[ToldCause]:
    return result.told.causes if result.told is not None and result.told.verdict == "named" else []


def _verdict_is(result: Result, verdict: str) -> float:
    return float(result.told is not None and result.told.verdict == verdict)


def _right_parameters(result: Result, right: Callable[[float, float, float, float], bool]) -> float | None:
    """Return the share of the true cause's parameters that were told right; one that was not told is wrong."""
    true = result.truth.causes[0]
    told = next((cause for cause in _causes(result) if cause.name == true.name), None)
    if told is None or not true.parameters:
        return None

    def is_right(name: str, value: float) -> bool:
        quantity = told.parameters.get(name)
        if quantity is None or quantity.value is None or quantity.low is None or quantity.high is None:
            return False
        return right(value, quantity.value, quantity.low, quantity.high)

    return float(np.mean([is_right(name, value) for name, value in true.parameters.items()]))


def _whole(share: float | None) -> float | None:
    return None if share is None else float(share == 1.0)
