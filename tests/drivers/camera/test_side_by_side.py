"""Frames of the fake node: pixels, times, which ones come and what is lost."""

import errno
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from drivers.camera import v4l2_abi as v4l2
from drivers.camera.frame_pool import FramePool
from drivers.camera.side_by_side import V4l2StereoCamera, split_eyes
from drivers.camera.v4l2_device import IoctlArgument
from messages import DropCause
from sim_rig.camera.v4l2_node import ZED_MODES, Fault, ManualClock, V4l2Node, stepping_card
from tests.bench.v4l2_bench import HEIGHT, MODE, SCENE, T0_NS, WIDTH, answering, camera, fail, node, read, sequences

# Pictures and times.


def test_eyes_are_split_and_colour_is_left_behind() -> None:
    rng = np.random.default_rng(5)
    yuyv = rng.integers(0, 256, (6, 20, 2), np.uint8)
    pair = FramePool(1, 10, 6).take()
    assert pair is not None
    split_eyes(yuyv.view("<u2")[:, :, 0], pair)
    np.testing.assert_array_equal(pair.left, yuyv[:, :10, 0])
    np.testing.assert_array_equal(pair.right, yuyv[:, 10:, 0])


@pytest.mark.parametrize("row_padding", [0, 10, 64])
def test_pixels_are_those_the_camera_saw_at_any_row_pitch(row_padding: int) -> None:
    source = camera(node(row_padding=row_padding))
    for _ in range(4):
        frame = read(source)
        left, right = SCENE(frame.header.seq)
        np.testing.assert_array_equal(frame.left, left)
        np.testing.assert_array_equal(frame.right, right)


def test_a_frame_keeps_its_pixels_while_the_camera_overwrites_its_buffers() -> None:
    source = camera(node(), pool_frames=2)
    first = read(source)
    sequences(source, 20)
    np.testing.assert_array_equal(first.left, SCENE(0)[0])
    np.testing.assert_array_equal(first.right, SCENE(0)[1])


def test_header_tells_exposure_arrival_and_size() -> None:
    source = camera(node(), stamp_to_mid_exposure_s=0.004, exposure_s=0.008)
    header = read(source).header
    assert header.t_exposure_ns == T0_NS + 104_000_000
    assert header.t_arrival_ns == T0_NS + 115_000_000
    assert (header.exposure_s, header.width_px, header.height_px) == (0.008, WIDTH, HEIGHT)
    assert math.isnan(read(camera(node())).header.exposure_s)


def test_the_size_of_a_zed_is_found_among_its_modes() -> None:
    source = V4l2StereoCamera(
        "/dev/video0", 1280, 720, pool_frames=1, kernel=node(scene=stepping_card(1280, 720), modes=ZED_MODES)
    )
    assert read(source).right.shape == (720, 1280)


# Which frames come.


def test_every_third_frame_comes_and_the_others_are_no_drops() -> None:
    source = camera(node())
    assert sequences(source, 200) == list(range(0, 600, 3))
    assert source.dropped == {}
    assert source.camera_rate_hz == 60.0


def test_jitter_of_the_stamps_does_not_change_the_choice() -> None:
    rng = np.random.default_rng(3)
    jitter_s = rng.uniform(-0.003, 0.003, 700)
    source = camera(node(stamp_jitter_s=lambda frame: float(jitter_s[frame])))
    assert set(np.diff(sequences(source, 200))) == {3}


@pytest.mark.parametrize(("slow_period_s", "steps"), [(1 / 30, {1, 2}), (1 / 15, {1})])
def test_a_camera_slowed_by_poor_light_gives_what_the_picker_documents(slow_period_s: float, steps: set[int]) -> None:
    slow = node(slow_period_s=slow_period_s)
    source = camera(slow)
    assert set(np.diff(sequences(source, 60)[10:])) == steps
    assert source.dropped == {}


def test_a_camera_without_60_hz_says_so_and_works() -> None:
    source = camera(node(rates_hz=(15, 30)))
    assert source.camera_rate_hz == 30.0
    assert len(sequences(source, 20)) == 20


def no_period(argument: IoctlArgument) -> None:
    assert isinstance(argument, v4l2.StreamParm)
    argument.parm.capture.timeperframe.numerator = 0


def no_capability(argument: IoctlArgument) -> None:
    assert isinstance(argument, v4l2.StreamParm)
    argument.parm.capture.capability = 0


@pytest.mark.parametrize("answer", [no_period, no_capability, fail(errno.ENOTTY)])
def test_a_device_that_tells_no_rate_works(answer: Callable[[IoctlArgument], None]) -> None:
    source = camera(answering(v4l2.VIDIOC_S_PARM, answer))
    assert math.isnan(source.camera_rate_hz)
    assert sequences(source, 5) == [0, 3, 6, 9, 12]


def test_nothing_comes_before_its_time() -> None:
    kernel = node()
    source = camera(kernel)
    assert source.read(0.0) is None
    assert source.read(0.1149) is None
    assert kernel.monotonic_ns() - T0_NS == pytest.approx(114.9e6, abs=10)
    assert source.read(0.0002) is not None
    assert source.read(0.0) is None


# What is lost, and why.


def test_lost_frames_are_counted_and_the_grid_served_by_the_next() -> None:
    source = camera(node(faults=dict.fromkeys([3, 7, 10, 11], Fault.LOST)))
    assert sequences(source, 5) == [0, 4, 6, 9, 12]
    assert source.dropped == {DropCause.CAMERA_GAP: 4}


@pytest.mark.parametrize("fault", [Fault.ERROR, Fault.SHORT, Fault.OLD_STAMP])
def test_damaged_frames_are_counted_and_never_returned(fault: Fault) -> None:
    source = camera(node(faults=dict.fromkeys([3, 7, 12], fault)))
    assert sequences(source, 7) == [0, 4, 6, 9, 13, 15, 18]
    assert source.dropped == {DropCause.CORRUPT: 3}


def test_the_newest_frame_wins_when_the_reader_was_away() -> None:
    kernel = node()
    source = camera(kernel)
    assert sequences(source, 1) == [0]
    kernel.sleep(0.101)  # frames 1 to 6 fill all six buffers
    assert read(source, 0.0).header.seq == 6
    assert source.dropped == {DropCause.SUPERSEDED: 1}
    assert sequences(source, 2) == [9, 12]
    for _ in range(10):
        kernel.sleep(0.1005)
        read(source, 0.0)
    assert source.dropped == {DropCause.SUPERSEDED: 11}


def test_frames_the_camera_had_no_buffer_for_are_counted_exactly() -> None:
    kernel = node()
    source = camera(kernel)
    sequences(source, 1)
    kernel.sleep(1.001)  # 60 frames, six buffers
    assert sequences(source, 2) == [6, 61]
    assert source.dropped == {DropCause.SUPERSEDED: 1, DropCause.CAMERA_GAP: 54}


def test_a_full_pool_is_counted_and_recovers() -> None:
    source = camera(node(), pool_frames=2)
    held = [read(source), read(source)]
    assert source.read(0.11) is None
    assert source.dropped == {DropCause.POOL_EXHAUSTED: 2}
    held.pop(0)
    held.append(read(source))
    assert [frame.header.seq for frame in held] == [3, 12]
    assert source.read(0.51) is None
    held.clear()
    assert read(source).header.seq == 45
    assert source.dropped == {DropCause.POOL_EXHAUSTED: 12}


@dataclass
class Counting(V4l2Node):
    """A node with a sequence counter of its own."""

    sequence_of: Callable[[int], int] = int

    def ioctl(self, fd: int, request: int, argument: IoctlArgument) -> None:
        super().ioctl(fd, request, argument)
        if isinstance(argument, v4l2.Buffer):
            argument.sequence = self.sequence_of(argument.sequence)


def test_the_counter_wraps_without_a_gap_and_may_be_set_back() -> None:
    source = camera(Counting(SCENE, ManualClock(), modes=(MODE,), sequence_of=lambda k: (k + 2**32 - 4) % 2**32))
    assert sequences(source, 4) == [2**32 - 4, 2**32 - 1, 2, 5]
    assert source.dropped == {}
    source = camera(Counting(SCENE, ManualClock(), modes=(MODE,), sequence_of=lambda k: k % 5))
    assert sequences(source, 4) == [0, 3, 1, 4]
    assert source.dropped == {}
