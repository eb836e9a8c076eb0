"""The service and a virtual prosthesis in processes of their own on one bus: each hears the other, faults and all."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cli.console import VOID
from cli.main import app
from drivers.zenoh.settings import SOCKET

pytestmark = pytest.mark.realtime

GROUP = "239.74.163.79"


def demo(folder: Path, *more: str) -> tuple[int, str, dict[str, Any]]:
    """Return the exit code of a demo of some seconds on a bus of its own, what was printed and its facts."""
    file, zenoh = folder / "facts.json", f"{SOCKET}{folder / 'z.sock'}"
    command = ["demo", "--prosthesis", "--seconds", "9", "--zenoh", zenoh, "--can", f"udp_multicast:{GROUP}"]
    done = CliRunner().invoke(app, [*command, "--json", str(file), *more])
    return done.exit_code, done.output, json.loads(file.read_bytes()) if file.exists() else {}


@pytest.mark.long
def test_each_hears_the_other_on_a_bus_that_loses_delays_and_babbles(tmp_path: Path) -> None:
    code, output, facts = demo(tmp_path, "--bus-faults", "loss=0.05,delay_s=0.02,babble_hz=200")
    assert code in (0, VOID)  # a busy host voids the figures, not the counts
    told, health = facts["prosthesis"], facts["run"]["health"]
    assert told["contacts"] >= 1
    assert told["states"] > 200
    assert health["ankle_states"] > 0.5 * told["states"]
    assert health["can_bus"]["ankle_refused"] > 0
    assert told["lost_frames"] > 0
    assert told["set_points"] + told["refused"].get("not_valid", 0) > 20
    assert told["refused"]["wrong_crc"] > 0
    assert told["stumbles"] == 0
    assert "Prosthesis" in output


def test_a_bus_that_ends_with_this_process_is_refused_in_one_line(tmp_path: Path) -> None:
    done = CliRunner().invoke(
        app, ["demo", "--prosthesis", "--can", "virtual:x", "--zenoh", f"{SOCKET}{tmp_path / 'z'}"]
    )
    assert done.exit_code != 0
    assert "prosthesis: CAN virtual:x ends with this process" in str(done.exception)
