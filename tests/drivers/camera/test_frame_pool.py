import gc
import math
import threading
import tracemalloc
from itertools import pairwise

import cv2
import numpy as np
import pytest

from drivers.camera.frame_grid import GridPicker
from drivers.camera.frame_pool import FramePair, FramePool
from messages import FrameHeader, StereoFrame

HEADER = FrameHeader(seq=0, t_exposure_ns=0, t_arrival_ns=0, exposure_s=math.nan, width_px=8, height_px=4)


def taken(pool: FramePool) -> FramePair:
    pair = pool.take()
    assert pair is not None
    return pair


def test_pool_lends_its_count_and_no_more() -> None:
    pool = FramePool(3, 8, 4)
    held = [taken(pool) for _ in range(3)]
    assert pool.take() is None
    assert pool.free == 0
    del held[1]
    assert pool.free == 1
    assert pool.take() is not None


def test_pairs_are_images_of_the_size_asked_for_and_never_overlap() -> None:
    pool = FramePool(2, 8, 4)
    images = [image for _ in range(2) for image in taken(pool)]  # only the images are kept, not the pairs
    assert {(image.shape, image.dtype, image.flags.c_contiguous) for image in images} == {
        ((4, 8), np.dtype(np.uint8), True)
    }
    for number, image in enumerate(images):
        image[:] = number
    assert [set(image.ravel().tolist()) for image in images] == [{0}, {1}, {2}, {3}]


@pytest.mark.parametrize(
    "keep",
    [
        lambda frame: frame,
        lambda frame: frame.left,
        lambda frame: frame.right,
        lambda frame: frame.right[1:][::2].T,
        lambda frame: memoryview(frame.left),
        lambda frame: np.asarray(frame.left).reshape(-1)[3:5],
        lambda frame: frame.left.view(np.int8),
    ],
    ids=["frame", "left", "right", "view of a view", "memoryview", "reshaped", "other type"],
)
def test_pixels_stay_lent_while_anything_refers_to_them(keep: object) -> None:
    assert callable(keep)
    pool = FramePool(1, 8, 4)
    frame = taken(pool).frame(HEADER)
    kept = keep(frame)
    del frame
    assert pool.free == 0
    del kept
    assert pool.free == 1


def test_pair_comes_back_from_another_thread() -> None:
    pool = FramePool(1, 8, 4)
    held = [taken(pool)]
    thread = threading.Thread(target=held.clear)
    thread.start()
    thread.join()
    assert pool.free == 1


def test_no_pair_is_lost_or_lent_twice_between_threads() -> None:
    pool = FramePool(4, 8, 4)
    clashes: list[int] = []

    def use(mark: int) -> None:
        for _ in range(300):
            pair = pool.take()
            if pair is not None:
                pair.left[:] = mark
                pair.right[:] = mark
                if set(np.unique(pair.left)) | set(np.unique(pair.right)) != {mark}:
                    clashes.append(mark)

    threads = [threading.Thread(target=use, args=(mark,)) for mark in range(1, 7)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert clashes == []
    assert pool.free == 4


def test_a_frame_owns_its_pixels_and_nobody_can_write_them() -> None:
    pair = taken(FramePool(1, 8, 4))
    pair.left[:] = 1
    pair.right[:] = 2
    frame = pair.frame(HEADER)
    assert isinstance(frame, StereoFrame)
    for image in (frame.left, frame.right, frame.left[1:]):
        with pytest.raises(ValueError, match="read-only"):
            image[0, 0] = 9
    assert cv2.resize(frame.right, (4, 2), interpolation=cv2.INTER_AREA).tolist() == [[2] * 4] * 2


def test_a_pool_may_go_before_its_frames() -> None:
    pool = FramePool(1, 8, 4)
    frame = taken(pool).frame(HEADER)
    del pool
    gc.collect()
    assert frame.left.shape == (4, 8)


def test_steady_state_allocates_no_image_memory() -> None:
    pool = FramePool(2, 640, 360)
    frame = taken(pool).frame(HEADER)
    tracemalloc.start()
    for _ in range(20):
        frame = taken(pool).frame(HEADER)  # the one before is still held while this one is taken
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert frame.left.shape == (360, 640)
    assert peak < 640 * 360 // 8


def picked_ms(rate_hz: float, seconds: float = 30.0, nominal_hz: float | None = None) -> list[float]:
    picker = GridPicker(1.0 / (nominal_hz or rate_hz))
    stamps = (10**12 + round(frame * 1e9 / rate_hz) for frame in range(round(rate_hz * seconds)))
    return [(t_ns - 10**12) * 1e-6 for t_ns in stamps if picker.pick(t_ns)]


@pytest.mark.parametrize("rate_hz", [60.0, 20.0, 100.0])
def test_rates_that_hold_the_grid_come_50_ms_apart(rate_hz: float) -> None:
    times = picked_ms(rate_hz)
    assert len(times) == 600
    assert {round(later - earlier, 3) for earlier, later in pairwise(times)} == {50.0}


@pytest.mark.parametrize("rate_hz", [59.4, 59.94, 60.006, 60.6])
def test_every_third_frame_of_a_camera_whose_clock_is_off_by_up_to_one_percent(rate_hz: float) -> None:
    gaps = {round((later - earlier) * rate_hz * 1e-3, 3) for earlier, later in pairwise(picked_ms(rate_hz, 300.0))}
    assert gaps == {3.0}


@pytest.mark.parametrize(
    ("rate_hz", "gaps_ms"),
    [(30.0, {33.3, 66.7}), (50.0, {40.0, 60.0}), (25.0, {40.0, 80.0})],
)
def test_other_rates_above_20_still_give_20_frames_a_second(rate_hz: float, gaps_ms: set[float]) -> None:
    times = picked_ms(rate_hz)
    assert len(times) == pytest.approx(600, abs=2)
    assert {round(later - earlier, 1) for earlier, later in pairwise(times)} == gaps_ms


@pytest.mark.parametrize("rate_hz", [15.0, 10.0, 3.0])
@pytest.mark.parametrize("nominal_hz", [60.0, None])
def test_a_slower_camera_gives_every_frame(rate_hz: float, nominal_hz: float | None) -> None:
    assert len(picked_ms(rate_hz, nominal_hz=nominal_hz)) == 30 * rate_hz


def test_silence_is_followed_by_single_frames_not_a_burst() -> None:
    picker = GridPicker(1.0 / 60.0)
    frames = [frame for frame in (*range(30), *range(7237, 7267)) if picker.pick(round(frame * 1e9 / 60))]
    # 7237 is all there is for the point of the lost 7236; from then on every third.
    assert [frame for frame in frames if frame > 30] == [7237, *range(7239, 7267, 3)]


def test_the_next_frame_stands_in_for_a_lost_one() -> None:
    picker = GridPicker(1.0 / 60.0)
    lost = {3, 9, 15, 16}
    frames = [frame for frame in range(27) if frame not in lost and picker.pick(round(frame * 1e9 / 60))]
    # 17 is nearer to the point of 18, which is served by 18 itself: the point of 15 goes without.
    assert frames == [0, 4, 6, 10, 12, 18, 21, 24]


def test_frames_standing_in_for_lost_ones_do_not_shift_the_grid() -> None:
    picker = GridPicker(1.0 / 60.0)
    frames = {frame for frame in range(600) if frame % 6 != 3 and picker.pick(round(frame * 1e9 / 60))}
    assert frames == {*range(0, 600, 6), *range(4, 600, 6)}


def test_a_camera_much_faster_than_told_gives_no_burst() -> None:
    picker = GridPicker(1.0 / 5.0)
    times = [t_ns for t_ns in range(0, 10**9, 16_666_667) if picker.pick(t_ns)]
    assert min(later - earlier for earlier, later in pairwise(times)) >= 25e6


@pytest.mark.parametrize("rate_hz", [60.0, 5.0])
def test_a_stamp_that_does_not_advance_is_never_picked(rate_hz: float) -> None:
    picker = GridPicker(1.0 / rate_hz)
    assert picker.pick(10**9)
    assert not picker.pick(10**9)
    assert not picker.pick(10**9 - 50_000_000)
    assert picker.pick(10**9 + 50_000_000)
    assert not picker.pick(10**9 + 49_000_000)


def test_repeated_stamps_do_not_spoil_the_period() -> None:
    picker = GridPicker(1.0 / 60.0)
    assert [picker.pick(10**9) for _ in range(20)] == [True] + [False] * 19
    assert picker.pick(10**9 + 42_000_000)
