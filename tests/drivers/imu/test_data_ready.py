"""The GPIO line at libgpiod's level, which this file stands in for: what is asked of it and what it may answer."""

from collections import deque

import gpiod
import pytest
from gpiod.line import Clock, Direction, Edge

from drivers.imu.data_ready import GpiodDataReady, parse_data_ready
from drivers.protocols import DeviceError


class Request:
    """libgpiod's LineRequest as far as the driver knows it."""

    def __init__(self) -> None:
        self.events: deque[gpiod.EdgeEvent] = deque()
        self.failure: OSError | None = None
        self.released = False
        self.sequence = 0

    def rise(self, t_ns: int, *, dropped: int = 0) -> None:
        self.sequence += 1 + dropped
        self.events.append(
            gpiod.EdgeEvent(gpiod.EdgeEvent.Type.RISING_EDGE.value, t_ns, 17, self.sequence, self.sequence)
        )

    def wait_edge_events(self, timeout: float) -> bool:
        assert timeout >= 0.0
        return bool(self.events) or self.failure is not None

    def read_edge_events(self, max_events: int) -> list[gpiod.EdgeEvent]:
        if self.failure is not None:
            raise self.failure
        return [self.events.popleft() for _ in range(min(max_events, len(self.events), 64))]

    def release(self) -> None:
        self.released = True

    def __bool__(self) -> bool:
        return not self.released


@pytest.fixture
def request_made(monkeypatch: pytest.MonkeyPatch) -> tuple[Request, dict[str, object]]:
    request, asked = Request(), dict[str, object]()

    def request_lines(path: str, **options: object) -> Request:
        asked.update(options, path=path)
        return request

    monkeypatch.setattr(gpiod, "request_lines", request_lines)
    return request, asked


def test_rising_edges_are_asked_for_in_the_monotonic_clock(request_made: tuple[Request, dict[str, object]]) -> None:
    _, asked = request_made
    GpiodDataReady("/dev/gpiochip3", 17)
    assert asked["path"] == "/dev/gpiochip3"
    assert asked["event_buffer_size"] == 512
    config = asked["config"]
    assert isinstance(config, dict)
    settings = config[17]
    assert (settings.direction, settings.edge_detection, settings.event_clock) == (
        Direction.INPUT,
        Edge.RISING,
        Clock.MONOTONIC,
    )


def test_all_waiting_edges_come_at_once_and_dropped_ones_are_counted(
    request_made: tuple[Request, dict[str, object]],
) -> None:
    request, _ = request_made
    line = GpiodDataReady("/dev/gpiochip3", 17)
    assert line.wait(0.1) == []
    for k in range(100):
        request.rise(1000 + k)
    assert line.wait(0.1) == list(range(1000, 1100))
    request.rise(2000, dropped=7)
    assert line.wait(-1.0) == [2000]
    assert line.dropped == 7


def test_a_chip_that_is_unplugged_is_one_clear_line(request_made: tuple[Request, dict[str, object]]) -> None:
    request, _ = request_made
    line = GpiodDataReady("/dev/gpiochip3", 17)
    request.failure = OSError(19, "No such device")
    with pytest.raises(DeviceError, match=r"^data-ready line 17 of /dev/gpiochip3: .*No such device$"):
        line.wait(0.1)
    line.close()
    line.close()
    assert request.released


def test_a_chip_that_is_not_there_is_one_clear_line() -> None:
    with pytest.raises(DeviceError, match=r"^data-ready line 4 of /dev/gpiochip99: No such file or directory$"):
        GpiodDataReady("/dev/gpiochip99", 4)
    with pytest.raises(DeviceError, match=r"^data-ready line 4 of /dev/null: [^\n]+$"):
        GpiodDataReady("/dev/null", 4)


def test_the_line_is_named_by_chip_and_number() -> None:
    assert parse_data_ready("/dev/gpiochip0:17") == ("/dev/gpiochip0", 17)
    for wrong in ("", "17", "/dev/gpiochip0", "gpiochip0:17", "/dev/gpiochip0:x"):
        with pytest.raises(ValueError, match="expected PATH:LINE"):
            parse_data_ready(wrong)
