"""`gaiteyes replay`: a recording, or a folder in the ASL layout, through the same pipeline as live."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.options import JsonFile

if TYPE_CHECKING:
    from cli.imu_table import ImuTable


def replay(
    source: Annotated[Path, typer.Argument(help="An MCAP recording, or a folder in the EuRoC/ASL layout.")],
    out: Annotated[Path | None, typer.Option(help="File to write: every estimate, as one JSON object a line.")] = None,
    config: Annotated[Path | None, typer.Option(help="Use this configuration instead of the source's.")] = None,
    overlay: Annotated[
        Path | None,
        typer.Option(
            help="Draw what is said of each frame into its picture: a video (.mp4, .mkv, .avi) or a folder of PNGs."
        ),
    ] = None,
    foxglove: Annotated[
        Path | None,
        typer.Option(help="Write an MCAP file for Foxglove's own panels: picture, calibration, transforms, scene."),
    ] = None,
    imu: Annotated[
        Path | None,
        typer.Option(help="Write the IMU's samples as FOLDER/imu.csv, for a laboratory's reference beside it."),
    ] = None,
    json: JsonFile = None,
) -> None:
    """Replay a recording; the same source gives the same bytes."""
    from collections import Counter
    from contextlib import ExitStack, closing

    import cv2

    from cli.console import RECORDING_CUT, check_writable, floor_table, score_table, show, table, write_json
    from cli.overlay.overlay import Overlay
    from cli.overlay.picture_files import open_pictures
    from cli.progress import passing, working
    from cli.scene.foxglove_file import LAYOUT, FoxgloveFile
    from daemon import replay as replaying
    from daemon.config import load_configuration
    from daemon.pipeline import Pipeline
    from daemon.replay import ReplayObserver
    from daemon.replay_source import open_source
    from daemon.setpoints import modulator_of_recording
    from lab.evaluation.floor import score_floor
    from lab.evaluation.score import Scoreboard
    from messages import TOPICS, Frame, Status

    check_writable(json)
    cv2.setNumThreads(1)
    opened = open_source(source, None if config is None else load_configuration(config))
    foothold = opened.configuration.foothold
    samples = None if imu is None else _imu_table(imu, opened.utc_offset_ns)
    setpoints = modulator_of_recording(opened.configuration.setpoint)
    pipeline = Pipeline(opened.calibration, foothold, opened.learnt, setpoints=setpoints)
    with ExitStack() as stack:
        observers: list[ReplayObserver] = []
        if overlay is not None:
            files = stack.enter_context(closing(open_pictures(overlay, TOPICS["frame"].rate_hz)))
            drawing = Overlay(opened.calibration, foothold, files, lambda: pipeline.surfaces)
            observers.append(stack.enter_context(closing(drawing)))
        if foxglove is not None:
            scene = FoxgloveFile(foxglove, opened, lambda: pipeline.surfaces)
            observers.append(stack.enter_context(closing(scene)))
        if samples is not None:
            observers.append(stack.enter_context(closing(samples)))
        tell = stack.enter_context(working("replaying"))
        replayed = replaying.replay(passing(opened.inputs(), tell, "replaying: inputs"), pipeline, out, observers)
    damage = opened.damage()

    valid = sum(ground.status is Status.VALID for ground in replayed.grounds)
    refused = Counter(ground.reason.value for ground in replayed.grounds if ground.status is not Status.VALID)
    rows = [[f"{name} estimates", str(count)] for name, count in replayed.estimates.items()]
    rows += [["ground that is valid", str(valid)], *([f"no ground: {why}", str(n)] for why, n in refused.items())]
    table(opened.title, ["", ""], rows)
    facts: dict[str, object] = {
        "estimates": replayed.estimates,
        "valid": valid,
        "refused": dict(refused),
        "damage": damage,
    }
    if samples is not None:
        facts["imu_start_utc"] = samples.start_utc
        typer.echo(f"{samples.path}: t_s = 0 is {samples.start_utc or 'at a time that the source does not tell'}")
    if foxglove is not None:
        typer.echo(f"{foxglove}: for Foxglove, with the layout {LAYOUT}")
    truth = opened.rig_truth()
    if truth:
        board = Scoreboard()
        for ground in replayed.grounds:
            if ground.t_exposure_ns in truth:
                board.add(ground, truth[ground.t_exposure_ns])
        facts["ground"] = board.summary()
        show(score_table("Ground against the recorded truth", board.summary()))
    if opened.poses is not None:
        frames = (message for message in opened.inputs() if isinstance(message, Frame))
        facts["floor"] = scores = score_floor(frames, replayed.grounds, opened.poses, opened.calibration, foothold)
        floor_table("Floor against the truth's level ground at z = 0", scores)
    if damage is not None:
        typer.echo(f"gaiteyes: replayed up to where the recording is damaged: {damage}", err=True)
    if json is not None:
        write_json(json, facts)
    if damage is not None:
        raise typer.Exit(RECORDING_CUT)


def _imu_table(folder: Path, utc_offset_ns: int | None) -> "ImuTable":
    from cli.imu_table import ImuTable  # not before: its SciPy takes as long as all the rest

    return ImuTable(folder, utc_offset_ns)
