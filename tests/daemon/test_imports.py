import os
import subprocess
import sys
from pathlib import Path

import pytest

HOME = Path(__file__).parents[2]

TRANSPORTS = {"zenoh", "can", "serial", "smbus2", "cantools", "gpiod", "mcap", "mcap_protobuf", "foxglove"}
SLOW = {"scipy"}
"""0.4 s of a start, for functions that numpy has."""


def test_the_pipeline_loads_no_transport_and_no_scipy() -> None:
    told = subprocess.run(
        [sys.executable, "-c", "import sys, daemon.pipeline; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = {name.partition(".")[0] for name in told.stdout.split()}
    assert "numpy" in loaded
    assert not loaded & (TRANSPORTS | SLOW)


@pytest.mark.parametrize("arguments", [["check"], ["init"], ["run"], ["replay", "none.mcap"]], ids=" ".join)
def test_what_a_person_runs_on_a_wearable_loads_no_scipy(tmp_path: Path, arguments: list[str]) -> None:
    script = "import sys, cli.main\ntry: cli.main.main()\nfinally: print(*sys.modules, file=sys.stderr)"
    told = subprocess.run(
        [sys.executable, "-c", script, *arguments],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(HOME)},
        capture_output=True,
        text=True,
        check=False,
    )
    loaded = {name.partition(".")[0] for name in told.stderr.splitlines()[-1].split()}
    assert "numpy" in loaded
    assert not loaded & SLOW
