"""The service's camera, which is opened at the start and replaced when the configuration changes."""

from collections import Counter
from collections.abc import Callable

from drivers.protocols import DeviceError, FrameSource
from messages import DropCause, Frame

OpenCamera = Callable[[], FrameSource]


class ReplaceableCamera:
    """A FrameSource that opens its camera when it is first read, and another one after `replace`.

    A camera that cannot be opened is tried again by the next `read`; drops are counted over all cameras.
    """

    def __init__(self, open_camera: OpenCamera) -> None:
        self._due: OpenCamera | None = open_camera
        self._camera: FrameSource | None = None
        self._dropped_before: Counter[DropCause] = Counter()

    @property
    def dropped(self) -> dict[DropCause, int]:
        """Return the frames lost so far, by cause, since the start."""
        camera = self._camera
        return dict(self._dropped_before + Counter(camera.dropped if camera is not None else {}))

    def replace(self, open_camera: OpenCamera) -> None:
        """Close the camera and open another one at the next `read`; may be called from another thread."""
        self._due = open_camera

    def open(self) -> None:
        """Open the camera now. Raises DeviceError if that fails."""
        due = self._due
        if due is None:
            return
        self.close()
        self._camera = due()
        if self._due is due:
            self._due = None

    def read(self, timeout_s: float) -> Frame | None:
        """Return the newest frame not yet returned, or None if none came within `timeout_s`.

        Raises DeviceError when the device is gone for now; a later call may succeed again.
        """
        self.open()
        if self._camera is None:
            raise DeviceError("camera: closed")
        return self._camera.read(timeout_s)

    def close(self) -> None:
        """Release the camera, if there is one."""
        camera, self._camera = self._camera, None
        if camera is not None:
            camera.close()
            self._dropped_before += Counter(camera.dropped)
