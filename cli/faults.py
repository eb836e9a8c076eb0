"""`gaiteyes faults`: the running daemon on the rig, one fault after the other and two at once."""

from pathlib import Path
from typing import Annotated

import typer

from cli.options import JsonFile


def faults(
    only: Annotated[str | None, typer.Option(help="Names of faults, or their beginnings, with commas.")] = None,
    pairs: Annotated[int, typer.Option(min=0, help="How many pairs of faults to add; none with --only.")] = 30,
    seed: Annotated[int, typer.Option(min=0, help="Draws the pairs, the unit and the gait.")] = 1,
    show: Annotated[bool, typer.Option("--list", help="Print all faults and stop.")] = False,
    file: Annotated[
        Path | None, typer.Option(help="Keep each trial as it ends in this file, and go on with what it lacks.")
    ] = None,
    log: Annotated[Path | None, typer.Option(help="Keep what the daemon logged in this file.")] = None,
    json: JsonFile = None,
) -> None:
    """Let the simulated hardware fail; measure what the service says.

    How soon each fault is flagged, and every wrong value.

    Exit codes: 1 a trial failed; 4 none did, but the host was too busy for some of them, whose figures are void.
    """
    from messages.extras import needs

    needs("gaiteyes faults", "skimage")

    import shutil
    import signal
    import tempfile
    import time

    import msgspec

    from cli.console import VOID, check_writable, console, table, write_json
    from lab.faults.campaign import Campaign, Trial
    from lab.faults.campaign_file import CampaignFile
    from lab.faults.catalogue import CATALOGUE, named
    from lab.faults.catalogue import pairs as drawn
    from lab.faults.claims import claims
    from lab.faults.daemon_under_test import SCENARIO, film_of_lap
    from lab.faults.report import Attempt, CampaignReport
    from lab.faults.tables import CLAIM_COLUMNS, COLUMNS, claim_row, line, listing, row
    from sim_rig.camera.film import film_file

    chosen = list(CATALOGUE.values()) if only is None else named(only)
    if show:
        for fault in chosen:
            console.print(listing(fault), soft_wrap=True)
        return
    check_writable(json)
    trials = [Trial((fault,)) for fault in chosen]
    if only is None:
        trials += [Trial(pair) for pair in drawn(pairs, seed)]
    kept = None if file is None else CampaignFile(file, seed, SCENARIO)
    attempts: list[Attempt] = [] if kept is None else kept.attempts
    left = [trial for trial in trials if kept is None or trial.name not in kept.done]
    console.print(f"{len(left)} of {len(trials)} trials to run, seed {seed}")
    began_s, done = time.monotonic(), 0

    def tell(attempt: Attempt) -> None:
        nonlocal done
        done += not attempt.trial.void
        if kept is None:
            attempts.append(attempt)
        else:
            kept.add(attempt)
        minutes = (time.monotonic() - began_s) / 60
        text = f"{done:3d}/{len(left)}  {minutes:4.1f} min  {line(attempt.trial)}"
        console.print(text, soft_wrap=True)

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # whoever ends it, nothing is left running
    with tempfile.TemporaryDirectory(prefix="gaiteyes-faults-") as folder, film_file() as path:
        if left:
            console.print("a lap of the walk is rendered first …")
        film = film_of_lap(seed, path) if left else None
        campaign = Campaign(seed, Path(folder), tell, film=film)
        try:
            campaign.run(left)
        finally:
            campaign.close()
            if log is not None and (Path(folder) / "daemon.log").exists():
                shutil.copyfile(Path(folder) / "daemon.log", log)
    report = CampaignReport.of(seed, SCENARIO, attempts)
    rows = list(claims(report))
    table("Faults", COLUMNS, [row(trial) for trial in report.trials])
    command = "gaiteyes faults" + (f" --pairs {pairs}" if only is None else f" --only {only}") + f" --seed {seed}"
    table(command, CLAIM_COLUMNS, [claim_row(claim) for claim in rows], words=True)
    if json is not None:
        facts = {"command": command, "claims": rows, "void": report.void}
        write_json(json, facts | msgspec.to_builtins(report))
    if report.void:
        console.print(f"Void, the host was too busy: {', '.join(report.void)}.", soft_wrap=True)
    if not report.passed:
        raise typer.Exit(1)
    if report.void:
        raise typer.Exit(VOID)
