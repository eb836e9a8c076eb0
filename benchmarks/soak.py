"""The daemon at full load for as long as wished: does it grow, lose samples, or say anything wrong or stale?

    python -m benchmarks.soak --seconds 1800
    python -m benchmarks.soak --seconds 86400 --every 600

Real service, drivers and outlets in a process of its own, on the rig: recording (to /dev/null, so that the disk is no
limit), CAN with the ankle's traffic, Zenoh with four more subscribers. Growth is the slope of a straight line through
the resident memory after the first minute.
"""

import argparse
import tempfile
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import msgspec
import numpy as np

from lab.faults.daemon_under_test import DaemonUnderTest
from lab.faults.report import Process

_SETTLED_S = 60.0
_LOSSES = ("imu_lost", "imu_refused", "inbox_dropped", "recorder_dropped", "can_errors", "zenoh_errors")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=1800.0)
    parser.add_argument("--every", type=float, default=30.0, help="seconds between two looks at the process")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with (
        tempfile.TemporaryDirectory(prefix="gaiteyes-soak-") as folder,
        closing(DaemonUnderTest(options.seed, Path(folder))) as daemon,
    ):
        daemon.start(msgspec.structs.replace(daemon.plan, record=Path("/dev/null")))
        daemon.around.start_subscribers(4)
        if not daemon.settle(in_motion=False):
            raise SystemExit("the ground does not become steady")
        looks: list[tuple[float, Process]] = []
        began_s = time.monotonic()
        daemon.begin_free()
        while not looks or looks[-1][0] < options.seconds:
            daemon.listen(options.every)
            daemon.end_free()
            looks.append((time.monotonic() - began_s, daemon.look()))
            daemon.begin_free()
            _tell(daemon, looks)


def _tell(daemon: DaemonUnderTest, looks: Sequence[tuple[float, Process]]) -> None:
    seconds, process = looks[-1]
    counted = daemon.counted()
    losses = ", ".join(f"{name} {counted[name]}" for name in _LOSSES)
    print(
        f"{seconds:7.0f} s  {process.memory_mb[1]:6.1f} MB, {_growth_mb_per_h(looks):+.2f} MB/h  "
        f"{process.threads[1]} threads  {process.open_files[1]} files  "
        f"valid {100 * daemon.free.valid_share:.2f} %, wrong {daemon.free.wrong}, stale {daemon.free.stale}  {losses}",
        flush=True,
    )


def _growth_mb_per_h(looks: Sequence[tuple[float, Process]]) -> float:
    settled = [(seconds / 3600.0, process.memory_mb[1]) for seconds, process in looks if seconds > _SETTLED_S]
    if len(settled) < 3:
        return float("nan")
    hours, memory_mb = np.array(settled).T
    return float(np.polyfit(hours, memory_mb, 1)[0])


if __name__ == "__main__":
    main()
