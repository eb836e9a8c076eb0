"""Disk images from folders."""

import os
from pathlib import Path

from tests.kernel.machine.host import remove, run

BLOCK = 4096
MEMORY_SECTION = 128 << 20  # of Linux on x86-64


def make_disk(tree: Path, image: Path, *, spare_mb: int) -> None:
    """Write what is in `tree` to an ext4 image with some room left, of a size that can be mapped as memory.

    Its label is the name of `image` up to the first dot.
    """
    remove(image)
    used = sum(-(-file.lstat().st_size // BLOCK) * BLOCK + 512 for file in tree.rglob("*"))
    sections = -(-(round(used * 1.05) + (spare_mb << 20)) // MEMORY_SECTION)
    with image.open("wb") as disk:
        os.truncate(disk.fileno(), sections * MEMORY_SECTION)
    label = image.name.partition(".")[0]
    layout = (*("-b", str(BLOCK), "-m", "0", "-O", "^has_journal"), *("-E", "lazy_itable_init=1"))
    run("mkfs.ext4", "-q", "-F", "-L", label, *layout, "-d", tree, image)
