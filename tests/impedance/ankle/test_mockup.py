"""A mock-up of known values, the delay that a known weight tells, and impedance by condition."""

import json
from pathlib import Path

import msgspec
import pytest
from typer.testing import CliRunner

from cli.platform import platform
from impedance.ankle.conditions import gathered, load_conditions
from impedance.ankle.impedance import identify
from impedance.ankle.inherited import read_delay, with_delay
from impedance.ankle.table import AnkleTable, save_table
from impedance.ankle.trial import Manoeuvre, Perturbation, load_trial
from impedance.ankle.validation import validated
from messages.errors import UserError
from sim_rig.platform.ankle import walk
from sim_rig.platform.ankle_measured import SENSOR_NOISE, late, measured
from sim_rig.platform.ankle_person import mockup, person
from sim_rig.platform.ankle_truth import true_table

EXPLAINED = """\
system = "platform"
[parameters.mass_kg]
value = 22.68
unit = "kg"
[effects.force_delay.value_s]
value = 0.0008
low = 0.00079
high = 0.00081
unit = "s"
"""


def invoked(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(platform, ["ankle", *words])
    if isinstance(result.exception, UserError):
        return 2, str(result.exception)
    return result.exit_code, result.output


@pytest.mark.parametrize("shod", [False, True])
def test_springs_and_dampers_come_back_within_2_and_5_percent(shod: bool) -> None:
    run = walk(mockup(220.0, 1.6, shod=shod), [Perturbation.RANDOM] * 3, 8)
    trial = measured(late(run, 6e-4), SENSOR_NOISE, 8)
    every = validated(trial, identify(trial))
    assert [each.quantity for each in every] == ["stiffness", "damping"] * 2
    assert all(each.holds for each in every), every
    assert every[0].known == 220.0


def test_another_spring_than_stated_fails(tmp_path: Path) -> None:
    folder = tmp_path / "mockup"
    assert invoked("simulate", "--out", str(folder), "--mockup", "--cycles", "3")[0] == 0
    out = tmp_path / "validation.json"
    code, text = invoked("validate", str(folder), "--json", str(out))
    assert code == 0, text
    assert {each["holds"] for each in json.loads(out.read_text())} == {True}
    settings = (folder / "trial.toml").read_text()
    assert load_trial(folder).settings.manoeuvre is Manoeuvre.MOCKUP
    (folder / "trial.toml").write_text(
        settings.replace("stiffness_nm_per_rad = [250.0", "stiffness_nm_per_rad = [260.0")
    )
    code, text = invoked("validate", str(folder))
    assert code == 1
    assert "fails" in text
    (folder / "trial.toml").write_text(settings.replace('manoeuvre = "mockup"', 'manoeuvre = "standing"'))
    with pytest.raises(UserError, match=r'manoeuvre "mockup" needs the table \[mockup\]'):
        load_trial(folder)


def test_only_a_mockup_is_validated() -> None:
    trial = measured(walk(person(2), [Perturbation.RANDOM] * 3, 2), SENSOR_NOISE, 2)
    with pytest.raises(UserError, match=r"no table \[mockup\]"):
        validated(trial, identify(trial))


def test_a_known_weight_hands_its_delay_on(tmp_path: Path) -> None:
    explained, identified = tmp_path / "extended.toml", tmp_path / "weight.json"
    explained.write_text(EXPLAINED)
    errors = [{"kind": "gain", "found": 0.1}, {"kind": "delay", "found": 8e-4, "deviation": 5e-6}]
    identified.write_text(json.dumps({"checks": {"errors": errors}}))
    for path in (explained, identified):
        told = read_delay(path)
        assert told.delay_s == 8e-4
        assert told.deviation_s == pytest.approx(5e-6, rel=0.05)
    run = walk(person(4), [Perturbation.RANDOM] * 4, 4)
    trial = measured(late(run, 8e-4), SENSOR_NOISE, 4)
    found = identify(with_delay(trial, told))
    assert found.delay_s == pytest.approx(8e-4, abs=2e-5)
    assert found.delay_deviation_s <= told.deviation_s


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        ("a.toml", EXPLAINED.split("[effects")[0], "names no effects.force_delay: .* platform identify --json"),
        ("b.toml", EXPLAINED.replace("platform", "imu"), "system is 'imu'"),
        ("c.toml", EXPLAINED.replace("low = 0.00079\n", ""), r"force_delay.value_s.low is None"),
        ("d.toml", EXPLAINED.replace("0.0008\n", "0.8\n"), r"the delay is 0.8 ± .* s, allowed up to ±0.02 s"),
        ("e.json", "[1, 2]", "holds no delay under checks.errors"),
        ("f.json", "{", "not JSON"),
    ],
)
def test_a_file_that_tells_no_delay_is_one_line(tmp_path: Path, name: str, text: str, line: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(UserError, match=line) as caught:
        read_delay(tmp_path / name)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def level() -> AnkleTable:
    return true_table(walk(person(5), [Perturbation.RANDOM], 5))


def test_tables_are_gathered_by_condition(tmp_path: Path, level: AnkleTable) -> None:
    ramp = msgspec.structs.replace(level, ground_slope_deg=-5.0)
    turn = msgspec.structs.replace(level, manoeuvre=Manoeuvre.SPIN_TURN)
    other = msgspec.structs.replace(ramp, subject="other")
    paths = [tmp_path / f"{k}.toml" for k in range(4)]
    for path, table in zip(paths, (turn, level, ramp, other), strict=True):
        save_table(path, table)
    out = tmp_path / "conditions.toml"
    code, text = invoked("conditions", *map(str, paths[:3]), "--out", str(out))
    assert code == 0, text
    assert "spin_turn" in text
    read = load_conditions(out)
    assert read == gathered(paths[:3])
    assert [(each.manoeuvre.value, each.ground_slope_deg) for each in read.condition] == [
        ("spin_turn", 0.0),
        ("straight", -5.0),
        ("straight", 0.0),
    ]
    with pytest.raises(UserError, match=r"3.toml: subject is 'other'"):
        gathered(paths)
    with pytest.raises(UserError, match=r"straight at 0° stands in .* already"):
        gathered([paths[1], paths[1]])


def test_nobody_stands_on_a_mockup(tmp_path: Path) -> None:
    code, text = invoked("simulate", "--out", str(tmp_path), "--mockup", "--standing")
    assert code == 2
    assert "nobody stands on a mock-up" in text
