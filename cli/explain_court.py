"""`gaiteyes explain court`: the finder tested on recordings with hidden effects, which it gets as files alone."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import JsonFile, Workers

if TYPE_CHECKING:
    from lab.court.ported import Count
    from lab.court.score import SystemScore


def court(
    systems: Annotated[
        str,
        typer.Option(
            help="Which systems, with commas: platform, imu, wearable; or pendulum, motor, quarter_car, "
            "two_tanks, heater, handed over with ports."
        ),
    ] = "platform,imu,wearable",
    cases: Annotated[
        int | None,
        typer.Option(min=1, help="Cases of each system; by default 120 or more, four of every effect; with ports 44."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of the results; what is there already is not run again.")] = Path(
        "court"
    ),
    workers: Workers = 2,
    scheduler: Annotated[
        str | None, typer.Option(help="A dask scheduler's address: use its workers instead of this machine's.")
    ] = None,
    development: Annotated[
        bool, typer.Option("--development", help="Take the recorded seeds that development may look at.")
    ] = False,
    json: JsonFile = None,
) -> None:
    """Test the finder on hidden effects. Their random seeds come from the operating system and are shown afterwards."""
    from messages.extras import needs

    needs("gaiteyes explain court", "mujoco")
    needs("gaiteyes explain court", "skimage")
    if scheduler is not None:
        needs("--scheduler", "distributed")

    from cli.console import check_writable, console, write_json
    from lab.court.plan import PORTED, SYSTEMS, hidden_system, slots
    from lab.court.ported import counts
    from lab.court.result import Result
    from lab.court.run import check_same_court, executor, results, run
    from lab.court.score import score
    from lab.court.tables import markdown
    from messages.errors import UserError

    check_writable(json)
    chosen = [name.strip() for name in systems.split(",")]
    for name in chosen:
        if name not in (*SYSTEMS, *PORTED):
            raise UserError(f"--systems {name}: no such system; expected {', '.join((*SYSTEMS, *PORTED))}")
    asked = {name: slots(name, hidden_system(name), cases) for name in chosen}
    every = [slot for of_system in asked.values() for slot in of_system]
    check_same_court(every, out, development=development)
    done = sum((out / slot.file_name).exists() for slot in every)
    console.print(f"{len(every)} cases, {done} of them finished before; results in {out}")

    def tell(result: Result) -> None:
        nonlocal done
        done += 1
        console.print(f"{done:4d}/{len(every)}  {result.line}", soft_wrap=True)

    with executor(workers, scheduler) as pool:
        run(every, out, pool, development=development, tell=tell)
    found = {name: results(of_system, out) for name, of_system in asked.items()}
    scores = [score(name, found[name], hidden_system(name).SIZES) for name in chosen]
    seeds = {name: [result.truth.seed for result in found[name]] for name in chosen}
    with_ports = counts([result for name in chosen if name in PORTED for result in found[name]])
    _print(scores, with_ports)
    (out / "court.md").write_text(markdown(scores, seeds, with_ports), encoding="utf-8")
    told = {"scores": scores, "seeds": seeds, "with_ports": with_ports}
    for path in (out / "court.json", json):
        if path is not None:
            write_json(path, told)


def _print(scores: "list[SystemScore]", with_ports: "list[Count]") -> None:
    from cli.console import table
    from lab.court.tables import (
        CONFUSION_COLUMNS,
        COUNT_COLUMNS,
        SMALLEST_COLUMNS,
        confusion_rows,
        count_rows,
        rate_columns,
        rate_rows,
        smallest_rows,
    )

    if with_ports:
        table("Systems with ports, together", COUNT_COLUMNS, count_rows(with_ports))
    table("Results on hidden effects", rate_columns(scores), rate_rows(scores))
    for score in scores:
        table(f"{score.system}: smallest size found", SMALLEST_COLUMNS, smallest_rows(score))
        table(
            f"{score.system}: what was named for each hidden effect",
            CONFUSION_COLUMNS,
            confusion_rows(score),
            words=True,
        )
