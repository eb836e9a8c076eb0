"""What is asked of a camera, given what it lists: the choice by itself, and on the fake node."""

import errno
from fractions import Fraction

import numpy as np
import pytest

from drivers.camera import v4l2_abi as v4l2
from drivers.camera.side_by_side import V4l2StereoCamera
from drivers.camera.v4l2_device import IoctlArgument
from drivers.camera.v4l2_formats import GREY_FORMATS, Choice, Listed, Offer, Rates, WantedFormat
from sim_rig.camera.v4l2_node import ZED_MODES, Mode, stepping_card
from tests.bench.v4l2_bench import HEIGHT, MODE, SCENE, WIDTH, answering, camera, fail, node, read, sequences

YUYV, GREY = v4l2.V4L2_PIX_FMT_YUYV, v4l2.V4L2_PIX_FMT_GREY
WANTED = WantedFormat(GREY_FORMATS, 2560, 720, "two eyes need")


def choices(offers: list[Offer]) -> list[Choice]:
    return Listed(offers, []).choices(WANTED, 60)


def rates(*hz: float) -> Rates:
    return Rates(tuple(Fraction(rate).limit_denominator(1001) for rate in hz))


def offer(fourcc: int, width: int, height: int, *hz: float) -> Offer:
    return Offer(fourcc, (width, height), (width, height), rates(*hz))


@pytest.mark.parametrize(
    ("listed_hz", "asked_hz", "chosen_hz"),
    [
        ((15, 30, 60), 60, 60),
        ((15, 30, 60), 30, 30),
        ((15, 30, 59.94), 60, 59.94),  # what is asked for, as cameras spell it
        ((15, 30), 60, 30),
        ((20, 30, 50), 60, 20),  # meets every point of the grid
        ((20, 30, 40, 50), 60, 40),
        ((7.5, 15), 60, 15),
        ((25, 50, 90), 60, 50),
        ((), 60, 60),
    ],
)
def test_the_rate_that_serves_the_grid_best_is_chosen(
    listed_hz: tuple[float, ...], asked_hz: int, chosen_hz: float
) -> None:
    assert float(rates(*listed_hz).nearest(asked_hz)) == pytest.approx(chosen_hz, rel=1e-5)


def test_of_a_range_of_rates_the_one_asked_for_is_chosen_if_it_is_in() -> None:
    span = Rates((Fraction(5), Fraction(50)), is_range=True)
    assert [span.nearest(asked) for asked in (20, 60, 1)] == [20, 50, 5]


def test_size_and_pixel_format_decide_before_the_rate() -> None:
    listed = [
        offer(YUYV, 2560, 720, 15, 30),
        offer(YUYV, 1344, 376, 60),
        offer(GREY, 2560, 720, 15, 60),
    ]
    assert choices(listed) == [Choice(GREY, Fraction(60)), Choice(YUYV, Fraction(30))]


def test_at_one_rate_half_the_bandwidth_is_chosen() -> None:
    listed = [offer(YUYV, 2560, 720, 60), offer(GREY, 2560, 720, 60)]
    assert choices(listed)[0].fourcc == GREY
    listed = [offer(YUYV, 2560, 720, 60), offer(GREY, 2560, 720, 15)]
    assert choices(listed)[0].fourcc == YUYV


def test_a_range_of_sizes_holds_those_within() -> None:
    span = Offer(YUYV, (48, 30), (8192, 4320), rates())
    assert choices([span]) == [Choice(YUYV, Fraction(60))]
    assert not span.holds(2560, 20)
    assert not span.holds(9000, 720)


def test_without_a_list_everything_wanted_is_tried() -> None:
    assert [choice.fourcc for choice in choices([])] == list(GREY_FORMATS)
    source = camera(answering(v4l2.VIDIOC_ENUM_FMT, fail(errno.ENOTTY)))
    assert sequences(source, 3) == [0, 3, 6]


def test_a_grey_camera_gives_the_pixels_it_saw_at_any_row_pitch() -> None:
    for row_padding in (0, 10, 64):
        source = camera(node(modes=(Mode("GREY", 2 * WIDTH, HEIGHT),), row_padding=row_padding))
        for _ in range(3):
            frame = read(source)
            np.testing.assert_array_equal(frame.left, SCENE(frame.header.seq)[0])
            np.testing.assert_array_equal(frame.right, SCENE(frame.header.seq)[1])


@pytest.mark.parametrize(
    ("eye_px", "rate_hz", "chosen_hz"), [((1280, 720), 60, 60.0), ((1280, 720), 100, 60.0), ((1920, 1080), 60, 30.0)]
)
def test_a_zed_runs_at_the_best_rate_of_its_mode(eye_px: tuple[int, int], rate_hz: int, chosen_hz: float) -> None:
    kernel = node(scene=stepping_card(*eye_px), modes=ZED_MODES)
    source = V4l2StereoCamera("/dev/video0", *eye_px, pool_frames=1, rate_hz=rate_hz, kernel=kernel)
    assert source.camera_rate_hz == chosen_hz
    assert read(source).header.width_px == eye_px[0]


def continuous(argument: IoctlArgument) -> None:
    assert isinstance(argument, v4l2.FrmIvalEnum)
    argument.type = 2
    argument.stepwise.min.numerator, argument.stepwise.min.denominator = 1, 90
    argument.stepwise.max.numerator, argument.stepwise.max.denominator = 1, 5


def unstated(argument: IoctlArgument) -> None:
    assert isinstance(argument, v4l2.FrmIvalEnum)
    argument.discrete.numerator = 0


@pytest.mark.parametrize("answer", [continuous, unstated, fail(errno.ENOTTY)])
def test_odd_lists_of_rates_leave_it_to_the_camera(answer: object) -> None:
    assert callable(answer)
    source = camera(answering(v4l2.VIDIOC_ENUM_FRAMEINTERVALS, answer, MODE))
    assert source.camera_rate_hz == 60.0
    assert sequences(source, 3) == [0, 3, 6]
