"""The results of a court, which tests the finder on hidden effects, as rows to print and as a page in Markdown."""

from collections.abc import Sequence

from lab.court.ported import Count
from lab.court.score import Rate, SystemScore
from lab.court.smallest import Smallest

RATE_WORDS = {
    "first_name": "the first name is right",
    "first_two": "one of the first two names is right",
    "exact_pair": "of two effects, exactly both are named",
    "clean_nothing": "nothing hidden: nothing named",
    "outside_unknown": "effect not in the library: answer is unknown",
    "interval": "parameters within their 95 % intervals",
    "interval_and_narrow": "the same, and narrower than the value",
    "every_interval": "all parameters of a case within their intervals",
    "share_of_oracle": "held-out gain, as a share of that with the true causes given",
}
SMALLEST_COLUMNS = ("effect", "smallest size found in 95 %", "range of sizes", "unit", "found")
COUNT_COLUMNS = ("of all cases", "required", "found")
CONFUSION_COLUMNS = ("hidden effect", "named first, and how often")


def rate_columns(scores: Sequence[SystemScore]) -> list[str]:
    """Return the heading of the table of rates."""
    return ["average over effects", "required", *(score.system for score in scores)]


def rate_rows(scores: Sequence[SystemScore]) -> list[list[str]]:
    """Return a row for every rate, a column for every system."""
    rows = []
    for name, words in RATE_WORDS.items():
        of_systems = [score.rates[name] for score in scores]
        wanted = of_systems[0].wanted
        rows.append([words, "" if wanted is None else f"≥ {100.0 * wanted:.0f} %", *map(_rate, of_systems)])
    rows.append(["cases", "", *(str(score.cases) for score in scores)])
    rows.append(["time of a verdict: median, longest", "", *(f"{s.median_s:.1f}, {s.longest_s:.1f} s" for s in scores)])
    rows.append(["processor time of a verdict: longest", "", *(f"{s.longest_cpu_s:.1f} s" for s in scores)])
    return rows


def smallest_rows(score: SystemScore) -> list[list[str]]:
    """Return a row for every effect: the smallest size that is found in 95 % of cases."""
    return [[name, *_smallest(of_it)] for name, of_it in score.smallest.items()]


def confusion_rows(score: SystemScore) -> list[list[str]]:
    """Return a row for every hidden effect: what was named first, most often first."""
    return [
        [true, ", ".join(f"{name} {count}" for name, count in row.items())] for true, row in score.confusion.items()
    ]


def count_rows(found: Sequence[Count]) -> list[list[str]]:
    """Return a row for every count over all systems with ports."""
    rows = []
    for each in found:
        wanted = "" if each.wanted is None else f"{'≤' if each.at_most else '≥'} {100.0 * each.wanted:.0f} %"
        share = f" ({100.0 * each.k / each.n:.1f} %)" if each.n else ""
        rows.append([each.words, wanted, f"{each.k:g} of {each.n}{share}"])
    return rows


def markdown(scores: Sequence[SystemScore], seeds: dict[str, list[int]], with_ports: Sequence[Count] = ()) -> str:
    """Return the whole court as a page; `seeds` by system, which are known now that all is judged."""
    parts = ["# Results on hidden effects", ""]
    if with_ports:
        parts += [*_sheet(COUNT_COLUMNS, count_rows(with_ports)), ""]
    parts += _sheet(rate_columns(scores), rate_rows(scores))
    for score in scores:
        parts += ["", f"## {score.system}: smallest size found", "", *_sheet(SMALLEST_COLUMNS, smallest_rows(score))]
        parts += [
            "",
            f"## {score.system}: what was named for each hidden effect",
            "",
            *_sheet(CONFUSION_COLUMNS, confusion_rows(score)),
        ]
        if score.failures:
            parts += ["", f"## {score.system}: failures", ""]
            parts += [f"- {name}: {line}" for name, line in score.failures.items()]
        parts += ["", f"Seeds: {' '.join(map(str, seeds[score.system]))}"]
    return "\n".join(parts) + "\n"


def _rate(rate: Rate) -> str:
    return "–" if rate.share is None else f"{100.0 * rate.share:.1f} % of {rate.cases}"


def _smallest(found: Smallest) -> list[str]:
    size = f"{found.size:.3g}" if found.size is not None else "none"
    drawn = f"{found.low:g} to {found.high:g}" if found.low is not None else ""
    return [size, drawn, found.unit, f"{found.found} of {found.cases}"]


def _sheet(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    lines = (columns, ["---"] * len(columns), *rows)
    return [f"| {' | '.join(line)} |" for line in lines]
