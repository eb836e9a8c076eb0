"""The numerical tests as other processors run them: `python -m tests.processors [pytest's arguments]`.

OpenBLAS computes with a kernel made for the processor, and each adds in an order of its own; `OPENBLAS_CORETYPE` asks
for another's. It takes the nearest that it was built with, so what it really took is printed, and nothing runs twice.
The long ones are left out, unless pytest's arguments ask for them: `-m 'not hidden'`.
"""

import os
import subprocess
import sys
from typing import Final

SETTINGS: Final = (("Haswell", 2), ("SkylakeX", 2))
"""A kernel and a number of threads each."""

PLACES: Final = (
    *("tests/calib", "tests/discrepancy", "tests/impedance", "tests/lab/thesis", "tests/perception", "tests/systems"),
    "tests/replay/test_frozen_walk.py",
)
"""The tests that may depend on the last bits of the processor's arithmetic."""

_QUICK: Final = ("-m", "not hidden and not long")
_BESIDE: Final = ("--numprocesses", "auto", "--maxprocesses", "4", "--dist", "loadfile")

_AT_REST: Final = {"OPENBLAS_THREAD_TIMEOUT": "4"}
"""A thread without work waits for 2⁴ cycles and then sleeps: those of two processes on two processors else take twice
the time, waiting."""

# Prints the kernels of numpy and scipy, after the work that would end a process on a processor without their
# instructions.
_PROBE: Final = """
import numpy, scipy.linalg, threadpoolctl
scipy.linalg.svd(numpy.random.default_rng(0).normal(size=(200, 100)) @ numpy.ones((100, 150)))
pools = [pool for pool in threadpoolctl.threadpool_info() if pool["internal_api"] == "openblas"]
print("/".join(sorted({pool["architecture"] for pool in pools})))
"""


def main(arguments: list[str]) -> int:
    """Run the tests in PLACES under each setting; return 1 where one failed, else 0."""
    ran: set[tuple[str, int]] = set()
    failed = []
    for kernel, threads in SETTINGS:
        asked = f"{kernel}, {threads} thread{'s' if threads > 1 else ''}"
        environment = os.environ | _AT_REST | {"OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": str(threads)}
        probe = subprocess.run([sys.executable, "-c", _PROBE], env=environment, stdout=subprocess.PIPE, text=True)
        taken = probe.stdout.strip() or "no OpenBLAS"
        if probe.returncode < 0:
            print(f"== {asked}: left out, this processor cannot run it", flush=True)
        elif probe.returncode > 0:
            return 1
        elif (taken, threads) in ran:
            print(f"== {asked}: left out, {taken} here, which has run", flush=True)
        else:
            print(f"== {asked}: runs as {taken}", flush=True)
            ran.add((taken, threads))
            tests = [sys.executable, "-m", "pytest", *PLACES, *_QUICK, *_BESIDE, *arguments]
            if subprocess.run(tests, env=environment).returncode:
                failed.append(asked)
    passed = f"passed under {len(ran)} of {len(SETTINGS)} settings"
    print(f"failed: {'; '.join(failed)}" if failed else passed, flush=True)
    return 1 if failed or not ran else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
