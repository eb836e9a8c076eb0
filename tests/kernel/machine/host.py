"""What the kernel tier asks of the host: commands, Debian's packages, and a cache for what takes long to make."""

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[3]
WORKSHOP = PROJECT / "build" / "kernel"
PYTHON = f"python{sys.version_info.major}.{sys.version_info.minor}"
PYTHON_PATH = Path(sysconfig.get_path("scripts")) / "python"
DIST_PACKAGES = f"usr/local/lib/{PYTHON}/dist-packages"
"""Where Debian's Python looks for packages that are not Debian's."""
PACKAGES = ("qemu-system-x86", "mmdebstrap", "busybox-static", "e2fsprogs", "kmod", "gcc", "make")


class SkippedError(Exception):
    """This host cannot run the kernel tier. One line that says why."""


class FailedError(Exception):
    """Building or running the machine failed. One line, and where the rest stands."""


@contextmanager
def step(title: str) -> Iterator[None]:
    """Tell a step and how long it took."""
    print(f"  {title} … ", end="", flush=True)
    start_s = time.monotonic()
    try:
        yield
    finally:
        print(f"{time.monotonic() - start_s:.1f} s", flush=True)


def run(*command: str | Path, folder: Path | None = None) -> None:
    """Run a command, its output into the build log. Raises FailedError."""
    WORKSHOP.mkdir(parents=True, exist_ok=True)
    log = WORKSHOP / "build.log"
    with log.open("a", encoding="utf-8") as output:
        output.write(f"\n$ {' '.join(map(str, command))}\n")
        output.flush()
        result = subprocess.run(
            command, cwd=folder, stdin=subprocess.DEVNULL, stdout=output, stderr=output, check=False, env=_ENVIRONMENT
        )
    if result.returncode:
        raise FailedError(f"`{' '.join(map(str, command[:4]))} …` failed; see {log}")


def told(*command: str | Path) -> str:
    """Return what a command prints. Raises FailedError."""
    result = subprocess.run(command, capture_output=True, text=True, check=False, env=_ENVIRONMENT)
    if result.returncode:
        raise FailedError(f"`{' '.join(map(str, command))}` failed: {' '.join(result.stderr.split())}")
    return result.stdout


_ENVIRONMENT = {**os.environ, "DEBIAN_FRONTEND": "noninteractive", "LC_ALL": "C.UTF-8"}


@contextmanager
def alone() -> Iterator[None]:
    """Hold the workshop for one run. Raises FailedError if another one has it."""
    WORKSHOP.mkdir(parents=True, exist_ok=True)
    with (WORKSHOP / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise FailedError("another run of the kernel tier is under way") from error
        yield


def require_debian() -> None:
    """Raise SkippedError unless this is Debian on x86-64, and root: the machine is made of Debian's packages."""
    if not (shutil.which("apt-get") and Path("/etc/debian_version").exists() and os.uname().machine == "x86_64"):
        raise SkippedError("the kernel tier needs Debian on x86-64")
    if os.geteuid() != 0:
        raise SkippedError("building the machine needs root")


def require_packages(names: Sequence[str]) -> None:
    """Install what is missing. Raises SkippedError, naming the packages, where they cannot be had."""
    missing = [name for name in names if not _is_installed(name)]
    if not missing:
        return
    with step(f"installing {' '.join(missing)}"):
        install = ("apt-get", "install", "--yes", "--quiet", "--no-install-recommends", *missing)
        try:
            run(*install)
        except FailedError:
            try:
                run("apt-get", "update", "--quiet")
                run(*install)
            except FailedError as failed:
                raise SkippedError(f"packages {', '.join(missing)} are missing and cannot be installed") from failed


def _is_installed(name: str) -> bool:
    status = subprocess.run(["dpkg-query", "-W", "-f=${db:Status-Status}", name], capture_output=True, check=False)
    return status.stdout == b"installed"


def dependency(package: str, prefix: str) -> str:
    """Return the package whose name starts with `prefix` that `package` depends on. Raises SkippedError."""
    for line in told("apt-cache", "depends", "--important", package).splitlines():
        kind, _, name = line.strip().partition(": ")
        if kind == "Depends" and name.startswith(prefix):
            return name
    raise SkippedError(f"Debian's package {package} is not on offer here; `apt-get update` may help")


def candidate(package: str) -> str:
    """Return the version of `package` that apt would install."""
    versions = [line for line in told("apt-cache", "policy", package).splitlines() if "Candidate:" in line]
    return versions[0].split()[-1] if versions else ""


def debian_sources() -> tuple[str, list[str]]:
    """Return the release's code name and apt's source lines of Debian itself, as the host has them."""
    fields = "$(ORIGIN)|$(CODENAME)|deb $(REPO_URI) $(RELEASE) $(COMPONENT)"
    targets = told("apt-get", "indextargets", "--format", fields, "Created-By: Packages").splitlines()
    debian = [target.split("|") for target in targets if target.startswith("Debian|")]
    if not debian:
        raise SkippedError("apt knows no Debian mirror here; `apt-get update` may help")
    return debian[0][1], sorted({line for _, _, line in debian})


def digest(*parts: str | Path) -> str:
    """Return a key for what is made of these texts and files."""
    total = hashlib.sha256()
    for part in parts:
        content = part.read_bytes() if isinstance(part, Path) else part.encode()
        total.update(len(content).to_bytes(8, "little") + content)
    return total.hexdigest()[:16]


def cached(name: str, key: str, make: Callable[[Path], None]) -> Path:
    """Return the file or folder `name` for `key`, made by `make(path)` unless it stands from an earlier run."""
    path = WORKSHOP / f"{name}-{key}"
    if path.exists():
        return path
    for old in WORKSHOP.glob(f"{name}-*"):
        remove(old)
    unfinished = WORKSHOP / f"{name}-unfinished"
    with step(f"making {name}"):
        make(unfinished)
    return unfinished.rename(path)


def remove(path: Path) -> None:
    """Delete a file or a folder with all it holds."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
