"""`python -m tests.kernel [PYTEST OPTIONS]`: build the machine, run the tests of this folder in it, judge the results.

Two machines share the tests, for two processors. Exit code 0 if all passed or the host cannot run them (one line says
why), 1 otherwise. What is left in build/kernel: build.log, and for each machine results-NAME/ with junit.xml,
pytest.txt, journal.txt and console.txt.
"""

import shlex
import sys
from pathlib import Path

from tests.kernel.machine import boot, debian, host, initial, kernel, packages, project
from tests.kernel.machine.host import WORKSHOP, FailedError, SkippedError
from tests.kernel.machine.verdict import print_verdict

LIMIT_S = 3600.0
"""For a busy host. What hangs inside is ended there, by the machine's own clock."""
_SERVICE = "tests/kernel/test_service.py"
_FIRST = "tests/kernel/test_first_run.py"
"""In a machine that nothing was plugged into."""
_REST = sorted(f"tests/kernel/{file.name}" for file in Path(__file__).parent.glob("test_*.py"))
SHARES = {
    "devices": " ".join((_FIRST, *(file for file in _REST if file not in (_FIRST, _SERVICE)))),
    "service": _SERVICE,
}
"""Which tests each machine runs: about as long."""


def main(pytest_options: list[str]) -> int:
    """Do it all; return the exit code."""
    try:
        host.require_debian()
        with host.alone():
            print("kernel tier:")
            return 0 if _run(shlex.join(pytest_options)) else 1
    except SkippedError as reason:
        print(f"kernel tier skipped: {reason}")
        return 0
    except FailedError as failure:
        print(f"kernel tier failed: {failure}")
        return 1


def _run(pytest_options: str) -> bool:
    host.require_packages(host.PACKAGES)
    linux = kernel.current()
    debian.require_same_python()
    host.require_packages([linux.headers])
    built = kernel.built(linux)
    disks = [debian.debian_disk(linux, built), packages.packages_disk(), project.project_disk()]
    machine = boot.Machine(built / "vmlinuz", initial.boot_disk(linux, built), disks)
    results = {WORKSHOP / f"results-{name}": f"{share} {pytest_options}" for name, share in SHARES.items()}
    with host.step(f"running Linux {linux.release}"):
        boot.run_all(machine, results, limit_s=LIMIT_S)
    return print_verdict([folder / "junit.xml" for folder in results])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
