"""`python -m tests.kernel [PYTEST OPTIONS]`: build the machine, run the tests of this folder in it, judge the results.

Exit code 0 if all passed or the host cannot run them (one line says why), 1 otherwise. What is left in build/kernel:
results/junit.xml, results/pytest.txt, results/journal.txt, results/console.txt and build.log.
"""

import shlex
import sys

from tests.kernel.machine import boot, debian, host, initial, kernel, packages, project
from tests.kernel.machine.host import WORKSHOP, FailedError, SkippedError
from tests.kernel.machine.verdict import print_verdict

LIMIT_S = 900.0


def main(pytest_options: list[str]) -> int:
    """Do it all; return the exit code."""
    print("kernel tier:")
    try:
        host.require_debian()
        host.require_packages(host.PACKAGES)
        linux = kernel.current()
        debian.require_same_python()
        host.require_packages([linux.headers])
        built = kernel.built(linux)
        disks = [debian.debian_disk(linux, built), packages.packages_disk(), project.project_disk()]
        machine = boot.Machine(built / "vmlinuz", initial.boot_disk(linux, built), disks)
        results = WORKSHOP / "results"
        with host.step(f"running Linux {linux.release}"):
            boot.run(machine, results, shlex.join(pytest_options), limit_s=LIMIT_S)
        return 0 if print_verdict(results / "junit.xml") else 1
    except SkippedError as reason:
        print(f"skipped: {reason}")
        return 0
    except FailedError as failure:
        print(f"failed: {failure}")
        return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
