"""The machine's third disk: the project as it stands."""

import os
import shutil
import subprocess
from pathlib import Path

from tests.bench.packages import PACKAGES
from tests.kernel.machine import host
from tests.kernel.machine.disk import make_disk
from tests.kernel.machine.host import PROJECT, PYTHON_PATH, WORKSHOP, FailedError, remove, run
from tests.kernel.machine.scene import scene_file

PROJECT_PARTS = (
    *PACKAGES,
    *("tests", "systemd", "examples", "pyproject.toml", "Makefile", "constraints.txt", "README.md", "LICENSE"),
)


def project_disk() -> Path:
    """Return an ext4 image of the project as it stands, compiled: made anew each time."""
    tree, image = WORKSHOP / "project-tree", WORKSHOP / "project.img"
    picture = scene_file()
    remove(tree)
    tree.mkdir(parents=True)
    with host.step("copying the project"):
        for part in PROJECT_PARTS:
            source = PROJECT / part
            if source.is_dir():
                shutil.copytree(source, tree / part, ignore=shutil.ignore_patterns("__pycache__"))
            elif source.exists():
                shutil.copy2(source, tree / part)
        shutil.copy2(picture, tree / "tests" / "kernel" / "scene.npz")
        run(PYTHON_PATH, "-m", "compileall", "-q", "-j", "0", "-s", tree, "-p", "/srv/gaiteyes", tree)
        _rewrite_assertions(tree)
        make_disk(tree, image, spare_mb=8)
    return image


def _rewrite_assertions(tree: Path) -> None:
    """Let pytest compile the tests here, where it is quick, and tell at once if they cannot be collected."""
    environment = {**os.environ, "GAITEYES_KERNEL_TIER": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    command = (PYTHON_PATH, "-m", "pytest", "tests/kernel", "--collect-only", "-p", "no:cacheprovider")
    collected = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    if collected.returncode:
        raise FailedError(f"the tests cannot be collected:\n{collected.stdout}")
