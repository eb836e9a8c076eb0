"""What every FrameSource, stereo or depth, does, whatever stands behind it. A new one joins by a line in BENCHES."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from drivers.camera.depth import V4l2DepthCamera
from drivers.camera.side_by_side import V4l2StereoCamera
from drivers.camera.zed import ZedCamera
from drivers.protocols import DeviceError, FrameSource
from messages import DepthFrame, DropCause, Frame
from sim_rig.camera.v4l2_node import ManualClock, Mode, V4l2Node, stepping_card
from sim_rig.camera.zed_unit import ZedUnit
from tests.bench.v4l2_bench import HEIGHT, WIDTH, node, stepping_depth
from tests.bench.v4l2_pair_bench import cameras, jitter_s

POOL_FRAMES = 4
TIMEOUT_S = 1.0


@dataclass
class Bench:
    """A source that can hold POOL_FRAMES frames, with what a test needs to act on it.

    `pause` lets the source's time pass while nobody reads. `unplug` and `plug_in` are None where a source cannot fail.
    """

    source: FrameSource
    size_px: tuple[int, int]
    pause: Callable[[float], None]
    unplug: Callable[[], None] | None = None
    plug_in: Callable[[], None] | None = None


def v4l2_bench() -> Bench:
    width_px, height_px = 96, 40
    node = V4l2Node(
        stepping_card(width_px, height_px), ManualClock(), modes=(Mode("YUYV", 2 * width_px, height_px),), row_padding=8
    )
    source = V4l2StereoCamera("/dev/video0", width_px, height_px, pool_frames=POOL_FRAMES, kernel=node)
    return Bench(source, (width_px, height_px), node.sleep, node.unplug, node.plug_in)


def v4l2_depth_bench() -> Bench:
    width_px, height_px = 96, 40
    mode = Mode("Z16 ", width_px, height_px)
    node = V4l2Node(stepping_depth(width_px, height_px), ManualClock(), modes=(mode,), row_padding=8)
    source = V4l2DepthCamera("/dev/video0", width_px, height_px, pool_frames=POOL_FRAMES, kernel=node)
    return Bench(source, (width_px, height_px), node.sleep, node.unplug, node.plug_in)


def v4l2_pair_bench() -> Bench:
    both = cameras(
        {"phase_ns": 3_000_000, "stamp_jitter_s": jitter_s(1, 0.0002)},
        {"phase_ns": 3_400_000, "stamp_jitter_s": jitter_s(2, 0.0002), "startup_s": 0.12, "transfer_s": 0.011},
    )
    return Bench(
        both.pair(pool_frames=POOL_FRAMES), (WIDTH, HEIGHT), both.machine.sleep, both.right.unplug, both.right.plug_in
    )


def zed_bench() -> Bench:
    kernel = node(zed=ZedUnit())
    source = ZedCamera(
        kernel.path, WIDTH, HEIGHT, exposure_s=0.004, gain_percent=20.0, pool_frames=POOL_FRAMES, kernel=kernel
    )
    return Bench(source, (WIDTH, HEIGHT), kernel.sleep, kernel.unplug, kernel.plug_in)


BENCHES: dict[str, Callable[[], Bench]] = {
    "v4l2": v4l2_bench,
    "v4l2 depth": v4l2_depth_bench,
    "v4l2 pair": v4l2_pair_bench,
    "zed": zed_bench,
}


@pytest.fixture(params=list(BENCHES.values()), ids=list(BENCHES))
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    made: Bench = request.param()
    yield made
    made.source.close()


def read(bench: Bench) -> Frame:
    frame = bench.source.read(TIMEOUT_S)
    assert frame is not None
    return frame


def test_a_frame_is_two_grey_images_or_one_of_depth_of_the_size_its_header_tells(bench: Bench) -> None:
    frame = read(bench)
    assert (frame.header.width_px, frame.header.height_px) == bench.size_px
    for image in frame.images:
        assert image.shape == (frame.header.height_px, frame.header.width_px)
        assert image.dtype == (np.uint16 if isinstance(frame, DepthFrame) else np.uint8)
        assert image.flags.c_contiguous
        assert image.max() > image.min()
    assert isinstance(frame, DepthFrame) or not np.array_equal(frame.left, frame.right)
    assert math.isnan(frame.header.exposure_s) or frame.header.exposure_s > 0.0


def test_frames_come_twenty_a_second_in_order(bench: Bench) -> None:
    headers = [read(bench).header for _ in range(21)]
    for earlier, later in pairwise(headers):
        assert later.seq > earlier.seq
        assert later.t_exposure_ns > earlier.t_exposure_ns
        assert later.t_arrival_ns >= earlier.t_arrival_ns
    assert headers[-1].t_exposure_ns - headers[0].t_exposure_ns == pytest.approx(1e9, rel=0.02)
    assert all(0 <= header.t_arrival_ns - header.t_exposure_ns < 10**9 for header in headers)


def test_a_frame_owns_its_pixels(bench: Bench) -> None:
    first = read(bench)
    copies = [image.copy() for image in first.images]
    second = read(bench)
    for image in first.images:
        assert not image.flags.writeable
        assert not any(np.shares_memory(image, other) for other in second.images)
    del second
    for _ in range(3 * POOL_FRAMES):
        read(bench)
    for image, copy in zip(first.images, copies, strict=True):
        np.testing.assert_array_equal(image, copy)


def test_no_frame_comes_twice_and_none_before_its_time(bench: Bench) -> None:
    read(bench)
    seqs = [frame.header.seq for _ in range(200) if (frame := bench.source.read(0.001)) is not None]
    assert len(seqs) == len(set(seqs))
    assert len(seqs) <= 25


def test_the_newest_frame_wins_and_the_older_are_counted(bench: Bench) -> None:
    before = read(bench).header
    bench.pause(0.23)
    after = read(bench).header
    assert after.t_exposure_ns - before.t_exposure_ns >= 99_000_000
    assert sum(bench.source.dropped.values()) > 0
    assert DropCause.CORRUPT not in bench.source.dropped


def test_held_frames_bound_memory_and_the_source_recovers(bench: Bench) -> None:
    held = [read(bench) for _ in range(POOL_FRAMES)]
    assert bench.source.read(0.2) is None
    assert bench.source.dropped[DropCause.POOL_EXHAUSTED] > 0
    held.pop()
    assert read(bench).header.seq > held[-1].header.seq


def test_counters_only_grow_and_cannot_be_changed_from_outside(bench: Bench) -> None:
    read(bench)
    bench.pause(0.3)
    read(bench)
    counted = bench.source.dropped
    assert all(isinstance(cause, DropCause) and count > 0 for cause, count in counted.items())
    bench.source.dropped.clear()
    assert bench.source.dropped == counted


def test_a_device_that_goes_is_an_error_and_may_come_back(bench: Bench) -> None:
    if bench.unplug is None or bench.plug_in is None:
        pytest.skip("this source has no cable")
    before = read(bench)
    bench.unplug()
    for _ in range(3):
        with pytest.raises(DeviceError):
            bench.source.read(0.05)
    bench.plug_in()
    bench.pause(1.0)
    after = read(bench)
    assert after.header.t_exposure_ns > before.header.t_exposure_ns


def test_closing_twice_does_no_harm_and_leaves_frames_alone(bench: Bench) -> None:
    frame = read(bench)
    before = frame.images[0].copy()
    bench.source.close()
    bench.source.close()
    np.testing.assert_array_equal(frame.images[0], before)
