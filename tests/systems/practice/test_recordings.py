"""Practice recordings: made from their seed, with the effect that was asked for and no other."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cli.main import app
from messages.errors import UserError
from systems.own.table import Table
from systems.practice.recordings import FIT, HELD_OUT, SYSTEMS, effects_of, make, simulated


@pytest.mark.parametrize("system", sorted(SYSTEMS))
def test_every_system_is_there_with_its_file_and_fits_itself(tmp_path: Path, system: str) -> None:
    assert make(system, {}, tmp_path, 3) == {}
    assert (tmp_path / f"{system}.py").read_text().startswith('"""')
    made = SYSTEMS[system]
    for name in (FIT, HELD_OUT):
        found = made.simulation(Table.load(tmp_path / name))
        left = found.channels.values - found.with_terms(()).predicted(made.truth)
        stated = np.array([made.noise[channel] for channel in found.channels.names])
        assert np.allclose(left.std(axis=0), stated, rtol=0.1)
    assert len(effects_of(system)) > 25


def test_recordings_depend_on_the_seed_alone(tmp_path: Path) -> None:
    make("tanks", {"overflow_at_upper": 0.5}, tmp_path / "a", 1)
    make("tanks", {"overflow_at_upper": 0.5}, tmp_path / "b", 1)
    make("tanks", {"overflow_at_upper": 0.5}, tmp_path / "c", 2)
    one, again, other = ((tmp_path / name / FIT).read_bytes() for name in "abc")
    assert one == again != other


def test_an_effect_is_in_the_recording() -> None:
    plain, _ = simulated("pendulum", {}, 1)
    with_it, _ = simulated("pendulum", {"coulomb_friction_at_joint": 0.05}, 1)
    assert np.ptp(plain.channels.values - with_it.channels.values) > 0.1


@pytest.mark.parametrize(
    ("system", "effect", "line"),
    [
        ("pendulm", {}, "system pendulm is unknown; the nearest known is pendulum"),
        ("pendulum", {"coulomb_at_joint": 1.0}, "effect coulomb_at_joint is unknown"),
        ("pendulum", {"cogging_at_joint.sin": 1.0}, "parameter sin is unknown; the nearest known is sine"),
        ("pendulum", {"coulomb_friction_at_joint": -1.0}, "coulomb_friction_at_joint=-1: allowed 0 to"),
    ],
)
def test_what_cannot_be_made_is_told(tmp_path: Path, system: str, effect: dict[str, float], line: str) -> None:
    with pytest.raises(UserError, match=line):
        make(system, effect, tmp_path, 1)


@pytest.mark.long
def test_from_practice_to_a_verdict_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "own"
    words = ["--effect", "coulomb_friction_at_joint=0.02", "--out", str(folder)]
    done = CliRunner().invoke(app, ["explain", "practice", "pendulum", *words])
    assert done.exit_code == 0, done.output
    monkeypatch.chdir(folder)
    command = [
        "explain",
        "own",
        "pendulum:simulation",
        FIT,
        "--held-out",
        HELD_OUT,
        "--out",
        "explained",
        "--no-report",
    ]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    assert "The simulation is missing: coulomb friction at joint" in done.output
    assert (folder / "explained" / "extended.toml").is_file()
