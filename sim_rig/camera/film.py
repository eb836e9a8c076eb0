"""A walk's frames, rendered before it begins: for a host that cannot render and run the service at once.

    with film_file() as path:
        film = make_film(scene, shutter, count, path)      all cores, as fast as they can
        film.frames(shutter)                               then each frame when it is due, from the file

The file has no header: frame k's left and right eye follow those of k − 1. A film of a walk whose laps are all alike is
that of one lap, shown over and over.
"""

import contextlib
import itertools
import multiprocessing
import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import cv2
import numpy as np

from drivers.protocols import DeviceError
from messages import UserError
from messages.arrays import GreyImage
from sim_rig.camera.rendered_frames import PAIR_BYTES, Rendered, Scene
from sim_rig.camera.shutter import Shutter
from sim_rig.children import without_interrupt
from sim_rig.unit import HEIGHT_PX, WIDTH_PX

_AHEAD_NS = 1_000_000_000
_SPARE_BYTES = 1 << 30
_GOODBYE_S = 2.0
_LARGE_FILES = Path("/var/tmp")  # on the disk, where the usual folder for temporary files may be memory
_BESIDE = 2
_MEASURED_S = 0.4


@dataclass(frozen=True)
class Film:
    """`count` frames in the file at `path`, from frame 0 on; one that `repeats` goes on with frame 0 again."""

    path: Path
    count: int
    repeats: bool

    def frames(self, shutter: Shutter) -> "FilmedFrames":
        """Return the frames for a player; they become available as time goes by, from the next one on."""
        return FilmedFrames(self, shutter)


@contextlib.contextmanager
def film_file() -> Iterator[Path]:
    """Yield the path of an empty file for a film, which is gone with this process however that ends.

    It has no name on the disk; other processes of the user open it by that of this process.
    """
    folder = _LARGE_FILES if os.access(_LARGE_FILES, os.W_OK) else None
    with tempfile.TemporaryFile(dir=folder) as file:
        yield Path(f"/proc/{os.getpid()}/fd/{file.fileno()}")


def make_film(scene: Scene, shutter: Shutter, count: int, path: Path) -> Film:
    """Render frames 0 to `count` − 1 into the file at `path`, one process for each processor that may be used.

    Raises UserError where there is too little room for it, or a process ends too early.
    """
    with path.open("wb") as file:
        size, disk = count * PAIR_BYTES, os.statvfs(file.fileno())
        free = disk.f_bavail * disk.f_frsize
        if free < size + _SPARE_BYTES:
            raise UserError(f"a film of {count} frames takes {size / 1e9:.1f} GB, {free / 1e9:.1f} GB are free")
        try:
            file.truncate(size)
        except OSError as error:  # a limit of this user's, or of the file system's
            raise UserError(f"a film of {count} frames takes {size / 1e9:.1f} GB: {error.strerror}") from None
    context = multiprocessing.get_context("spawn")
    bounds = np.linspace(0, count, len(os.sched_getaffinity(0)) + 1).astype(int).tolist()
    shares = [
        context.Process(target=_render, args=(scene, shutter, range(first, last), path), daemon=True)
        for first, last in itertools.pairwise(bounds)
    ]
    try:
        with without_interrupt():
            for share in shares:
                share.start()
        for share in shares:
            share.join()
            if share.exitcode:
                raise UserError(f"the renderer's process has ended (exit code {share.exitcode})")
    finally:
        for share in shares:
            if share.is_alive():
                share.kill()
    return Film(path, count, scene.scenario.repeats)


def rendering_s(scene: Scene, shutter: Shutter) -> float:
    """Return how long a pair of frames takes while as much work goes on beside: two processors may share one core.

    Raises UserError where a renderer ends too early.
    """
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    renderers = [context.Process(target=_measure, args=(scene, shutter, sender), daemon=True) for _ in range(_BESIDE)]
    with without_interrupt():
        for renderer in renderers:
            renderer.start()
    sender.close()
    try:
        return max(float(receiver.recv()) for _ in renderers)
    except EOFError as error:
        raise UserError("the renderer's process has ended") from error
    finally:
        for renderer in renderers:
            renderer.join(_GOODBYE_S)


class FilmedFrames:
    """A film's frames as `RenderedFrames` gives them, each a while before it is due; one pair is held at a time.

    The first frame is the first one that is not due yet; a film that does not repeat shows nothing after its end.
    """

    def __init__(self, film: Film, shutter: Shutter) -> None:
        self._film = film
        self._shutter = shutter
        self._next = shutter.first_in_time(time.monotonic_ns())
        self._pair = np.empty((2, HEIGHT_PX, WIDTH_PX), np.uint8)
        self._fd = os.open(film.path, os.O_RDONLY)

    def collect(self) -> Iterator[Rendered]:
        """Yield the frames that have come near since the last call. Raises DeviceError once this is closed."""
        if self._fd < 0:
            raise DeviceError("simulated camera: it is closed")
        until_ns = time.monotonic_ns() + _AHEAD_NS
        while self._shutter.true_ns(self._next) < until_ns and (self._film.repeats or self._next < self._film.count):
            yield Rendered(self._next % self._film.count, self._next, ready_ns=0)
            self._next += 1

    def wait(self, timeout_s: float) -> None:
        """Wait as long as that: what is not there yet comes near with time alone."""
        time.sleep(timeout_s)

    def pictures(self, rendered: Rendered) -> tuple[GreyImage, GreyImage]:
        """Return the left and right picture, which stay as they are until the next pair is asked for."""
        read = os.preadv(self._fd, [self._pair.data], rendered.slot * PAIR_BYTES)
        if read != PAIR_BYTES:
            raise DeviceError(f"{self._film.path}: frame {rendered.slot} is cut off")
        left, right = self._pair
        return left, right

    def give_back(self, rendered: Rendered) -> None:
        """Do nothing: the film stays."""

    def close(self) -> None:
        """Close the file; may be called again."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def _render(scene: Scene, shutter: Shutter, frames: range, path: Path) -> None:
    """Render some frames into their places in the file, as long as the process that started this one lives."""
    cv2.setNumThreads(1)
    renderer = scene.renderer()
    pair = np.empty((2, HEIGHT_PX, WIDTH_PX), np.uint8)
    parent = multiprocessing.parent_process()
    with path.open("r+b") as file:
        file.seek(frames.start * PAIR_BYTES)
        for k in frames:
            if parent is None or not parent.is_alive():
                return
            renderer.render(shutter.true_ns(k), shutter.exposure_s(k), k, *pair)
            file.write(pair.data)


def _measure(scene: Scene, shutter: Shutter, to: Connection) -> None:
    """Send how long a pair of frames takes, by the clock; the first loads the textures in sight."""
    cv2.setNumThreads(1)
    renderer = scene.renderer()
    pair = np.empty((2, HEIGHT_PX, WIDTH_PX), np.uint8)
    took_s: list[float] = []
    while sum(took_s[1:]) < _MEASURED_S:
        began_s = time.perf_counter()
        renderer.render(shutter.true_ns(0), shutter.exposure_s(0), 0, *pair)
        took_s.append(time.perf_counter() - began_s)
    to.send(statistics.median(took_s[1:]))
