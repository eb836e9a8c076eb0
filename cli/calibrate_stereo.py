"""`gaiteyes calibrate stereo`: both lenses and the pair, from views of a board."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cli.calibrate_target import Into, Out, SideBySide, Unit, target
from cli.options import CONFIG_FILE, ConfigFile, JsonFile

if TYPE_CHECKING:
    from calib.stereo.board import Board
    from calib.stereo.collect import Views
    from calib.stereo.fit import StereoFit
    from calib.stereo.pairs import Pair
    from messages import Calibration

Source = Annotated[
    Path | None,
    typer.Option(
        "--from", help="Folder of pictures, two videos, a recording or a EuRoC folder, instead of the camera."
    ),
]
_NOMINAL_SQUARE_M = 0.025
_FACTORY_BASELINE = 2.5e-3
"""Of a baseline that a maker states: 0.3 mm of 120."""
_PICTURES_FOR_SIZE = 5
_LIVE_EVERY = 4
"""Frames of 20 a second: five looks a second; a board takes about 0.1 s to be found."""


def stereo(
    source: Source = None,
    board: Annotated[
        str | None, typer.Option(help="Inner corners of the board, as 9x6; a chessboard's are found without.")
    ] = None,
    square_mm: Annotated[float | None, typer.Option(help="Side of one square, measured over many.")] = None,
    baseline_mm: Annotated[
        float | None, typer.Option(help="Distance of the lenses, where the square is not known.")
    ] = None,
    board_error: Annotated[float, typer.Option(min=0.0, max=2.0, help="Error of the square, 1 σ, %.")] = 0.1,
    charuco: Annotated[str | None, typer.Option(help="Dictionary of a ChArUco board, as DICT_5X5_250.")] = None,
    marker_share: Annotated[float, typer.Option(help="Side of a ChArUco board's markers, of a square's.")] = 0.75,
    legacy: Annotated[bool, typer.Option(help="The ChArUco board is drawn as before OpenCV 4.6.")] = False,
    side_by_side: SideBySide = False,
    into: Into = None,
    out: Out = None,
    unit: Unit = None,
    config: ConfigFile = CONFIG_FILE,
    seconds: Annotated[
        float, typer.Option(min=20.0, max=1200.0, help="How long to look at a camera, at most.")
    ] = 180.0,
    json: JsonFile = None,
) -> None:
    """Calibrate both lenses and the pair with a chessboard or a ChArUco board.

    Hold it still in twenty places and more: near and far, in every part of both pictures, tilted by 30° and more
    toward each side. It need not be flat, but must not bend between views.
    """
    import cv2

    from calib.files import check_calibration, save_calibration
    from calib.stereo.fit import fit_pair
    from cli.console import check_writable, console, write_json

    check_writable(json)
    cv2.setNumThreads(1)
    file, known = target(out, into)
    where = str(source if source is not None else config)
    size = board or _found_size(source, charuco, side_by_side)
    sheet = _board(size, square_mm, baseline_mm, charuco, marker_share, legacy=legacy)
    views = _live_views(sheet, config, known, seconds) if source is None else _read_views(sheet, source, side_by_side)
    error = 1e-2 * board_error if baseline_mm is None else math.hypot(_FACTORY_BASELINE, 1e-2 * board_error)
    fit = fit_pair(views.kept, sheet, views.size_px, where, board_error=error)
    if baseline_mm is not None:
        fit = fit.scaled_to(1e-3 * baseline_mm)
    made = _unit_with(fit, known, unit or f"{Path(where).stem}, rest nominal"[:64])
    check_calibration(made, where)
    save_calibration(file, made)
    _tell_fit(fit, views, where)
    console.print(f"Written to {file}: unit '{made.unit}', calibration {made.id}.", soft_wrap=True, highlight=False)
    if known is None:
        console.print(
            "IMU, mounting, row time and stamps are nominal: calibrate imu and calibrate mount before anybody walks.",
            soft_wrap=True,
        )
    if json is not None:
        write_json(json, {"file": str(file), "id": made.id} | _facts(fit, views))


def _found_size(source: Path | None, dictionary: str | None, side_by_side: bool) -> str:
    """Return the inner corners of the chessboard in a source, as --board has them."""
    from calib.stereo.board import size_of_chessboard
    from calib.stereo.pairs import read_pairs
    from messages import UserError

    if source is None or dictionary is not None:
        raise UserError("tell the board's inner corners, as in --board 9x6")
    count = sum(1 for _ in read_pairs(source, side_by_side=side_by_side))
    step = max(1, count // _PICTURES_FOR_SIZE)
    pairs = read_pairs(source, side_by_side=side_by_side)
    columns, rows_ = size_of_chessboard([pair.left for k, pair in enumerate(pairs) if k % step == 0], str(source))
    return f"{columns}x{rows_}"


def _board(
    size: str,
    square_mm: float | None,
    baseline_mm: float | None,
    dictionary: str | None,
    marker_share: float,
    *,
    legacy: bool,
) -> "Board":
    from calib.stereo.board import board_of_text
    from messages import UserError

    if (square_mm is None) == (baseline_mm is None):
        raise UserError("tell either --square-mm, measured on the board, or --baseline-mm, of the lenses")
    square_m = _NOMINAL_SQUARE_M if square_mm is None else 1e-3 * square_mm
    return board_of_text(size, square_m, dictionary, marker_share, legacy=legacy)


def _read_views(board: "Board", source: Path, side_by_side: bool) -> "Views":
    from calib.stereo.collect import Views, thinned
    from calib.stereo.pairs import read_pairs
    from cli.progress import LiveLine

    moving = source.is_file() or (source / "mav0").is_dir() or any(source.glob("imu0*"))
    views = Views(board, moving=moving)
    pairs: Iterator[Pair] = read_pairs(source, side_by_side=side_by_side)
    with LiveLine() as line:
        for pair in thinned(pairs, 2 * _LIVE_EVERY) if moving else pairs:
            views.add(pair)
            line.tell(_coverage_line(views))
    return views


def _live_views(board: "Board", config: Path, known: "Calibration | None", seconds: float) -> "Views":
    """Collect views from the camera that the configuration names, until they are enough."""
    import time

    from calib.nominal import nominal_pair, uncalibrated_unit
    from calib.stereo.collect import Views
    from calib.stereo.pairs import Pair
    from cli import devices
    from cli.progress import LiveLine
    from daemon.config import load_configuration
    from messages import StereoFrame

    settings = load_configuration(config).camera
    with devices.next_step_named():
        camera = devices.camera_opener(settings, known or uncalibrated_unit("nominal", nominal_pair()))()
    views, start_s, frames = Views(board, moving=True), time.monotonic(), 0
    try:
        with LiveLine() as line:
            while time.monotonic() - start_s < seconds and not views.is_enough:
                frame = camera.read(timeout_s=0.2)
                if not isinstance(frame, StereoFrame):
                    continue
                frames += 1
                if frames % _LIVE_EVERY < 2:
                    views.add(Pair(f"{time.monotonic() - start_s:.1f} s", frame.left, frame.right))
                    line.tell(_coverage_line(views))
    finally:
        camera.close()
    return views


def _coverage_line(views: "Views") -> str:
    """Return what is covered by now: a row of marks for each row of regions, left eye and right."""
    marks = ["".join("■" if seen else "·" for seen in row) for row in views.covered.reshape(-1, 3)]
    moved = f"; hold still ({views.moved} moved)" if views.moved else ""
    return (
        f"{len(views.kept)} views kept of {views.seen} that show the board, {views.looked_at} looked at; covered, left "
        f"{' '.join(marks[:3])}  right {' '.join(marks[3:])}{moved}"
    )


def _unit_with(fit: "StereoFit", known: "Calibration | None", unit: str) -> "Calibration":
    import msgspec

    from calib.nominal import uncalibrated_unit
    from calib.stereo.fit import with_pair

    made = uncalibrated_unit(unit, fit.stereo)
    if known is not None:
        before = known.stereo
        pair = msgspec.structs.replace(
            fit.stereo, row_time_s=before.row_time_s, stamp_to_mid_exposure_s=before.stamp_to_mid_exposure_s
        )
        made = msgspec.structs.replace(known, stereo=pair)
    return msgspec.structs.replace(made, residual=with_pair(made.residual, fit.residual))


def _tell_fit(fit: "StereoFit", views: "Views", where: str) -> None:
    from calib.stereo.collect import looks
    from calib.stereo.consequences import by_region
    from cli.console import console, table

    worth = fit.worth
    digits = {"px": 2, "m": 5, "rad": 5, "1": 5}
    table(
        f"{where}: {len(fit.views)} views, {views.size_px[0]}x{views.size_px[1]} px, board "
        f"{views.board.columns}x{views.board.rows}, squares {1e3 * fit.square_m:.3f} mm",
        ["", "value", "95 %", "unit"],
        [
            [
                name,
                f"{q.value:.{digits[q.unit]}f}",
                f"± {0.5 * (q.high - q.low):.{digits[q.unit]}f}",
                "" if q.unit == "1" else q.unit,
            ]
            for name, q in fit.quantities.items()
        ],
    )
    regions = by_region(fit.stereo, fit.views, fit.residuals_px)
    table(
        "residual by region, px RMS",
        ["", "left eye", "", "", "right eye", "", ""],
        [
            [name, *("–" if math.isnan(value) else f"{value:.2f}" for value in (*regions[0, row], *regions[1, row]))]
            for row, name in enumerate(("top", "middle", "bottom"))
        ],
    )
    shape = "flat" if fit.flat else f"bent by {1e3 * fit.bulge_m:.2f} mm, which is allowed for"
    lines = [
        f"stereo RMS {fit.rms_px:.3f} px (left {fit.eye_rms_px[0]:.3f}, right {fit.eye_rms_px[1]:.3f}); rows differ by "
        f"{worth.row_error_mean_px:.3f} px (mean), {worth.row_error_most_px:.2f} px at most",
        f"the board is {shape}; {fit.corners_out} corners did not fit and were left out",
        f"left to users of this calibration, 1 σ: distances at 1 m {100 * worth.depth_scale:.2f} %, rows "
        f"{worth.rows_px:.2f} px over the picture",
    ]
    lines += [f"view {name} left out: {why}" for name, why in fit.left_out]
    empty = looks(worth.covered)
    if empty:
        lines.append(f"NOT COVERED  {'; '.join(empty)}: the lenses are extrapolated there; show the board there too")
    for text in lines:
        console.print(text, soft_wrap=True, highlight=False, markup=False)


def _facts(fit: "StereoFit", views: "Views") -> dict[str, object]:
    from calib.stereo.collect import looks
    from calib.stereo.consequences import by_region

    worth = fit.worth
    return {
        "board": {"columns": views.board.columns, "rows": views.board.rows, "square_m": fit.square_m},
        "pairs": {"looked_at": views.looked_at, "seen": views.seen, "used": [view.name for view in fit.views]},
        "left_out": dict(fit.left_out),
        "corners_left_out": fit.corners_out,
        "rms_px": fit.rms_px,
        "eye_rms_px": list(fit.eye_rms_px),
        "row_error_px": {
            "mean": worth.row_error_mean_px,
            "rms": worth.row_error_rms_px,
            "most": worth.row_error_most_px,
        },
        "board_bent_m": None if fit.flat else fit.bulge_m,
        "residual_by_region_px": by_region(fit.stereo, fit.views, fit.residuals_px).tolist(),
        "not_covered": looks(worth.covered),
        "quantities": {name: quantity._asdict() for name, quantity in fit.quantities.items()},
        "depth_scale_std": worth.depth_scale,
        "rows_std_px": worth.rows_px,
        "stereo": fit.stereo,
        "residual": fit.residual,
    }
