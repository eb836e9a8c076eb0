"""Running the machine: one emulated processor, three disks mapped as memory, a folder for the results."""

import subprocess
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from tests.kernel.machine.host import FailedError, remove

MEMORY_MB = 2048
MAPPED_MB = 8192
INSTRUCTIONS = "shift=0,sleep=off"
"""The machine's clock counts its instructions, a nanosecond each, and jumps to the next timer when it has nothing else.

So it is equally quick on any host, however busy, and pauses cost no time. But while it waits for the host the clock
runs away and timeouts expire: hence disks that are memory, and a serial line for what the tests say.
"""
PROCESSOR = "Nehalem"
"""The oldest that NumPy's wheels run on. QEMU 7.2 emulates AVX2 wrongly: NumPy's sorting crashes on it."""
_TIMED_OUT = 124  # of timeout(1)
COMMAND_LINE = (
    "console=ttyS0 quiet panic=-1 mitigations=off tsc=reliable clocksource=tsc random.trust_cpu=on "
    "systemd.show_status=false net.ifnames=0"
)


@dataclass(frozen=True)
class Machine:
    """Everything it takes; what is written to the disks is forgotten."""

    kernel: Path
    boot: Path
    disks: Sequence[Path]


def run_all(machine: Machine, results: Mapping[Path, str], *, limit_s: float) -> None:
    """Run one machine for each folder of results, side by side, with pytest's options for each."""
    with ThreadPoolExecutor(len(results)) as side_by_side:
        for ended in [side_by_side.submit(run, machine, *each, limit_s) for each in results.items()]:
            ended.result()


def run(machine: Machine, results: Path, pytest_options: str, limit_s: float) -> None:
    """Boot, run the tests inside, power off; `results` then holds what they left. Raises FailedError after `limit_s`.

    The emulator is TCG whatever the host offers: nested hardware virtualisation may open and then hang.
    """
    remove(results)
    results.mkdir(parents=True)
    quoted = pytest_options.replace("\\", "\\\\").replace('"', '\\"')
    (results / "environment").write_text(f'PYTEST_ADDOPTS="{quoted}"\n', encoding="utf-8")
    disks = [
        option
        for number, disk in enumerate(machine.disks)
        for option in (
            *("-object", f"memory-backend-file,id=disk{number},share=off,mem-path={disk},size={disk.stat().st_size}"),
            *("-device", f"nvdimm,memdev=disk{number},slot={number}"),
        )
    ]
    command = [
        *("timeout", "--kill-after=10", str(round(limit_s))),
        *("qemu-system-x86_64", "-accel", "tcg,tb-size=512", "-cpu", PROCESSOR, "-smp", "1"),
        *("-machine", "nvdimm=on", "-m", f"{MEMORY_MB},slots={len(machine.disks)},maxmem={MAPPED_MB}M"),
        *("-icount", INSTRUCTIONS),
        *("-nodefaults", "-no-user-config", "-no-reboot", "-display", "none"),
        *("-serial", f"file:{results / 'console.txt'}", "-serial", f"file:{results / 'pytest.txt'}"),
        *("-kernel", str(machine.kernel), "-initrd", str(machine.boot), "-append", COMMAND_LINE),
        *disks,
        *("-virtfs", f"local,path={results},mount_tag=results,security_model=none"),
        *("-object", "can-bus,id=canbus0"),
        *("-device", "kvaser_pci,canbus=canbus0", "-device", "kvaser_pci,canbus=canbus0"),
    ]
    ended = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    if ended.returncode == _TIMED_OUT:
        raise FailedError(f"the machine did not end within {limit_s:.0f} s; see {results}")
    if ended.returncode:
        raise FailedError(f"the emulator failed: {' '.join(ended.stderr.split())}")
