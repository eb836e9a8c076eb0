"""Cameras that are not what they should be, or fail while they stream."""

import errno
import mmap
import os
import select

import numpy as np
import pytest

from drivers.camera import v4l2_abi as v4l2
from drivers.camera.side_by_side import V4l2StereoCamera
from drivers.camera.v4l2_device import IoctlArgument, Kernel
from drivers.protocols import DeviceError
from sim_rig.camera.v4l2_node import Fault, ManualClock, Mode, V4l2Node
from tests.bench.v4l2_bench import HEIGHT, MODE, SCENE, WIDTH, answering, camera, fail, node, read, sequences

# A camera that is not what it should be.


def refusal(kernel: Kernel) -> str:
    with pytest.raises(DeviceError) as caught:
        camera(kernel)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith("/dev/video0")
    return line


def test_another_size_is_refused_with_what_the_camera_offers() -> None:
    line = refusal(
        node(modes=(Mode("YUYV", 2560, 720, (30, 60)), Mode("YUYV", 1344, 376, (15,)), Mode("MJPG", 128, 32, (30,))))
    )
    assert line == (
        "/dev/video0 (ZED 2: ZED 2): two eyes of 64x32, the calibration's size, need GREY or YUYV 128x32; the camera "
        "answers YUYV 1344x376 and offers YUYV 2560x720 (30, 60 Hz), YUYV 1344x376 (15 Hz), MJPG"
    )


def test_another_pixel_format_is_refused() -> None:
    line = refusal(node(modes=(Mode("MJPG", 128, 32, (30,)),)))
    assert line.endswith("the camera answers MJPG 128x32 and offers MJPG")


def short_buffer(argument: IoctlArgument) -> None:
    assert isinstance(argument, v4l2.Buffer)
    argument.length = 4096


def range_of_sizes(argument: IoctlArgument) -> None:
    assert isinstance(argument, v4l2.FrmSizeEnum)
    argument.type = 3
    argument.stepwise.min_width, argument.stepwise.max_width = 48, 8192
    argument.stepwise.min_height, argument.stepwise.max_height = 30, 4320


def test_a_range_of_sizes_is_told_as_a_range() -> None:
    odd = answering(v4l2.VIDIOC_ENUM_FRAMESIZES, range_of_sizes, Mode("YUYV", 640, 480))
    assert "offers YUYV 48x30 to 8192x4320" in refusal(odd)


def test_a_driver_that_lists_no_formats_is_told_so() -> None:
    silent = answering(v4l2.VIDIOC_ENUM_FMT, fail(errno.ENOTTY), Mode("YUYV", 640, 480))
    assert refusal(silent).endswith("answers YUYV 640x480 and offers no list of formats")


@pytest.mark.parametrize(
    ("kernel", "words"),
    [
        (node(device_caps=0x00800000 | v4l2.V4L2_CAP_STREAMING), "captures no images"),
        (node(device_caps=v4l2.V4L2_CAP_VIDEO_CAPTURE), "cannot stream"),
        (node(held=True), "in use by another program"),
        (node(most_buffers=1), "grants 1 frame buffers"),
        (node(path="/dev/video2"), "no such device"),
        (answering(v4l2.VIDIOC_STREAMON, fail(errno.ENOSPC)), "the USB bus has no bandwidth left for its images"),
        (answering(v4l2.VIDIOC_STREAMON, fail(errno.EPROTO)), "starting to stream failed: Protocol error"),
        (answering(v4l2.VIDIOC_S_FMT, fail(errno.EPIPE)), "the camera refused the request"),
        (answering(v4l2.VIDIOC_S_FMT, fail(errno.EBUSY)), "in use by another program"),
        (answering(v4l2.VIDIOC_S_PARM, fail(errno.EIO)), "setting the frame rate failed"),
        (answering(v4l2.VIDIOC_QUERYBUF, short_buffer), "buffers of 4096 bytes with rows of 256 cannot hold"),
    ],
    ids=[
        "metadata node",
        "no streaming",
        "busy",
        "one buffer",
        "no node",
        "no bandwidth",
        "cable",
        "stalled",
        "busy at the format",
        "I/O error",
        "short buffer",
    ],
)
def test_unfit_devices_are_refused(kernel: V4l2Node, words: str) -> None:
    assert words in refusal(kernel)


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EACCES, "permission denied; the user must be in the group"),
        (errno.EBUSY, "in use by another program"),
        (errno.ENXIO, "no camera behind this node"),
        (errno.EMFILE, "cannot be opened: Too many open files"),
    ],
)
def test_what_open_refuses_is_told(number: int, words: str) -> None:
    class Closed(V4l2Node):
        def open(self, path: str) -> int:
            raise OSError(number, os.strerror(number), path)

    assert words in refusal(Closed(SCENE, ManualClock()))


def test_a_failed_start_leaves_the_device_free() -> None:
    kernel = answering(v4l2.VIDIOC_STREAMON, fail(errno.ENOSPC))
    refusal(kernel)
    kernel.request = 0
    assert read(camera(kernel)).header.seq == 0


def test_a_mapping_that_fails_is_told() -> None:
    class Unmappable(V4l2Node):
        def mmap(self, fd: int, length: int, offset: int) -> mmap.mmap:
            if offset > 0:
                raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))
            return super().mmap(fd, length, offset)

    assert "mapping a buffer failed" in refusal(Unmappable(SCENE, ManualClock(), modes=(MODE,)))


@pytest.mark.parametrize(
    ("kernel", "words"),
    [
        (node(timestamp_flags=v4l2.V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN), "these are of an unknown clock"),
        (node(timestamp_flags=v4l2.V4L2_BUF_FLAG_TIMESTAMP_COPY), "these are copied from the program that feeds it"),
        (node(faults={0: Fault.REALTIME_STAMP}), r"these are 1.7e\+09 s in the future \(uvcvideo's parameter"),
    ],
    ids=["unknown", "copied", "real time"],
)
def test_stamps_of_another_clock_are_refused(kernel: V4l2Node, words: str) -> None:
    source = camera(kernel)
    with pytest.raises(DeviceError, match=words):
        source.read(0.2)


# A camera that fails while it streams.


def test_unplugged_and_back() -> None:
    kernel = node(faults={31: Fault.UNPLUG})
    source = camera(kernel)
    assert sequences(source, 11)[-1] == 30
    with pytest.raises(DeviceError, match=r"/dev/video0 \(ZED 2: ZED 2\): the camera was unplugged"):
        source.read(0.2)
    with pytest.raises(DeviceError, match="unplugged"):
        source.read(0.2)
    with pytest.raises(DeviceError, match="no such device"):
        source.read(0.5)
    kernel.plug_in()
    frame = read(source, 1.0)
    first = frame.header.seq  # the camera counts anew, the grid goes on
    assert first in (0, 1, 2)
    np.testing.assert_array_equal(frame.left, SCENE(32 + first)[0])
    assert sequences(source, 3) == [first + 3, first + 6, first + 9]
    assert source.dropped == {}


def test_a_camera_that_comes_back_with_another_number_is_found_by_its_lasting_name() -> None:
    lasting = "/dev/v4l/by-id/usb-STEREOLABS_ZED_2-video-index0"
    kernel = node(link=lasting)
    by_number = camera(kernel)
    by_number.close()
    source = V4l2StereoCamera(lasting, WIDTH, HEIGHT, pool_frames=4, kernel=kernel)
    sequences(source, 2)
    kernel.unplug()
    with pytest.raises(DeviceError, match="unplugged"):
        source.read(0.1)
    kernel.plug_in("/dev/video2")
    assert read(source, 1.0).header.seq == 0
    assert "no such device; cameras are /dev/video*, or by a lasting name /dev/v4l/by-id/*" in refusal(kernel)


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENODEV, "unplugged"),
        (errno.EIO, "reading a frame failed: Input/output error"),
        (errno.EPIPE, "the camera refused the request or stopped its stream"),
    ],
)
def test_what_ends_a_stream_is_told_and_the_camera_opened_anew(number: int, words: str) -> None:
    kernel = answering(v4l2.VIDIOC_DQBUF, fail(number))
    source = camera(kernel)
    with pytest.raises(DeviceError, match=words):
        source.read(0.2)
    kernel.request = 0
    assert read(source, 1.0).header.seq == 0


def test_a_missing_camera_is_looked_for_twice_a_second() -> None:
    class Counted(V4l2Node):
        opened = 0

        def open(self, path: str) -> int:
            self.opened += 1
            return super().open(path)

    kernel = Counted(SCENE, ManualClock(), modes=(MODE,))
    source = camera(kernel)
    kernel.unplug()
    start_ns = kernel.monotonic_ns()
    calls = 0
    while kernel.monotonic_ns() - start_ns < 10 * 10**9:
        with pytest.raises(DeviceError):
            source.read(0.1)
        calls += 1
    assert kernel.opened - 1 == pytest.approx(20, abs=1)
    assert calls < 130


def test_what_is_lost_while_the_camera_is_away_is_no_gap() -> None:
    kernel = node(faults={4: Fault.UNPLUG} | dict.fromkeys(range(5, 15), Fault.LOST))
    source = camera(kernel)
    sequences(source, 2)
    with pytest.raises(DeviceError):
        source.read(0.2)
    kernel.plug_in()
    assert read(source, 1.0).header.seq >= 10
    assert source.dropped == {}


def test_unplugged_between_two_reads() -> None:
    kernel = node()
    source = camera(kernel)
    sequences(source, 2)
    kernel.unplug()
    with pytest.raises(DeviceError, match="unplugged"):
        source.read(0.0)


def test_a_silent_camera_is_reopened() -> None:
    kernel = node()
    source = camera(kernel)
    kernel.slow_period_s = 1e6
    sequences(source, 1)
    kernel.slow_period_s = 0.0
    for _ in range(30):
        assert source.read(0.1) is None
    with pytest.raises(DeviceError, match="no image for 3 s"):
        source.read(0.1)
    assert read(source, 1.0).header.seq == 0


def test_an_error_reported_by_poll_alone_ends_the_stream() -> None:
    class Broken(V4l2Node):
        def poll(self, fd: int, timeout_s: float) -> int:
            return super().poll(fd, min(timeout_s, 0.0)) | select.POLLERR

    with pytest.raises(DeviceError, match="unplugged or stopped streaming"):
        camera(Broken(SCENE, ManualClock(), modes=(MODE,))).read(0.2)


def test_readiness_without_a_frame_is_waited_out() -> None:
    class Eager(V4l2Node):
        early = 3

        def poll(self, fd: int, timeout_s: float) -> int:
            if self.early:
                self.early -= 1
                return select.POLLIN
            return super().poll(fd, timeout_s)

    kernel = Eager(SCENE, ManualClock(), modes=(MODE,))
    assert read(camera(kernel)).header.seq == 0
    assert kernel.early == 0


def test_close_frees_the_device_for_others_and_ends_reading() -> None:
    kernel = node()
    source = camera(kernel)
    frame = read(source)
    assert "in use by another program" in refusal(kernel)
    source.close()
    source.close()
    with pytest.raises(DeviceError, match="/dev/video0: closed"):
        source.read(0.1)
    np.testing.assert_array_equal(frame.left, SCENE(0)[0])
    assert read(camera(kernel)).header.seq == 0
