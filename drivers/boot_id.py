"""Which run of the kernel this is."""

from pathlib import Path

_BOOT_ID_FILE = Path("/proc/sys/kernel/random/boot_id")


def read_boot_id(file: Path = _BOOT_ID_FILE) -> str:
    """Return the identity of this run of the kernel: monotonic times compare only between equal ones."""
    return file.read_text(encoding="ascii").strip()
