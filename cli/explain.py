"""`gaiteyes explain`: what a simulation gets wrong in a recording, why, and what the extended simulation gains."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.explain_answer import Loader, command, write
from cli.explain_court import court
from cli.explain_effects import effects
from cli.explain_own import own, practice
from cli.explain_tables import tables

if TYPE_CHECKING:
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
explain.command("own")(command(own, "CSV file of the recording to fit."))
explain.command()(practice)


def _of_system(system: str) -> Callable[..., None]:
    return command(lambda: Loader(partial(_loaded, system)), "Folder of the recording to fit.")


for _system, _told in _SYSTEMS.items():
    explain.command(_system, help=_told)(_of_system(_system))


@explain.command()
def simulate(
    system: Annotated[str, typer.Argument(help="platform, imu, wearable, or your own MODULE:FUNCTION.")],
    recording: Annotated[Path, typer.Argument(help="The recording whose inputs drive the simulation.")],
    extended: Annotated[Path, typer.Argument(help="extended.toml of an explanation.")],
    out: Annotated[Path, typer.Option(help="CSV file to write: t_s and, per channel, measured, base, extended.")],
) -> None:
    """Simulate a recording with an extended model, beside the base model at the same parameters of its own."""
    from cli.console import console
    from discrepancy.report.extended import load_extended, with_constructed
    from discrepancy.report.output import beside_text
    from discrepancy.values import predicted
    from messages.errors import UserError

    if ":" in system:
        from systems.own.function import function_of, simulation_of

        loaded = simulation_of(function_of(system), recording)
    elif system in _SYSTEMS:
        loaded = _loaded(system, recording)
    else:
        raise UserError(f"{system}: no such system; expected {', '.join(_SYSTEMS)} or MODULE:FUNCTION")
    simulation = with_constructed(extended, loaded)
    values = load_extended(extended, simulation)
    own = {parameter.name for parameter in simulation.parameters}
    base = {name: value for name, value in values.items() if name in own}
    text = beside_text(simulation.channels, predicted(simulation, base), predicted(simulation, values))
    write(out, text.encode())
    console.print(f"written to {out}")


def _loaded(system: str, folder: Path) -> "Simulation":
    from importlib import import_module

    from messages.errors import UserError

    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder")
    simulation: Simulation = import_module(f"systems.{system}").load(folder)
    return simulation
