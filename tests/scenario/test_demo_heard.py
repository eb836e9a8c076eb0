"""What `make run` starts, heard by both examples in processes of their own."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from sim_rig.can.slcan_hub import PORT
from tests.bench.zenoh_peer import free_endpoint

pytestmark = pytest.mark.realtime

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    """Return where the demo publishes, while it runs."""
    listen = free_endpoint()
    command = [sys.executable, "-m", "cli.main", "demo", "--seconds", "60", "--scenario", "standing", "--zenoh", listen]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as demo:
        assert demo.stdout is not None
        for line in demo.stdout:
            if "slope" in line:
                break
        else:
            pytest.fail("the demo ended before it saw the ground")
        drained = threading.Thread(target=demo.stdout.read)
        drained.start()
        yield listen
        demo.terminate()
        drained.join()
        assert demo.wait(30) == 0


def heard(example: str, *arguments: str, count: int) -> list[str]:
    """Return the first `count` lines that the example prints."""
    command = [sys.executable, str(EXAMPLES / example), *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        watchdog = threading.Timer(30.0, process.kill)
        watchdog.start()
        assert process.stdout is not None
        lines = [line for _, line in zip(range(count), process.stdout, strict=False)]
        watchdog.cancel()
        process.kill()
    return lines


def test_a_subscriber_hears_the_ground_and_is_told_that_it_is_simulated(endpoint: str) -> None:
    lines = heard("zenoh_subscriber.py", "--connect", endpoint, "--accept-simulated", count=20)
    # a busy machine may be late with a sample or a frame, and the service then says so
    assert sum(line.startswith("simulated valid none slope") for line in lines) >= 3
    assert not any(line.startswith(("live", "replay")) for line in lines)


def test_a_subscriber_that_wants_live_data_refuses(endpoint: str) -> None:
    lines = heard("zenoh_subscriber.py", "--connect", endpoint, count=5)
    assert all(line.startswith("silence, refused") for line in lines)
    assert "'not_live': " in lines[-1]


def test_a_can_listener_hears_the_same_ground(endpoint: str) -> None:
    assert endpoint
    lines = heard("can_listener.py", "--channel", f"socket://127.0.0.1:{PORT}", "--accept-simulated", count=20)
    told = [line for line in lines if line.startswith("ground simulated slope")]
    assert len(told) >= 3
    heights_m = [float(line.split("height ")[1].split()[0]) for line in told]
    assert all(0.9 < height_m < 1.0 for height_m in heights_m)
