"""The camera's seat: absent at first, exchanged while running, nothing counted twice or forgotten."""

import pytest

from daemon.camera_seat import CameraSeat
from drivers.protocols import DeviceError
from messages import DropCause
from tests.bench.quiet_devices import GreyCamera


def test_a_camera_that_is_absent_is_tried_again_with_each_read() -> None:
    camera, attempts = GreyCamera(), list[None]()

    def open_camera() -> GreyCamera:
        attempts.append(None)
        if len(attempts) < 3:
            raise DeviceError("/dev/video0: no such device")
        return camera

    seat = CameraSeat(open_camera)
    for _ in range(2):
        with pytest.raises(DeviceError, match="no such device"):
            seat.read(0.0)
    assert seat.dropped == {}
    assert seat.read(0.0) is not None
    assert len(attempts) == 3


def test_an_exchange_closes_the_old_camera_and_keeps_its_count() -> None:
    old, new = GreyCamera(), GreyCamera()
    old.dropped, new.dropped = {DropCause.CAMERA_GAP: 3}, {DropCause.CAMERA_GAP: 1, DropCause.CORRUPT: 2}
    seat = CameraSeat(lambda: old)
    seat.open()
    seat.exchange(lambda: new)
    seat.read(0.0)
    assert old.closed
    assert seat.dropped == {DropCause.CAMERA_GAP: 4, DropCause.CORRUPT: 2}
    seat.close()
    assert new.closed
    assert seat.dropped == {DropCause.CAMERA_GAP: 4, DropCause.CORRUPT: 2}
    with pytest.raises(DeviceError, match="closed"):
        seat.read(0.0)


def test_a_camera_that_fails_to_follow_leaves_the_seat_empty_until_it_comes() -> None:
    old, late = GreyCamera(), GreyCamera()
    seat = CameraSeat(lambda: old)
    seat.open()
    present = False

    def open_late() -> GreyCamera:
        if not present:
            raise DeviceError("/dev/video9: no such device")
        return late

    seat.exchange(open_late)
    with pytest.raises(DeviceError, match="video9"):
        seat.read(0.0)
    present = True
    assert seat.read(0.0) is not None
