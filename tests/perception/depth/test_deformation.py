"""What stays in the picture is a deformation of the view; what passes through it with the ground is none."""

from dataclasses import replace

import numpy as np
import pytest

from messages.arrays import FloatArray
from perception.depth.deformation import Deformation, DeformationWatch
from perception.depth.eye_shifts import EyeShifts

ROWS, COLUMNS = 9, 12
STD_PX = 0.06
Y, X = np.mgrid[-1.0 : 1.0 : ROWS * 1j, -1.0 : 1.0 : COLUMNS * 1j]
DROP = np.exp(-8.0 * (X - 0.2) ** 2 - 8.0 * (Y + 0.1) ** 2)
NOTHING = np.zeros((ROWS, COLUMNS))


def shown(
    chance: np.random.Generator, x_px: FloatArray, y_px: FloatArray, whole: FloatArray | None = None
) -> EyeShifts:
    return EyeShifts(
        row=5,
        column=9,
        of_picture=(18, 32),
        x_px=x_px + chance.normal(0.0, STD_PX, x_px.shape),
        y_px=y_px + chance.normal(0.0, STD_PX, y_px.shape),
        y_var_px2=np.full(x_px.shape, STD_PX**2),
        whole=np.ones(x_px.shape, bool) if whole is None else whole.astype(bool),
        alike_share=1.0,
        middle=(0.0, 0.1),
        half=(0.3, 0.25),
    )


def walked(
    watch: DeformationWatch, frames: int, x_px: FloatArray = NOTHING, y_px: FloatArray = NOTHING, way_m: float = 0.1
) -> Deformation:
    chance = np.random.default_rng(frames)
    for _ in range(frames):
        found = watch.add(shown(chance, x_px, y_px), way_m)
    return found


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_neither_contradicts_nor_widens(seed: int) -> None:
    chance, watch = np.random.default_rng([seed, 1]), DeformationWatch()
    found = [watch.add(shown(chance, NOTHING, NOTHING), 0.1) for _ in range(300)]
    assert not any(each.contradicts for each in found)
    assert np.mean([each.size_px for each in found[10:]]) < 0.015


@pytest.mark.parametrize("most_px", [0.2, 0.5, 2.0])
def test_a_drop_that_moves_part_of_a_picture_up_or_down_contradicts_the_sooner_the_larger(most_px: float) -> None:
    watch = DeformationWatch()
    walked(watch, 50)
    frames = next(n for n in range(1, 40) if walked(watch, 1, y_px=most_px * DROP).contradicts)
    assert frames <= {0.2: 20, 0.5: 5, 2.0: 2}[most_px]


@pytest.mark.parametrize(("most_px", "frames"), [(0.2, 20), (0.5, 8), (2.0, 8)])
def test_it_ends_soon_after_the_drop_has_run_down(most_px: float, frames: int) -> None:
    watch = DeformationWatch()
    assert walked(watch, 50, x_px=most_px * DROP, y_px=most_px * DROP).contradicts
    assert not walked(watch, frames).contradicts


def test_a_drop_that_moves_still_contradicts() -> None:
    watch, chance = DeformationWatch(), np.random.default_rng(9)
    walked(watch, 20, y_px=2.0 * DROP)
    for k in range(40):
        found = watch.add(shown(chance, NOTHING, np.roll(2.0 * DROP, k // 4, axis=1)), 0.1)
        assert found.contradicts


def test_what_is_small_is_told_by_its_size() -> None:
    found = walked(DeformationWatch(), 60, y_px=0.05 * X)
    assert not found.contradicts
    assert found.size_px == pytest.approx(0.05 / np.sqrt(3.0), rel=0.35)


def test_all_tiles_lower_alike_is_no_deformation() -> None:
    found = walked(DeformationWatch(), 50, y_px=NOTHING + 0.8)
    assert not found.contradicts
    assert found.size_px < 0.02


def test_the_first_frames_of_another_ground_are_doubtful_where_they_are_shifted() -> None:
    watch = DeformationWatch()
    walked(watch, 50)
    assert not walked(watch, 1, y_px=0.2 * DROP).doubtful  # one of fifty
    watch.begin_anew(with_newest=True)
    assert walked(watch, 1, y_px=0.2 * DROP).doubtful


def test_of_the_first_frames_one_that_is_a_little_off_is_chance_and_two_in_a_row_are_not() -> None:
    off_px = NOTHING.copy()
    off_px[3:6, 4:7] = 0.2
    little, none = (replace(shown(np.random.default_rng(0), NOTHING, NOTHING), y_px=y) for y in (off_px, NOTHING))
    watch = DeformationWatch()
    assert not watch.add(little, 0.1).contradicts
    assert not watch.add(none, 0.1).contradicts
    watch.begin_anew(with_newest=False)
    assert not watch.add(little, 0.1).contradicts
    assert watch.add(little, 0.1).contradicts


def test_a_shift_along_the_rows_that_stays_over_a_way_contradicts_and_at_rest_does_not() -> None:
    assert walked(DeformationWatch(), 60, x_px=0.6 * DROP).contradicts
    assert not walked(DeformationWatch(), 60, x_px=0.6 * DROP, way_m=0.0).contradicts


def test_relief_passes_through_the_picture() -> None:
    watch, chance = DeformationWatch(), np.random.default_rng(7)
    bumps = np.repeat(np.repeat(chance.normal(0.0, 0.35, (200, 4)), 3, axis=0), 3, axis=1)
    for k in range(400):
        first = 580 - k
        assert not watch.add(shown(chance, bumps[first : first + ROWS], NOTHING), 0.08).contradicts


def test_who_walks_along_a_kerb_or_an_arched_path_sees_no_deformation() -> None:
    assert not walked(DeformationWatch(), 80, x_px=0.8 * X**2 + 0.3 * Y).contradicts


def test_about_an_edge_tiles_are_not_counted() -> None:
    watch, chance = DeformationWatch(), np.random.default_rng(8)
    whole = NOTHING + 1.0
    whole[4] = 0.0
    hidden = NOTHING.copy()
    hidden[3:6] = 1.0
    for _ in range(30):
        found = watch.add(shown(chance, NOTHING, hidden, whole), 0.1)
    assert not found.contradicts


def test_what_the_calibration_may_leave_is_no_deformation_until_it_is_more() -> None:
    assert walked(DeformationWatch(), 60, y_px=0.4 * DROP).contradicts
    assert not walked(DeformationWatch(calibrated_px=0.1), 60, y_px=0.4 * DROP).contradicts
    assert walked(DeformationWatch(calibrated_px=0.1), 60, y_px=1.2 * DROP).contradicts


def test_an_edge_that_passes_through_a_tile_is_no_deformation() -> None:
    """A hard shadow's edge or a joint moves what is found of the tiles it crosses by half a pixel, in one frame."""
    chance, watch = np.random.default_rng(7), DeformationWatch()
    for frame in range(60):
        crossed = np.abs(Y - (3.0 - 0.8 * (frame % 10))) < 0.3
        seen = shown(chance, NOTHING, np.where(crossed, 0.35, 0.0))
        clear = replace(seen, y_var_px2=np.where(crossed, 0.03**2, seen.y_var_px2))
        assert not watch.add(clear, 0.1).contradicts


@pytest.mark.parametrize(("way_m", "contradicts"), [(0.0, False), (0.1, True)])
def test_who_stands_sees_the_same_errors_of_the_same_texture_again(way_m: float, contradicts: bool) -> None:
    """Once she walks they would be others: what then stays is the picture's."""
    chance, watch, shift = np.random.default_rng(7), DeformationWatch(), 0.0 * NOTHING
    shift[5:8, 4:7] = -0.2
    for _ in range(30):
        seen = shown(chance, NOTHING, shift)
        found = watch.add(replace(seen, y_var_px2=np.where(shift != 0.0, 0.25**2, seen.y_var_px2)), way_m)
    assert found.contradicts is contradicts
