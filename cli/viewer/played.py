"""A recording, replayed at the pace at which it was recorded, with its pictures."""

import threading
import time
from collections.abc import Callable
from typing import Protocol

from cli.overlay.lettering import Picture
from cli.overlay.overlay import Overlay
from cli.viewer.board import Board
from cli.viewer.facts import Facts
from daemon.pictures import jpeg, small
from daemon.pipeline import Pipeline
from daemon.replay_source import ReplaySource
from messages import AnkleState, DroppedFrame, Frame, GroundPlane, GroundTruth, Image, ImuSample, Input

TOO_LATE_S = 0.1
"""Behind the recording's pace by so much, pictures are passed over: estimates never are."""
LEAST_SHOWN_S = 0.5
"""But one is shown so often."""
FAR_TOO_LATE_S = 1.0
"""A host that cannot keep the pace plays slower."""


class Pace(Protocol):
    """Says when a message's time has come."""

    def wait_for(self, message: Input) -> float:
        """Wait until it is time for `message`; return by how much it is late, in seconds."""


class Player:
    """Plays `source` onto `board`; `command` takes "pause", "play" and "again", from any thread.

    `pace` begins a new counting of time; by default it is that of the recording, as is the `truth` of each ground.
    """

    def __init__(
        self,
        source: ReplaySource,
        board: Board,
        pace: "Callable[[], Pace] | None" = None,
        truth: Callable[[GroundPlane], GroundTruth | None] | None = None,
    ) -> None:
        self._source = source
        self._pace = pace or RecordedPace
        self._board = board
        self._going = threading.Event()
        self._going.set()
        self._again = threading.Event()
        recorded = {} if truth is not None else source.rig_truth()
        self._facts = Facts(board, source.calibration, truth or (lambda ground: recorded.get(ground.t_exposure_ns)))
        self._late_s = 0.0
        self._shown_s = -LEAST_SHOWN_S
        board.set_facts({"source": "recording", "latency_of": "exposure to arrival", "ended": "", "plays": True})

    def command(self, said: str) -> None:
        """Do what a button says; anything else is ignored."""
        if said == "again":
            self._again.set()
            self._going.set()
            self._board.set_facts({"plays": True})
        elif said in ("pause", "play"):
            (self._going.set if said == "play" else self._going.clear)()
            self._board.set_facts({"plays": said == "play"})

    def play(self) -> None:
        """Play for ever: at the end wait to be told to begin again."""
        while True:
            self._play_once()
            if not self._again.is_set():
                damage = self._source.damage()
                self._board.set_facts({"ended": damage or "the end of the recording"})
            self._again.wait()
            self._again.clear()
            self._facts.restart()
            self._board.set_facts({"ended": ""})

    def _play_once(self) -> None:
        source, pipeline = (
            self._source,
            Pipeline(self._source.calibration, self._source.configuration.foothold, self._source.learnt),
        )
        overlay = Overlay(
            source.calibration,
            source.configuration.foothold,
            _Pictures(self._board),
            lambda: pipeline.surfaces,
            self._shown,
        )
        pace = self._pace()
        latency_s: dict[int, float] = {}
        for message in source.inputs():
            if self._again.is_set():
                return
            if not self._going.is_set():
                self._going.wait()
                pace = self._pace()
            self._late_s = pace.wait_for(message)
            if isinstance(message, Frame):
                header = message.header
                latency_s = {header.t_exposure_ns: 1e-9 * (header.t_arrival_ns - header.t_exposure_ns)}
            overlay.add_input(message)
            for estimate in pipeline.step(message):
                overlay.add_estimate(estimate)
                t_ns = estimate.t_exposure_ns if isinstance(estimate, GroundPlane) else 0
                self._facts.add(estimate, latency_s.get(t_ns, float("nan")))
        overlay.close()

    def _shown(self, image: Image) -> Image | None:
        now_s = time.monotonic()
        if self._late_s > TOO_LATE_S and now_s - self._shown_s < LEAST_SHOWN_S:
            return None
        self._shown_s = now_s
        return small(image)


class _Pictures:
    """Where the overlay's pictures go."""

    def __init__(self, board: Board) -> None:
        self._board = board

    def write(self, picture: Picture) -> None:
        self._board.set_picture(jpeg(picture))

    def close(self) -> None:
        """Do nothing: each picture is whole."""


class RecordedPace:
    """That of the recording, counted from the first message."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None

    def wait_for(self, message: Input) -> float:
        """Wait until it is time for `message`; return by how much it is late, in seconds."""
        t_ns = _arrival_ns(message)
        now_ns = time.monotonic_ns()
        if self._offset_ns is None or now_ns - t_ns - self._offset_ns > 1e9 * FAR_TOO_LATE_S:
            self._offset_ns = now_ns - t_ns
        early_s = 1e-9 * (t_ns + self._offset_ns - now_ns)
        if early_s > 0.0:
            time.sleep(min(early_s, FAR_TOO_LATE_S))
        return max(0.0, -early_s)


def _arrival_ns(message: Input) -> int:
    if isinstance(message, Frame | DroppedFrame):
        return message.header.t_arrival_ns
    if isinstance(message, ImuSample):
        return message.t_arrival_ns
    return message.t_sample_ns if isinstance(message, AnkleState) else message.t_ns
