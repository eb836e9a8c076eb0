"""`gaiteyes platform simulate --extended`: what the finder found, in the rig's mechanics, and found there again."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from cli.main import app
from discrepancy.simulation import Effect
from discrepancy.verdict import Verdict, from_json
from impedance.recording.recording import read_truth
from messages.errors import UserError

pytest.importorskip("mujoco")

from sim_rig.platform.extended.simulate import MECHANISMS
from systems.platform import load


def told(path: Path, *entries: tuple[str, float, str]) -> Path:
    lines = [f'[{field}]\nvalue = {value!r}\nunit = "{unit}"\n' for field, value, unit in entries]
    path.write_text('system = "platform"\n' + "\n".join(lines), encoding="utf-8")
    return path


def run(*arguments: str | Path | int) -> None:
    result = CliRunner().invoke(app, [str(each) for each in arguments])
    if result.exception is not None:
        raise result.exception


def explained(recording: Path, out: Path) -> Verdict:
    run("explain", "platform", recording, "--out", out, "--no-report")
    return from_json((out / "verdict.json").read_bytes())


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "sizes"),
    [
        ("force_delay", {"value_s": (1.2e-3, "s")}),
        ("crosstalk", {"tx_from_fy": (0.02, "m")}),
        ("saturation", {"tz": (120.0, "N·m")}),
        ("tape_compliance", {"z_hz": (70.7, "Hz"), "x_hz": (51.1, "Hz"), "zeta": (0.07, "1"), "seen": (0.0, "1")}),
        ("aliasing", {"update_hz": (45.6, "Hz")}),
    ],
)
def test_what_is_simulated_is_found_again_and_so_is_what_was_found(
    effect: str, sizes: dict[str, tuple[float, str]], tmp_path: Path
) -> None:
    first = told(tmp_path / "first.toml", *((f"effects.{effect}.{key}", *each) for key, each in sizes.items()))
    values = {key: value for key, (value, _) in sizes.items()}
    for number, extension in ((1, first), (2, tmp_path / "1" / "extended.toml")):
        recording, out = tmp_path / f"recording_{number}", tmp_path / str(number)
        run("platform", "simulate", "--out", recording, "--foot", "--seconds", 12, "--seed", number,
            "--extended", extension)  # fmt: skip
        verdict = explained(recording, out)
        assert [cause.name for cause in verdict.causes] == [effect]
        for name, value in values.items():
            found = verdict.causes[0].parameters[name]
            assert found.low is not None
            assert found.high is not None
            spare = 0.5 * (found.high - found.low)  # one of twenty lies outside, and there are more here
            assert found.low - spare <= value <= found.high + spare


def test_the_body_that_was_found_is_simulated(tmp_path: Path) -> None:
    entries = [
        (f"parameters.plate_{name}", value, unit)
        for name, value, unit in (
            ("mx_kgm", 0.02, "kg·m"), ("my_kgm", -0.12, "kg·m"), ("mz_kgm", 0.0, "kg·m"), ("jxx_kgm2", 0.05, "kg·m²"),
            ("jyy_kgm2", 0.12, "kg·m²"), ("jzz_kgm2", 0.11, "kg·m²"), ("jyz_kgm2", 0.0, "kg·m²"),
            ("jxz_kgm2", 0.0, "kg·m²"), ("jxy_kgm2", 0.008, "kg·m²"),
        )
    ]  # fmt: skip
    extension = told(tmp_path / "extended.toml", *entries)
    run("platform", "simulate", "--out", tmp_path / "run", "--seconds", 2, "--extended", extension)
    plate = read_truth(tmp_path / "run").plate
    assert plate.vector[[0, 2, 4]] == pytest.approx([4.64, -0.12, 0.05])


@pytest.mark.parametrize(
    ("field", "unit", "said"),
    [
        ("effects.dropped_samples.held", "1", "effects.dropped_samples: the rig has no mechanism for it"),
        ("effects.magic.value", "1", "effects.magic: the rig has no mechanism for it"),
        ("effects.force_delay.value_s", "ms", 'effects.force_delay.value_s.unit is "ms"; expected "s"'),
        ("effects.force_delay.late_s", "s", "effects.force_delay.late_s is unknown; the nearest known is value_s"),
        ("effects.tape_compliance.z_hz", "Hz", "effects are of a foot, and none is on the plate: add --foot"),
        ("parameters.foot_mass_kg", "kg", "parameters.foot_mass_kg is unknown; the nearest known is plate_mass_kg"),
        ("parameters.plate_mx_kgm", "kg·m", "parameters.plate_my_kgm is missing"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_one_line(field: str, unit: str, said: str, tmp_path: Path) -> None:
    extension = told(tmp_path / "extended.toml", (field, 1.0, unit))
    with pytest.raises(UserError) as refused:
        run("platform", "simulate", "--out", tmp_path / "run", "--seconds", 2, "--extended", extension)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "run").exists()


def test_every_effect_of_the_library_has_its_mechanism_but_one(tmp_path: Path) -> None:
    run("platform", "simulate", "--out", tmp_path, "--foot", "--seconds", 6)
    library: dict[str, Effect] = {effect.name: effect for effect in load(tmp_path).effects}
    assert set(library) - set(MECHANISMS) == {"dropped_samples"}
    for name, mechanism in MECHANISMS.items():
        assert dict(mechanism.units) == {p.name: p.unit for p in library[name].parameters}
