"""`gaiteyes evaluate`: accuracy against known truth, faster than real time."""

from pathlib import Path
from typing import Annotated

import typer

evaluate = typer.Typer(help="Accuracy against known truth.", no_args_is_help=True)

JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the same facts for a program.")]


@evaluate.command()
def motorcycle(json: JsonFile = None) -> None:
    """A real stereo photograph: the floor as this project measures it, beside the floor in its true disparity."""
    from messages.extras import needs

    needs("gaiteyes evaluate motorcycle", "skimage")

    from cli.console import table, write_json
    from lab.evaluation.real_pair import compare_floor, load

    found = compare_floor(load())
    table(
        "Concrete floor of the Middlebury 2014 Motorcycle pair (741×500)",
        ["", "measured", "true disparity", "difference"],
        [
            ["pitch", f"{found.pitch_deg:.3f}°", f"{found.true_pitch_deg:.3f}°", f"{found.pitch_error_deg:+.3f}°"],
            ["height", f"{found.height_m:.4f} m", f"{found.true_height_m:.4f} m", f"{found.height_error_mm:+.1f} mm"],
            ["angle between the planes", "", "", f"{found.angle_error_deg:.3f}°"],
        ],
    )
    if json is not None:
        write_json(json, found)


@evaluate.command()
def rig(
    seeds: Annotated[str, typer.Option(help="Simulated units, one walk each: 1,2,5 or 1-8.")] = "1-4",
    seconds: Annotated[float, typer.Option(min=5.0, help="Length of each walk.")] = 60.0,
    scenario: Annotated[str, typer.Option(help="What is walked on; see `gaiteyes demo --help`.")] = "mixed",
    camera: Annotated[str, typer.Option(help="The wearer's camera: stereo or depth.")] = "stereo",
    perfect_calibration: Annotated[
        bool, typer.Option(help="Calibration without its usual errors; results say so.")
    ] = False,
    json: JsonFile = None,
) -> None:
    """The simulated wearer offline: slope and height error on each kind of ground, for several units."""
    from messages.extras import needs

    needs("gaiteyes evaluate rig", "skimage")

    from cli.console import check_writable, progress, score_table, seed_list, write_json
    from lab.evaluation.offline import score_walk
    from lab.evaluation.score import Scoreboard

    check_writable(json)
    boards = {}
    for seed in progress(seed_list(seeds), "walking"):
        boards[seed] = score_walk(seed, scenario, seconds, perfect_calibration=perfect_calibration, camera=camera)
    together = Scoreboard()
    for seed, board in boards.items():
        together.take(board)
        score_table(f"unit {seed}, {scenario}, {seconds:g} s", board.summary())
    label = "perfect calibration" if perfect_calibration else "calibration with its stated residual"
    if camera != "stereo":
        label = f"{camera} camera, {label}"
    score_table(f"all units together, {label}", together.summary())
    if json is not None:
        units = {str(seed): board.summary() for seed, board in boards.items()}
        write_json(json, {"calibration": label, "units": units, "together": together.summary()})
