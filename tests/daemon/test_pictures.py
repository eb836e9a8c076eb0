"""Pictures are made only while somebody looks, of frames of which all was said, and never at the cost of a frame."""

import weakref

import cv2
import msgspec
import numpy as np
import pytest

from daemon.pictures import WIDTH_PX, Greeting, Pictures, SeenFrame, grey, small
from messages import DepthFrame, Estimate, FrameHeader, Reason, Side, Source, StereoFrame, Terrain
from perception.terrain.surfaces import PathSurfaces, Surface
from tests.bench import recorded

MS = 1_000_000
SURFACES = PathSurfaces([Surface(0.2, 1.5, 0.8, -0.9, 0.01, 0.002, 0.003)], 0.1)
GREETING = Greeting(source=Source.SIMULATED, calibration_text="unit: a", configuration_text="")


class Readers:
    """In place of the socket: keeps what would be sent."""

    def __init__(self) -> None:
        self.is_watched = True
        self.greetings: list[bytes] = []
        self.packets: list[bytes] = []

    def welcome(self, greeting: bytes) -> None:
        self.greetings.append(greeting)

    def send(self, packet: bytes) -> None:
        self.packets.append(packet)

    def close(self) -> None:
        self.is_watched = False

    @property
    def seen(self) -> list[SeenFrame]:
        return [msgspec.msgpack.decode(packet, type=SeenFrame) for packet in self.packets]


@pytest.fixture
def readers() -> Readers:
    return Readers()


@pytest.fixture
def pictures(readers: Readers) -> Pictures:
    return Pictures(readers, GREETING, lambda: SURFACES)


def test_a_frame_is_sent_once_its_terrain_was_told_with_the_surfaces_of_that(
    pictures: Pictures, readers: Readers
) -> None:
    frame = _frame(3, 1000 * MS)
    pictures.add_frame(frame)
    _say(pictures, recorded.ground(3, 1000 * MS))
    pictures.serve(0.0)
    assert readers.packets == []
    _say(pictures, _terrain(2))
    _say(pictures, _terrain(3))
    pictures.serve(0.0)
    (seen,) = readers.seen
    assert (seen.frame_seq, seen.t_exposure_ns) == (3, frame.header.t_exposure_ns)
    assert seen.surfaces == SURFACES
    picture = cv2.imdecode(np.frombuffer(seen.jpeg, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert picture.shape == (360, WIDTH_PX)
    assert abs(float(picture.mean()) - float(frame.left.mean())) < 2.0
    assert msgspec.msgpack.decode(readers.greetings[0], type=Greeting) == GREETING


def test_without_a_reader_no_frame_is_kept(pictures: Pictures, readers: Readers) -> None:
    readers.is_watched = False
    frame = _frame(1, 1000 * MS)
    gone = weakref.ref(frame.left)
    pictures.add_frame(frame)
    del frame
    assert gone() is None
    _say(pictures, _terrain(1))
    pictures.serve(0.0)
    assert readers.packets == []


def test_while_one_waits_the_next_are_passed_over_and_at_most_one_frame_is_held(
    pictures: Pictures, readers: Readers
) -> None:
    held = []
    for k in range(6):
        frame = _frame(k, (1000 + 100 * k) * MS)
        held.append(weakref.ref(frame.left))
        pictures.add_frame(frame)
        del frame
        _say(pictures, _terrain(k))
    assert [ref() is not None for ref in held] == [True, False, False, False, False, False]
    pictures.serve(0.0)
    assert held[0]() is None
    assert [seen.frame_seq for seen in readers.seen] == [0]


def test_every_second_frame_is_enough(pictures: Pictures, readers: Readers) -> None:
    for k in range(10):
        pictures.add_frame(_frame(k, (1000 + 50 * k) * MS))
        _say(pictures, _terrain(k))
        pictures.serve(0.0)
    assert [seen.frame_seq for seen in readers.seen] == [0, 2, 4, 6, 8]


def test_where_pictures_are_turned_off_surfaces_are_sent_alone(readers: Readers) -> None:
    pictures = Pictures(readers, GREETING, lambda: SURFACES, surfaces_only=True)
    pictures.add_frame(_frame(1, 1000 * MS))
    _say(pictures, _terrain(1))
    pictures.serve(0.0)
    (seen,) = readers.seen
    assert seen.jpeg == b""
    assert seen.surfaces == SURFACES


def test_of_a_depth_image_near_is_bright_and_unknown_is_black() -> None:
    depth = np.full((720, 1280), 1000, np.uint16)
    depth[:, 640:] = 4000
    depth[:40] = 0
    shown = small(DepthFrame(header=recorded.header(1, MS, 1280, 720), depth=depth).depth)
    assert shown.shape == (360, WIDTH_PX)
    assert shown[0].max() == 0
    assert shown[200, 100] > shown[200, 500] > 60
    assert np.array_equal(grey(shown), shown)


def _say(pictures: Pictures, estimate: Estimate) -> None:
    header: FrameHeader | None = None
    pictures.add_estimate(estimate, header)


def _frame(seq: int, t_ns: int) -> StereoFrame:
    pixels = np.tile(np.linspace(20, 220, 1280).astype(np.uint8), (720, 1))
    return StereoFrame(header=recorded.header(seq, t_ns, 1280, 720), left=pixels, right=pixels)


def _terrain(seq: int) -> Terrain:
    return Terrain.invalid(
        t_exposure_ns=1, frame_seq=seq, reason=Reason.LOW_TEXTURE, side=Side.RIGHT, calibration_id="c"
    )
