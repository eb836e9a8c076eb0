"""A recording is played with its pictures, its truth and its end; buttons are obeyed."""

import json
import threading
import time
from typing import Any

import pytest

from cli.viewer.board import NOTHING_YET, Board
from cli.viewer.played import FAR_TOO_LATE_S, Player, RecordedPace
from daemon.config import Configuration
from daemon.replay_source import ReplaySource
from messages import Input, Tick
from sim_rig.depth_wearer import DepthWearer
from sim_rig.walk.scenario import scenario

START_NS = 10_000_000_000
PATIENCE_S = 60.0
SLOPE, SLOPE_LOW, SLOPE_HIGH, SLOPE_TRUE = 1, 2, 3, 5


class Unhurried:
    def wait_for(self, _message: Input) -> float:
        return 0.0


@pytest.fixture(scope="module")
def source() -> ReplaySource:
    wearer = DepthWearer(4, scenario("standing"), START_NS)
    inputs = list(wearer.offline_inputs(1.6))
    return ReplaySource(
        title="standing",
        calibration=wearer.calibration,
        configuration=Configuration(),
        inputs=lambda: iter(inputs),
        rig_truth=lambda: {
            t_ns: wearer.truth(t_ns) for t_ns in (wearer.shutter.header(k).t_exposure_ns for k in range(32))
        },
    )


def test_a_recording_waits_while_it_is_paused_and_is_played_to_its_end(source: ReplaySource) -> None:
    board = Board("standing")
    player = Player(source, board, Unhurried)
    player.command("pause")
    player.command("no such thing")
    threading.Thread(target=player.play, daemon=True).start()
    assert board.news(NOTHING_YET, 0.0).point == 0  # type: ignore[union-attr]
    player.command("play")
    told = _end(board)
    grounds = [point for point in told["points"] if point[SLOPE] is not None]
    assert len(grounds) >= 10
    for point in grounds:
        assert point[SLOPE_LOW] < point[SLOPE] < point[SLOPE_HIGH]
        assert point[SLOPE_LOW] < point[SLOPE_TRUE] < point[SLOPE_HIGH]
    assert told["facts"]["status"] == "valid"
    assert told["facts"]["source"] == "recording"
    assert dict(told["facts"]["health"])["load"] == "normal"
    assert "° down" in told["facts"]["attitude"]
    assert board.news(NOTHING_YET, 0.0).jpeg.startswith(b"\xff\xd8")  # type: ignore[union-attr]


@pytest.mark.long
def test_played_again_it_is_the_same(source: ReplaySource) -> None:
    board = Board("standing")
    player = Player(source, board, Unhurried)
    threading.Thread(target=player.play, daemon=True).start()
    first = _end(board)
    player.command("again")
    _until(board, lambda facts: facts["ended"] == "")
    assert _end(board)["points"] == first["points"]


def test_the_pace_is_the_recording_s_and_slower_where_the_host_is(monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns, slept = [5_000_000_000], []

    def sleep(seconds: float) -> None:
        slept.append(round(seconds, 3))
        now_ns[0] += round(1e9 * seconds)

    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns[0])
    monkeypatch.setattr(time, "sleep", sleep)
    pace = RecordedPace()
    assert pace.wait_for(Tick(t_ns=0)) == 0.0
    assert pace.wait_for(Tick(t_ns=250_000_000)) == 0.0
    assert slept == [0.25]
    now_ns[0] += 300_000_000
    assert pace.wait_for(Tick(t_ns=350_000_000)) == pytest.approx(0.2)
    now_ns[0] += round(1e9 * (FAR_TOO_LATE_S + 1.0))
    assert pace.wait_for(Tick(t_ns=360_000_000)) == 0.0
    pace.wait_for(Tick(t_ns=460_000_000))
    assert slept == [0.25, 0.1]


def _end(board: Board) -> dict[str, Any]:
    return _until(board, lambda facts: facts.get("ended") == "the end of the recording")


def _until(board: Board, holds: Any) -> dict[str, Any]:
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        news = board.news(NOTHING_YET, 0.1)
        assert news is not None
        told: dict[str, Any] = json.loads(news.text)
        if holds(told["facts"]):
            return told
        time.sleep(0.01)
    raise AssertionError("it did not come")
