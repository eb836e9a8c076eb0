"""The machine's kernel: Debian's own, the modules the tests need, and two built against its headers."""

import shutil
from dataclasses import dataclass
from pathlib import Path

from tests.kernel.machine import host
from tests.kernel.machine.host import PROJECT, WORKSHOP, FailedError, SkippedError, cached, digest, remove, run, told

BOOT_MODULES = ("nfit", "nd_pmem", "crc32c_generic", "ext4", "virtio_pci", "9pnet_virtio", "9p")
TEST_MODULES = (
    *("i2c-dev", "i2c-stub"),
    *("videodev", "vivid"),
    *("can-raw", "can-dev", "vcan", "kvaser_pci", "sch_netem"),
    *("autofs4", "af_packet"),
)
BUILT_MODULES = ("gaiteyes_rig", "v4l2loopback")
RIG_MODULE = PROJECT / "sim_rig" / "kernel" / "module"


@dataclass(frozen=True)
class KernelPackages:
    """The names of Debian's current kernel and of the loopback's source; `key` changes with any of them."""

    release: str
    image: str
    headers: str
    key: str


def current() -> KernelPackages:
    """Return the kernel that linux-image-amd64 depends on today. Raises SkippedError."""
    image = host.dependency("linux-image-amd64", "linux-image-")
    release = image.removeprefix("linux-image-")
    headers = f"linux-headers-{release}"
    versions = (host.candidate(name) for name in (image, headers, "v4l2loopback-dkms"))
    sources = (path for path in sorted(RIG_MODULE.iterdir()) if path.is_file())
    key = digest(release, *versions, *BOOT_MODULES, *TEST_MODULES, Path(__file__), *sources)
    return KernelPackages(release, image, headers, key)


def built(packages: KernelPackages) -> Path:
    """Return a folder with `vmlinuz` and `lib/modules`, cached."""
    return cached("kernel", packages.key, lambda path: _make(packages, path))


def load_order(kernel: Path, release: str, names: tuple[str, ...]) -> list[Path]:
    """Return the module files to load for `names`, dependencies first, below lib/modules of the folder `kernel`."""
    files: list[Path] = []
    for name in names:
        lines = told("modprobe", "--dirname", kernel, "--set-version", release, "--show-depends", name).splitlines()
        loads = (Path(line.split()[1]) for line in lines if line.startswith("insmod "))
        files += [file for file in loads if file not in files]
    return files


def _make(packages: KernelPackages, target: Path) -> None:
    unpacked = WORKSHOP / "kernel-unpacked"
    for name in (packages.image, "v4l2loopback-dkms"):
        _download_and_unpack(name, unpacked)
    run("depmod", "--basedir", unpacked, packages.release)
    remove(target)
    modules = target / "lib" / "modules" / packages.release
    modules.mkdir(parents=True)
    for file in load_order(unpacked, packages.release, BOOT_MODULES + TEST_MODULES):
        copy = target / file.relative_to(unpacked)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(file, copy)
    for name in ("modules.builtin", "modules.builtin.modinfo", "modules.order"):
        shutil.copy2(unpacked / "lib" / "modules" / packages.release / name, modules)
    shutil.copy2(unpacked / "boot" / f"vmlinuz-{packages.release}", target / "vmlinuz")
    (loopback,) = (unpacked / "usr" / "src").glob("v4l2loopback-*")
    (modules / "extra").mkdir()
    for name, source in zip(BUILT_MODULES, (RIG_MODULE, loopback), strict=True):
        _build_module(source, unpacked / f"build-{name}", packages.release)
        shutil.copy2(unpacked / f"build-{name}" / f"{name}.ko", modules / "extra")
    run("depmod", "--basedir", target, packages.release)
    remove(unpacked)


def _download_and_unpack(name: str, folder: Path) -> None:
    downloads = folder / "downloads"
    downloads.mkdir(parents=True, exist_ok=True)
    try:
        run("apt-get", "download", "--quiet", "-o", "APT::Sandbox::User=root", name, folder=downloads)
    except FailedError as failed:
        raise SkippedError(f"package {name} cannot be fetched") from failed
    (package,) = downloads.glob(f"{name}_*.deb")
    run("dpkg", "--extract", package, folder)


def _build_module(source: Path, folder: Path, release: str) -> None:
    shutil.copytree(source, folder)
    if source.name.startswith("v4l2loopback"):
        _state_the_clock(folder / "v4l2loopback.c")
    run("make", "-C", f"/usr/src/linux-headers-{release}", f"M={folder}", "modules")


def _state_the_clock(source: Path) -> None:
    """Make the loopback say that its stamps are of CLOCK_MONOTONIC: they are, but it leaves them unmarked."""
    text = source.read_text(encoding="utf-8")
    unmarked = "\t\tb->flags = 0;\n"
    if text.count(unmarked) != 1:
        raise FailedError(f"{source}: another v4l2loopback than the one this tier knows")
    source.write_text(text.replace(unmarked, "\t\tb->flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;\n"), encoding="utf-8")
