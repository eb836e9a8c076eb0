"""Wheel and source archive: they hold what the packages need, and the wheel works from any folder."""

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[2]
TRACKED = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
LIMIT_S = 300.0
_BUILD = """
from setuptools import build_meta
build_meta.build_wheel({out!r})
build_meta.build_sdist({out!r})
"""


def tracked() -> list[Path]:
    """Return the files of the project, as a clone has them."""
    done = subprocess.run(TRACKED, cwd=PROJECT, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("this is no clone")
    return [Path(line) for line in done.stdout.splitlines() if (PROJECT / line).is_file()]


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with both, built from a copy of the project by what pyproject.toml asks for."""
    base = tmp_path_factory.mktemp("archives")
    for file in tracked():
        copy = base / "project" / file
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes((PROJECT / file).read_bytes())
    subprocess.run([sys.executable, "-m", "venv", base / "venv"], check=True, timeout=LIMIT_S)
    python = base / "venv" / "bin" / "python"
    install = [str(python), "-m", "pip", "install", "--quiet", "setuptools>=77"]
    if subprocess.run(install, capture_output=True, timeout=LIMIT_S, check=False).returncode:
        pytest.skip("setuptools cannot be had here")
    out = base / "out"
    out.mkdir()
    build = [str(python), "-c", _BUILD.format(out=str(out))]
    done = subprocess.run(build, cwd=base / "project", capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def unpacked(archives: Path) -> Path:
    """Return the folder that the wheel was unpacked into, as an installation does it."""
    folder = archives / "unpacked"
    with zipfile.ZipFile(next(archives.glob("*.whl"))) as wheel:
        wheel.extractall(folder)
    return folder


def gaiteyes(unpacked: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command out of the wheel, in a folder that has nothing of the project."""
    environment = {**os.environ, "PYTHONPATH": str(unpacked)}
    command = [sys.executable, "-m", "cli.main", *arguments]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=False
    )


@pytest.mark.long
def test_the_wheel_holds_the_packages_whole_and_nothing_else(archives: Path, unpacked: Path) -> None:
    packages = {file.parts[0] for file in tracked() if (PROJECT / file.parts[0] / "py.typed").exists()}
    expected = {str(file) for file in tracked() if file.parts[0] in packages}
    held = {str(path.relative_to(unpacked)) for path in unpacked.rglob("*") if path.is_file()}
    assert {name for name in held if ".dist-info/" not in name} == expected


@pytest.mark.long
def test_the_source_archive_holds_what_a_clone_does(archives: Path) -> None:
    with tarfile.open(next(archives.glob("*.tar.gz"))) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    left_out = {str(file) for file in tracked()} - held
    assert all(name.startswith(".") for name in left_out), left_out


@pytest.mark.long
def test_the_command_of_the_wheel_works_from_anywhere(unpacked: Path, tmp_path: Path) -> None:
    version = gaiteyes(unpacked, tmp_path, "--version")
    assert version.stdout == f"gaiteyes {next(unpacked.glob('*.dist-info')).name.split('-')[1].removesuffix('.dist')}\n"
    done = gaiteyes(unpacked, tmp_path, "platform", "ankle", "simulate", "--cycles", "1", "--out", "trial")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "trial" / "truth.toml").is_file()


@pytest.mark.long
@pytest.mark.realtime
def test_the_demo_of_the_wheel_works_from_anywhere(unpacked: Path, tmp_path: Path) -> None:
    pytest.importorskip("skimage")
    outlets = ("--can", "virtual:wheel", "--zenoh", f"unixsock-stream/{tmp_path}/z.sock")
    done = gaiteyes(unpacked, tmp_path, "demo", "--seconds", "2", *outlets)
    assert done.returncode in (0, 4), done.stderr  # 4: the host was too busy to judge by
    assert "Ground against truth" in done.stdout
    assert "Traceback" not in done.stderr
