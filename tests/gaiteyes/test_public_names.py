"""`import gaiteyes` in fresh interpreters: what it offers, and how little it loads."""

import inspect
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest
import tomli

import discrepancy
import gaiteyes

HOME = Path(__file__).parents[2]
HEAVY = {"cv2", "scipy", "mujoco", "matplotlib", "skimage"}
TRANSPORTS = {"zenoh", "can", "serial", "smbus2", "cantools"}

BLOCKED = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ModuleNotFoundError(f"No module named '{{name}}'", name=name)

sys.meta_path.insert(0, Blocker())
"""


def fresh(program: str, *, blocked: set[str] | None = None) -> str:
    """What `program` prints in an interpreter of its own, in which the `blocked` packages are not installed."""
    text = BLOCKED.format(blocked=blocked or set()) + program
    done = subprocess.run([sys.executable, "-c", text], cwd=HOME, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def loaded_by(program: str) -> set[str]:
    return set(fresh(program + "\nprint(*{name.partition('.')[0] for name in sys.modules})").split())


def test_the_package_alone_loads_nothing() -> None:
    assert not loaded_by("import gaiteyes") & (HEAVY | TRANSPORTS | {"numpy", "msgspec", "messages"})


def test_listening_needs_zenoh_and_nothing_heavy() -> None:
    loaded = loaded_by("import gaiteyes; gaiteyes.listen; gaiteyes.GroundPlane")
    assert "zenoh" in loaded
    assert not loaded & (HEAVY | TRANSPORTS - {"zenoh"})


@pytest.mark.parametrize("name", ["OwnSimulation", "Effect", "Parameter", "Channels", "GroundPlane", "Refusal"])
def test_types_load_neither_mathematics_nor_transports(name: str) -> None:
    assert not loaded_by(f"import gaiteyes; gaiteyes.{name}") & (HEAVY | TRANSPORTS)


def test_finder_messages_and_pipeline_work_without_transports() -> None:
    program = (
        "import gaiteyes; print(gaiteyes.explain.__name__, gaiteyes.Attitude.__name__, gaiteyes.Pipeline.__name__)"
    )
    assert fresh(program, blocked=TRANSPORTS).split() == ["explain", "Attitude", "Pipeline"]


def test_every_name_is_there_and_documented_as_what_it_is() -> None:
    assert len(set(gaiteyes.__all__)) == len(gaiteyes.__all__)
    assert dir(gaiteyes) == sorted(gaiteyes.__all__)
    for name in gaiteyes.__all__:
        found = getattr(gaiteyes, name)
        assert found is getattr(gaiteyes, name)
        if inspect.isfunction(found) or (inspect.isclass(found) and not get_args(found)):
            assert found.__name__ == name
            assert found.__doc__, name


def test_a_name_that_is_none_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'gaiteyes' has no attribute 'lissten'"):
        getattr(gaiteyes, "lissten")  # noqa: B009  # mypy refuses it as written
    with pytest.raises(AttributeError, match="module 'discrepancy' has no attribute 'explian'"):
        getattr(discrepancy, "explian")  # noqa: B009


def test_the_finder_hands_on_its_own_names_after_any_import() -> None:
    program = """
import discrepancy.finder, discrepancy.simulation
from discrepancy import Channels, Effect, OwnSimulation, Parameter, explain
print(explain is discrepancy.finder.explain, Channels is discrepancy.simulation.Channels, callable(explain))
"""
    assert fresh(program).split() == ["True"] * 3
    assert not loaded_by("import discrepancy") & (HEAVY | {"numpy"})


def test_public_names_of_both_packages_are_the_same_objects() -> None:
    for name in set(discrepancy.__all__) & set(gaiteyes.__all__):
        assert getattr(discrepancy, name) is getattr(gaiteyes, name)
    assert set(discrepancy.__all__) <= set(gaiteyes.__all__)


def test_the_version_stands_once() -> None:
    project = tomli.loads((HOME / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["dynamic"] == ["version"]
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "gaiteyes.__version__"}
    assert f"version: {gaiteyes.__version__}" in (HOME / "CITATION.cff").read_text(encoding="utf-8")
