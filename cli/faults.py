"""`gaiteyes faults`: the running daemon on the rig, one fault after the other and two at once."""

from pathlib import Path
from typing import Annotated

import typer


def faults(
    only: Annotated[str | None, typer.Option(help="Names of faults, or their beginnings, with commas.")] = None,
    pairs: Annotated[int, typer.Option(min=0, help="How many pairs of faults to add; none with --only.")] = 30,
    seed: Annotated[int, typer.Option(min=0, help="Draws the pairs, the unit and the gait.")] = 1,
    show: Annotated[bool, typer.Option("--list", help="Print all faults and stop.")] = False,
    log: Annotated[Path | None, typer.Option(help="Keep what the daemon logged in this file.")] = None,
    json: Annotated[Path | None, typer.Option(help="Write all results for a program.")] = None,
) -> None:
    """Inject faults into the daemon's simulated hardware; measure how soon each is flagged, and every wrong value."""
    from messages.extras import needs

    needs("gaiteyes faults", "skimage")

    import shutil
    import signal
    import tempfile

    from cli.console import check_writable, console, table, write_json
    from lab.faults.campaign import Campaign, Trial
    from lab.faults.catalogue import CATALOGUE, named
    from lab.faults.catalogue import pairs as drawn
    from lab.faults.report import TrialReport
    from lab.faults.tables import COLUMNS, line, listing, row, summary

    chosen = list(CATALOGUE.values()) if only is None else named(only)
    if show:
        for fault in chosen:
            console.print(listing(fault), highlight=False, soft_wrap=True)
        return
    check_writable(json)
    trials = [Trial((fault,)) for fault in chosen]
    if only is None:
        trials += [Trial(pair) for pair in drawn(pairs, seed)]
    console.print(f"{len(trials)} trials, seed {seed}")
    done = 0

    def tell(report: TrialReport) -> None:
        nonlocal done
        done += 1
        console.print(f"{done:3d}/{len(trials)}  {line(report)}", highlight=False, soft_wrap=True)

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # whoever ends it, nothing is left running
    with tempfile.TemporaryDirectory(prefix="gaiteyes-faults-") as folder:
        campaign = Campaign(seed, Path(folder), tell)
        try:
            report = campaign.run(trials)
        finally:
            campaign.close()
            if log is not None and (Path(folder) / "daemon.log").exists():
                shutil.copyfile(Path(folder) / "daemon.log", log)
    table("Faults", COLUMNS, [row(trial) for trial in report.trials])
    table("Campaign", ["", ""], summary(report))
    if json is not None:
        write_json(json, report)
    if not report.passed:
        raise typer.Exit(1)
