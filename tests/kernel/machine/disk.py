"""Disk images from folders."""

import os
from pathlib import Path

from tests.kernel.machine.host import remove, run


def make_disk(tree: Path, image: Path, *, spare_mb: int) -> None:
    """Write what is in `tree` to an ext4 image with some room left."""
    remove(image)
    used = sum(-(-file.lstat().st_size // 4096) * 4096 + 512 for file in tree.rglob("*"))
    with image.open("wb") as disk:
        os.truncate(disk.fileno(), round(used * 1.05) + (spare_mb << 20))
    run("mkfs.ext4", "-q", "-F", "-m", "0", "-O", "^has_journal", "-E", "lazy_itable_init=1", "-d", tree, image)
