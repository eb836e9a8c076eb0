"""What can go wrong with a pair of images between the ground and the host: each function returns one `ImageChange`."""

import itertools
from collections.abc import Callable

import cv2
import numpy as np

from lab.faults.faulty_camera import ImageChange, Pair
from messages.arrays import GreyImage
from sim_rig.unit import HEIGHT_PX, WIDTH_PX

_FOCAL_PX = 698.6
_SHAPE = (HEIGHT_PX, WIDTH_PX)


def _black() -> GreyImage:
    return np.zeros(_SHAPE, np.uint8)


def _noise(deviation: float) -> GreyImage:
    """Return noise about 16, in a picture somewhat larger than needed."""
    rng = np.random.default_rng(7)
    noise = rng.normal(16.0, deviation, (HEIGHT_PX + 64, WIDTH_PX + 64))
    return np.clip(noise, 0, 255).astype(np.uint8)


def frozen() -> ImageChange:
    """The same two pictures again and again."""
    kept: list[Pair] = []

    def change(pair: Pair) -> Pair:
        if not kept:
            kept.append((pair[0].copy(), pair[1].copy()))
        return kept[0]

    return change


def frozen_but_noisy() -> ImageChange:
    """The same two pictures, each time with other noise, as a stuck optical path in front of a living sensor."""
    still, noise, frames = frozen(), _noise(2.0), itertools.count()

    def change(pair: Pair) -> Pair:
        shift = next(frames) * 13 % 64
        fresh = noise[shift : shift + HEIGHT_PX, 64 - shift : 64 - shift + WIDTH_PX]
        left, right = still(pair)
        return cv2.add(left, fresh).astype(np.uint8), cv2.add(right, fresh[::-1]).astype(np.uint8)

    return change


def swapped() -> ImageChange:
    """Left and right exchanged."""
    return lambda pair: (pair[1], pair[0])


def black(*, left: bool, right: bool) -> ImageChange:
    """One image, or both, black."""
    dark = _black()
    return lambda pair: (dark if left else pair[0], dark if right else pair[1])


def exposed(gain: float) -> ImageChange:
    """Both images `gain` times as bright, saturated at white."""
    return lambda pair: (_times(pair[0], gain), _times(pair[1], gain))


def darkening(per_frame: float) -> ImageChange:
    """Every frame darker than the one before by the factor `per_frame`."""
    gains = itertools.accumulate(itertools.repeat(per_frame), lambda gain, factor: gain * factor)

    def change(pair: Pair) -> Pair:
        gain = next(gains)
        return _times(pair[0], gain), _times(pair[1], gain)

    return change


def _times(picture: GreyImage, gain: float) -> GreyImage:
    return cv2.convertScaleAbs(picture, alpha=gain).astype(np.uint8)


def textureless() -> ImageChange:
    """Even grey with the sensor's noise, as freshly fallen snow."""
    noise, frames = _noise(1.5), itertools.count()
    grey = np.full(_SHAPE, 120, np.uint8)

    def change(_pair: Pair) -> Pair:
        shift = next(frames) * 13 % 64
        fresh = noise[shift : shift + HEIGHT_PX, shift : shift + WIDTH_PX]
        return cv2.add(grey, fresh).astype(np.uint8), cv2.add(grey, fresh[::-1, ::-1]).astype(np.uint8)

    return change


def blurred_left(width_px: int) -> ImageChange:
    """Water on the left lens: a box blur of `width_px`."""
    return lambda pair: (cv2.blur(pair[0], (width_px, width_px)).astype(np.uint8), pair[1])


def dirty_left(radius_px: int) -> ImageChange:
    """A blob of mud in the middle of the left picture."""

    def change(pair: Pair) -> Pair:
        left = pair[0].copy()
        cv2.circle(left, (WIDTH_PX // 2, HEIGHT_PX // 2), radius_px, 40, cv2.FILLED)
        return left, pair[1]

    return change


def torn() -> ImageChange:
    """The lower half of both pictures is still that of the frame before."""
    return _with_the_one_before(
        lambda now, before: (_upper(now[0], before[0]), _upper(now[1], before[1])),
    )


def right_late() -> ImageChange:
    """The right picture is the one taken a frame earlier."""
    return _with_the_one_before(lambda now, before: (now[0], before[1]))


def _upper(now: GreyImage, before: GreyImage) -> GreyImage:
    return np.concatenate((now[: HEIGHT_PX // 2], before[HEIGHT_PX // 2 :]))


def _with_the_one_before(mix: Callable[[Pair, Pair], Pair]) -> ImageChange:
    kept: list[Pair] = []

    def change(pair: Pair) -> Pair:
        now = (pair[0].copy(), pair[1].copy())
        before = kept.pop() if kept else now
        kept.append(now)
        return mix(now, before)

    return change


def right_shifted(rows_px: int, columns_px: int) -> ImageChange:
    """The right camera has slipped in its mount: its picture is shifted down and to the right."""
    return lambda pair: (pair[0], np.roll(pair[1], (rows_px, columns_px), axis=(0, 1)))


def turned(pitch_deg: float, roll_deg: float) -> ImageChange:
    """Both cameras turned on their mount, seen as the picture of a pinhole of the nominal focal length."""
    K = np.array([[_FOCAL_PX, 0.0, (WIDTH_PX - 1) / 2], [0.0, _FOCAL_PX, (HEIGHT_PX - 1) / 2], [0.0, 0.0, 1.0]])
    R, _ = cv2.Rodrigues(np.deg2rad([pitch_deg, 0.0, 0.0]))
    R_roll, _ = cv2.Rodrigues(np.deg2rad([0.0, 0.0, roll_deg]))
    H = K @ R @ R_roll @ np.linalg.inv(K)

    def change(pair: Pair) -> Pair:
        left, right = (
            cv2.warpPerspective(picture, H, (WIDTH_PX, HEIGHT_PX), flags=cv2.INTER_LINEAR).astype(np.uint8)
            for picture in pair
        )
        return left, right

    return change
