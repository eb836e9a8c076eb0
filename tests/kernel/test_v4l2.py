"""The camera driver on V4L2 itself: pixels through, what a camera does wrong, what it is not."""

import time
from collections.abc import Iterator

import numpy as np
import pytest

from drivers.camera.side_by_side import V4l2StereoCamera
from drivers.protocols import DeviceError
from messages import DropCause, StereoFrame
from sim_rig.camera.v4l2_node import stepping_card
from tests.kernel import loopback, vivid

PATIENCE_S = 10.0


@pytest.fixture
def fed() -> Iterator[loopback.FedLoopback]:
    made = loopback.FedLoopback()
    yield made
    made.unplug()


@pytest.fixture
def webcam() -> Iterator[vivid.Vivid]:
    made = vivid.Vivid()
    yield made
    made.plug_in()


def read(source: V4l2StereoCamera) -> StereoFrame:
    """The next frame, however long the driver takes to find its camera again."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        try:
            frame = source.read(0.5)
        except DeviceError:
            continue
        if frame is not None:
            return frame
    raise AssertionError("no frame came")


def read_until_error(source: V4l2StereoCamera) -> None:
    for _ in range(20):
        source.read(0.5)


def read_until_dropped(source: V4l2StereoCamera, cause: DropCause) -> int:
    for _ in range(40):
        read(source)
        if dropped := source.dropped.get(cause, 0):
            return dropped
    raise AssertionError(f"{cause} was not counted")


def test_pixels_arrive_as_they_were_shown(fed: loopback.FedLoopback) -> None:
    source = fed.camera()
    frame = read(source)
    step = int(frame.left[0, 0])
    left, right = stepping_card(*loopback.EYE_PX)(step)
    np.testing.assert_array_equal(frame.left, left)
    np.testing.assert_array_equal(frame.right, right)
    source.close()


def test_a_camera_that_falls_silent_is_an_error_until_it_shows_again(fed: loopback.FedLoopback) -> None:
    source = fed.camera()
    before = read(source)
    fed.unplug()
    with pytest.raises(DeviceError, match="no image for 3 s"):
        read_until_error(source)
    fed.plug_in()
    assert read(source).header.t_exposure_ns > before.header.t_exposure_ns
    source.close()


def test_a_node_nobody_feeds_captures_no_images(fed: loopback.FedLoopback) -> None:
    fed.unplug()
    with pytest.raises(DeviceError) as refused:
        fed.camera()
    assert "\n" not in str(refused.value)


def test_an_unplugged_camera_is_an_error_and_is_found_again(webcam: vivid.Vivid) -> None:
    source = webcam.camera()
    before = read(source)
    webcam.unplug()
    with pytest.raises(DeviceError, match="unplugged"):
        read_until_error(source)
    with pytest.raises(DeviceError):
        source.read(1.0)
    webcam.plug_in()
    assert read(source).header.t_exposure_ns > before.header.t_exposure_ns
    source.close()


def test_frames_lost_in_the_camera_are_counted_by_their_sequence(webcam: vivid.Vivid) -> None:
    source = webcam.camera()
    read(source)
    webcam.set("Percentage of Dropped Buffers", 50)
    assert read_until_dropped(source, DropCause.CAMERA_GAP) > 0
    source.close()


def test_a_frame_with_the_error_flag_is_not_used_and_counted(webcam: vivid.Vivid) -> None:
    source = webcam.camera()
    read(source)
    webcam.set("Inject V4L2_BUF_FLAG_ERROR")
    assert read_until_dropped(source, DropCause.CORRUPT) == 1
    source.close()


def test_a_stream_that_fails_for_good_is_opened_anew(webcam: vivid.Vivid) -> None:
    source = webcam.camera()
    before = read(source)
    webcam.set("Inject Fatal Streaming Error")
    with pytest.raises(DeviceError):
        read_until_error(source)
    assert read(source).header.t_exposure_ns > before.header.t_exposure_ns
    source.close()


@pytest.mark.parametrize("request_name", ["VIDIOC_REQBUFS", "VIDIOC_STREAMON"])
def test_a_camera_that_refuses_to_stream_is_one_clear_line(webcam: vivid.Vivid, request_name: str) -> None:
    webcam.set(f"Inject {request_name} Error")
    with pytest.raises(DeviceError, match=vivid.NODE) as refused:
        webcam.camera()
    assert "\n" not in str(refused.value)
    source = webcam.camera()
    read(source)
    source.close()


def test_a_camera_in_use_is_said_to_be(webcam: vivid.Vivid) -> None:
    source = webcam.camera()
    with pytest.raises(DeviceError, match="in use by another program"):
        webcam.camera()
    source.close()


def test_a_size_the_camera_has_not_is_refused_with_those_it_has(webcam: vivid.Vivid) -> None:
    with pytest.raises(DeviceError, match=r"320x180.*1280x720"):
        webcam.camera((200, 100))
