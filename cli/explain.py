"""`gaiteyes explain`: what a simulation gets wrong in a recording, why, and what the extended simulation gains."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.explain_court import court
from cli.explain_effects import effects
from cli.explain_tables import tables
from cli.options import JsonFile

if TYPE_CHECKING:
    from discrepancy.explanation import Explanation
    from discrepancy.simulation import Simulation

_SYSTEMS = {
    "platform": "A recording of the vibrating platform: motion, force plate.",
    "imu": "An IMU beside a reference motion: imu.csv, reference.csv.",
    "wearable": "A wearable's recording beside its ground: MCAP, ground.csv.",
}

explain = typer.Typer(
    help="Find what a simulation gets wrong in a recording, and why.",
    no_args_is_help=True,
)
explain.command()(court)
explain.command()(tables)
explain.command()(effects)


def _command(system: str) -> Callable[..., None]:
    def recording(
        recording: Annotated[Path, typer.Argument(help="Folder of the recording to fit.")],
        out: Annotated[Path, typer.Option(help="Folder for verdict, report, held-out data and extended model.")],
        held_out: Annotated[
            Path | None, typer.Option(help="Another recording to test on; by default the last 30 % of the first.")
        ] = None,
        only: Annotated[str, typer.Option(help="Try only these effects, with commas.")] = "",
        without: Annotated[str, typer.Option(help="Leave these effects out of the library, with commas.")] = "",
        report: Annotated[bool, typer.Option(help="Draw report.html (extra lab).")] = True,
        seed: Annotated[int, typer.Option(min=0, help="Seed of the random resampling for intervals.")] = 1,
        json: JsonFile = None,
    ) -> None:
        from cli.console import check_writable, console
        from cli.progress import working
        from discrepancy import explain as explained
        from discrepancy.report.output import check_report, write_report
        from discrepancy.restricted import check_names
        from discrepancy.restricted import without as restricted
        from discrepancy.verdict import to_json

        check_writable(json)
        if report:
            check_report()
        tried, left_out = _names(only), _names(without)
        with working("reading the recording") as now:
            fit = _loaded(system, recording)
            check_names("--only", tried, fit)
            check_names("--without", left_out, fit)
            other = None if held_out is None else restricted(_loaded(system, held_out), left_out)
            now("searching for effects that the simulation lacks")
            explanation = explained(restricted(fit, left_out), other, seed=seed, only=tried)
            now("writing the results")
            files = [path for path in (recording, held_out) if path is not None]
            write_report(explanation, out, report=report, files=files)
        if json is not None:
            _write(json, to_json(explanation.verdict))
        _print(explanation)
        console.print(f"written to {out}")

    recording.__doc__ = _SYSTEMS[system]
    return recording


for _system in _SYSTEMS:
    explain.command(_system)(_command(_system))


@explain.command()
def simulate(
    system: Annotated[str, typer.Argument(help="platform, imu or wearable.")],
    recording: Annotated[Path, typer.Argument(help="Folder of the recording whose inputs drive the simulation.")],
    extended: Annotated[Path, typer.Argument(help="extended.toml of an explanation.")],
    out: Annotated[Path, typer.Option(help="CSV file to write: t_s and, per channel, measured, base, extended.")],
) -> None:
    """Simulate a recording with an extended model, beside the base model at the same parameters of its own."""
    from cli.console import console
    from discrepancy.report.extended import load_extended
    from discrepancy.report.output import beside_text
    from discrepancy.values import predicted
    from messages.errors import UserError

    if system not in _SYSTEMS:
        raise UserError(f"{system}: no such system; expected {', '.join(_SYSTEMS)}")
    simulation = _loaded(system, recording)
    values = load_extended(extended, simulation)
    own = {parameter.name for parameter in simulation.parameters}
    base = {name: value for name, value in values.items() if name in own}
    text = beside_text(simulation.channels, predicted(simulation, base), predicted(simulation, values))
    _write(out, text.encode())
    console.print(f"written to {out}")


def _loaded(system: str, folder: Path) -> "Simulation":
    from importlib import import_module

    from messages.errors import UserError

    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder")
    simulation: Simulation = import_module(f"systems.{system}").load(folder)
    return simulation


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _write(path: Path, data: bytes) -> None:
    from messages.errors import UserError

    try:
        path.write_bytes(data)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error


def _print(explanation: "Explanation") -> None:
    from cli.console import console, table
    from discrepancy.report.wording import (
        headline,
        parameter_words,
        quantity_text,
        removed_text,
        seen_text,
        share_text,
        words,
    )

    verdict, gain = explanation.verdict, explanation.verdict.gain
    console.print(headline(verdict), style="bold")
    rows = [
        [words(cause.name), parameter_words(name), *quantity_text(quantity)]
        for cause in verdict.causes
        for name, quantity in cause.parameters.items()
    ]
    if rows:
        table("Causes", ["cause", "parameter", "value", "95 %", "unit"], rows)
    for effect in explanation.causes:
        console.print(f"- {words(effect.name)}: {effect.explanation} {effect.remedy}")
    told = f"; {removed_text(verdict)}" if verdict.causes else ""
    console.print(
        f"held-out error {share_text(gain.held_out_nrmse_before)} → {share_text(gain.held_out_nrmse_after)}, noise "
        f"{share_text(gain.noise_floor_nrmse)}{'' if verdict.noise_from else ' (estimated)'}{told}",
        highlight=False,
    )
    if verdict.seen_above:
        console.print(f"would have been seen from: {seen_text(verdict)}")
    for note in explanation.notes:
        console.print(f"note: {note}")
    if verdict.next_experiment:
        console.print(f"next experiment: {verdict.next_experiment}")
