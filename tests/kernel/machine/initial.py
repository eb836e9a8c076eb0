"""The machine's initial RAM disk: what it takes to find the other disks."""

import shutil
import subprocess
from pathlib import Path

from tests.kernel.machine import kernel
from tests.kernel.machine.host import DIST_PACKAGES, WORKSHOP, FailedError, cached, digest, remove
from tests.kernel.machine.kernel import KernelPackages

INIT = Path(__file__).parent / "guest" / "init"


def boot_disk(packages: KernelPackages, kernel_folder: Path) -> Path:
    """Return the initial RAM disk, cached."""
    key = digest(packages.key, INIT, Path(__file__))
    tree = WORKSHOP / "boot-tree"

    def make(image: Path) -> None:
        remove(tree)
        for folder in ("bin", "modules", "proc", "sys", "dev", "root"):
            (tree / folder).mkdir(parents=True)
        shutil.copy2("/bin/busybox", tree / "bin" / "busybox")
        for name in ("sh", "cat", "sleep", "findfs", "mount", "umount", "insmod", "switch_root"):
            (tree / "bin" / name).symlink_to("busybox")
        order = kernel.load_order(kernel_folder, packages.release, kernel.BOOT_MODULES)
        for file in order:
            shutil.copy2(file, tree / "modules")
        (tree / "modules" / "order").write_text("".join(f"{file.name}\n" for file in order))
        (tree / "packages").write_text(f"{DIST_PACKAGES}\n")
        shutil.copy2(INIT, tree / "init")
        (tree / "init").chmod(0o755)
        names = "\n".join(str(path.relative_to(tree)) for path in sorted(tree.rglob("*")))
        with image.open("wb") as archive:
            command = ["/bin/busybox", "cpio", "-o", "-H", "newc"]
            packed = subprocess.run(command, input=names.encode(), stdout=archive, cwd=tree, check=False)
        if packed.returncode:
            raise FailedError("packing the initial RAM disk failed")
        remove(tree)

    return cached("boot.cpio", key, make)
