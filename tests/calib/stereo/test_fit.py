"""The pair from views of a board: true values within their intervals, bad views named, what is not told refused."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from calib.files import load_calibration
from calib.stereo.board import Board, board_of_text, find_corners
from calib.stereo.fit import StereoFit, fit_pair
from cli.main import app
from lab.evaluation.calibration_trials import charuco_picture, drawn_views, true_values
from messages import UserError
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, draw_unit
from tests.bench.data_folder import shared_data

BOARD = Board(9, 6, 0.03)
SIZE = (WIDTH_PX, HEIGHT_PX)
TRUE = draw_unit(5).stereo


@pytest.fixture(scope="module")
def fit() -> StereoFit:
    views = drawn_views(np.random.default_rng(1), TRUE, BOARD, 16, 0.1)
    return fit_pair(views, BOARD, SIZE, "bench", board_error=0.0)


def test_corners_with_noise_tell_the_pair(fit: StereoFit) -> None:
    assert fit.rms_px == pytest.approx(0.1 * np.sqrt(2.0), rel=0.1)
    assert fit.flat
    assert fit.left_out == ()
    for name, value in true_values(TRUE).items():
        quantity = fit.quantities[name]
        assert abs(value - quantity.value) < 2.0 * (quantity.high - quantity.value), name  # four deviations
    assert fit.worth.row_error_mean_px < 0.15
    assert fit.worth.depth_scale < 0.003
    assert fit.residual.baseline_std < 1e-3


@pytest.mark.long
def test_a_board_that_is_bent_is_noticed_and_does_no_harm() -> None:
    views = drawn_views(np.random.default_rng(2), TRUE, BOARD, 16, 0.1, bulge_m=0.002)
    found = fit_pair(views, BOARD, SIZE, "bench")
    assert not found.flat
    assert found.bulge_m == pytest.approx(0.002, abs=0.0006)
    assert found.rms_px == pytest.approx(0.1 * np.sqrt(2.0), rel=0.1)


@pytest.mark.long
def test_a_view_whose_eyes_are_of_two_times_and_a_wrong_corner_are_left_out() -> None:
    views = drawn_views(np.random.default_rng(3), TRUE, BOARD, 12, 0.1)
    moved = views[4].right_px + np.array((6.0, 1.5))
    views[4] = views[4]._replace(name="moved", right_px=moved)
    views[7].left_px[11] += 3.0
    found = fit_pair(views, BOARD, SIZE, "bench")
    assert [name for name, _ in found.left_out] == ["moved"]
    assert found.corners_out == 1
    assert len(found.views) == 11


def test_what_the_views_do_not_tell_is_refused() -> None:
    rng = np.random.default_rng(4)
    views = drawn_views(rng, TRUE, BOARD, 4, 0.1)
    with pytest.raises(UserError, match="bench: both eyes see the board in 4 pairs, allowed from 5"):
        fit_pair(views, BOARD, SIZE, "bench")


@pytest.mark.long
def test_views_from_one_place_are_refused() -> None:
    rng = np.random.default_rng(4)
    views = drawn_views(rng, TRUE, BOARD, 1, 0.1)
    same = [views[0]._replace(left_px=views[0].left_px + rng.normal(0.0, 0.1, (54, 2))) for _ in range(8)]
    with pytest.raises(UserError, match="bench: the"):
        fit_pair(same, BOARD, SIZE, "bench")


def test_charuco_corners_are_found_to_a_fraction_of_a_pixel() -> None:
    board = board_of_text("9x6", 0.03, "DICT_5X5_250", 0.75, legacy=False)
    picture, true = charuco_picture(board, np.random.default_rng(5))
    corners = find_corners(board, picture)
    assert corners is not None
    assert len(corners.ids) > 40
    off = np.linalg.norm(corners.px - true[corners.ids], axis=1)
    assert np.sqrt((off**2).mean()) < 0.15
    assert off.max() < 0.4
    assert find_corners(board, np.full_like(picture, 128)) is None


@pytest.mark.parametrize(
    ("text", "problem"),
    [("9", "--board 9: expected inner corners"), ("2x6", "2 inner corners in columns, allowed 3 to 40")],
)
def test_an_impossible_board_is_one_line(text: str, problem: str) -> None:
    with pytest.raises(UserError, match=problem):
        board_of_text(text, 0.03, None, 0.75, legacy=False)


@pytest.mark.long
def test_95_percent_intervals_hold() -> None:
    inside = dict[str, list[bool]]()
    depth = []
    for seed in range(1000, 1025):
        rng = np.random.default_rng(seed)
        true = draw_unit(seed).stereo
        found = fit_pair(drawn_views(rng, true, BOARD, 14, 0.15), BOARD, SIZE, "bench", board_error=0.0)
        for name, value in true_values(true).items():
            quantity = found.quantities[name]
            inside.setdefault(name, []).append(quantity.low <= value <= quantity.high)
        f_b = found.stereo.left.fx_px * np.linalg.norm(found.stereo.X_RL.p_m)
        depth.append(f_b / (true.left.fx_px * np.linalg.norm(true.X_RL.p_m)) - 1.0)
    share = float(np.mean([each for name in inside.values() for each in name]))
    assert 0.90 <= share <= 0.99, share  # 300 units: benchmarks.calibration
    assert np.percentile(np.abs(depth), 95.0) < 0.003


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "board", "options", "rms_px", "rows_px"),
    [
        ("zed_chessboard_720p", (11, 8), ("--baseline-mm", "119"), 0.20, 0.15),
        ("opencv_chessboard_stereo", (9, 6), ("--square-mm", "25"), 0.22, 0.14),
    ],
)
def test_real_chessboards_without_telling_their_size(
    tmp_path: Path, name: str, board: tuple[int, int], options: tuple[str, ...], rms_px: float, rows_px: float
) -> None:
    out, facts = tmp_path / "unit.yaml", tmp_path / "facts.json"
    source = str(shared_data(name))
    app(
        ["calibrate", "stereo", "--from", source, *options, "--out", str(out), "--json", str(facts)],
        standalone_mode=False,
    )
    told = msgspec.json.decode(facts.read_bytes())
    assert (told["board"]["columns"], told["board"]["rows"]) == board
    assert told["rms_px"] <= rms_px
    assert told["row_error_px"]["mean"] <= rows_px
    assert told["not_covered"]  # neither set covers the whole of both pictures
    made = load_calibration(out)
    assert made.id == told["id"]
    assert made.residual.focal_length_std > 1e-3
