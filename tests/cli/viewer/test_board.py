"""A browser gets everything that is new once, and the newest where it was slow."""

import json
from typing import Any

from cli.viewer.board import MOST_POINTS, NOTHING_YET, Board, News


def test_each_point_comes_once_and_facts_stay() -> None:
    board = Board("walk")
    board.set_facts({"status": "valid"})
    board.add_point((0.0, 1.0))
    board.add_point((0.1, None))
    first = _news(board, NOTHING_YET)
    assert _told(first) == {"facts": {"title": "walk", "status": "valid"}, "points": [[0.0, 1.0], [0.1, None]]}
    assert first.jpeg is None
    board.add_point((0.2, 2.0))
    board.set_picture(b"picture")
    second = _news(board, first)
    assert _told(second)["points"] == [[0.2, 2.0]]
    assert second.jpeg == b"picture"
    third = _news(board, second)
    assert _told(third)["points"] == []
    assert third.jpeg is None


def test_who_was_away_gets_the_newest() -> None:
    board = Board("walk")
    for k in range(2 * MOST_POINTS):
        board.add_point((float(k),))
        board.set_picture(b"%d" % k)
    news = _news(board, NOTHING_YET)
    assert [point[0] for point in _told(news)["points"]] == list(range(MOST_POINTS, 2 * MOST_POINTS))
    assert news.jpeg == b"%d" % (2 * MOST_POINTS - 1)


def test_a_new_run_is_told_and_begins_with_its_own_points() -> None:
    board = Board("walk")
    for k in range(5):
        board.add_point((float(k),))
    before = _news(board, NOTHING_YET)
    board.clear_points()
    board.add_point((0.0,))
    after = _news(board, before)
    assert _told(after)["points"] == [[0.0]]
    assert _told(after)["facts"].get("runs") != _told(before)["facts"].get("runs")


def test_once_closed_nothing_more_comes() -> None:
    board = Board("walk")
    board.close()
    assert board.news(NOTHING_YET, 0.0) is None


def _news(board: Board, known: News) -> News:
    news = board.news(known, 0.0)
    assert news is not None
    return news


def _told(news: News) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(news.text)
    return told
