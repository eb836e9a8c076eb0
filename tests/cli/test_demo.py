"""The demo on a host that is too busy to judge, and on one that is not."""

import itertools
import json
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


def demo(folder: Path) -> tuple[int, str, str]:
    """Return the exit code, what was printed and what the summary for a program calls void."""
    facts, zenoh = folder / "facts.json", f"{SOCKET}{folder / 'z.sock'}"
    command = ["demo", "--seconds", "1", "--zenoh", zenoh, "--can", "virtual:test", "--json", str(facts)]
    done = CliRunner().invoke(app, command)
    return done.exit_code, done.output, json.loads(facts.read_bytes())["void"]


def test_figures_of_a_starved_host_are_void(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(busy_host, "waited_s", STARVED)
    code, output, void = demo(tmp_path)
    assert code == VOID
    assert "These figures are void" in output
    assert "programs waited for a processor" in void


@pytest.mark.long
@pytest.mark.parametrize("most_late", [1.0, -1.0], ids=["any number may be late", "none may be, and none is too many"])
def test_figures_of_a_late_renderer_are_void(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most_late: float) -> None:
    monkeypatch.setattr(busy_host, "waited_s", CALM)
    monkeypatch.setattr(busy_host, "MOST_LATE", most_late)  # so that the machine that tests is not on trial
    code, output, void = demo(tmp_path)
    assert code == (0 if most_late > 0.0 else VOID)
    assert ("frames were rendered too late" in output) is bool(void) is (code == VOID)
