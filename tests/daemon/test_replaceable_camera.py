"""A camera that can be replaced: absent at first, replaced while running, nothing counted twice or forgotten."""

import pytest

from daemon.replaceable_camera import ReplaceableCamera
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

    replaceable = ReplaceableCamera(open_camera)
    for _ in range(2):
        with pytest.raises(DeviceError, match="no such device"):
            replaceable.read(0.0)
    assert replaceable.dropped == {}
    assert replaceable.read(0.0) is not None
    assert len(attempts) == 3


def test_an_exchange_closes_the_old_camera_and_keeps_its_count() -> None:
    old, new = GreyCamera(), GreyCamera()
    old.dropped, new.dropped = {DropCause.CAMERA_GAP: 3}, {DropCause.CAMERA_GAP: 1, DropCause.CORRUPT: 2}
    replaceable = ReplaceableCamera(lambda: old)
    replaceable.open()
    replaceable.replace(lambda: new)
    replaceable.read(0.0)
    assert old.closed
    assert replaceable.dropped == {DropCause.CAMERA_GAP: 4, DropCause.CORRUPT: 2}
    replaceable.close()
    assert new.closed
    assert replaceable.dropped == {DropCause.CAMERA_GAP: 4, DropCause.CORRUPT: 2}
    with pytest.raises(DeviceError, match="closed"):
        replaceable.read(0.0)


def test_a_camera_that_fails_to_follow_leaves_the_seat_empty_until_it_comes() -> None:
    old, late = GreyCamera(), GreyCamera()
    replaceable = ReplaceableCamera(lambda: old)
    replaceable.open()
    present = False

    def open_late() -> GreyCamera:
        if not present:
            raise DeviceError("/dev/video9: no such device")
        return late

    replaceable.replace(open_late)
    with pytest.raises(DeviceError, match="video9"):
        replaceable.read(0.0)
    present = True
    assert replaceable.read(0.0) is not None
