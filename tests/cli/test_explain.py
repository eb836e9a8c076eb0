"""`gaiteyes explain`: from folders to a verdict, and one line for whatever a person gets wrong."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer

from cli.main import app
from messages.errors import UserError
from tests.bench.explained import TRUE, Toy, toy


def explain(*arguments: object) -> None:
    app(["explain", *map(str, arguments)], standalone_mode=False)


def load(folder: Path) -> Toy:
    return toy(int(folder.name))


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """Two folders, which the system's name now stands for as recordings of the toy."""
    monkeypatch.setitem(sys.modules, "systems.platform", SimpleNamespace(load=load))
    for seed in ("1", "2"):
        (tmp_path / seed).mkdir()
    return tmp_path / "1", tmp_path / "2"


def test_from_folders_to_a_verdict_and_a_model_that_simulates(
    folders: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fit, held_out = folders
    out = tmp_path / "out"
    explain("platform", fit, "--held-out", held_out, "--out", out, "--no-report", "--json", tmp_path / "facts.json")
    printed = " ".join(capsys.readouterr().out.split())
    assert "The simulation is missing: force delay." in printed
    assert "The force plate's samples arrive late. Shift the force channel back." in printed
    verdict = json.loads((out / "verdict.json").read_bytes())
    assert json.loads((tmp_path / "facts.json").read_bytes()) == verdict
    assert [cause["name"] for cause in verdict["causes"]] == ["force_delay"]
    delay = verdict["causes"][0]["parameters"]["value_s"]
    assert delay["low"] <= TRUE["force_delay.value_s"] <= delay["high"]
    assert verdict["noise_from"] is None  # nor is it stated how much of what lies above it is gone
    assert verdict["gain"]["share_of_excess_removed"] is None
    assert verdict["gain"]["held_out_nrmse_after"] < verdict["gain"]["held_out_nrmse_before"]

    explain("simulate", "platform", held_out, out / "extended.toml", "--out", tmp_path / "simulated.csv")
    simulated = np.genfromtxt(tmp_path / "simulated.csv", delimiter=",", skip_header=1)
    judged = np.genfromtxt(out / "held_out.csv", delimiter=",", skip_header=1)
    assert np.allclose(simulated[:, 3], judged[:, 3], atol=1e-6)
    assert np.nanstd(simulated[:, 1] - simulated[:, 3]) < np.nanstd(simulated[:, 1] - simulated[:, 2])


def test_several_recordings_are_fitted_together_and_told_apart(
    folders: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fit, other = folders
    for seed in ("3", "4"):
        (tmp_path / seed).mkdir()
    held_out = ("--held-out", tmp_path / "3", "--held-out", tmp_path / "4")
    explain("platform", fit, "--also", other, *held_out, "--out", tmp_path / "out", "--no-report")
    printed = " ".join(capsys.readouterr().out.split())
    assert "Each recording by itself" in printed
    verdict = json.loads((tmp_path / "out" / "verdict.json").read_bytes())
    assert [cause["name"] for cause in verdict["causes"]] == ["force_delay"]
    told = [(each["name"], each["held_out"]) for each in verdict["recordings"]]
    assert told == [("1", False), ("2", False), ("3", True), ("4", True)]
    with pytest.raises(UserError, match="given twice"):
        explain("platform", fit, "--also", fit, "--out", tmp_path / "twice", "--no-report")


def test_what_is_left_out_is_not_named(folders: tuple[Path, Path], tmp_path: Path) -> None:
    fit, held_out = folders
    out = tmp_path / "out"
    explain("platform", fit, "--held-out", held_out, "--out", out, "--no-report", "--without", "force_delay")
    verdict = json.loads((out / "verdict.json").read_bytes())
    assert verdict["verdict"] == "unknown"
    assert verdict["causes"] == []


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("platform", "absent", "--out", "out"), "absent: no such folder"),
        (("simulate", "plattform", "1", "x.toml", "--out", "x.csv"), "plattform: no such system; expected platform"),
        (("court", "--systems", "plattform"), "--systems plattform: no such system"),
        (("platform", "1", "--out", "out", "--json", "nowhere/facts.json"), "its folder does not exist"),
    ],
)
def test_a_mistake_is_one_line(arguments: tuple[str, ...], told: str) -> None:
    with pytest.raises(UserError, match=told) as mistake:
        explain(*arguments)
    assert "\n" not in str(mistake.value)


def test_an_effect_that_is_in_no_library_is_one_line(folders: tuple[Path, Path], tmp_path: Path) -> None:
    for option in ("--only", "--without"):
        with pytest.raises(UserError, match=rf"{option} late: not in the library of toy; expected force_delay"):
            explain("platform", folders[0], "--out", tmp_path / "out", "--no-report", option, "late")


def test_a_system_that_is_none_is_refused() -> None:
    with pytest.raises(typer.TyperException, match="No such command"):
        explain("treadmill", "x", "--out", "y")
