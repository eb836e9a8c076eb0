"""Depth frames of the fake node: pixels, sizes, what is lost and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from calib.files import save_calibration
from cli.devices import camera_opener
from daemon.config import CameraSettings
from drivers.camera.depth import V4l2DepthCamera
from drivers.protocols import DeviceError
from messages import DepthFrame, DropCause
from sim_rig.camera.depth_unit import draw_depth_unit
from sim_rig.camera.v4l2_node import Fault, ManualClock, Mode, V4l2Node
from tests.bench.v4l2_bench import HEIGHT, WIDTH, stepping_depth

SCENE = stepping_depth(WIDTH, HEIGHT)
MODE = Mode("Z16 ", WIDTH, HEIGHT)


def node(**options: object) -> V4l2Node:
    return V4l2Node(**{"scene": SCENE, "clock": ManualClock(), "modes": (MODE,)} | options)  # type: ignore[arg-type]  # options of many types


def camera(kernel: V4l2Node, *, pool_frames: int = 3) -> V4l2DepthCamera:
    return V4l2DepthCamera("/dev/video0", WIDTH, HEIGHT, pool_frames=pool_frames, kernel=kernel)


def read(source: V4l2DepthCamera) -> DepthFrame:
    frame = source.read(0.2)
    assert frame is not None
    return frame


@pytest.mark.parametrize("row_padding", [0, 10, 64])
def test_every_bit_of_depth_is_that_of_the_camera_at_any_row_pitch(row_padding: int) -> None:
    source = camera(node(row_padding=row_padding))
    for _ in range(4):
        frame = read(source)
        np.testing.assert_array_equal(frame.depth, SCENE(frame.header.seq)[0])
    assert frame.depth.dtype == np.uint16
    assert frame.depth.max() > 255
    assert frame.depth.min() == 0


def test_a_frame_keeps_its_depth_while_the_camera_overwrites_its_buffers() -> None:
    source = camera(node(), pool_frames=2)
    first = read(source)
    for _ in range(20):
        read(source)
    np.testing.assert_array_equal(first.depth, SCENE(0)[0])


def test_memory_is_bounded_and_comes_back() -> None:
    source = camera(node(), pool_frames=2)
    held = [read(source).depth[1:], read(source).depth]
    assert source.read(0.11) is None
    assert source.dropped == {DropCause.POOL_EXHAUSTED: 2}
    held.pop()
    assert read(source).header.seq == 12


def test_lost_and_damaged_frames_have_the_causes_of_every_camera() -> None:
    source = camera(node(faults={1: Fault.LOST, 3: Fault.SHORT, 6: Fault.ERROR}))
    assert [read(source).header.seq for _ in range(4)] == [0, 4, 7, 9]
    assert source.dropped == {DropCause.CAMERA_GAP: 1, DropCause.CORRUPT: 2}


def test_another_size_or_format_is_refused_in_one_line_with_what_is_offered() -> None:
    offers = (Mode("YUYV", WIDTH, HEIGHT, (30,)), Mode("Z16 ", 2 * WIDTH, HEIGHT, (30, 60)))
    with pytest.raises(DeviceError) as raised:
        camera(node(modes=offers))
    line = str(raised.value)
    assert line.startswith(
        "/dev/video0 (ZED 2: ZED 2): a depth image of 64x32, the calibration's size, needs Z16 64x32; "
    )
    assert all(offer in line for offer in ("Z16 128x32", "YUYV"))
    assert "\n" not in line


def test_the_calibration_decides_that_the_camera_is_one_of_depth(tmp_path: Path) -> None:
    _, calibration = draw_depth_unit(1, perfect_calibration=False)
    save_calibration(tmp_path / "depth.yaml", calibration)
    with pytest.raises(DeviceError, match="no such device"):
        camera_opener(CameraSettings(device=str(tmp_path / "video9")), calibration)()
