"""The machine's first disk: a small Debian with systemd, and the kernel's modules."""

import shutil
from pathlib import Path

from tests.kernel.machine import disk, host
from tests.kernel.machine.host import DIST_PACKAGES, PYTHON, WORKSHOP, cached, digest, remove, run
from tests.kernel.machine.kernel import KernelPackages

UNITS = tuple((Path(__file__).parent / "guest" / f"kernel-tests.{kind}") for kind in ("target", "service"))
GUEST_PACKAGES = (*("systemd", "udev", "kmod", "python3", "iproute2"),)
MASKED = (
    *("apt-daily.timer", "apt-daily-upgrade.timer", "dpkg-db-backup.timer", "e2scrub_all.timer", "fstrim.timer"),
    *("systemd-pcrphase.service", "systemd-random-seed.service", "systemd-update-utmp.service", "e2scrub_reap.service"),
)


def require_same_python() -> None:
    """Raise SkippedError unless Debian's Python can use the packages of this one."""
    name = host.dependency("python3", "python3.")
    if name != PYTHON:
        raise host.SkippedError(f"Debian's Python here is {name}, the project's environment has {PYTHON}")


def debian_disk(packages: KernelPackages, kernel_folder: Path) -> Path:
    """Return an ext4 image of Debian with systemd and this kernel's modules, cached."""
    release, sources = host.debian_sources()
    made_of = (*UNITS, Path(__file__), Path(disk.__file__))
    key = digest(packages.key, release, *sources, *GUEST_PACKAGES, *MASKED, PYTHON, *made_of)
    tree = WORKSHOP / "debian-tree"

    def make(image: Path) -> None:
        remove(tree)
        run(
            *("mmdebstrap", "--variant=minbase", "--mode=root", f"--include={','.join(GUEST_PACKAGES)}"),
            *('--aptopt=Acquire::Languages "none"', "--dpkgopt=force-unsafe-io", "--skip=check/qemu"),
            *(f"--dpkgopt=path-exclude=/usr/share/{folder}/*" for folder in ("doc", "man", "locale", "i18n")),
            *(release, str(tree), *sources),
        )
        _furnish(tree, kernel_folder)
        disk.make_disk(tree, image, spare_mb=256)
        remove(tree)

    return cached("debian.img", key, make)


def _furnish(tree: Path, kernel_folder: Path) -> None:
    shutil.copytree(kernel_folder / "lib" / "modules", tree / "usr" / "lib" / "modules", dirs_exist_ok=True)
    units = tree / "etc" / "systemd" / "system"
    for file in UNITS:
        shutil.copy2(file, units)
    (units / "default.target").symlink_to("kernel-tests.target")
    for unit in MASKED:
        (units / unit).symlink_to("/dev/null")
    for folder in (DIST_PACKAGES, "srv/gaiteyes", "results"):
        (tree / folder).mkdir(parents=True, exist_ok=True)
    (tree / "etc" / "machine-id").write_text("67616974657965736b65726e656c3031\n")
    (tree / "etc" / "hostname").write_text("kernel-tests\n")
    (tree / "etc" / "fstab").write_text("")
