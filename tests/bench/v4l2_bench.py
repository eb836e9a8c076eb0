"""A small camera on the fake node, and what tests ask of it."""

import math
import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.camera.side_by_side import V4l2StereoCamera
from drivers.camera.v4l2_device import IoctlArgument, Kernel
from messages import StereoFrame
from messages.arrays import DepthImage
from sim_rig.camera.v4l2_node import DepthScene, ManualClock, Mode, V4l2Node, stepping_card

WIDTH, HEIGHT = 64, 32
MODE = Mode("YUYV", 2 * WIDTH, HEIGHT)
SCENE = stepping_card(WIDTH, HEIGHT)
T0_NS = 1_000_000_000_000


def stepping_depth(width_px: int, height_px: int) -> DepthScene:
    """Return a scene of depths above and below 255 steps, and one corner without, that grow by one every frame."""
    depth = (np.arange(height_px)[:, None] * 37 + np.arange(width_px) * 11 + 200).astype(np.uint16)

    def picture(frame: int) -> tuple[DepthImage]:
        image = depth + np.uint16(frame % 1000)
        image[:2, :3] = 0
        return (image,)

    return picture


def node(**options: object) -> V4l2Node:
    return V4l2Node(**{"scene": SCENE, "clock": ManualClock(T0_NS), "modes": (MODE,)} | options)  # type: ignore[arg-type]  # options of many types


def camera(
    kernel: Kernel, *, pool_frames: int = 4, stamp_to_mid_exposure_s: float = 0.0, exposure_s: float = math.nan
) -> V4l2StereoCamera:
    return V4l2StereoCamera(
        "/dev/video0",
        WIDTH,
        HEIGHT,
        pool_frames=pool_frames,
        stamp_to_mid_exposure_s=stamp_to_mid_exposure_s,
        exposure_s=exposure_s,
        kernel=kernel,
    )


def read(source: V4l2StereoCamera, timeout_s: float = 0.2) -> StereoFrame:
    frame = source.read(timeout_s)
    assert frame is not None
    return frame


def sequences(source: V4l2StereoCamera, count: int) -> list[int]:
    return [read(source).header.seq for _ in range(count)]


@dataclass
class Answering(V4l2Node):
    """A node that answers one kind of request its own way."""

    request: int = 0
    answer: Callable[[IoctlArgument], None] = lambda _argument: None

    def ioctl(self, fd: int, request: int, argument: IoctlArgument) -> None:
        super().ioctl(fd, request, argument)
        if request == self.request:
            self.answer(argument)


def answering(request: int, answer: Callable[[IoctlArgument], None], mode: Mode = MODE) -> Answering:
    return Answering(SCENE, ManualClock(), modes=(mode,), request=request, answer=answer)


def fail(number: int) -> Callable[[IoctlArgument], None]:
    def answer(_argument: IoctlArgument) -> None:
        raise OSError(number, os.strerror(number))

    return answer
