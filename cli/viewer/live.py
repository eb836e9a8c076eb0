"""What a running service says, as a subscriber of its topics, drawn into the pictures that it gives."""

import time
from collections import deque
from contextlib import ExitStack
from types import TracebackType
from typing import TypeVar

import cv2
import msgspec
import numpy as np

from calib.files import parse_calibration
from cli.overlay.drawing import drawn
from cli.overlay.said_of_frames import SaidOfFrames
from cli.viewer.board import Board
from cli.viewer.facts import Facts
from daemon.config import parse_configuration
from daemon.pictures import WIDTH_PX, Greeting, SeenFrame, jpeg
from drivers.picture_socket import PictureReader
from drivers.zenoh.device_listener import DeviceListener
from messages import Image, UserError

S = TypeVar("S", Greeting, SeenFrame)

LONGEST_WAIT_S = 0.1
"""A picture waits so long for its estimates, which come another way."""
POLL_S = 0.01
SILENCE_S = 1.0
GREETING_S = 3.0
_GREY = 60


class LiveSource:
    """Listens to `device` on this machine. Raises UserError, in one line, where there is nothing to listen to."""

    def __init__(self, device: str, board: Board) -> None:
        self._board = board
        with ExitStack() as opened:
            self._reader = PictureReader(device)
            opened.callback(self._reader.close)
            greeting = self._greeting(device)
            calibration = parse_calibration(greeting.calibration_text, f"{device}: calibration")
            self._foothold = parse_configuration(greeting.configuration_text, f"{device}: configuration").foothold
            self._listener = DeviceListener(device)
            opened.callback(self._listener.close)
            self._undo = opened.pop_all()
        lens = calibration.camera.lens
        self._blank = np.full((round(WIDTH_PX * lens.height_px / lens.width_px), WIDTH_PX), _GREY, np.uint8)
        self._said = SaidOfFrames(calibration)
        self._facts = Facts(board, calibration)
        self._waiting: deque[tuple[SeenFrame, float]] = deque(maxlen=4)
        self._heard_s = time.monotonic()
        self._facts.restart()
        board.set_facts(
            {"source": greeting.source.value, "latency_of": "exposure to publication", "ended": "", "plays": None}
        )

    def __enter__(self) -> "LiveSource":
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _traceback: TracebackType | None
    ) -> None:
        self._undo.close()

    def follow(self) -> None:
        """Show what comes until the service has gone."""
        try:
            while True:
                packet = self._reader.receive(POLL_S)
                if packet is not None:
                    self._waiting.append((_decoded(packet, SeenFrame), time.monotonic()))
                self._hear()
                self._show()
        except EOFError:
            return

    def _greeting(self, device: str) -> Greeting:
        try:
            packet = self._reader.receive(GREETING_S)
        except EOFError:
            packet = None
        if packet is None:
            raise UserError(f"'{device}' does not answer; it may have as many viewers as it takes")
        return _decoded(packet, Greeting)

    def _hear(self) -> None:
        now_s = time.monotonic()
        for received in self._listener.take(timeout_s=0.0):
            self._heard_s = now_s
            self._said.add(received.message)
            self._facts.add(received.message, received.stamp.age_s)
        silent = now_s - self._heard_s > SILENCE_S
        refused = ", ".join(f"{count} {why.value}" for why, count in self._listener.refused.items())
        self._board.set_facts({"silent": silent, "refused": refused or "nothing"})

    def _show(self) -> None:
        while self._waiting:
            seen, came_s = self._waiting[0]
            if not self._said.is_complete(seen.t_exposure_ns) and time.monotonic() - came_s < LONGEST_WAIT_S:
                return
            self._waiting.popleft()
            self._said.add_surfaces(seen.t_exposure_ns, seen.surfaces)
            said = self._said.about(seen.t_exposure_ns)
            if said is not None:
                self._board.set_picture(jpeg(drawn(self._unpacked(seen), said, self._foothold)))

    def _unpacked(self, seen: SeenFrame) -> Image:
        if not seen.jpeg:
            return self._blank
        image = cv2.imdecode(np.frombuffer(seen.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
        return self._blank if image is None else np.asarray(image, dtype=np.uint8)


def _decoded(packet: bytes, kind: type[S]) -> S:
    try:
        return msgspec.msgpack.decode(packet, type=kind)
    except msgspec.MsgspecError as error:
        raise UserError(f"the service speaks otherwise, is it of another version? {kind.__name__}: {error}") from error


def follow_device(device: str, board: Board) -> None:
    """Show `device`, also after it was started anew, for ever. Raises UserError where it is not there at the start."""
    source = LiveSource(device, board)
    while True:
        with source:
            source.follow()
        source = _again(device, board)


def _again(device: str, board: Board) -> LiveSource:
    board.set_facts({"ended": f"'{device}' has ended; this page goes on when it is started again"})
    while True:
        time.sleep(SILENCE_S)
        try:
            return LiveSource(device, board)
        except UserError:
            continue
