"""The demo on a host that is too busy to judge, and on one that is not."""

import itertools
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cli.console import VOID
from cli.main import app
from drivers.zenoh.settings import SOCKET
from lab.evaluation import busy_host

pytestmark = pytest.mark.realtime

CALM = itertools.repeat(0.0).__next__
STARVED = itertools.count(0.0, 100.0).__next__  # another 100 s waited at each look


@pytest.mark.parametrize(("waited_s", "void"), [(CALM, False), (STARVED, True)], ids=["calm", "starved"])
def test_figures_of_a_starved_host_are_void(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waited_s: Callable[[], float], void: bool
) -> None:
    monkeypatch.setattr(busy_host, "waited_s", waited_s)
    monkeypatch.setattr(busy_host, "MOST_LATE", 1.0)  # the renderer of the machine that tests is not on trial
    facts = tmp_path / "facts.json"
    zenoh = f"{SOCKET}{tmp_path / 'z.sock'}"
    done = CliRunner().invoke(
        app, ["demo", "--seconds", "1", "--zenoh", zenoh, "--can", "virtual:test", "--json", str(facts)]
    )
    assert done.exit_code == (VOID if void else 0), done.output
    assert ("These figures are void" in done.output) is void
    assert bool(json.loads(facts.read_bytes())["void"]) is void


def test_frames_that_are_rendered_too_late_make_figures_void(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(busy_host, "waited_s", CALM)
    monkeypatch.setattr(busy_host, "MOST_LATE", -1.0)  # none at all is then too many
    done = CliRunner().invoke(
        app, ["demo", "--seconds", "1", "--zenoh", f"{SOCKET}{tmp_path / 'z.sock'}", "--can", "virtual:test"]
    )
    assert done.exit_code == VOID
    assert "frames were rendered too late" in done.output
