"""`gaiteyes explain own` and `practice`: anybody's simulation, and recordings to try the finder on."""

from pathlib import Path
from typing import Annotated

import typer

from cli.explain_answer import Loader


def own(
    function: Annotated[str, typer.Argument(help="MODULE:FUNCTION that makes the simulation from a table.")],
) -> Loader:
    """Your own simulation: a function of a table that returns it, found in the current folder."""
    from systems.own.function import function_of, simulation_of, source_of

    found = function_of(function)
    return Loader(lambda path: simulation_of(found, path), source_of(found))


def practice(
    system: Annotated[str, typer.Argument(help="pendulum, motor or tanks.")],
    out: Annotated[Path, typer.Option(help="Folder for both recordings and the simulation that lacks the effect.")],
    effect: Annotated[
        list[str] | None, typer.Option(help="EFFECT=VALUE, or EFFECT.PARAMETER=VALUE; may be given several times.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Draws inputs and noise.")] = 1,
) -> None:
    """Make recordings of an example with an effect that its simulation lacks, to try the finder on.

    Without --effect nothing is missing, and the effects that there are are listed.
    """
    from cli.console import console
    from systems.practice.recordings import FIT, HELD_OUT, effects_of, make

    hidden = make(system, dict(_assigned(text) for text in effect or ()), out, seed)
    told = ", ".join(f"{key} = {value:g}" for key, value in hidden.items()) or "no effect"
    console.print(f"{system} with {told}, seed {seed}: written to {out}")
    if not hidden:
        console.print(f"effects: {', '.join(effects_of(system))}")
    console.print(f"cd {out} && gaiteyes explain own {system}:simulation {FIT} --held-out {HELD_OUT} --out explained")


def _assigned(text: str) -> tuple[str, float]:
    from messages.errors import UserError

    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise UserError(f"--effect {text}: expected EFFECT=VALUE, the value a number in SI units") from None
