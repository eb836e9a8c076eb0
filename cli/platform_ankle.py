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


@ankle.command()
def identify(
    trial: Annotated[Path, typer.Argument(help="Folder with trial.toml, cycles.csv and events.csv.")],
    out: Annotated[Path, typer.Option(help="The file to write.")] = Path("ankle_impedance.toml"),
    plot: Annotated[Path | None, typer.Option(help="Draw the curves into this PNG.")] = None,
    json: JsonFile = None,
) -> None:
    """Identify stiffness, damping and inertia about both axes, with 95 % intervals."""
    from cli.console import check_writable, console, write_json
    from cli.progress import working
    from impedance.ankle.impedance import identify as identified
    from impedance.ankle.plot import draw
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
    if json is not None:
        write_json(json, found)
    console.print(f"written to {out}")


def _print(found: "AnkleTable") -> None:
    from cli.console import console, table

    for name, axis in zip(("dorsi-plantarflexion", "inversion-eversion"), found.axes(), strict=True):
        curves = [
            list(zip(*columns, strict=True))
            for columns in (
                (axis.stiffness_nm_per_rad, axis.stiffness_nm_per_rad_low, axis.stiffness_nm_per_rad_high),
                (axis.damping_nms_per_rad, axis.damping_nms_per_rad_low, axis.damping_nms_per_rad_high),
            )
        ]
        rows = [
            [f"{stance:.1f} %", f"{k:.1f}", f"{k_low:.1f} to {k_high:.1f}", f"{b:.3f}", f"{b_low:.3f} to {b_high:.3f}"]
            for stance, (k, k_low, k_high), (b, b_low, b_high) in zip(found.stance_percent, *curves, strict=True)
        ]
        table(name, ["stance", "N·m/rad", "95 %", "N·m·s/rad", "95 %"], rows[:: max(1, len(rows) // 14)])
        console.print(
            f"foot about the ankle: {axis.foot_inertia_kgm2:.4f} kg m², 95 % "
            f"{axis.foot_inertia_kgm2_low:.4f} to {axis.foot_inertia_kgm2_high:.4f}"
        )
        for reason in axis.not_identifiable:
            console.print(f"not identifiable: {reason}")
