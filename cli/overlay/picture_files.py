"""Where pictures go: one video, or a folder of PNG files."""

from pathlib import Path
from typing import Protocol

import cv2

from cli.overlay.lettering import Picture
from messages import UserError

CODECS = {".mp4": "mp4v", ".mkv": "mp4v", ".avi": "MJPG"}
"""Of a video's name: codecs that opencv-python-headless brings with it."""


class PictureFiles(Protocol):
    """Takes pictures of one size, in their order."""

    def write(self, picture: Picture) -> None:
        """Write one more. Raises UserError where that cannot be done."""

    def close(self) -> None:
        """Finish what was written."""


def open_pictures(path: Path, rate_hz: float) -> PictureFiles:
    """Return a video where the name ends like one (CODECS), shown at `rate_hz`, else a folder of numbered PNG files.

    Raises UserError, naming `path`, where nothing can be written there.
    """
    return _Video(path, rate_hz) if path.suffix.lower() in CODECS else _Folder(path)


class _Video:
    def __init__(self, path: Path, rate_hz: float) -> None:
        self._path, self._rate_hz = path, rate_hz
        try:
            path.open("wb").close()  # the writer would only say that it is not open
        except OSError as error:
            raise _refused(path, error) from error
        self._writer: cv2.VideoWriter | None = None

    def write(self, picture: Picture) -> None:
        if self._writer is None:
            rows, columns = picture.shape[:2]
            codec = CODECS[self._path.suffix.lower()]
            fourcc = cv2.VideoWriter.fourcc(*codec)
            self._writer = cv2.VideoWriter(str(self._path), fourcc, self._rate_hz, (columns, rows))
            if not self._writer.isOpened():
                raise UserError(f"--overlay {self._path}: this OpenCV writes no video with the codec {codec}")
        self._writer.write(picture)

    def close(self) -> None:
        if self._writer is not None:
            self._writer.release()


class _Folder:
    def __init__(self, path: Path) -> None:
        if path.suffix:
            known = ", ".join(CODECS)
            raise UserError(f"--overlay {path}: a video's name ends in one of {known}, a folder's in none of any kind")
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _refused(path, error) from error
        self._path, self._count = path, 0

    def write(self, picture: Picture) -> None:
        written = self._path / f"{self._count:06d}.png"
        try:
            written.write_bytes(cv2.imencode(".png", picture)[1].tobytes())
        except OSError as error:
            raise _refused(written, error) from error
        self._count += 1

    def close(self) -> None:
        """Do nothing: each file is whole."""


def _refused(path: Path, error: OSError) -> UserError:
    return UserError(f"--overlay {path}: {error.strerror}")
