"""What is found on a machine, what is not looked at, and what is never asked."""

import errno
from pathlib import Path

import pytest

from drivers.can.settings import CanInterface
from drivers.discovery.cameras import CameraKind
from drivers.discovery.devices import FoundDevices
from sim_rig.camera.v4l2_node import Mode
from sim_rig.imu.i2c_bus import I2cWires
from tests.bench.plugged import Plugged


@pytest.fixture
def plugged(tmp_path: Path) -> Plugged:
    return Plugged(tmp_path)


def test_an_empty_machine_has_nothing(plugged: Plugged) -> None:
    assert plugged.find() == FoundDevices(imus=[], cameras=[], cans=[], remarks=[])


def test_a_chip_is_found_on_its_bus_at_its_address_and_by_its_name(plugged: Plugged) -> None:
    plugged.bus(0, I2cWires({}))
    plugged.imu(10, 0x69, who_am_i=0x71)
    plugged.imu(2)
    found = plugged.find()
    assert [(imu.bus, imu.address, imu.is_known) for imu in found.imus] == [(2, 0x68, True), (10, 0x69, True)]
    assert str(found.imus[1]) == "MPU-9250 at 0x69 of /dev/i2c-10"
    assert found.imu == found.imus[0]
    assert not found.remarks


def test_a_chip_that_no_driver_supports_is_told_but_not_taken(plugged: Plugged) -> None:
    plugged.imu(1, who_am_i=0x72)
    found = plugged.find()
    assert found.imu is None
    assert str(found.imus[0]).startswith("WHO_AM_I 0x72, a relative of the MPU-6500 sold as MPU-6050")


@pytest.mark.parametrize("adapter", ["SMBus I801 adapter at efa0", "AMDGPU DM i2c hw bus 0", "DPDDC-A"])
def test_the_buses_of_a_pc_are_never_opened(plugged: Plugged, adapter: str) -> None:
    plugged.imu(0, adapter=adapter)
    assert plugged.find().imus == []


@pytest.mark.parametrize(
    ("error", "remark"),
    [
        (errno.EACCES, "/dev/i2c-1: Permission denied; the user must be in the group that owns it, usually 'i2c'"),
        (errno.ENODEV, "/dev/i2c-1: No such device"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_a_remark(plugged: Plugged, error: int, remark: str) -> None:
    plugged.bus(1, error)
    assert plugged.find().remarks == [remark]


@pytest.mark.parametrize(
    ("error", "remark"),
    [
        (errno.EBUSY, "/dev/i2c-1: a driver of the kernel holds address 0x68"),
        (errno.ETIMEDOUT, "/dev/i2c-1, address 0x68: Connection timed out"),
    ],
)
def test_an_address_that_cannot_be_asked_is_a_remark(plugged: Plugged, error: int, remark: str) -> None:
    wires = I2cWires({})
    wires.fail(error)
    plugged.bus(1, wires)
    assert plugged.find().remarks == [remark]


def test_of_a_zed_the_size_nearest_to_720_rows_and_its_lasting_name(plugged: Plugged) -> None:
    plugged.camera("Webcam", Mode("YUYV", 1280, 720))
    plugged.camera(by_id="usb-STEREOLABS_ZED_2-video-index0")
    plugged.camera("Webcam, its metadata", device_caps=0)
    found = plugged.find()
    assert [camera.kind for camera in found.cameras] == [CameraKind.SINGLE, CameraKind.SIDE_BY_SIDE]
    zed = found.camera
    assert zed is not None
    assert (zed.width_px, zed.height_px) == (1280, 720)
    assert zed.path.endswith("dev/v4l/by-id/usb-STEREOLABS_ZED_2-video-index0")
    assert found.camera_at(str(plugged.root / "dev" / "video1")) == zed


def test_depth_is_depth_whatever_else_a_camera_has(plugged: Plugged) -> None:
    plugged.camera("Depth", modes=(Mode("YUYV", 1920, 1080), Mode("Z16 ", 848, 480), Mode("Z16 ", 1280, 720)))
    (camera,) = plugged.find().cameras
    assert (camera.kind, camera.width_px, camera.height_px) == (CameraKind.DEPTH, 1280, 720)


def test_a_camera_without_usable_pictures_is_none(plugged: Plugged) -> None:
    plugged.camera("packed pictures alone", Mode("MJPG", 1280, 720))
    assert plugged.find().cameras == []


def test_a_bus_that_is_up_comes_before_one_that_is_down_and_no_serial_port_is_opened(plugged: Plugged) -> None:
    plugged.can("eth0", up=True, kind=1)
    plugged.can("can0", up=False)
    plugged.can("can1", up=True)
    plugged.ports += [("/dev/ttyACM0", "Openlight Labs CANable"), ("/dev/ttyUSB0", "FTDI Scanner"), ("/dev/ttyS0", "")]
    found = plugged.find()
    assert [can.channel for can in found.cans] == ["can0", "can1", "/dev/ttyACM0"]
    assert found.can is not None
    assert (found.can.interface, found.can.channel) == (CanInterface.SOCKETCAN, "can1")
    assert found.remarks == [
        "/dev/ttyUSB0 (FTDI Scanner) may be an slcan adapter; if it is one: --can slcan:/dev/ttyUSB0"
    ]
