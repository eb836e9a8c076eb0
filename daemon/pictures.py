"""Small pictures of the left eye, or of a depth camera, for `gaiteyes view`; made only while somebody looks.

The pipeline's thread hands over a frame once all was said of it, and only when the one before is done with: it copies
nothing and waits for nothing. Scaling, packing and sending happen in a thread of their own.
"""

import threading
from collections.abc import Callable
from typing import NamedTuple, Protocol

import cv2
import msgspec
import numpy as np

from messages import Estimate, Frame, FrameHeader, Image, Source, Terrain
from messages.arrays import GreyImage
from perception.terrain.surfaces import PathSurfaces

LEAST_APART_NS = 90_000_000
"""Every second frame at 20 a second."""
WIDTH_PX = 640
JPEG_QUALITY = 75


class PictureReaders(Protocol):
    """Who looks: `drivers.picture_socket.PictureServer`."""

    @property
    def is_watched(self) -> bool:
        """Return whether anybody reads."""

    def welcome(self, greeting: bytes) -> None:
        """Take in who has come since the last call, and greet them."""

    def send(self, packet: bytes) -> None:
        """Send to all who read, without waiting."""

    def close(self) -> None:
        """Hang up on all."""


class Greeting(msgspec.Struct, frozen=True, kw_only=True):
    """The first packet for a reader: what it needs to draw anything into pictures."""

    source: Source
    calibration_text: str
    configuration_text: str


class SeenFrame(msgspec.Struct, frozen=True, kw_only=True):
    """One picture, at most WIDTH_PX wide, as JPEG, and the surfaces of the path that were found in it.

    `jpeg` is empty where no pictures are given.
    """

    t_exposure_ns: int
    frame_seq: int
    surfaces: PathSurfaces
    jpeg: bytes


class _Seen(NamedTuple):
    frame: Frame
    surfaces: PathSurfaces


class Pictures:
    """Takes frames and estimates in the pipeline's thread, and serves `server`'s readers in another (`serve`).

    `surfaces` returns what the pipeline's newest terrain was made of. With `surfaces_only` no picture is made.
    """

    def __init__(
        self,
        server: PictureReaders,
        greeting: Greeting,
        surfaces: Callable[[], PathSurfaces],
        *,
        surfaces_only: bool = False,
    ) -> None:
        self._server = server
        self._surfaces_only = surfaces_only
        self._greeting = msgspec.msgpack.encode(greeting)
        self._surfaces = surfaces
        self._frame: Frame | None = None
        self._last_ns = 0
        self._handed_over = threading.Condition()
        self._seen: _Seen | None = None

    def add_frame(self, frame: Frame) -> None:
        """Take the frame that the pipeline works on next."""
        t_ns = frame.header.t_exposure_ns
        is_due = abs(t_ns - self._last_ns) >= LEAST_APART_NS
        self._frame = frame if self._server.is_watched and is_due and self._seen is None else None

    def add_estimate(self, estimate: Estimate, _header: FrameHeader | None) -> None:
        """Hand the frame over when its last estimate has been published."""
        frame = self._frame
        if isinstance(estimate, Terrain) and frame is not None and estimate.frame_seq == frame.header.seq:
            self._frame, self._last_ns = None, frame.header.t_exposure_ns
            with self._handed_over:
                self._seen = _Seen(frame, self._surfaces())
                self._handed_over.notify()

    def serve(self, timeout_s: float) -> None:
        """Greet new readers, then send what was handed over, or wait for it up to `timeout_s`."""
        self._server.welcome(self._greeting)
        with self._handed_over:
            self._handed_over.wait_for(lambda: self._seen is not None, timeout_s)
            seen = self._seen
        if seen is not None:
            picture = None if self._surfaces_only else small(seen.frame.images[0])
            header, surfaces = seen.frame.header, seen.surfaces
            self._seen = seen = None  # the frame's buffer is free before it is packed
            self._server.send(
                msgspec.msgpack.encode(
                    SeenFrame(
                        t_exposure_ns=header.t_exposure_ns,
                        frame_seq=header.seq,
                        surfaces=surfaces,
                        jpeg=b"" if picture is None else jpeg(picture),
                    )
                )
            )

    def close(self) -> None:
        """Hang up on all readers."""
        self._server.close()


def small(image: Image) -> GreyImage:
    """Return `image` (height, width) in shades of grey, no wider than WIDTH_PX, in memory of its own."""
    factor = min(1.0, WIDTH_PX / image.shape[1])
    size = (round(factor * image.shape[1]), round(factor * image.shape[0]))
    if image.dtype != np.uint8:
        return grey(np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_NEAREST), dtype=np.uint16))
    return np.array(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def grey(image: Image) -> GreyImage:
    """Return `image` (height, width) to be looked at: of a depth image near is bright, and black what has no depth."""
    if image.dtype == np.uint8:
        return np.asarray(image, dtype=np.uint8)
    known = image > 0
    near = np.percentile(image[known], 1.0) if known.any() else 1.0
    inverse = np.divide(near, image, out=np.zeros(image.shape), where=known)
    return np.clip(60.0 + 170.0 * inverse, 0, 255).astype(np.uint8) * known


def jpeg(picture: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> bytes:
    """Return `picture`, (height, width) or (height, width, 3), as JPEG."""
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
