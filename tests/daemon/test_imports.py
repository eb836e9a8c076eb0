import subprocess
import sys

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
