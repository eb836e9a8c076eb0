"""`gaiteyes platform ankle`: the ankle's impedance over stance, from perturbed steps on the vibrating platform."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import JsonFile

if TYPE_CHECKING:
    from impedance.ankle.table import AnkleTable

ankle = typer.Typer(help="Identify the ankle's stiffness and damping over stance.", no_args_is_help=True)


@ankle.command()
def simulate(
    out: Annotated[Path, typer.Option(help="Folder to write the trial into.")],
    cycles: Annotated[int, typer.Option(min=1, max=500, help="Perturbed cycles.")] = 10,
    unperturbed: Annotated[int, typer.Option(min=0, max=500, help="Unperturbed cycles beside them.")] = 0,
    ramps: Annotated[bool, typer.Option("--ramps", help="One 2° ramp of 75 ms per cycle instead of random.")] = False,
    standing: Annotated[bool, typer.Option("--standing", help="Standing instead of walking.")] = False,
    slope_deg: Annotated[float, typer.Option(min=-10.0, max=10.0, help="Slope of the ground.")] = 0.0,
    snr_db: Annotated[
        float | None, typer.Option(help="Signal-to-noise ratio of the moment; by default the sensors' noise.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Draws the person, the steps and the noise.")] = 1,
) -> None:
    """Simulate a person on the platform; truth.toml beside the trial holds the true impedance."""
    from cli.progress import working
    from impedance.ankle.table import save_table
    from impedance.ankle.trial import Perturbation, save_trial
    from sim_rig.platform.ankle import AnkleNoise, measured, true_table, walk
    from sim_rig.platform.ankle_person import person

    kind = Perturbation.RAMP if ramps else Perturbation.RANDOM
    kinds = [kind] * cycles + [Perturbation.NONE] * unperturbed
    with working("simulating"):
        run = walk(person(seed, walks=not standing), kinds, seed, slope_deg)
    save_trial(out, measured(run, AnkleNoise(snr_db=snr_db), seed))
    save_table(out / "truth.toml", true_table(run))


@ankle.command("import")
def import_c3d(
    file: Annotated[Path, typer.Argument(help="The C3D file.")],
    layout: Annotated[Path, typer.Argument(help="A trial.toml with a table [c3d]; see docs/platform.md.")],
    out: Annotated[Path, typer.Option(help="Folder to write the trial into.")],
) -> None:
    """Bring a C3D file with events in as a trial of the ankle."""
    from cli.console import console
    from impedance.ankle.c3d import read_c3d_trial
    from impedance.ankle.trial import save_trial

    trial, notes = read_c3d_trial(file, layout)
    save_trial(out, trial)
    for note in notes:
        console.print(f"- {note}", highlight=False, markup=False)
    kinds = [kind.value for kind in trial.perturbation]
    told = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
    console.print(f"{len(kinds)} stances ({told}), written to {out}")


@ankle.command()
def identify(
    trial: Annotated[Path, typer.Argument(help="Folder with trial.toml, cycles.csv and events.csv.")],
    out: Annotated[Path, typer.Option(help="The file to write.")] = Path("ankle_impedance.toml"),
    plot: Annotated[Path | None, typer.Option(help="Draw the curves into this PNG.")] = None,
    html: Annotated[Path | None, typer.Option(help="Write the report into this HTML file.")] = None,
    json: JsonFile = None,
) -> None:
    """Identify stiffness, damping and inertia about both axes, with 95 % intervals."""
    from cli.console import check_writable, console, write_json
    from cli.progress import working
    from impedance.ankle.impedance import identify as identified
    from impedance.ankle.plot import draw
    from impedance.ankle.report import write_report
    from impedance.ankle.table import save_table, table_of
    from impedance.ankle.trial import load_trial

    check_writable(json)
    recorded = load_trial(trial)
    with working("identifying"):
        found = table_of(recorded, identified(recorded))
    save_table(out, found)
    _print(found)
    if plot is not None:
        draw(plot, found)
    if html is not None:
        write_report(html, found, [trial])
    if json is not None:
        write_json(json, found)
    console.print(f"written to {out}")


def _print(found: "AnkleTable") -> None:
    from cli.console import console, show
    from impedance.ankle.plot import AXES
    from impedance.ankle.report import axis_sentences, axis_table, delay_sentence

    for name, axis in zip(AXES, found.axes(), strict=True):
        show(axis_table(found, axis, name))
        for sentence in axis_sentences(axis):
            console.print(sentence)
    console.print(delay_sentence(found))
