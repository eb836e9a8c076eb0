"""Which of the images a V4L2 camera offers to ask for: pixel format, size and frame rate.

Reference: Linux Media Infrastructure userspace API, "ioctl VIDIOC_ENUM_FMT", "… FRAMESIZES" and "… FRAMEINTERVALS".
"""

from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from drivers.camera import v4l2_abi as v4l2
from messages import TOPICS

Pixels = NDArray[np.uint8] | NDArray[np.uint16]
"""An image as the kernel shows it, (height_px, width_px): one number a pixel, in YUYV with Y as its low byte."""

PIXEL_TYPES: dict[int, DTypeLike] = {
    v4l2.V4L2_PIX_FMT_GREY: np.dtype("u1"),
    v4l2.V4L2_PIX_FMT_YUYV: np.dtype("<u2"),
    v4l2.V4L2_PIX_FMT_Z16: np.dtype("<u2"),
}

GREY_FORMATS = (v4l2.V4L2_PIX_FMT_GREY, v4l2.V4L2_PIX_FMT_YUYV)
"""Both hold the luminance unpacked; GREY needs half the bandwidth."""

_GRID_HZ = TOPICS["frame"].rate_hz
_SAME_RATE = 0.01
_LONGEST_LIST = 256

ListedStruct = v4l2.FmtDesc | v4l2.FrmSizeEnum | v4l2.FrmIvalEnum
Exists = Callable[[int, ListedStruct], bool]
"""Fills in one line of a list by its request; False behind the last one, or where the device has no such list."""


class WantedFormat(NamedTuple):
    """What is asked of a camera: pixel formats, the best first, one size, and in words what needs them."""

    fourccs: tuple[int, ...]
    width: int
    height: int
    need: str

    def __str__(self) -> str:
        """Return it as a person reads it."""
        return f"{self.need} {' or '.join(map(_name, self.fourccs))} {self.width}x{self.height}"


class Rates(NamedTuple):
    """Frame rates in Hz, or with `is_range` the slowest and the fastest of a range; none if the camera lists none."""

    hz: tuple[Fraction, ...]
    is_range: bool = False

    def nearest(self, asked_hz: int) -> Fraction:
        """Return the rate that serves the 50 ms grid best.

        That is the one asked for; else a multiple of 20 Hz, which meets the grid's points exactly; else any above
        20 Hz; else the fastest. Among equals the nearest to the one asked for.
        """
        if not self.hz:
            return Fraction(asked_hz)
        if self.is_range:
            return min(max(self.hz[0], Fraction(asked_hz)), self.hz[1])
        return min(self.hz, key=lambda rate_hz: unfitness(rate_hz, asked_hz))

    def __str__(self) -> str:
        """Return them as a person reads them."""
        between = " to " if self.is_range else ", "
        return f" ({between.join(f'{float(rate_hz):.4g}' for rate_hz in self.hz)} Hz)" if self.hz else ""


class Offer(NamedTuple):
    """One pixel format of a camera with one size, or with all from `smallest` to `largest` (width, height)."""

    fourcc: int
    smallest: tuple[int, int]
    largest: tuple[int, int]
    rates: Rates

    def holds(self, width: int, height: int) -> bool:
        """Return whether images of this size are on offer."""
        (least_width, least_height), (most_width, most_height) = self.smallest, self.largest
        return least_width <= width <= most_width and least_height <= height <= most_height

    def __str__(self) -> str:
        """Return it as a person reads it."""
        sizes = dict.fromkeys(f"{width}x{height}" for width, height in (self.smallest, self.largest))
        return f"{_name(self.fourcc)} {' to '.join(sizes)}{self.rates}"


class Choice(NamedTuple):
    """What to ask the camera for."""

    fourcc: int
    rate_hz: Fraction


def unfitness(rate_hz: Fraction, asked_hz: int) -> tuple[bool, bool, Fraction, Fraction]:
    """Return what sorts frame rates, the fittest first (see `Rates.nearest`)."""
    is_asked = abs(rate_hz / asked_hz - 1) < _SAME_RATE
    per_grid = float(rate_hz) / _GRID_HZ
    meets_grid = per_grid > 0.5 and abs(per_grid / round(per_grid or 1.0) - 1.0) < _SAME_RATE
    missing_hz = max(Fraction(0), Fraction(_GRID_HZ) - rate_hz)
    return not is_asked, not meets_grid, missing_hz, abs(rate_hz - asked_hz)


class Listed(NamedTuple):
    """What a camera lists: images in the pixel formats wanted, and the names of its other formats."""

    offers: list[Offer]
    others: list[str]

    def choices(self, wanted: WantedFormat, asked_hz: int) -> list[Choice]:
        """Return what to ask for, one after the other, until the camera agrees; it may do more than it lists."""
        found = [
            Choice(offer.fourcc, offer.rates.nearest(asked_hz))
            for offer in self.offers
            if offer.holds(wanted.width, wanted.height)
        ]
        found.sort(key=lambda choice: (unfitness(choice.rate_hz, asked_hz), wanted.fourccs.index(choice.fourcc)))
        return found or [Choice(fourcc, Fraction(asked_hz)) for fourcc in wanted.fourccs]

    def __str__(self) -> str:
        """Return it as a person reads it."""
        return ", ".join((*map(str, self.offers), *self.others)) or "no list of formats"


def listed(exists: Exists, wanted: WantedFormat) -> Listed:
    """Return what the camera lists; a range of sizes comes with the rates of the size wanted."""
    found = Listed([], [])
    for format_index in range(_LONGEST_LIST):
        description = v4l2.FmtDesc(index=format_index, type=v4l2.V4L2_BUF_TYPE_VIDEO_CAPTURE)
        if not exists(v4l2.VIDIOC_ENUM_FMT, description):
            break
        if description.pixelformat in wanted.fourccs:
            found.offers.extend(_sizes(exists, description.pixelformat, wanted))
        else:
            found.others.append(_name(description.pixelformat))
    return found


def _sizes(exists: Exists, fourcc: int, wanted: WantedFormat) -> Iterator[Offer]:
    for size_index in range(_LONGEST_LIST):
        size = v4l2.FrmSizeEnum(index=size_index, pixel_format=fourcc)
        if not exists(v4l2.VIDIOC_ENUM_FRAMESIZES, size):
            return
        if size.type != v4l2.V4L2_FRMSIZE_TYPE_DISCRETE:
            span = size.stepwise
            smallest, largest = (span.min_width, span.min_height), (span.max_width, span.max_height)
            rates = _rates(exists, fourcc, wanted.width, wanted.height)
            yield Offer(fourcc, smallest, largest, rates)
            return
        only = (size.discrete.width, size.discrete.height)
        yield Offer(fourcc, only, only, _rates(exists, fourcc, *only))


def _rates(exists: Exists, fourcc: int, width: int, height: int) -> Rates:
    found: list[Fraction] = []
    for index in range(_LONGEST_LIST):
        interval = v4l2.FrmIvalEnum(index=index, pixel_format=fourcc, width=width, height=height)
        if not exists(v4l2.VIDIOC_ENUM_FRAMEINTERVALS, interval):
            return Rates(tuple(found))
        if interval.type != v4l2.V4L2_FRMIVAL_TYPE_DISCRETE:
            ends = (_hz(interval.stepwise.max), _hz(interval.stepwise.min))
            return Rates(tuple(hz for hz in ends if hz), is_range=True) if all(ends) else Rates(())
        rate_hz = _hz(interval.discrete)
        if rate_hz:
            found.append(rate_hz)
    return Rates(tuple(found))


def _hz(period: v4l2.Fract) -> Fraction | None:
    """Return the rate of a time from frame to frame, None if the camera states none."""
    if not (period.numerator and period.denominator):
        return None
    return Fraction(period.denominator, period.numerator)


def _name(fourcc: int) -> str:
    return v4l2.fourcc_name(fourcc).rstrip()


def format_name(pix: v4l2.PixFormat) -> str:
    """Return the format of an image as a person reads it."""
    return f"{_name(pix.pixelformat)} {pix.width}x{pix.height}"
