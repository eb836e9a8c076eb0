"""`gaiteyes explain tables`: which effect or pair of effects made the thesis's Tables 1 and 2."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import JsonFile, Workers

if TYPE_CHECKING:
    from lab.thesis.hypotheses import Sizes
    from lab.thesis.search import Candidate
    from lab.thesis.verdict import TablesVerdict

_SHOWN = 12


def tables(
    out: Annotated[Path, typer.Option(help="Folder for runs and estimates; one begun before is continued.")],
    seed: Annotated[int, typer.Option(min=0, help="Draws the actuators' inputs and the noise.")] = 1,
    seconds: Annotated[float, typer.Option(min=4.0, max=600.0, help="Length of each run.")] = 60.0,
    best: Annotated[int, typer.Option(min=1, help="Best pairs of either estimator that are simulated.")] = 16,
    random: Annotated[int, typer.Option(min=1, help="Random pairs that are simulated.")] = 20,
    flips: Annotated[int, typer.Option(min=19, help="Made-up tables that the best pair is compared on.")] = 200,
    workers: Workers = 2,
    json: JsonFile = None,
) -> None:
    """Ask which effect or pair of effects best reproduces the experimental columns of the thesis's Tables 1 and 2.

    Every cause is simulated through the thesis's own estimator at several sizes. Sizes are fitted on the 29 and 40 Hz
    columns; 67 Hz is predicted, and the plate must stay right.
    """
    from cli.console import check_writable, console, table, write_json
    from cli.progress import counted
    from messages.extras import needs

    check_writable(json)
    needs("gaiteyes explain tables", "mujoco")
    from lab.thesis.hypotheses import Study
    from lab.thesis.verdict import Effort, judged

    def shown(steps: "Iterable[Sizes]", count: int, what: str) -> None:
        for _ in counted(steps, count, what):
            pass

    found = judged(Study(out, seed, seconds), Effort(best, random, flips, workers), shown)
    columns = ["cause and its size", "J ≥ 0", "29, 40 Hz", "foot, 67 Hz", "plate", "Jx 0.0", "missed"]
    how = f"RMS misfit in tolerances, {seconds:g} s, seed {seed}"
    table(f"One cause: {how}", columns, [_row(c) for c in [found.base, *_once(found.singles)[:_SHOWN]]])
    table(f"Two causes: {how}", columns, [_row(c) for c in _once(found.pairs)[:_SHOWN]])
    table(f"Three causes: {how}", columns, [_row(c) for c in _once(found.triples)[:_SHOWN]])
    table(f"Two causes drawn at random: {how}", columns, [_row(c) for c in found.random[:_SHOWN]])
    table("The best, with the same sizes, other torque steps and other noise", columns, [_row(c) for c in found.again])
    _table_of_best(found)
    console.print(f"verdict: {found.verdict}", style="bold")
    for sentence in found.sentences:
        console.print(f"- {sentence}")
    if json is not None:
        write_json(json, found.facts)


def _once(candidates: "Iterable[Candidate]") -> "list[Candidate]":
    """Return the better of both estimators for each set of causes."""
    seen: dict[tuple[str, ...], Candidate] = {}
    for candidate in candidates:
        seen.setdefault(candidate.names, candidate)
    return list(seen.values())


def _row(candidate: "Candidate") -> list[str]:
    from lab.thesis.causes import CAUSES

    m = candidate.misfit
    return [
        "\n+ ".join(f"{name}: {size:.3g} {CAUSES[name].unit}".strip() for name, size in candidate.sizes.items())
        or "none",
        "yes" if candidate.bounded else "no",
        f"{m.fit:.2f}" if candidate.simulated else f"≈ {m.fit:.2f}",
        f"{m.foot_test:.2f}",
        f"{m.plate:.2f}",
        "yes" if m.pinned else "no",
        str(len(m.missed)),
    ]


def _table_of_best(found: "TablesVerdict") -> None:
    from cli.console import table
    from lab.thesis.hypotheses import CELLS, printed_cells, tolerances
    from lab.thesis.printed import RATES_HZ

    best = found.best
    printed, tolerance = printed_cells(), tolerances()
    here = printed + best.misfit.z * tolerance
    table(
        f"The best beside the printed figures: {' + '.join(best.names)}",
        ["", "tolerance", *(f"{hz} Hz {whose}" for hz in RATES_HZ for whose in ("printed", "here"))],
        [
            [name, f"{tolerance[k]:.2f}", *(f"{x:.2f}" for hz in range(3) for x in (printed[hz, k], here[hz, k]))]
            for k, name in enumerate(CELLS)
        ],
    )
