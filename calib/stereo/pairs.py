"""Pairs of pictures to calibrate with, or to check a calibration on: from a folder, two videos or a recording."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.recording.asl_folder import AslFolder
from drivers.recording.recording import McapRecording
from messages import StereoFrame, UserError
from messages.arrays import GreyImage

_PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm")
_VIDEOS = (".mp4", ".avi", ".mkv", ".mov")
_EYE = re.compile(
    r"(?<![A-Za-z])(?:left|right|LEFT|RIGHT|Left|Right)(?=$|[^a-z]|cam|im|eye|view)|(?<=[a-z])(?:Left|Right)(?![a-z])"
    r"|(?<![A-Za-z])[lrLR](?![A-Za-z])|(?<=[a-z])[LR](?![A-Za-z])"
    r"|(?<![A-Za-z])(?:cam|camera|Cam|Camera|CAM)[_-]?0?[012](?!\d)|(?<![A-Za-z])image_?0?[01](?=/)"
)
"""An eye in a path: as a word, at a hump, as a letter that stands alone, or by a camera's number."""


class Pair(NamedTuple):
    """Both eyes' grey pictures of one instant, and what a person calls it."""

    name: str
    left: GreyImage
    right: GreyImage


def read_pairs(source: Path, *, side_by_side: bool = False) -> Iterator[Pair]:
    """Yield the pairs of a recording (MCAP), of a EuRoC folder, or of a folder with pictures or two videos.

    In a folder the files' names tell the eyes: `left`, `right` (or `l`, `r`, `cam0`, `cam1`) stand in the name, in that
    of their folder, or in both, and what else is in them is the same; pictures with both eyes beside each other need
    `side_by_side`. Raises UserError, one line, for what holds no pairs, and for pictures of different sizes.
    """
    if not source.exists():
        raise UserError(f"{source}: no such file or folder")
    first: tuple[int, ...] | None = None
    for pair in _pairs(source, side_by_side):
        first = first or pair.left.shape
        if not pair.left.shape == pair.right.shape == first:
            left, right = (f"{shape[1]}x{shape[0]}" for shape in (pair.left.shape, pair.right.shape))
            raise UserError(
                f"{source}: {pair.name} is {left} and {right} px, allowed {first[1]}x{first[0]} for all and both eyes"
            )
        yield pair
    if first is None:
        raise UserError(f"{source}: holds no stereo frame")


def _pairs(source: Path, side_by_side: bool) -> Iterator[Pair]:
    if source.is_file():
        yield from _frames(McapRecording(source))
    elif any(True for place in ("imu0*", "mav0/imu0*") for _ in source.glob(place)):
        yield from _frames(AslFolder(source))
    else:
        files = sorted(path for path in source.rglob("*") if path.is_file())
        videos = [path for path in files if path.suffix.lower() in _VIDEOS]
        pictures = [path for path in files if path.suffix.lower() in _PICTURES]
        if not pictures and not videos:
            raise UserError(f"{source}: holds no picture and no video; allowed are {', '.join(_PICTURES + _VIDEOS)}")
        if side_by_side:
            yield from map(_split, pictures)
        elif pictures:
            yield from (Pair(name, _grey(left), _grey(right)) for name, left, right in _named(source, pictures))
        else:
            yield from _video_pairs(source, videos)


def _frames(recording: McapRecording | AslFolder) -> Iterator[Pair]:
    start_ns: int | None = None
    for message in recording.inputs():
        if isinstance(message, StereoFrame):
            t_ns = message.header.t_exposure_ns
            start_ns = t_ns if start_ns is None else start_ns
            yield Pair(f"{1e-9 * (t_ns - start_ns):.2f} s", message.left, message.right)


def _named(source: Path, files: list[Path]) -> Iterator[tuple[str, Path, Path]]:
    """Yield name, left and right file, of files whose names differ in nothing but the eye."""
    eyes: dict[str, dict[str, Path]] = {}
    for path in files:
        told = str(path.relative_to(source).with_suffix(""))
        found = {_eye(each) for each in _EYE.findall(told)}
        found = found & {"l", "r"} or found
        if len(found) == 1:
            eyes.setdefault(found.pop(), {})[_EYE.sub("", told)] = path
    left, right = next(((eyes[a], eyes[b]) for a, b in _EYES if a in eyes and b in eyes), ({}, {}))
    both = [rest for rest in left if rest in right]
    if not both:
        raise UserError(
            f"{source}: of {len(files)} files none are a pair; name them left01.png and right01.png, say, or put them "
            "into folders left and right; pictures with both eyes beside each other need --side-by-side"
        )
    for rest in both:
        yield rest.strip(" _-/") or rest, left[rest], right[rest]


_EYES = (("l", "r"), ("0", "1"), ("1", "2"))
"""What the left and the right eye are called by, in the order in which they are looked for."""


def _eye(token: str) -> str:
    """Return l or r, or a camera's number."""
    return token[-1] if token[-1].isdigit() else token[0].lower()


def _video_pairs(source: Path, files: list[Path]) -> Iterator[Pair]:
    for name, *paths in _named(source, files):
        videos = [cv2.VideoCapture(str(path)) for path in paths]
        number = 0
        while True:
            (seen_left, left), (seen_right, right) = (video.read() for video in videos)
            if not (seen_left and seen_right):
                break
            yield Pair(f"{name} {number}".strip(), *(_one_channel(picture) for picture in (left, right)))
            number += 1


def _split(path: Path) -> Pair:
    both = _grey(path)
    half = both.shape[1] // 2
    return Pair(path.stem, np.ascontiguousarray(both[:, :half]), np.ascontiguousarray(both[:, half : 2 * half]))


def _grey(path: Path) -> GreyImage:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if picture is None:
        raise UserError(f"{path}: is no picture that can be read")
    if picture.dtype != np.uint8:  # ten, twelve or sixteen bits: what is brightest is white
        picture = cv2.normalize(picture, np.empty(0), 0.0, 255.0, cv2.NORM_MINMAX, cv2.CV_8U)
    return picture.astype(np.uint8, copy=False)


def _one_channel(picture: NDArray[Any]) -> GreyImage:
    return cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)
