"""The rig's stereo camera: frames rendered ahead of time and handed over when they are due."""

import time
from collections import deque

import numpy as np

from drivers.camera.frame_grid import GRID_NS
from drivers.camera.frame_pool import FramePool
from messages import DropCause, StereoFrame
from sim_rig.camera.rendered_frames import FramesAhead, Rendered
from sim_rig.camera.shutter import Shutter
from sim_rig.unit import HEIGHT_PX, WIDTH_PX


class RigCamera:
    """A StereoSource on the 50 ms grid, of `frames` that are there before they are due.

    Of the frames that came due since the last `read` the newest is returned and the others count as SUPERSEDED; a
    frame that was not rendered when it was due counts as LATE. `pool_frames` frames may be held at once.
    """

    def __init__(self, frames: FramesAhead, shutter: Shutter, pool_frames: int = 12) -> None:
        self._shutter = shutter
        self._dropped: dict[DropCause, int] = {}
        self._pool = FramePool(pool_frames, WIDTH_PX, HEIGHT_PX)
        self._waiting: deque[Rendered] = deque()
        self._latest_k: int | None = None
        self._frames = frames

    @property
    def dropped(self) -> dict[DropCause, int]:
        """Return the frames lost so far, by cause."""
        return dict(self._dropped)

    def read(self, timeout_s: float) -> StereoFrame | None:
        """Return the newest frame that is due and was not yet returned, or None if none came due in time.

        Raises DeviceError once the rendering process has ended.
        """
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        while True:
            self._collect()
            now_ns = time.monotonic_ns()
            frame = self._newest_due(now_ns)
            if frame is not None or now_ns >= deadline_ns:
                return frame
            wake_ns = min(deadline_ns, self._shutter.due_ns(self._waiting[0].k)) if self._waiting else deadline_ns
            self._rest((wake_ns - now_ns) * 1e-9)

    def close(self) -> None:
        """Release the frames; may be called again."""
        self._frames.close()

    def _rest(self, seconds: float) -> None:
        """Wait for the next frame to be due or, while there is none, to be rendered."""
        if self._waiting:
            time.sleep(seconds)
        else:
            self._frames.wait(seconds)

    def _collect(self) -> None:
        for rendered in self._frames.collect():
            if self._latest_k is not None:
                self._count(DropCause.LATE, rendered.k - self._latest_k - 1)
            self._latest_k = rendered.k
            self._waiting.append(rendered)

    def _newest_due(self, now_ns: int) -> StereoFrame | None:
        due: list[Rendered] = []
        while self._waiting and self._shutter.due_ns(self._waiting[0].k) <= now_ns:
            rendered = self._waiting.popleft()
            if rendered.ready_ns > self._shutter.due_ns(rendered.k):
                self._count(DropCause.LATE, 1)
                self._frames.give_back(rendered)
            else:
                due.append(rendered)
        stale = [r for r in due if now_ns - self._shutter.due_ns(r.k) >= GRID_NS or r is not due[-1]]
        for rendered in stale:
            self._count(DropCause.SUPERSEDED, 1)
            self._frames.give_back(rendered)
        return None if len(stale) == len(due) else self._copied(due[-1])

    def _copied(self, rendered: Rendered) -> StereoFrame | None:
        pair = self._pool.take()
        if pair is None:
            self._count(DropCause.POOL_EXHAUSTED, 1)
            self._frames.give_back(rendered)
            return None
        left, right = self._frames.pictures(rendered)
        np.copyto(pair.left, left)
        np.copyto(pair.right, right)
        self._frames.give_back(rendered)
        return pair.frame(self._shutter.header(rendered.k))

    def _count(self, cause: DropCause, frames: int) -> None:
        if frames:
            self._dropped[cause] = self._dropped.get(cause, 0) + frames
