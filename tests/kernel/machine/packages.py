"""The machine's second disk: the packages of the project's virtual environment."""

import shutil
import sysconfig
from pathlib import Path

from tests.kernel.machine import disk
from tests.kernel.machine.host import PYTHON, PYTHON_PATH, WORKSHOP, cached, digest, remove, run

NOT_NEEDED_INSIDE = shutil.ignore_patterns(
    *("__editable__*", "distutils-precedence.pth", "tests", "*.pyi", "*.a"),
    *("mypy", "mypyc", "pip", "setuptools", "grimp", "scipy-stubs", "ruff*", "importlinter"),
    *("skimage", "PIL", "pillow.libs", "networkx", "imageio", "tifffile", "vqf"),
)


def packages_disk() -> Path:
    """Return an ext4 image of the virtual environment's packages, development tools left out, cached."""
    site = Path(sysconfig.get_path("purelib"))
    installed = sorted(folder.name for folder in site.glob("*.dist-info"))
    tree = WORKSHOP / "packages-tree"

    def make(image: Path) -> None:
        remove(tree)
        shutil.copytree(site, tree, ignore=NOT_NEEDED_INSIDE)
        (tree / "gaiteyes.pth").write_text("/srv/gaiteyes\n")
        run(PYTHON_PATH, "-m", "compileall", "-q", "-j", "0", tree)
        disk.make_disk(tree, image, spare_mb=8)
        remove(tree)

    return cached("packages.img", digest(*installed, PYTHON, Path(__file__), Path(disk.__file__)), make)
