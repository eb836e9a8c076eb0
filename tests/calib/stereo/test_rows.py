"""Rows without a board: what is turned into a picture comes back with its name, and sound pictures pass."""

from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from calib.nominal import nominal_pair
from calib.stereo.pairs import Pair, read_pairs
from calib.stereo.rows import check_rows
from cli.main import app
from messages import UserError
from messages.arrays import GreyImage
from tests.bench.data_folder import shared_data

STEREO = nominal_pair(640, 360)
DISPARITY_PX = 24


def texture(seed: int) -> GreyImage:
    rough = np.random.default_rng(seed).uniform(0.0, 255.0, (360, 700)).astype(np.float32)
    smooth = cv2.GaussianBlur(rough, (0, 0), 2.0)
    bright: GreyImage = np.clip(128.0 + 6.0 * (smooth - np.mean(smooth)), 0.0, 255.0).astype(np.uint8)
    return bright


def pair(seed: int, *, down_px: float = 0.0, roll_rad: float = 0.0) -> Pair:
    """Return a wall far away whose right picture stands lower, or is turned about its middle."""
    wide = texture(seed)
    moved = np.array(((1.0, 0.0, -float(DISPARITY_PX)), (0.0, 1.0, down_px)))
    right = cv2.warpAffine(wide, moved, (640, 360), flags=cv2.INTER_CUBIC)
    turn = cv2.getRotationMatrix2D((319.5, 179.5), -np.degrees(roll_rad), 1.0)
    right = cv2.warpAffine(right, turn, (640, 360), flags=cv2.INTER_CUBIC)
    return Pair(str(seed), np.ascontiguousarray(wide[:, :640]), right.astype(np.uint8))


def test_sound_rows_are_no_fault() -> None:
    found = check_rows(STEREO, [pair(seed) for seed in (1, 2)], "bench")
    assert not found.is_fault
    assert found.rms_px < 0.1


def test_a_pitched_eye_and_a_rolled_one_are_told_apart() -> None:
    pitched = check_rows(STEREO, [pair(seed, down_px=1.5) for seed in (1, 2)], "bench")
    assert pitched.is_fault
    assert pitched.cause == "pitch"
    assert pitched.median_px == pytest.approx(1.5, abs=0.1)
    rolled = check_rows(STEREO, [pair(seed, roll_rad=0.008) for seed in (1, 2)], "bench")
    assert rolled.is_fault
    assert rolled.cause == "roll"
    assert rolled.values["roll"] == pytest.approx(0.008, abs=0.001)


def test_what_shows_nothing_is_refused() -> None:
    grey = np.full((360, 640), 90, np.uint8)
    with pytest.raises(UserError, match="bench: 0 things in 1 pairs are surely the same in both eyes"):
        check_rows(STEREO, [Pair("grey", grey, grey)], "bench")
    with pytest.raises(UserError, match=r"bench: small is 64x36 px, the calibration's allowed 640x360"):
        check_rows(STEREO, [Pair("small", grey[:36, :64], grey[:36, :64])], "bench")


def test_pairs_are_found_by_their_names(tmp_path: Path) -> None:
    for name in ("left_01.png", "right_01.png", "left_02.png", "right_03.png", "board.png"):
        cv2.imwrite(str(tmp_path / name), np.zeros((36, 64), np.uint8))
    assert [each.name for each in read_pairs(tmp_path)] == ["01"]
    with pytest.raises(UserError, match="no such file or folder"):
        next(read_pairs(tmp_path / "nowhere"))
    (tmp_path / "right_01.png").write_bytes(b"no picture")
    with pytest.raises(UserError, match=r"right_01\.png: is no picture that can be read"):
        next(read_pairs(tmp_path))


@pytest.mark.long
def test_the_row_fault_of_a_real_factory_calibration_is_named(tmp_path: Path) -> None:
    folder, facts = shared_data("oakd_balcony_floor"), tmp_path / "rows.json"
    arguments = ["calibrate", "rows", str(folder / "calib.json"), "--from", str(folder), "--json", str(facts)]
    assert app(arguments, standalone_mode=False) == 1
    told = msgspec.json.decode(facts.read_bytes())
    assert told["is_fault"]
    assert told["rms_px"] == pytest.approx(1.2, abs=0.15)
    assert told["median_px"] == pytest.approx(1.15, abs=0.15)
    assert told["cause"] == "roll"
