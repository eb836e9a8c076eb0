"""A stereo camera that Linux shows as one V4L2 node delivering both eyes side by side, as a StereoLabs ZED does.

The kernel fills a few mapped buffers in turn. The frame chosen for a point of the 50 ms grid is copied once, into the
pool; every buffer goes back to the kernel at once.
"""

import math
from collections import Counter

from drivers import v4l2_abi as v4l2
from drivers.protocols import DeviceError
from drivers.stereo_source import FramePool, GridPicker
from drivers.v4l2_device import Kernel, LinuxKernel, V4l2Device
from messages import DropCause, FrameHeader, StereoFrame

_RETRY_S = 0.5
_SILENCE_S = 3.0
_STAMP_AHEAD_S = 0.1
_SEQUENCES = 1 << 32


class V4l2StereoCamera:
    """A side-by-side YUYV camera as a StereoSource: frames on the 50 ms grid (see GridPicker), the newest wins.

    `width_px` × `height_px` is the size of one eye, that of the calibration; the camera must deliver exactly twice
    the width. `rate_hz` is asked of the camera, `camera_rate_hz` is what it answered. A ZED belongs at 60: at its
    lower rates frames arrive 30 to 60 ms older. `pool_frames` bounds how many frames may be held at once.

    A frame's `t_exposure_ns` is the kernel's stamp plus `stamp_to_mid_exposure_s`, a calibration item, because
    uvcvideo stamps the first USB payload of a frame whatever its flags say. `exposure_s` is handed on as given; a ZED
    shows it in no V4L2 control. `seq` is the kernel's 32-bit sequence, which starts anew when the device is reopened.

    Drops are counted per frame of the camera, 60 a second: `CAMERA_GAP` (missing sequence numbers), `CORRUPT` (error
    flag, short buffer, a stamp no later than the one before) and, among frames chosen for the grid, `SUPERSEDED` and
    `POOL_EXHAUSTED`. Frames between the grid's points are no drops.

    Raises DeviceError, one line naming the device, if the path is no such camera, is in use, or delivers another size.
    When the camera fails later (unplugged, silent for 3 s, stamps of another clock), `read` closes it and raises
    DeviceError; later calls wait, within their timeout, and try to open it again twice a second.
    """

    def __init__(
        self,
        path: str,
        width_px: int,
        height_px: int,
        *,
        pool_frames: int,
        stamp_to_mid_exposure_s: float = 0.0,
        exposure_s: float = math.nan,
        rate_hz: int = 60,
        kernel: Kernel | None = None,
    ) -> None:
        self._path = path
        self._width_px = width_px
        self._height_px = height_px
        self._rate_hz = rate_hz
        self._stamp_to_exposure_ns = round(stamp_to_mid_exposure_s * 1e9)
        self._exposure_s = exposure_s
        self._kernel: Kernel = LinuxKernel() if kernel is None else kernel
        self._pool = FramePool(pool_frames, width_px, height_px)
        self._dropped: Counter[DropCause] = Counter()
        self._latest_stamp_ns = -1
        self._latest_seq: int | None = None
        self._heard_ns = 0
        self._camera_rate_hz = math.nan
        self._closed = False
        self._failure = ""
        self._retry_at_ns = 0
        self._device: V4l2Device | None = self._open()
        self._picker = GridPicker(1.0 / (rate_hz if math.isnan(self._camera_rate_hz) else self._camera_rate_hz))

    @property
    def camera_rate_hz(self) -> float:
        """Return the rate the camera answered when last opened; NaN if it does not tell."""
        return self._camera_rate_hz

    @property
    def dropped(self) -> dict[DropCause, int]:
        """Return the frames lost in the camera or here, by cause, since the start."""
        return dict(self._dropped)

    def read(self, timeout_s: float) -> StereoFrame | None:
        """Return the newest frame not yet returned, or None if none came within `timeout_s`.

        Raises DeviceError while the camera is gone; a later call may succeed again.
        """
        deadline_ns = self._kernel.monotonic_ns() + round(timeout_s * 1e9)
        device = self._device or self._reopen(timeout_s)
        try:
            while True:
                frame = self._newest(device)
                remaining_s = (deadline_ns - self._kernel.monotonic_ns()) * 1e-9
                if frame is not None or remaining_s <= 0.0:
                    return frame
                device.wait(remaining_s)
        except DeviceError as error:
            device.close()
            self._device = None
            self._retry_later(error)
            raise

    def close(self) -> None:
        """Release the camera for good."""
        self._closed = True
        if self._device is not None:
            self._device.close()
            self._device = None

    def _open(self) -> V4l2Device:
        device = V4l2Device(self._kernel, self._path, 2 * self._width_px, self._height_px, self._rate_hz)
        self._camera_rate_hz = device.rate_hz
        self._latest_seq = None
        self._heard_ns = self._kernel.monotonic_ns()
        return device

    def _reopen(self, timeout_s: float) -> V4l2Device:
        if self._closed:
            raise DeviceError(f"{self._path}: closed")
        wait_s = (self._retry_at_ns - self._kernel.monotonic_ns()) * 1e-9
        if wait_s > 0.0:
            self._kernel.sleep(min(wait_s, timeout_s))
            if wait_s > timeout_s:
                raise DeviceError(self._failure)
        try:
            self._device = self._open()
        except DeviceError as error:
            self._retry_later(error)
            raise
        return self._device

    def _retry_later(self, error: DeviceError) -> None:
        self._failure = str(error)
        self._retry_at_ns = self._kernel.monotonic_ns() + round(_RETRY_S * 1e9)

    def _newest(self, device: V4l2Device) -> StereoFrame | None:
        """Empty the kernel's queue and return the last frame chosen from it."""
        arrival_ns = self._kernel.monotonic_ns()
        chosen: v4l2.Buffer | None = None
        while (buffer := device.dequeue()) is not None:
            self._heard_ns = arrival_ns
            if not self._chooses(device, buffer, arrival_ns):
                device.requeue(buffer)
                continue
            if chosen is not None:
                self._count(DropCause.SUPERSEDED, 1)
                device.requeue(chosen)
            chosen = buffer
        if chosen is not None:
            return self._take(device, chosen, arrival_ns)
        if arrival_ns - self._heard_ns > _SILENCE_S * 1e9:
            raise DeviceError(f"{device.name}: no image for {_SILENCE_S:.0f} s")
        return None

    def _chooses(self, device: V4l2Device, buffer: v4l2.Buffer, arrival_ns: int) -> bool:
        if self._latest_seq is not None:
            # Modulo 2³²; half of that or more is a counter set back, not a gap.
            lost = (buffer.sequence - self._latest_seq - 1) % _SEQUENCES
            self._count(DropCause.CAMERA_GAP, lost if lost < _SEQUENCES // 2 else 0)
        self._latest_seq = buffer.sequence

        _check_clock(device, buffer, arrival_ns)
        stamp_ns = _stamp_ns(buffer)
        broken = buffer.flags & v4l2.V4L2_BUF_FLAG_ERROR or buffer.bytesused < device.frame_bytes
        if broken or stamp_ns <= self._latest_stamp_ns:
            self._count(DropCause.CORRUPT, 1)
            return False
        self._latest_stamp_ns = stamp_ns
        return self._picker.pick(stamp_ns)

    def _take(self, device: V4l2Device, buffer: v4l2.Buffer, arrival_ns: int) -> StereoFrame | None:
        """Copy a frame into the pool and give its buffer back."""
        pair = self._pool.take()
        if pair is None:
            self._count(DropCause.POOL_EXHAUSTED, 1)
            device.requeue(buffer)
            return None
        device.copy(buffer, pair)
        device.requeue(buffer)
        return pair.frame(
            FrameHeader(
                seq=buffer.sequence,
                t_exposure_ns=_stamp_ns(buffer) + self._stamp_to_exposure_ns,
                t_arrival_ns=arrival_ns,
                exposure_s=self._exposure_s,
                width_px=self._width_px,
                height_px=self._height_px,
            )
        )

    def _count(self, cause: DropCause, frames: int) -> None:
        if frames:
            self._dropped[cause] += frames


def _stamp_ns(buffer: v4l2.Buffer) -> int:
    return buffer.timestamp.tv_sec * 1_000_000_000 + buffer.timestamp.tv_usec * 1000


def _check_clock(device: V4l2Device, buffer: v4l2.Buffer, arrival_ns: int) -> None:
    """Raise DeviceError unless the stamp is of CLOCK_MONOTONIC.

    uvcvideo calls its stamps monotonic even when its parameter `clock` makes them CLOCK_REALTIME, decades ahead.
    """
    flag = buffer.flags & v4l2.V4L2_BUF_FLAG_TIMESTAMP_MASK
    ahead_s = (_stamp_ns(buffer) - arrival_ns) * 1e-9
    if flag == v4l2.V4L2_BUF_FLAG_TIMESTAMP_COPY:
        found = "copied from the program that feeds it"
    elif flag != v4l2.V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC:
        found = "of an unknown clock"
    elif ahead_s > _STAMP_AHEAD_S:
        found = f"{ahead_s:.3g} s in the future (uvcvideo's parameter `clock` must be CLOCK_MONOTONIC)"
    else:
        return
    raise DeviceError(f"{device.name}: frame stamps must be of CLOCK_MONOTONIC, these are {found}")
