import ctypes
import errno
import math
import mmap
import os
import re
import select
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from drivers import v4l2_abi as v4l2
from drivers.protocols import DeviceError
from drivers.stereo_source import FramePool
from drivers.v4l2 import V4l2StereoCamera
from drivers.v4l2_device import IoctlArgument, Kernel, LinuxKernel, split_eyes
from messages import DropCause, StereoFrame
from sim_rig.camera.v4l2_node import ZED_MODES, Fault, ManualClock, Mode, V4l2Node, stepping_card

WIDTH, HEIGHT = 64, 32
MODE = Mode("YUYV", 2 * WIDTH, HEIGHT)
SCENE = stepping_card(WIDTH, HEIGHT)
T0_NS = 1_000_000_000_000


def node(**options: object) -> V4l2Node:
    return V4l2Node(**{"scene": SCENE, "clock": ManualClock(T0_NS), "modes": (MODE,)} | options)  # type: ignore[arg-type]  # options of many types


def camera(
    kernel: Kernel, *, pool_frames: int = 4, stamp_to_mid_exposure_s: float = 0.0, exposure_s: float = math.nan
) -> V4l2StereoCamera:
    return V4l2StereoCamera(
        "/dev/video0",
        WIDTH,
        HEIGHT,
        pool_frames=pool_frames,
        stamp_to_mid_exposure_s=stamp_to_mid_exposure_s,
        exposure_s=exposure_s,
        kernel=kernel,
    )


def read(source: V4l2StereoCamera, timeout_s: float = 0.2) -> StereoFrame:
    frame = source.read(timeout_s)
    assert frame is not None
    return frame


def sequences(source: V4l2StereoCamera, count: int) -> list[int]:
    return [read(source).header.seq for _ in range(count)]


@dataclass
class Answering(V4l2Node):
    """A node that answers one kind of request its own way."""

    request: int = 0
    answer: Callable[[IoctlArgument], None] = lambda _argument: None

    def ioctl(self, fd: int, request: int, argument: IoctlArgument) -> None:
        super().ioctl(fd, request, argument)
        if request == self.request:
            self.answer(argument)


def answering(request: int, answer: Callable[[IoctlArgument], None], mode: Mode = MODE) -> Answering:
    return Answering(SCENE, ManualClock(), modes=(mode,), request=request, answer=answer)


def fail(number: int) -> Callable[[IoctlArgument], None]:
    def answer(_argument: IoctlArgument) -> None:
        raise OSError(number, os.strerror(number))

    return answer


# The numbers of <linux/videodev2.h>.

C_STRUCTS: dict[type[ctypes.Structure], str] = {
    v4l2.Capability: "struct v4l2_capability",
    v4l2.FmtDesc: "struct v4l2_fmtdesc",
    v4l2.FrmSizeDiscrete: "struct v4l2_frmsize_discrete",
    v4l2.FrmSizeStepwise: "struct v4l2_frmsize_stepwise",
    v4l2.FrmSizeEnum: "struct v4l2_frmsizeenum",
    v4l2.PixFormat: "struct v4l2_pix_format",
    v4l2.Format: "struct v4l2_format",
    v4l2.Fract: "struct v4l2_fract",
    v4l2.CaptureParm: "struct v4l2_captureparm",
    v4l2.StreamParm: "struct v4l2_streamparm",
    v4l2.RequestBuffers: "struct v4l2_requestbuffers",
    v4l2.Timeval: "struct timeval",
    v4l2.Timecode: "struct v4l2_timecode",
    v4l2.Buffer: "struct v4l2_buffer",
}


def abi_facts() -> Iterator[tuple[str, int]]:
    """Yield every number the driver relies on as a C expression and our value."""
    for name, value in vars(v4l2).items():
        if re.match("V4L2_|VIDIOC_", name):
            yield name, value
    for python, c_name in C_STRUCTS.items():
        yield f"sizeof({c_name})", ctypes.sizeof(python)
        for name, *_ in python._fields_:
            if not name.startswith("_"):
                yield f"offsetof({c_name}, {name})", getattr(python, name).offset
    yield "offsetof(struct v4l2_frmsizeenum, discrete)", v4l2.FrmSizeEnum.discrete.offset
    yield "offsetof(struct v4l2_frmsizeenum, stepwise)", v4l2.FrmSizeEnum.stepwise.offset


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
@pytest.mark.skipif(not Path("/usr/include/linux/videodev2.h").exists(), reason="no linux/videodev2.h")
@pytest.mark.skipif(sys.maxsize < 2**32, reason="the layouts are those of 64-bit Linux")
def test_every_number_and_layout_is_that_of_the_kernels_header(tmp_path: Path) -> None:
    facts = dict(abi_facts())
    assert len(facts) > 100
    lines = "".join(f'printf("%llu\\n", (unsigned long long)(unsigned int)({expression}));\n' for expression in facts)
    source = tmp_path / "abi.c"
    source.write_text(
        f"#include <stddef.h>\n#include <stdio.h>\n#include <linux/videodev2.h>\nint main(void) {{\n{lines}}}\n"
    )
    subprocess.run(["gcc", "-o", tmp_path / "abi", source], check=True)
    printed = subprocess.run([tmp_path / "abi"], check=True, capture_output=True, text=True).stdout
    header = dict(zip(facts, map(int, printed.split()), strict=True))
    assert facts == header


def test_format_codes_read_as_their_four_characters() -> None:
    assert v4l2.fourcc("YUYV") == 0x56595559
    assert v4l2.fourcc_name(v4l2.V4L2_PIX_FMT_MJPEG) == "MJPG"


# The real kernel, as far as a machine without a camera has one.


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("/dev/no-such-camera", r"/dev/no-such-camera: no such device; cameras are /dev/video\*"),
        ("/dev/null", r"/dev/null: no V4L2 camera \(asking for its capabilities: Inappropriate ioctl"),
        ("/dev", "/dev: cannot be opened: Is a directory"),
    ],
)
def test_a_path_that_is_no_camera_gets_one_clear_line(path: str, line: str) -> None:
    with pytest.raises(DeviceError, match=line) as caught:
        V4l2StereoCamera(path, WIDTH, HEIGHT, pool_frames=2)
    assert "\n" not in str(caught.value)


def test_kernel_maps_and_polls_real_descriptors(tmp_path: Path) -> None:
    kernel = LinuxKernel()
    path = tmp_path / "buffer"
    path.write_bytes(bytes(range(256)) * 16)
    fd = kernel.open(str(path))
    mapping = kernel.mmap(fd, 4096, 0)
    assert mapping[255] == 255
    mapping.close()
    kernel.close(fd)

    ours, theirs = os.pipe()
    assert kernel.poll(ours, 0.0) == 0
    os.write(theirs, b"x")
    assert kernel.poll(ours, 0.0) == select.POLLIN
    os.close(theirs)
    assert kernel.poll(ours, 0.0) & select.POLLHUP
    kernel.close(ours)


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


# A camera that is not what it should be.


def refusal(kernel: Kernel) -> str:
    with pytest.raises(DeviceError) as caught:
        camera(kernel)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith("/dev/video0")
    return line


def test_another_size_is_refused_with_what_the_camera_offers() -> None:
    line = refusal(node(modes=(Mode("YUYV", 2560, 720), Mode("YUYV", 1344, 376), Mode("MJPG", 128, 32))))
    assert line == (
        "/dev/video0 (ZED 2: ZED 2): two eyes of 64x32, the calibration's size, need YUYV 128x32; the camera answers "
        "YUYV 1344x376 and offers YUYV 2560x720, YUYV 1344x376, MJPG 128x32"
    )


def test_another_pixel_format_is_refused() -> None:
    assert "the camera answers MJPG 128x32 and offers MJPG 128x32" in refusal(node(modes=(Mode("MJPG", 128, 32),)))


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
        (answering(v4l2.VIDIOC_STREAMON, fail(errno.ENOSPC)), "starting to stream failed: No space left"),
        (answering(v4l2.VIDIOC_S_PARM, fail(errno.EIO)), "setting the frame rate failed"),
        (answering(v4l2.VIDIOC_QUERYBUF, short_buffer), "buffers of 4096 bytes with rows of 256 cannot hold"),
    ],
    ids=["metadata node", "no streaming", "busy", "one buffer", "no node", "no bandwidth", "I/O error", "short buffer"],
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


def test_a_stream_in_error_is_reopened() -> None:
    kernel = answering(v4l2.VIDIOC_DQBUF, fail(errno.EIO))
    source = camera(kernel)
    with pytest.raises(DeviceError, match="reading a frame failed: Input/output error"):
        source.read(0.2)
    kernel.request = 0
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
