"""Without the extras every command that needs one says so in one line, and every other one works."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import tomli

from cli.main import main
from messages.errors import UserError
from messages.extras import EXTRA_OF, needs

HOME = Path(__file__).parents[2]

NEEDED = {
    "demo": "rig",
    "faults": "rig",
    "evaluate motorcycle": "rig",
    "evaluate rig": "rig",
    "platform simulate --out out": "lab",
    "platform tables": "lab",
    "platform tables --ablations": "lab",
    "explain court --out out": "lab",
    "explain tables --out out": "lab",
}


@pytest.fixture
def no_extras(monkeypatch: pytest.MonkeyPatch) -> None:
    for package in EXTRA_OF:
        monkeypatch.setitem(sys.modules, package, None)


def run(monkeypatch: pytest.MonkeyPatch, arguments: str) -> int:
    monkeypatch.setattr("cli.logs.configure_logs", lambda: None)  # it would stay for the other tests
    monkeypatch.setattr(sys, "argv", ["gaiteyes", *arguments.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    assert isinstance(ended.value.code, int)
    return ended.value.code


@pytest.mark.usefixtures("no_extras")
@pytest.mark.parametrize("arguments", NEEDED)
def test_a_command_says_which_extra_it_needs(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path, arguments: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, arguments) == 2
    command = "gaiteyes " + arguments.partition(" --")[0]
    extra = NEEDED[arguments]
    assert caplog.messages == [f"{command} needs the extra '{extra}': pip install 'gaiteyes[{extra}]'"]
    assert not list(tmp_path.iterdir())


def test_the_scheduler_of_a_court_is_an_extra_of_its_own(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert run(monkeypatch, "explain court --out out --scheduler tcp://127.0.0.1:1") == 2
    assert caplog.messages == ["--scheduler needs the extra 'cluster': pip install 'gaiteyes[cluster]'"]


@pytest.mark.parametrize("package", EXTRA_OF)
def test_the_line_names_the_extra_that_brings_the_package(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    extra = EXTRA_OF[package]
    with pytest.raises(UserError, match=re.escape(f"this needs the extra '{extra}': pip install 'gaiteyes[{extra}]'")):
        needs("this", package)


def test_a_package_that_lacks_another_is_not_called_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "skimage.py").write_text("import nobody_has_this\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "skimage", raising=False)
    with pytest.raises(ModuleNotFoundError, match="nobody_has_this"):
        needs("this", "skimage")


def test_the_table_of_extras_is_that_of_the_project() -> None:
    extras = tomli.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    brought = {
        (re.split(r"[^a-z0-9-]", entry.lower())[0], extra)
        for extra in set(EXTRA_OF.values())
        for entry in extras[extra]
    }
    distributions = {"skimage": "scikit-image", "sklearn": "scikit-learn"}
    assert {(distributions.get(package, package), extra) for package, extra in EXTRA_OF.items()} == brought


WITHOUT_EXTRAS = """
import sys
for package in {packages!r}:
    sys.modules[package] = None
from cli.main import main
sys.argv = ["gaiteyes", *{arguments!r}]
main()
"""


@pytest.mark.long
@pytest.mark.parametrize("arguments", ["--help", "explain effects", "platform ankle simulate --cycles 1 --out trial"])
def test_a_command_that_needs_no_extra_works_without(tmp_path: Path, arguments: str) -> None:
    text = WITHOUT_EXTRAS.format(packages=list(EXTRA_OF), arguments=arguments.split())
    done = subprocess.run([sys.executable, "-c", text], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
