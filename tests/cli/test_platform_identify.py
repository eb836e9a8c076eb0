"""`gaiteyes platform identify`: from a folder to a table, a report and facts for a program."""

import json
from pathlib import Path

import pytest

from cli.main import app
from messages.errors import UserError
from tests.bench.html_page import read
from tests.bench.platform_motion import FOOT, PLATE, lines, noisy, recording


def identify(*arguments: object) -> None:
    app(["platform", "identify", *map(str, arguments)], standalone_mode=False)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    plate, foot = (tmp_path_factory.mktemp(name) for name in ("plate", "foot"))
    noisy(recording(lines(1), 6.0), 1).save(plate)
    noisy(recording(lines(2), 6.0, FOOT), 2).save(foot)
    return plate, foot


def test_the_plate_and_its_report(
    folders: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    identify(folders[0], "--out", tmp_path / "report", "--json", tmp_path / "facts.json")
    printed = capsys.readouterr().out
    assert "the markers agree with the joint" in printed
    assert "Jxx" in printed
    page = read(tmp_path / "report" / "report.html")
    for told in ("Inertia of the plate", "the markers agree with the joint", "Jyy", "platform.toml", "SHA-256"):
        assert told in page, told
    assert (tmp_path / "report" / "report.html").read_text(encoding="utf-8").count("<svg") == 2
    facts = json.loads((tmp_path / "facts.json").read_bytes())
    low, high = facts["parameters"]["Jzz"]["interval_95"]
    assert low < float(PLATE.inertia_kgm2[2, 2]) + 1e-3
    assert high > float(PLATE.inertia_kgm2[2, 2]) - 1e-3
    assert facts["with_joint"] is True


def test_the_foot_after_its_plate(folders: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    identify(folders[1], "--plate", folders[0])
    printed = capsys.readouterr().out
    assert "Inertia of the foot" in printed
    assert "taken as exact" not in printed


def test_what_cannot_be_told_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    noisy(recording(lines(3, (0.7, 0.0)), 6.0), 3).save(tmp_path / "one_axis")
    identify(tmp_path / "one_axis", "--no-weighed", "--json", tmp_path / "facts.json")
    assert "not identifiable" in capsys.readouterr().out
    facts = json.loads((tmp_path / "facts.json").read_bytes())
    assert facts["parameters"]["Jyy"]["estimate"] is None
    assert set(facts["null_direction"]) == set(facts["parameters"])


def test_a_folder_that_is_none_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"platform\.toml"):
        identify(tmp_path / "absent")
