"""Exposure and gain of a ZED through its extension unit, down to the bytes of each packet."""

import ctypes
import errno
import math
import os

import pytest

from drivers.camera import uvc_abi as uvc
from drivers.camera.zed import ZedCamera, raw_gain
from drivers.protocols import DeviceError
from messages import StereoFrame
from sim_rig.camera.v4l2_node import V4l2Node
from sim_rig.camera.zed_unit import USB2_BYTES, ZedUnit
from tests.bench.v4l2_bench import HEIGHT, WIDTH, node, sequences
from tests.bench.v4l2_bench import camera as plain_camera

ROW_S = 1.0 / (60.0 * 890)


def zed_node(**options: object) -> V4l2Node:
    return node(**({"zed": ZedUnit()} | options))


def camera(kernel: V4l2Node, exposure_s: float = 0.004, gain_percent: float = 20.0) -> ZedCamera:
    return ZedCamera(
        "/dev/video0",
        WIDTH,
        HEIGHT,
        exposure_s=exposure_s,
        gain_percent=gain_percent,
        pool_frames=4,
        kernel=kernel,
    )


def read(source: ZedCamera) -> StereoFrame:
    frame = source.read(0.2)
    assert frame is not None
    return frame


def refusal(kernel: V4l2Node, exposure_s: float = 0.004) -> str:
    with pytest.raises(DeviceError) as caught:
        camera(kernel, exposure_s)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith("/dev/video0 (")
    return line


@pytest.mark.parametrize("length", [384, USB2_BYTES])
def test_both_eyes_take_exposure_and_gain(length: int) -> None:
    unit = ZedUnit(length=length)
    camera(zed_node(zed=unit), exposure_s=0.004, gain_percent=20.0)
    rows = round(0.004 / ROW_S)
    for eye in ("left", "right"):
        registers = [unit.registers[eye, address] for address in (0x3500, 0x3501, 0x3502, 0x3507, 0x3508, 0x3509)]
        assert registers == [rows >> 12, rows >> 4 & 0xFF, rows << 4 & 0xF0, 0, 0, 131]
    # only the automatic's bit has changed
    assert unit.registers["processor", 0x80181033] == unit.registers["processor", 0x80181833] == 0x40


def test_headers_tell_the_exposure_in_whole_rows_once_it_is_in_effect() -> None:
    source = camera(zed_node(), exposure_s=0.004)
    exposures_s = [read(source).header.exposure_s for _ in range(4)]
    rows = exposures_s[-1] / ROW_S
    assert rows == pytest.approx(round(rows))
    assert exposures_s[-1] == pytest.approx(0.004, abs=ROW_S / 2)


def test_frames_exposed_before_the_setting_took_effect_do_not_claim_it() -> None:
    source = camera(zed_node(startup_s=0.0, transfer_s=0.1))
    assert math.isnan(read(source).header.exposure_s)
    assert not math.isnan([read(source).header.exposure_s for _ in range(3)][-1])


def test_a_camera_that_comes_back_is_set_again() -> None:
    kernel = zed_node()
    source = camera(kernel)
    read(source)
    kernel.unplug()
    with pytest.raises(DeviceError, match="unplugged"):
        source.read(0.1)
    kernel.plug_in()
    kernel.zed = ZedUnit()
    kernel.sleep(1.0)
    read(source)
    assert kernel.zed.registers["left", 0x3501] == 13
    assert not kernel.zed.registers["processor", 0x80181033] & 0x02


def test_without_a_fixed_exposure_the_unit_is_not_touched() -> None:
    class Untouchable(ZedUnit):
        def ask(self, request: uvc.XuControlQuery) -> None:
            raise AssertionError(f"asked for {request.query}")

    kernel = zed_node(zed=Untouchable())

    assert sequences(plain_camera(kernel), 3) == [0, 3, 6]


@pytest.mark.parametrize(
    ("kernel", "words"),
    [
        (node(), "has no control 2 in an extension unit 4"),
        (zed_node(card="Webcam C270"), "camera.exposure_s and gain_percent are for a ZED, this is none"),
        (zed_node(zed=ZedUnit(length=8)), "its extension unit 4 takes 8 bytes, no ZED's does"),
        (zed_node(zed=ZedUnit(rows=0)), "the left eye tells 0 rows a frame, images have 32"),
        (
            zed_node(zed=ZedUnit(stuck={("right", 0x3501): 0})),
            "register 0x3500 of the right eye reads 96, not 3424 as set",
        ),
        (
            zed_node(zed=ZedUnit(stuck={("processor", 0x80181833): 0x42})),
            "the right eye keeps its automatic exposure",
        ),
    ],
    ids=["old firmware", "no ZED", "short", "no frame length", "stuck", "automatic stays"],
)
def test_a_camera_that_does_not_obey_is_refused(kernel: V4l2Node, words: str) -> None:
    assert words in refusal(kernel)


@pytest.mark.parametrize("exposure_s", [1e-5, 0.0167, 0.05])
def test_an_exposure_that_the_rate_does_not_allow_is_refused_with_the_range(exposure_s: float) -> None:
    assert f"camera.exposure_s is {exposure_s:g}, allowed at 60 Hz 3.7e-05 to 0.0166" in refusal(zed_node(), exposure_s)


def test_a_refused_camera_is_left_free() -> None:
    kernel = zed_node(zed=ZedUnit(rows=0))
    refusal(kernel)
    kernel.zed = ZedUnit()
    read(camera(kernel))


def test_the_gain_scale_runs_through_all_four_zones() -> None:
    # the maker's mapping: 654 steps, without the gaps between the zones
    assert [raw_gain(percent) for percent in (0, 39, 40, 59, 60, 79, 80, 100)] == [
        0, 255, 385, 509, 894, 1019, 1916, 2047,
    ]  # fmt: skip
    raws = [raw_gain(percent / 10) for percent in range(1001)]
    assert raws == sorted(raws)


@pytest.mark.parametrize(
    ("unit", "selector", "query", "size", "number"),
    [
        (3, 2, uvc.UVC_GET_LEN, 2, errno.ENOENT),
        (4, 1, uvc.UVC_GET_LEN, 2, errno.ENOENT),
        (4, 2, uvc.UVC_GET_LEN, 4, errno.ENOBUFS),
        (4, 2, uvc.UVC_SET_CUR, 64, errno.ENOBUFS),
        (4, 2, uvc.UVC_GET_CUR, 64, errno.ENOBUFS),
        (4, 2, 0x7F, 384, errno.EINVAL),
    ],
)
def test_the_rigs_unit_refuses_as_uvcvideo_does(unit: int, selector: int, query: int, size: int, number: int) -> None:
    octets = (ctypes.c_uint8 * 512)()
    request = uvc.XuControlQuery(
        unit=unit, selector=selector, query=query, size=size, data=ctypes.cast(octets, ctypes.POINTER(ctypes.c_uint8))
    )
    kernel = zed_node()
    with pytest.raises(OSError, match=os.strerror(number)) as caught:
        kernel.ioctl(kernel.open("/dev/video0"), uvc.UVCIOC_CTRL_QUERY, request)
    assert caught.value.errno == number
