"""Kernel modules and commands of the system, for the tests."""

import subprocess


def system(*command: str) -> None:
    """Run a command of the system; a failure carries what it said."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stderr}"


def load_module(name: str, *parameters: str) -> None:
    """Load a module and let udev make its nodes."""
    system("modprobe", name, *parameters)
    system("udevadm", "settle", "--timeout=30")


def unload_module(name: str) -> None:
    """Unload a module; fails while it is in use."""
    system("modprobe", "-r", name)
