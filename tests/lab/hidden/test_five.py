"""The five systems: a case follows from its seed alone, its files do not tell what is hidden, and all acts."""

from pathlib import Path

import numpy as np
import pytest

from lab.hidden.case import Case, Kind
from lab.hidden.five.acting import Hidden
from lab.hidden.five.cases import FIVE, RECORDING
from lab.hidden.five.hidden import NAMED, mechanisms
from lab.hidden.five.systems import SYSTEMS, drawn
from messages.arrays import FloatArray

SEED = 4


def _files(tmp_path: Path, case: Case, name: str) -> tuple[str, str]:
    folders = tmp_path / name / "fit", tmp_path / name / "held_out"
    FIVE[case.system].write(case, *folders)
    first, second = ((folder / RECORDING).read_text() for folder in folders)
    return first, second


def test_a_case_follows_from_its_seed_and_its_files_name_nothing(tmp_path: Path) -> None:
    case = Case("motor", SEED, Kind.SINGLE, ("quadratic_drag_at_shaft",))
    first, again = _files(tmp_path, case, "a"), _files(tmp_path, case, "b")
    assert first == again
    assert first[0] != first[1]
    assert set(first[0].splitlines()[0].split(",")) <= {"t_s", "torque_nm", "speed_radps", "noise_speed_radps"}
    clean = _files(tmp_path, Case("motor", SEED, Kind.CLEAN, ()), "c")
    torque = [np.genfromtxt(text.splitlines(), delimiter=",", names=True)["torque_nm"] for text in (first[0], clean[0])]
    assert np.array_equal(torque[0], torque[1])
    assert first != clean


@pytest.mark.parametrize("system", sorted(SYSTEMS))
def test_what_is_hidden_leaves_something_that_the_constants_cannot_take_over(system: str) -> None:
    rng = np.random.default_rng(SEED)
    seconds = 0.25 * SYSTEMS[system].seconds
    for name, mechanism in mechanisms(system).items():
        hidden = mechanism.makes(mechanism.draws(rng, mechanism.sizes.high))
        streams = np.random.default_rng(SEED), np.random.default_rng(SEED + 1)
        assert drawn(system, hidden, *streams, seconds=seconds).beyond > 0.0 or "sat" in name or "stop" in name, name


def test_nothing_hidden_leaves_nothing_and_noise_is_what_it_says() -> None:
    one, other = (
        drawn("heater", Hidden(), np.random.default_rng(SEED), np.random.default_rng(noise)) for noise in (1, 2)
    )
    assert one.beyond == 0.0
    apart = (one.readings - other.readings).std() / np.sqrt(2.0)
    assert apart == pytest.approx(one.noise[0], rel=0.1)
    assert one.noise_share == pytest.approx(2e-3, rel=0.01)


def test_a_delayed_input_is_the_held_one_later() -> None:
    late = NAMED["motor"]["delay_of_torque_nm"].makes({"value": 0.03})
    t_s: FloatArray = np.linspace(0.0, 3.98, 200)
    driven = late.driven(lambda t: np.asarray(np.sin(t)), t_s, 10).ravel()
    held = np.repeat(np.sin(t_s), 10)
    assert driven[15:] == pytest.approx(held[:-15], abs=1e-12)
