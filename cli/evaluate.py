"""`gaiteyes evaluate`: accuracy against known truth, faster than real time."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import JsonFile

if TYPE_CHECKING:
    from lab.evaluation.causes.ledger import Ledger
    from reports.content import Table

evaluate = typer.Typer(help="Accuracy against known truth.", no_args_is_help=True)

HtmlFile = Annotated[Path | None, typer.Option("--html", help="Write the report into this HTML file.")]
PlotFile = Annotated[Path | None, typer.Option("--plot", help="Draw the causes; the ending chooses the format.")]
Recording = Annotated[
    Path | None, typer.Argument(help="A recording with truth instead: of the rig, or a folder in the ASL layout.")
]
Seeds = Annotated[str, typer.Option(help="Simulated units: 1,2,5 or 1-8.")]
Camera = Annotated[str, typer.Option(help="The wearer's camera: stereo or depth.")]


@evaluate.command()
def motorcycle(html: HtmlFile = None, json: JsonFile = None) -> None:
    """A real stereo photograph: the floor as this project measures it, beside the floor in its true disparity."""
    from messages.extras import needs

    needs("gaiteyes evaluate motorcycle", "skimage")

    from cli.console import check_writable, show, write_json
    from lab.evaluation.real_pair import compare_floor, load
    from reports.content import Table

    _check_report(html)
    check_writable(json)
    found = compare_floor(load())
    sheet = Table(
        "Concrete floor of the Middlebury 2014 Motorcycle pair (741×500)",
        ["", "measured", "true disparity", "difference"],
        [
            ["pitch", f"{found.pitch_deg:.3f}°", f"{found.true_pitch_deg:.3f}°", f"{found.pitch_error_deg:+.3f}°"],
            ["height", f"{found.height_m:.4f} m", f"{found.true_height_m:.4f} m", f"{found.height_error_mm:+.1f} mm"],
            ["angle between the planes", "", "", f"{found.angle_error_deg:.3f}°"],
        ],
    )
    show(sheet)
    _write_report(html, [sheet], [])
    if json is not None:
        write_json(json, found)


@evaluate.command()
def rig(
    seeds: Annotated[str, typer.Option(help="Simulated units, one walk each: 1,2,5 or 1-8.")] = "1-4",
    seconds: Annotated[float, typer.Option(min=5.0, help="Length of each walk.")] = 60.0,
    scenario: Annotated[
        str, typer.Option(help="What is walked on, as for `gaiteyes demo`; several such as level,ramps, or all.")
    ] = "mixed",
    camera: Annotated[str, typer.Option(help="The wearer's camera: stereo or depth.")] = "stereo",
    perfect_calibration: Annotated[
        bool, typer.Option(help="Calibration without its usual errors; results say so.")
    ] = False,
    html: HtmlFile = None,
    json: JsonFile = None,
) -> None:
    """The simulated wearer offline: slope and height error of several units, on each kind of ground or by scenario."""
    from messages.extras import needs

    needs("gaiteyes evaluate rig", "skimage")

    from cli.console import check_writable, score_table, seed_list, show, write_json
    from cli.progress import progress
    from lab.evaluation.offline import score_walk
    from lab.evaluation.score import Scoreboard
    from reports.content import Table
    from sim_rig.walk.scenario import scenario_names

    _check_report(html)
    check_writable(json)
    names, units = scenario_names(scenario), seed_list(seeds)
    walks = [(name, seed) for name in names for seed in units]
    boards: dict[str, dict[str, Scoreboard]] = {name: {} for name in names}
    together = {name: Scoreboard() for name in names}
    sheets: list[Table] = []
    for name, seed in progress(walks, "walking"):
        board = score_walk(seed, name, seconds, perfect_calibration=perfect_calibration, camera=camera)
        boards[name][str(seed)] = board
        together[name].take(board)
        if len(names) == 1:
            sheets.append(score_table(f"unit {seed}, {name}, {seconds:g} s", board.summary()))
            show(sheets[-1])
    label = "perfect calibration" if perfect_calibration else "calibration with its stated residual"
    if camera != "stereo":
        label = f"{camera} camera, {label}"
    summaries = {name: board.summary() for name, board in together.items()}
    if len(names) == 1:
        sheets.append(score_table(f"all units together, {label}", summaries[names[0]]))
    else:
        by_scenario = {name: found["all"] for name, found in summaries.items()}
        sheets.append(score_table(f"all units together, {label}", by_scenario, by="scenario"))
    show(sheets[-1])
    _write_report(html, [sheets[-1], *sheets[:-1]], [])
    if json is not None:
        scores = {
            name: {"units": {unit: board.summary() for unit, board in boards[name].items()}, "together": found}
            for name, found in summaries.items()
        }
        write_json(json, {"calibration": label, "scenarios": scores})


@evaluate.command()
def attitude(
    folder: Annotated[Path, typer.Argument(help="Logs: NAME_imu.csv with NAME_truth.csv (also .gz), or BROAD's npz.")],
    level_truth: Annotated[
        bool, typer.Option("--level-truth", help="Fit the truth's vertical to its velocities and the accelerometer.")
    ] = False,
    html: HtmlFile = None,
    json: JsonFile = None,
) -> None:
    """Logs of an IMU beside their truth: inclination error of the attitude filter, and of VQF, log by log."""
    from cli.console import check_writable, show, write_json
    from cli.evaluate_tables import attitude_table
    from cli.progress import progress
    from lab.evaluation.imu_logs.log import read_logs
    from lab.evaluation.imu_logs.score import judge, together

    _check_report(html)
    check_writable(json)
    trials = [judge(log, level=level_truth) for log in progress(list(read_logs(folder)), "filtering")]
    scores, pooled = [trial.score for trial in trials], together(trials)
    sheet = attitude_table(folder.resolve().name, scores, pooled)
    show(sheet)
    _write_report(html, [sheet], [folder])
    if json is not None:
        write_json(json, {"trials": scores, "together": pooled})


@evaluate.command()
def static(
    recording: Recording = None,
    seeds: Seeds = "1-4",
    slopes: Annotated[str, typer.Option(help="Ramps that each unit stands on, degrees.")] = "-8,0,8",
    seconds: Annotated[float, typer.Option(min=2.0, help="Length of each stand.")] = 4.0,
    camera: Camera = "stereo",
    plot: PlotFile = None,
    html: HtmlFile = None,
    json: JsonFile = None,
) -> None:
    """The camera still before ramps: errors split into IMU bias, orientation, depth and camera-IMU extrinsic."""
    from lab.evaluation.causes import rig as on_rig
    from lab.evaluation.causes.ledger import Ledger

    slopes_deg = _slopes(slopes)

    def stand(seed: int, ledger: Ledger) -> None:
        on_rig.static(seed, slopes_deg, seconds, camera, ledger)

    title = f"Standing on {slopes}°, {seconds:g} s each, {camera} camera, units {seeds}"
    _split_by_cause(title, recording, seeds, camera, on_rig.STATIC, stand, plot, html, json)


@evaluate.command()
def walking(
    recording: Recording = None,
    seeds: Seeds = "1-4",
    seconds: Annotated[float, typer.Option(min=5.0, help="Length of each walk.")] = 15.0,
    scenario: Annotated[str, typer.Option(help="What is walked on; see `gaiteyes demo --help`.")] = "mixed",
    camera: Camera = "stereo",
    plot: PlotFile = None,
    html: HtmlFile = None,
    json: JsonFile = None,
) -> None:
    """The camera on a walk: errors split as by `static`, and into blur and synchronisation."""
    from lab.evaluation.causes import rig as on_rig
    from lab.evaluation.causes.ledger import Ledger
    from sim_rig.walk.scenario import scenario as known_scenario

    known_scenario(scenario)

    def walk(seed: int, ledger: Ledger) -> None:
        on_rig.walking(seed, scenario, seconds, camera, ledger)

    title = f"Walking, {scenario}, {seconds:g} s, {camera} camera, units {seeds}"
    _split_by_cause(title, recording, seeds, camera, on_rig.WALKING, walk, plot, html, json)


def _split_by_cause(
    title: str,
    recording: Path | None,
    seeds: str,
    camera: str,
    causes: dict[str, str],
    run: "Callable[[int, Ledger], None]",
    plot: Path | None,
    html: Path | None,
    json: Path | None,
) -> None:
    """Run every unit, or replay the recording, and tell what each cause makes of the errors."""
    import cv2

    from cli.console import check_writable, console, seed_list, show, write_json
    from cli.evaluate_tables import cause_table, explanation
    from cli.progress import progress, working
    from lab.evaluation.causes.ledger import Ledger
    from lab.evaluation.causes.plot import draw, drawn
    from lab.evaluation.causes.recorded import split
    from lab.evaluation.offline import known_camera
    from messages.extras import needs

    _check_report(html)
    check_writable(json)
    if plot is not None:
        needs("--plot", "matplotlib")
    cv2.setNumThreads(1)
    facts: dict[str, object] = {}
    if recording is None:
        needs("gaiteyes evaluate", "skimage")
        known_camera(camera)
        ledger = Ledger(causes)
        for seed in progress(seed_list(seeds), "measuring"):
            run(seed, ledger)
    else:
        title = str(recording)
        with working("replaying"):
            ledger, explained = split(recording)
        facts["explained"] = explained
    scores = ledger.scores()
    sheet = cause_table(title, scores)
    show(sheet)
    sentences = [] if recording is None else [explanation(explained)]
    for sentence in sentences:
        console.print(sentence)
    if plot is not None:
        draw(plot, title, scores)
    if html is not None:
        _write_report(html, [sheet], [] if recording is None else [recording], sentences, drawn(scores))
    if json is not None:
        write_json(json, {**facts, "causes": scores})


def _check_report(html: Path | None) -> None:
    """Raise UserError now, before the long work, if the report could not be written."""
    from cli.console import check_writable
    from reports.page import check_page

    if html is not None:
        check_page("a report (--html)")
        check_writable(html, "--html")


def _write_report(
    html: Path | None,
    sheets: "Sequence[Table]",
    files: Sequence[Path],
    sentences: Sequence[str] = (),
    drawings: Sequence[str] = (),
) -> None:
    """Write the tables that were printed, the first with what else there is to say, as a page."""
    from reports.content import Section
    from reports.page import write_sections

    if html is None:
        return
    first, *others = sheets
    sections = [
        Section(first.title, sentences, replace(first, title=""), drawings),
        *(Section(sheet.title, table=replace(sheet, title="")) for sheet in others),
    ]
    write_sections(html, "GaitEyes: accuracy against known truth", "Estimates against known truth", sections, files)


def _slopes(text: str) -> list[float]:
    """Return the slopes in degrees; raises UserError for anything else, or beyond ±15°."""
    from messages.errors import UserError

    try:
        slopes_deg = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise UserError(f"--slopes {text}: expected degrees such as -8,0,8") from error
    if not all(-_STEEPEST_DEG <= slope <= _STEEPEST_DEG for slope in slopes_deg):
        raise UserError(f"--slopes {text}: allowed are −{_STEEPEST_DEG:g} to {_STEEPEST_DEG:g} degrees")
    return slopes_deg


_STEEPEST_DEG = 15.0
