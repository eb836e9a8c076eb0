"""The printed figures are as printed, and the command that sets the simulation beside them works end to end."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from cli.main import app
from lab.thesis.ablations import ABLATIONS, effect_of, foot_row, plate_row, printed_effects
from lab.thesis.printed import CUBOID_SIZE_M, FOOT, PLATE, ROWS, body_of, cuboid, rows_of
from lab.thesis.reproduced import cuboid_rows
from lab.thesis.study import NOISE_FREE, Experiment, Laboratory, Treatment
from sim_rig.platform import rig

SHORT_S = 6.0
USUAL = Experiment()


@pytest.fixture(scope="module")
def laboratory() -> Laboratory:
    return Laboratory(seed=2, duration_s=SHORT_S)


def test_the_simulated_plate_is_the_mean_of_the_printed_experiments() -> None:
    np.testing.assert_allclose(np.mean(PLATE.experiment, axis=0), PLATE.reference, atol=0.051)
    np.testing.assert_allclose(rows_of(rig.PLATE), PLATE.reference, atol=1e-9)
    np.testing.assert_allclose(rows_of(rig.FOOT), FOOT.reference, atol=1e-9)


def test_a_cuboid_of_one_size_has_all_the_printed_figures() -> None:
    assert PLATE.cuboid is not None
    np.testing.assert_allclose(cuboid_rows(), PLATE.cuboid, atol=0.051)
    size = np.array(CUBOID_SIZE_M)
    for axis in range(3):
        x, y, z = np.where(np.arange(3) == axis, 1.01 * size, size).tolist()
        assert np.abs(rows_of(cuboid(4.64, (x, y, z))) - PLATE.cuboid).max() > 0.1


def test_every_printed_foot_of_an_experiment_is_impossible_and_the_references_are_not() -> None:
    assert not any(body_of(column).is_consistent for column in FOOT.experiment)
    assert body_of(FOOT.reference).is_consistent
    assert body_of(PLATE.reference).is_consistent
    printed = printed_effects()
    assert [effect.impossible for effect in printed] == [1.0] * 5
    assert foot_row(printed[0])[1] == "-3.6 ± 0.5"
    assert plate_row(printed[1])[4] == "0.0"


def test_the_study_without_noise_finds_what_was_simulated(laboratory: Laboratory) -> None:
    plate, foot = laboratory.estimated(USUAL, NOISE_FREE, 0)
    np.testing.assert_allclose(rows_of(plate), PLATE.reference, atol=0.5)
    np.testing.assert_allclose(rows_of(foot), FOOT.reference, atol=0.5)


def test_draws_repeat_and_differ(laboratory: Laboratory) -> None:
    first, again, other = (laboratory.estimated(USUAL, Treatment(), draw)[1] for draw in (0, 0, 1))
    np.testing.assert_array_equal(first.vector, again.vector)
    assert np.abs(first.vector - other.vector).min() > 0.0


def test_more_position_noise_takes_mass_away(laboratory: Laboratory) -> None:
    """Errors in the regressor draw the mass towards zero; a foot tared away even more."""
    mass_kg = [
        laboratory.estimated(USUAL, treatment, 0)[1].mass_kg
        for treatment in (
            Treatment(),
            Treatment(noise=replace(rig.THESIS_NOISE, position_m=2e-4)),
            Treatment(foot_tared=True),
        )
    ]
    assert 22.68 > mass_kg[0] > mass_kg[1] > mass_kg[2]


def test_an_ablation_without_noise_is_drawn_once(laboratory: Laboratory) -> None:
    noise_free = next(ablation for ablation in ABLATIONS if ablation.treatment == NOISE_FREE)
    effect = effect_of(noise_free, laboratory, draws=3)
    assert effect.foot.shape == (1, 10)
    assert effect.facts["rows"] == ROWS
    assert len({ablation.cause for ablation in ABLATIONS}) == len(ABLATIONS)


@pytest.mark.long
def test_tables_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "tables.json"
    app(
        ["platform", "tables", "--draws", "2", "--seconds", "4", "--seed", "3", "--json", str(path)],
        standalone_mode=False,
    )
    printed = capsys.readouterr().out
    assert "Table 1, plate" in printed
    assert "Table 2, foot" in printed
    assert "-3.58 ± 0.50" in printed
    facts = json.loads(path.read_bytes())
    assert np.shape(facts["foot"]["noisy_errors"]) == (2, 10)
    assert np.abs(facts["plate"]["noise_free_errors"]).max() < 1.0
