"""Frames rendered ahead of time in a process of their own, for whoever plays the camera.

    child: render frame k into a free slot ── shared memory ── parent: takes it when it is due
           ◄─────────── pipe: slots that are free again ───────────
           ─────────── pipe: slot, k, when it was ready ──────────►

The walk is known beforehand, so the child works up to `slots` frames ahead. The memory has no name, so nothing of it
outlives the two processes; the child ends when the parent's end of the pipe closes, however that came about.
"""

from __future__ import annotations

import contextlib
import mmap
import multiprocessing
import os
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from typing import NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.protocols import DeviceError
from messages.arrays import GreyImage
from sim_rig.camera.renderer import Effects, Renderer
from sim_rig.camera.shutter import Shutter
from sim_rig.children import without_interrupt
from sim_rig.unit import HEIGHT_PX, WIDTH_PX, Unit
from sim_rig.walk.gait import Gait
from sim_rig.walk.scenario import Scenario

PAIR_BYTES = 2 * HEIGHT_PX * WIDTH_PX
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
        return self.scenario.gait(self.seed, self.start_ns)

    def renderer(self, effects: Effects | None = None) -> Renderer:
        """Return the renderer of both cameras, with these optical `effects` instead of the usual ones."""
        scenario = self.scenario
        return Renderer(
            self.unit,
            scenario.world,
            self.gait(),
            self.seed,
            things=scenario.things,
            contrast=scenario.contrast,
            effects=effects,
        )


class Rendered(NamedTuple):
    """One frame that waits in a slot: its number and when it was ready (CLOCK_MONOTONIC)."""

    slot: int
    k: int
    ready_ns: int


class FramesAhead(Protocol):
    """Frames of a walk that are there before they are due; see `RenderedFrames`, and `film.FilmedFrames`."""

    def collect(self) -> Iterator[Rendered]:
        """Yield what has become available since the last call."""

    def wait(self, timeout_s: float) -> None:
        """Wait until there is something to collect."""

    def pictures(self, rendered: Rendered) -> tuple[GreyImage, GreyImage]:
        """Return the left and right picture."""

    def give_back(self, rendered: Rendered) -> None:
        """Take the frame back: its pictures are not needed any more."""

    def close(self) -> None:
        """Release everything; may be called again."""


class RenderedFrames:
    """The frames of `scene` in order, up to `slots` of them ahead; `niceness` is that of the rendering process.

    The first frame is the first one that can be ready when it is due; later ones that cannot are left out.
    """

    def __init__(self, scene: Scene, shutter: Shutter, *, slots: int, niceness: int) -> None:
        memory_fd = os.memfd_create("gaiteyes-frames")
        os.truncate(memory_fd, slots * PAIR_BYTES)
        self._memory = mmap.mmap(memory_fd, slots * PAIR_BYTES)
        self._slots = _slots_of(self._memory)
        context = multiprocessing.get_context("spawn")
        self._pipe, childs_end = context.Pipe()
        self._process = context.Process(
            target=_render_frames,
            args=(childs_end, scene, shutter, slots, niceness),
            name="gaiteyes-renderer",
            daemon=True,
        )
        with without_interrupt():
            self._process.start()
        send_handle(self._pipe, memory_fd, self._process.pid)
        childs_end.close()
        os.close(memory_fd)

    def collect(self) -> Iterator[Rendered]:
        """Yield what has been rendered since the last call. Raises DeviceError once the rendering process has ended."""
        if self._memory.closed:
            raise DeviceError("simulated camera: it is closed")
        try:
            while self._pipe.poll():
                yield Rendered(*self._pipe.recv())
        except (EOFError, ConnectionResetError):
            self._process.join(_GOODBYE_S)
            code = self._process.exitcode
            raise DeviceError(f"simulated camera: its rendering process has ended (exit code {code})") from None

    def wait(self, timeout_s: float) -> None:
        """Wait until there is something to collect."""
        self._pipe.poll(timeout_s)

    def pictures(self, rendered: Rendered) -> tuple[GreyImage, GreyImage]:
        """Return the left and right picture, which stay as they are until the frame is given back."""
        left, right = self._slots[rendered.slot]
        return left, right

    def give_back(self, rendered: Rendered) -> None:
        """Let the frame's slot be rendered into again."""
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # `collect` tells that the child is gone
            self._pipe.send(rendered.slot)

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


def _render_frames(pipe: Connection, scene: Scene, shutter: Shutter, slot_count: int, niceness: int) -> None:
    """Render frame after frame into free slots; frames that can no longer be in time are left out."""
    os.nice(niceness)
    cv2.setNumThreads(1)
    memory = mmap.mmap(recv_handle(pipe), slot_count * PAIR_BYTES)
    slots = _slots_of(memory)
    try:
        renderer = scene.renderer()
        for _ in range(2):  # the first loads the textures in sight, the second tells how long a pair takes
            began_ns = time.monotonic_ns()
            renderer.render(began_ns, shutter.exposure_s(0), 0, *slots[0])
            rendering_ns = time.monotonic_ns() - began_ns
        free = deque(range(slot_count))
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
    slots: NDArray[np.uint8] = np.ndarray((len(memory) // PAIR_BYTES, 2, HEIGHT_PX, WIDTH_PX), np.uint8, buffer=memory)
    return slots
