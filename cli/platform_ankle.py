"""`gaiteyes platform ankle`: the ankle's impedance over stance, from perturbed steps on the vibrating platform."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import JsonFile

if TYPE_CHECKING:
    from impedance.ankle.table import AnkleTable
    from impedance.ankle.trial import AnkleTrial

DelayFrom = Annotated[
    Path | None,
    typer.Option(help="extended.toml of `explain platform`, or `platform identify --json`, of a known weight."),
]

ankle = typer.Typer(help="Identify the ankle's stiffness and damping over stance.", no_args_is_help=True)


@ankle.command()
def simulate(
    out: Annotated[Path, typer.Option(help="Folder to write the trial into.")],
    cycles: Annotated[int, typer.Option(min=1, max=500, help="Perturbed cycles.")] = 10,
    unperturbed: Annotated[int, typer.Option(min=0, max=500, help="Unperturbed cycles beside them.")] = 0,
    ramps: Annotated[bool, typer.Option("--ramps", help="One 2° ramp of 75 ms per cycle instead of random.")] = False,
    standing: Annotated[bool, typer.Option("--standing", help="Standing instead of walking.")] = False,
    shod: Annotated[
        bool, typer.Option("--shod", help="Shoe and heel pad below the foot, whose markers are seen too.")
    ] = False,
    mockup: Annotated[
        bool, typer.Option("--mockup", help="Spring and damper of known values instead of a person.")
    ] = False,
    stiffness: Annotated[
        float, typer.Option(min=20.0, max=1000.0, help="Of the mock-up about Z, N·m/rad; a third of it about X.")
    ] = 250.0,
    damping: Annotated[
        float, typer.Option(min=0.1, max=20.0, help="Of the mock-up about Z, N·m·s/rad; the same ratio about X.")
    ] = 1.5,
    delay_ms: Annotated[float, typer.Option(min=-5.0, max=5.0, help="The wrench is stamped late by this.")] = 0.0,
    slope_deg: Annotated[float, typer.Option(min=-10.0, max=10.0, help="Slope of the ground.")] = 0.0,
    snr_db: Annotated[
        float | None, typer.Option(help="Signal-to-noise ratio of the moment; by default the sensors' noise.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Draws the person, the steps and the noise.")] = 1,
) -> None:
    """Simulate a person, or a mock-up, on the platform; truth.toml beside the trial holds the true impedance."""
    from cli.progress import working
    from impedance.ankle.table import save_table
    from impedance.ankle.trial import Perturbation, save_trial
    from messages.errors import UserError
    from sim_rig.platform.ankle import walk
    from sim_rig.platform.ankle_measured import AnkleNoise, late, measured
    from sim_rig.platform.ankle_person import mockup as made
    from sim_rig.platform.ankle_person import person
    from sim_rig.platform.ankle_truth import true_table

    if mockup and standing:
        raise UserError("--mockup and --standing: nobody stands on a mock-up")
    kind = Perturbation.RAMP if ramps else Perturbation.RANDOM
    kinds = [kind] * cycles + [Perturbation.NONE] * unperturbed
    with working("simulating"):
        who = made(stiffness, damping, shod=shod) if mockup else person(seed, walks=not standing, shod=shod)
        run = walk(who, kinds, seed, slope_deg)
        heard = late(run, 1e-3 * delay_ms) if delay_ms else run
    save_trial(out, measured(heard, AnkleNoise(snr_db=snr_db), seed))
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
    delay_from: DelayFrom = None,
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

    check_writable(json)
    recorded = _recorded(trial, delay_from)
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


@ankle.command()
def validate(
    trial: Annotated[Path, typer.Argument(help="Folder of a trial of a mock-up, its trial.toml with [mockup].")],
    delay_from: DelayFrom = None,
    json: JsonFile = None,
) -> None:
    """Compare what is identified of a mock-up with its known values; exit code 1 where it is not within 2 and 5 %."""
    from cli.console import check_writable, table, write_json
    from cli.progress import working
    from impedance.ankle.impedance import identify as identified
    from impedance.ankle.validation import rows, validated

    check_writable(json)
    recorded = _recorded(trial, delay_from)
    with working("identifying"):
        every = validated(recorded, identified(recorded))
    columns = ["axis", "quantity", "known", "found, 95 %", "off", "allowed", ""]
    table(f"{trial}: mock-up against its known values", columns, rows(every))
    if json is not None:
        write_json(json, [{**asdict(each), "off_share": each.off_share, "holds": each.holds} for each in every])
    if not all(each.holds for each in every):
        raise typer.Exit(code=1)


@ankle.command()
def conditions(
    tables: Annotated[list[Path], typer.Argument(help="Files that `ankle identify` wrote, one per condition.")],
    out: Annotated[Path, typer.Option(help="The file to write.")] = Path("ankle_conditions.toml"),
) -> None:
    """Gather one subject's impedance by slope and manoeuvre into one file and one table."""
    from cli.console import console, table
    from impedance.ankle.conditions import COLUMNS, gathered, rows, save_conditions

    found = gathered(tables)
    save_conditions(out, found)
    table(f"Impedance of {found.condition[0].subject}'s ankle by condition", list(COLUMNS), rows(found))
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


def _recorded(folder: Path, delay_from: Path | None) -> "AnkleTrial":
    """Return the trial, with the wrench's delay that a known weight told in `delay_from`."""
    from impedance.ankle.inherited import read_delay, with_delay
    from impedance.ankle.trial import load_trial

    trial = load_trial(folder)
    return trial if delay_from is None else with_delay(trial, read_delay(delay_from))
