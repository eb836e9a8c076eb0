"""A human trial's folder and the table of impedance: what is written is read, what is wrong is one clear line."""

import re
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from cli.platform import platform
from impedance.ankle.table import load_table, save_table
from impedance.ankle.trial import Perturbation, load_trial, save_trial
from messages.errors import UserError
from sim_rig.platform.ankle import AnkleRun, walk
from sim_rig.platform.ankle_measured import AnkleNoise, measured
from sim_rig.platform.ankle_person import person
from sim_rig.platform.ankle_truth import true_table
from tests.bench.html_page import read


@pytest.fixture(scope="module")
def run() -> AnkleRun:
    return walk(person(5), [Perturbation.RANDOM, Perturbation.RAMP, Perturbation.NONE], 5, slope_deg=5.0)


@pytest.fixture
def folder(tmp_path: Path, run: AnkleRun) -> Path:
    save_trial(tmp_path, measured(run, AnkleNoise(), 5))
    return tmp_path


def test_a_trial_survives_its_folder(folder: Path, run: AnkleRun) -> None:
    written, read = measured(run, AnkleNoise(), 5), load_trial(folder)
    assert read.settings == written.settings
    assert read.perturbation == written.perturbation
    for name in ("cycle", "t_s", "stance", "plate_rad", "shank_rad", "wrench", "onset_s"):
        np.testing.assert_allclose(getattr(read, name), getattr(written, name), rtol=1e-8, atol=1e-9)
    assert np.median(read.plate_rad[:, 0]) == pytest.approx(np.deg2rad(5.0), abs=0.01)


def _edit(path: Path, change: Callable[[str], str]) -> None:
    path.write_text(change(path.read_text()))


def _cell(row: int, column: int, text: str) -> Callable[[str], str]:
    def change(whole: str) -> str:
        lines = whole.split("\n")
        cells = lines[row - 1].split(",")
        cells[column] = text
        lines[row - 1] = ",".join(cells)
        return "\n".join(lines)

    return change


def _scaled(column: int, factor: float) -> Callable[[str], str]:
    def change(whole: str) -> str:
        header, *rows = whole.strip().split("\n")
        cells = [row.split(",") for row in rows]
        for row in cells:
            row[column] = str(float(row[column]) * factor)
        return "\n".join([header, *(",".join(row) for row in cells)]) + "\n"

    return change


def _without_row(row: int) -> Callable[[str], str]:
    return lambda whole: "\n".join(line for k, line in enumerate(whole.split("\n"), start=1) if k != row)


WRONG = [
    ("cycles.csv", lambda text: text.replace("tz_nm", "tz"), r"column tz_nm is missing; expected cycle, t_s"),
    ("cycles.csv", _cell(9, 7, "abc"), r"cycles.csv: row 9: fx_n is 'abc', allowed a number"),
    ("cycles.csv", _cell(9, 8, "nan"), r"cycles.csv: row 9: fy_n is not finite; leave the whole cycle out"),
    ("cycles.csv", _without_row(20), r"row 20: t_s steps by 0.0057\d* s, allowed 0.00285\d* s .*: a gap"),
    ("cycles.csv", _scaled(3, 57.3), r"cycles.csv: plate_theta_rad reaches .*, allowed ±1 rad: degrees\?"),
    ("cycles.csv", _scaled(8, -1.0), r"fy_n .* the platform pushes up; axes swapped, or another unit\?"),
    ("cycles.csv", _cell(9, 2, "0"), r"cycles.csv: row 9: stance_percent must rise within a cycle"),
    ("cycles.csv", _scaled(1, 1000.0), r"cycles.csv: row 3: t_s steps by 2.857"),
    ("events.csv", lambda text: text.replace("ramp", "step"), r"row 3: perturbation is 'step', allowed none, ramp"),
    ("events.csv", _without_row(3), r"events.csv: cycle 2 of cycles.csv is missing"),
    ("events.csv", _cell(3, 2, "9.0"), r"events.csv: row 3: onset_s of a ramp is 9, allowed "),
    ("trial.toml", lambda text: text.replace("straight", "dance"), r"trial.toml: manoeuvre"),
    ("trial.toml", lambda text: re.sub(r"to_percent = .*", "to_percent = 12.0", text), r"to_percent is 12, all"),
    (
        "trial.toml",
        lambda text: re.sub(r"in_plate_m = .*", "in_plate_m = [-50, 100, 10]", text),
        r"trial.toml: .*in_pl",
    ),
]


@pytest.mark.parametrize(("name", "change", "line"), WRONG)
def test_what_is_wrong_is_named(folder: Path, name: str, change: Callable[[str], str], line: str) -> None:
    _edit(folder / name, change)
    with pytest.raises(UserError, match=line) as caught:
        load_trial(folder)
    assert "\n" not in str(caught.value)


def test_the_table_survives_its_file_and_refuses_nonsense(tmp_path: Path, run: AnkleRun) -> None:
    table, path = true_table(run), tmp_path / "ankle_impedance.toml"
    save_table(path, table)
    assert load_table(path) == table
    axis = table.dorsi_plantarflexion
    upside_down = msgspec.structs.replace(axis, stiffness_nm_per_rad_low=[1e6] * 29)
    short = msgspec.structs.replace(axis, damping_nms_per_rad=[1.0])
    for wrong, line in ((upside_down, "low to high"), (short, "29 values each")):
        with pytest.raises(UserError, match=line):
            save_table(path, msgspec.structs.replace(table, dorsi_plantarflexion=wrong))
    _edit(path, lambda text: text.replace("manoeuvre", "maneuver"))
    with pytest.raises(UserError, match="maneuver is not a known field; did you mean 'manoeuvre'"):
        load_table(path)


def test_the_commands_simulate_and_identify(tmp_path: Path) -> None:
    runner = CliRunner()
    simulated = runner.invoke(platform, ["ankle", "simulate", "--out", str(tmp_path / "trial"), "--cycles", "5"])
    assert simulated.exit_code == 0, simulated.output
    out, plot, html = (tmp_path / name for name in ("ankle_impedance.toml", "curves.png", "report.html"))
    written = ["--out", str(out), "--plot", str(plot), "--html", str(html)]
    arguments = ["ankle", "identify", str(tmp_path / "trial"), *written]
    identified = runner.invoke(platform, arguments)
    assert identified.exit_code == 0, identified.output
    found, truth = load_table(out), load_table(tmp_path / "trial" / "truth.toml")
    assert found.stance_percent == truth.stance_percent
    for one, true in zip(found.axes(), truth.axes(), strict=True):
        off = np.array(one.stiffness_nm_per_rad) / np.array(true.stiffness_nm_per_rad) - 1.0
        assert np.nanmean(np.abs(off)) < 0.1
    assert plot.read_bytes().startswith(b"\x89PNG")
    report = read(html)
    assert report.count(f"{found.dorsi_plantarflexion.foot_inertia_kgm2:.4f} kg m²") >= 1
    assert "trial/cycles.csv" in report
