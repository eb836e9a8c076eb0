"""The project's service under this machine's systemd: its own unit, user and udev rules, unchanged."""

import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from tests.kernel.modules import system

PROJECT = Path(__file__).parents[2]
NAME = "gaiteyes.service"
CONFIGURATION = Path("/etc/gaiteyes")
PATIENCE_S = 60.0

_PLACES = {
    "gaiteyes.service": "/etc/systemd/system/gaiteyes.service",
    "gaiteyes.sysusers": "/etc/sysusers.d/gaiteyes.conf",
    "70-gaiteyes.rules": "/etc/udev/rules.d/70-gaiteyes.rules",
}
_COMMAND = '#!/bin/sh\nexec /usr/bin/python3 -m cli.main "$@"\n'


def install() -> None:
    """Put the service's files where systemd and udev look; the command runs the project where it lies."""
    for name, place in _PLACES.items():
        Path(place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(PROJECT / "systemd" / name, place)
    command = Path("/usr/bin/gaiteyes")
    command.write_text(_COMMAND, encoding="utf-8")
    command.chmod(0o755)
    system("systemd-sysusers")
    system("systemctl", "daemon-reload")
    system("udevadm", "control", "--reload")


def apply_device_rules() -> None:
    """Let udev give the devices that are there to their groups."""
    system("udevadm", "trigger", "--subsystem-match=i2c-dev", "--subsystem-match=gpio")
    system("udevadm", "settle", "--timeout=30")


def control(verb: str) -> None:
    """Start, stop, reload … the service; returns when systemd has done so."""
    system("systemctl", verb, NAME)


def shown(name: str) -> str:
    """Return one of the unit's properties."""
    command = ["systemctl", "show", NAME, "--property", name, "--value"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def main_pid() -> int:
    """Return the service's process, 0 if there is none."""
    return int(shown("MainPID"))


def until(true: Callable[[], object], what: str, *, pause_s: float = 1.0, patience_s: float = PATIENCE_S) -> None:
    """Look every `pause_s` until something is true. Raises AssertionError, with the journal's end, if it takes long."""
    end_s = time.monotonic() + patience_s
    while not true():
        assert time.monotonic() < end_s, f"{what}: not within {patience_s} s\n{journal()}"
        time.sleep(pause_s)


def until_restarted(pid_before: int) -> None:
    """Wait until the service is active with another process."""
    until(lambda: shown("ActiveState") == "active" and main_pid() not in (0, pid_before), "a restart")


def journal(lines: int = 30) -> str:
    """Return the newest lines of the service's journal."""
    command = ["journalctl", "--unit", NAME, "--lines", str(lines), "--no-pager", "--output", "cat"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout
