"""What `make run` starts, heard by both examples in processes of their own."""

import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator

import pytest

from cli.console import VOID
from sim_rig.can.slcan_hub import PORT
from tests.bench.heard_example import heard
from tests.bench.zenoh_peer import free_endpoint

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    """Return where the demo publishes, while it runs."""
    listen = free_endpoint()
    demo_for_long = ["demo", "--scenario", "standing", "--seconds", "180", "--zenoh", listen]
    command = [sys.executable, "-m", "cli.main", *demo_for_long]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as demo:
        assert demo.stdout is not None
        told = list[str]()
        for line in demo.stdout:
            told.append(line)
            if re.match(r" *[0-9.]+ s  ", line):  # its first second; when it sees the ground depends on the machine
                break
        else:
            pytest.fail("the demo ended before it ran:\n" + "".join(told))
        drained = threading.Thread(target=demo.stdout.read)
        drained.start()
        yield listen
        demo.terminate()
        drained.join()
        assert demo.wait(30) in (0, VOID)


def three(words: str) -> Callable[[list[str]], bool]:
    """Return whether three lines say `words`."""
    return lambda lines: sum(words in line for line in lines) >= 3


def test_a_subscriber_hears_the_ground_and_is_told_that_it_is_simulated(endpoint: str) -> None:
    told = three("simulated valid none slope")
    lines = heard("zenoh_subscriber.py", "--connect", endpoint, "--accept-simulated", enough=told)
    assert not any(line.startswith(("live", "replay")) for line in lines), lines


def test_a_subscriber_that_wants_live_data_refuses(endpoint: str) -> None:
    told = three("'not_live': ")
    lines = heard("zenoh_subscriber.py", "--connect", endpoint, enough=told)
    assert all(line.startswith("silence, refused") for line in lines), lines


def test_a_can_listener_hears_the_same_ground(endpoint: str) -> None:
    assert endpoint
    ground = "ground simulated slope"
    bus = f"slcan:socket://127.0.0.1:{PORT}"
    lines = heard("can_listener.py", "--can", bus, "--accept-simulated", enough=three(ground))
    heights_m = [float(line.split("height ")[1].split()[0]) for line in lines if line.startswith(ground)]
    assert all(0.9 < height_m < 1.0 for height_m in heights_m), lines
