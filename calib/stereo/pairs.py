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
_SIDE = re.compile(r"(?<![a-z])(left|right|cam0|cam1|l|r)(?![a-z])", re.IGNORECASE)
"""Of an eye, where no other letter stands beside it."""
_LEFT = ("left", "cam0", "l")


class Pair(NamedTuple):
    """Both eyes' grey pictures of one instant, and what a person calls it."""

    name: str
    left: GreyImage
    right: GreyImage


def read_pairs(source: Path, *, side_by_side: bool = False) -> Iterator[Pair]:
    """Yield the pairs of a recording (MCAP), of a EuRoC folder, or of a folder with pictures or two videos.

    In a folder the files' names tell the eyes: `left`, `right` (or `l`, `r`, `cam0`, `cam1`) stand in the name or in
    that of their folder, and what else is in them is the same for both; pictures with both eyes beside each other need
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
    eyes: tuple[dict[str, Path], dict[str, Path]] = ({}, {})
    for path in files:
        told = str(path.relative_to(source).with_suffix(""))
        found = _SIDE.search(told)
        if found is not None:
            rest = told[: found.start()] + told[found.end() :]
            eyes[found.group().lower() not in _LEFT][rest] = path
    both = [rest for rest in eyes[0] if rest in eyes[1]]
    if not both:
        raise UserError(
            f"{source}: of {len(files)} files none are a pair; name them left01.png and right01.png, say, or put them "
            "into folders left and right; pictures with both eyes beside each other need --side-by-side"
        )
    for rest in both:
        yield rest.strip(" _-/") or rest, eyes[0][rest], eyes[1][rest]


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
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise UserError(f"{path}: is no picture that can be read")
    return picture.astype(np.uint8, copy=False)


def _one_channel(picture: NDArray[Any]) -> GreyImage:
    return cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)
