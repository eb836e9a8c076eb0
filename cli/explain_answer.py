"""What every `gaiteyes explain SYSTEM` does: fit, judge, write and print; the options that they share."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from inspect import Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cli.options import JsonFile

if TYPE_CHECKING:
    from discrepancy.explanation import Explanation
    from discrepancy.simulation import Simulation


@dataclass(frozen=True)
class Asked:
    """What a person asked for: the recording to fit, and the options of every such command."""

    recording: Path
    out: Annotated[Path, typer.Option(help="Folder for verdict, report, held-out data and extended model.")]
    also: Annotated[
        list[Path] | None,
        typer.Option(help="A further recording of the same system, fitted together with the first; may be repeated."),
    ] = None
    held_out: Annotated[
        list[Path] | None,
        typer.Option(
            help="Another recording to test on; may be repeated; by default the last 30 % of each fitted one."
        ),
    ] = None
    only: Annotated[str, typer.Option(help="Try only these effects, with commas.")] = ""
    without: Annotated[str, typer.Option(help="Leave these effects out of the library, with commas.")] = ""
    report: Annotated[bool, typer.Option(help="Draw report.html (extra lab).")] = True
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random resampling for intervals.")] = 1
    json: JsonFile = None


@dataclass(frozen=True)
class Loader:
    """What reads a recording, and the files of the simulation itself, which a report names beside the recordings."""

    read: "Callable[[Path], Simulation]"
    sources: tuple[Path, ...] = ()


def command(loader: Callable[..., Loader], recording: str) -> Callable[..., None]:
    """Return the command that explains a recording, told as `recording`.

    It takes the arguments of `loader`, which returns what reads a recording, then the recording and all of `Asked`.
    """
    own, shared = signature(loader).parameters, dict(signature(Asked).parameters)
    told = Annotated[Path, typer.Argument(help=recording)]
    shared["recording"] = shared["recording"].replace(annotation=told)

    def run(**given: Any) -> None:
        answer(loader(**{name: given[name] for name in own}), Asked(**{name: given[name] for name in shared}))

    run.__doc__ = loader.__doc__
    run.__signature__ = Signature([*own.values(), *shared.values()])  # type: ignore[attr-defined]  # typer reads it
    return run


def answer(loader: Loader, asked: Asked) -> None:
    """Explain what was asked, simulations coming from `loader`; write the results and print them."""
    from cli.console import check_writable, console
    from cli.progress import working
    from discrepancy import explain
    from discrepancy.recordings import check_different
    from discrepancy.report.output import check_report, write_report
    from discrepancy.restricted import check_names, without
    from discrepancy.verdict import to_json

    check_writable(asked.json)
    if asked.report:
        check_report()
    tried, left_out = _names(asked.only), _names(asked.without)
    fitted, held_out = [asked.recording, *(asked.also or [])], asked.held_out or []
    files = [*fitted, *held_out]
    check_different(files)
    with working("reading the recordings" if len(files) > 1 else "reading the recording") as now:
        first = loader.read(asked.recording)
        check_names("--only", tried, first)
        check_names("--without", left_out, first)
        every = [without(each, left_out) for each in (first, *(loader.read(path) for path in files[1:]))]
        now("searching for effects that the simulation lacks")
        fit, other = every[: len(fitted)], every[len(fitted) :]
        explanation = explain(fit, other, seed=asked.seed, only=tried, names=_short(files))
        now("writing the results")
        write_report(explanation, asked.out, report=asked.report, files=[*files, *loader.sources])
    if asked.json is not None:
        write(asked.json, to_json(explanation.verdict))
    _print(explanation)
    console.print(f"written to {asked.out}")


def write(path: Path, data: bytes) -> None:
    """Write a file; raises UserError where it cannot."""
    from messages.errors import UserError

    try:
        path.write_bytes(data)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error


def _short(files: Sequence[Path]) -> list[str]:
    """Return what tells the recordings apart: their own names, or the whole paths where two have the same."""
    names = [path.name for path in files]
    return names if len(set(names)) == len(names) else [str(path) for path in files]


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _print(explanation: "Explanation") -> None:
    from cli.console import console, table
    from discrepancy.report.wording import (
        headline,
        parameter_words,
        quantity_text,
        recording_row,
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
    if verdict.recordings:
        columns = ["recording", "", "error before", "after", "noise", "what is left"]
        table("Each recording by itself", columns, [recording_row(each) for each in verdict.recordings], words=True)
    for told in verdict.disagreements:
        console.print(f"the recordings disagree: {told}", highlight=False)
    if verdict.seen_above:
        console.print(f"would have been seen from: {seen_text(verdict)}")
    for note in explanation.notes:
        console.print(f"note: {note}")
    if verdict.next_experiment:
        console.print(f"next experiment: {verdict.next_experiment}")
