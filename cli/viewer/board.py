"""What the page shows, kept by one thread, read by those of the browsers: newest picture, facts, a ring of points.

A browser that is slow gets the newest of everything; of points that it missed for longer than the ring is, the newest.
"""

import threading
from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import msgspec

MOST_POINTS = 1200
"""A minute of them at 20 a second."""


class News(NamedTuple):
    """What is new since some earlier one: a text in JSON, a picture as JPEG if there is another. `number` counts."""

    number: int
    point: int
    picture: int
    text: bytes
    jpeg: bytes | None


NOTHING_YET = News(0, 0, 0, b"", None)


class Board:
    """Takes what is to be shown; any thread may read."""

    def __init__(self, title: str) -> None:
        self._changed = threading.Condition()
        self._number = self._point = self._picture = 0
        self._points: deque[Sequence[float | None]] = deque(maxlen=MOST_POINTS)
        self._facts: dict[str, object] = {"title": title}
        self._jpeg = b""
        self._closed = False

    def add_point(self, point: Sequence[float | None]) -> None:
        """Take what the charts show at one instant."""
        with self._changed:
            self._points.append(point)
            self._point += 1
            self._tell()

    def set_facts(self, facts: Mapping[str, object]) -> None:
        """Take facts by their names; the others stay."""
        with self._changed:
            self._facts |= facts
            self._tell()

    def set_picture(self, jpeg: bytes) -> None:
        """Take the newest picture."""
        with self._changed:
            self._jpeg = jpeg
            self._picture += 1
            self._tell()

    def clear_points(self) -> None:
        """Forget all points: a recording begins again."""
        with self._changed:
            self._points.clear()
            self._point = 0
            self._facts["runs"] = self._number
            self._tell()

    def close(self) -> None:
        """Let all readers go."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def news(self, known: News, timeout_s: float) -> News | None:
        """Return what is new since `known`, which may be nothing after `timeout_s`; None once closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._number > known.number, timeout_s)
            if self._closed:
                return None
            fresh = self._point - known.point if self._point >= known.point else self._point
            points = list(self._points)[-fresh:] if fresh else []
            is_new = self._picture > known.picture
            text = msgspec.json.encode({"facts": self._facts, "points": points})
            return News(self._number, self._point, self._picture, text, self._jpeg if is_new else None)

    def _tell(self) -> None:
        self._number += 1
        self._changed.notify_all()
