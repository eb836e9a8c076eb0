"""`gaiteyes platform tables`: the thesis's Tables 1 and 2, printed figures beside this simulation's."""

from typing import Annotated

import typer

from cli.options import JsonFile


def tables(
    draws: Annotated[int, typer.Option(min=2, help="Draws of measurement noise.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Draws the actuators' inputs and the noise.")] = 1,
    seconds: Annotated[float, typer.Option(min=2.0, max=600.0, help="Length of each run.")] = 60.0,
    ablations: Annotated[
        bool, typer.Option("--ablations", help="Show what each single cause changes, beside the printed anomalies.")
    ] = False,
    json: JsonFile = None,
) -> None:
    """Reproduce the thesis's Tables 1 and 2 with its own estimator, beside the printed figures.

    The simulated columns are at 40 Hz; "w/ noise" is the mean and deviation over the draws.
    """
    from cli.console import check_writable, table, write_json
    from cli.progress import progress
    from messages.extras import needs

    check_writable(json)
    needs("gaiteyes platform tables", "mujoco")
    if ablations:
        from lab.thesis.ablations import (
            ABLATIONS,
            FOOT_SHOWN,
            PLATE_SHOWN,
            effect_of,
            foot_row,
            plate_row,
            printed_effects,
        )
        from lab.thesis.study import Laboratory

        laboratory = Laboratory(seed, seconds)
        effects = [effect_of(ablation, laboratory, draws) for ablation in progress(ABLATIONS, "simulating each cause")]
        how = f"errors (kg, mm, g m²) by one cause at a time, {draws} draws, {seconds:g} s, seed {seed}"
        shown = [*printed_effects(), *effects]
        table(f"Foot: {how}", ["cause", *FOOT_SHOWN, "impossible"], map(foot_row, shown))
        table(f"Plate: {how}", ["cause", *PLATE_SHOWN], map(plate_row, shown))
        if json is not None:
            write_json(json, [effect.facts for effect in effects])
        return

    from lab.thesis.printed import FOOT, PLATE, RATES_HZ
    from lab.thesis.reproduced import ERROR_COLUMNS, error_rows, reproduced, value_columns, value_rows
    from lab.thesis.study import NOISE_FREE, Experiment, Laboratory, Treatment

    laboratory, usual = Laboratory(seed, seconds), Experiment()
    experiments = [
        laboratory.estimated(Experiment(update_hz=hz), Treatment(), 0) for hz in progress(RATES_HZ, "simulating")
    ]
    noisy = [laboratory.estimated(usual, Treatment(), draw) for draw in progress(range(draws), "identifying")]
    both = reproduced(experiments, noisy, laboratory.estimated(usual, NOISE_FREE, 0))
    for number, (body, printed, found) in enumerate(zip(("plate", "foot"), (PLATE, FOOT), both, strict=True), start=1):
        title = f"Table {number}, {body}"
        table(
            f"{title}: values, printed and simulated with one draw of noise",
            value_columns(printed),
            value_rows(printed, found),
        )
        table(
            f"{title}: errors in simulation, {draws} draws, {seconds:g} s, 40 Hz, seed {seed}",
            ERROR_COLUMNS,
            error_rows(printed, found),
        )
    if json is not None:
        write_json(json, {"seed": seed, "draws": draws, "plate": both[0].facts, "foot": both[1].facts})
