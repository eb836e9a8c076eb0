"""The rig's stereo camera: frames rendered ahead of time in a process of their own and handed over when they are due.

    child: render frame k into a free slot ── shared memory ── parent: wait until it is due, copy it once
           ◄─────────── pipe: slots that are free again ───────────
           ─────────── pipe: slot, k, when it was ready ──────────►

The walk is known beforehand, so the child works up to `_SLOTS` frames ahead. The memory has no name, so nothing of it
outlives the two processes; the child ends when the parent's end of the pipe closes, however that came about.
"""

from __future__ import annotations

import contextlib
import mmap
import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.protocols import DeviceError
from drivers.stereo_source import GRID_NS, FramePool
from messages import DropCause, StereoFrame
from sim_rig.camera.renderer import Renderer
from sim_rig.camera.shutter import Shutter
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, Unit
from sim_rig.walk.gait import Gait
from sim_rig.walk.scenario import Scenario

_SLOTS = 20
_SLOT_SHAPE = (2, HEIGHT_PX, WIDTH_PX)
_MEMORY_BYTES = _SLOTS * 2 * HEIGHT_PX * WIDTH_PX
_NICENESS = 5
_RENDERING_MARGIN = 1.25
_GOODBYE_S = 2.0


@dataclass(frozen=True)
class Scene:
    """All that a picture depends on besides the frame's number."""

    unit: Unit
    scenario: Scenario
    seed: int
    start_ns: int

    def gait(self) -> Gait:
        """Return the wearer's motion."""
        scenario = self.scenario
        return Gait(scenario.world, scenario.legs, scenario.hip_height_m, self.seed, self.start_ns)

    def renderer(self) -> Renderer:
        """Return the eyes."""
        return Renderer(self.unit, self.scenario.world, self.gait(), self.seed)


class _Rendered(NamedTuple):
    slot: int
    k: int
    ready_ns: int


class RigCamera:
    """A StereoSource on the 50 ms grid. The first frame is the first one the rendering process can have in time.

    Of the frames that came due since the last `read` the newest is returned and the others count as SUPERSEDED; a
    frame that was not rendered when it was due counts as LATE. `pool_frames` frames may be held at once.
    """

    def __init__(self, scene: Scene, shutter: Shutter, pool_frames: int = 12) -> None:
        self._shutter = shutter
        self._dropped: dict[DropCause, int] = {}
        self._pool = FramePool(pool_frames, WIDTH_PX, HEIGHT_PX)
        self._waiting: deque[_Rendered] = deque()
        self._latest_k: int | None = None
        memory_fd = os.memfd_create("gaiteyes-frames")
        os.truncate(memory_fd, _MEMORY_BYTES)
        self._memory = mmap.mmap(memory_fd, _MEMORY_BYTES)
        self._slots = _slots_of(self._memory)
        context = multiprocessing.get_context("spawn")
        self._pipe, childs_end = context.Pipe()
        self._process = context.Process(
            target=_render_frames,
            args=(childs_end, scene, shutter),
            name="gaiteyes-renderer",
            daemon=True,
        )
        with _without_interrupt():
            self._process.start()
        send_handle(self._pipe, memory_fd, self._process.pid)
        childs_end.close()
        os.close(memory_fd)

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
        """End the rendering process and give its memory back; may be called again."""
        if self._memory.closed:
            return
        self._pipe.close()
        self._process.join(_GOODBYE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._process.close()
        del self._slots
        self._memory.close()

    def _rest(self, seconds: float) -> None:
        """Wait for the next frame to be due or, while there is none, to be rendered."""
        if self._waiting:
            time.sleep(seconds)
        else:
            self._pipe.poll(seconds)

    def _collect(self) -> None:
        if self._memory.closed:
            raise DeviceError("rig camera: it is closed")
        try:
            while self._pipe.poll():
                rendered = _Rendered(*self._pipe.recv())
                if self._latest_k is not None:
                    self._count(DropCause.LATE, rendered.k - self._latest_k - 1)
                self._latest_k = rendered.k
                self._waiting.append(rendered)
        except (EOFError, ConnectionResetError):
            self._process.join(_GOODBYE_S)
            code = self._process.exitcode
            raise DeviceError(f"rig camera: its rendering process has ended (exit code {code})") from None

    def _newest_due(self, now_ns: int) -> StereoFrame | None:
        due: list[_Rendered] = []
        while self._waiting and self._shutter.due_ns(self._waiting[0].k) <= now_ns:
            rendered = self._waiting.popleft()
            if rendered.ready_ns > self._shutter.due_ns(rendered.k):
                self._count(DropCause.LATE, 1)
                self._give_back(rendered.slot)
            else:
                due.append(rendered)
        stale = [r for r in due if now_ns - self._shutter.due_ns(r.k) >= GRID_NS or r is not due[-1]]
        for rendered in stale:
            self._count(DropCause.SUPERSEDED, 1)
            self._give_back(rendered.slot)
        return None if len(stale) == len(due) else self._copied(due[-1])

    def _copied(self, rendered: _Rendered) -> StereoFrame | None:
        pair = self._pool.take()
        if pair is None:
            self._count(DropCause.POOL_EXHAUSTED, 1)
            self._give_back(rendered.slot)
            return None
        left, right = self._slots[rendered.slot]
        np.copyto(pair.left, left)
        np.copyto(pair.right, right)
        self._give_back(rendered.slot)
        return pair.frame(self._shutter.header(rendered.k))

    def _give_back(self, slot: int) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # the next read tells that the child is gone
            self._pipe.send(slot)

    def _count(self, cause: DropCause, frames: int) -> None:
        if frames:
            self._dropped[cause] = self._dropped.get(cause, 0) + frames


def _render_frames(pipe: Connection, scene: Scene, shutter: Shutter) -> None:
    """Render frame after frame into free slots; frames that can no longer be in time are left out."""
    os.nice(_NICENESS)
    cv2.setNumThreads(1)
    memory = mmap.mmap(recv_handle(pipe), _MEMORY_BYTES)
    slots = _slots_of(memory)
    try:
        renderer = scene.renderer()
        for _ in range(2):  # the first loads the textures in sight, the second tells how long a pair takes
            began_ns = time.monotonic_ns()
            renderer.render(began_ns, shutter.exposure_s(0), 0, *slots[0])
            rendering_ns = time.monotonic_ns() - began_ns
        free = deque(range(_SLOTS))
        k = 0
        with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):  # the camera was closed
            while True:
                while not free or pipe.poll():
                    free.append(pipe.recv())
                began_ns = time.monotonic_ns()
                k = max(k, shutter.first_in_time(began_ns + round(_RENDERING_MARGIN * rendering_ns)))
                slot = free.popleft()
                renderer.render(shutter.true_ns(k), shutter.exposure_s(k), k, *slots[slot])
                ready_ns = time.monotonic_ns()
                rendering_ns = ready_ns - began_ns
                pipe.send((slot, k, ready_ns))
                k += 1
    finally:
        del slots
        memory.close()


def _slots_of(memory: mmap.mmap) -> NDArray[np.uint8]:
    slots: NDArray[np.uint8] = np.ndarray((_SLOTS, *_SLOT_SHAPE), np.uint8, buffer=memory)
    return slots


@contextlib.contextmanager
def _without_interrupt() -> Iterator[None]:
    """Let a child that is started in here never see Ctrl-C: it ends when its parent says so."""
    resource_tracker.ensure_running()  # it would unblock the signal if it were started inside
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
