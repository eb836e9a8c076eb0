"""A hidden case: its seed alone decides, streams do not disturb each other, and its truth survives a file."""

from pathlib import Path

import numpy as np
import pytest

from lab.hidden.case import Case, Kind, Sizes, TrueCause, Truth
from messages.errors import UserError

CASE = Case("platform", 5, Kind.SINGLE, ("force_delay",))


def test_a_stream_is_its_seed_s_and_its_purpose_s_alone() -> None:
    first = CASE.stream("noise").standard_normal(4)
    CASE.stream("motion").standard_normal(100)
    assert np.array_equal(first, Case("imu", 5, Kind.CLEAN, ()).stream("noise").standard_normal(4))
    others = (CASE.stream("motion"), Case("platform", 6, Kind.SINGLE, ("force_delay",)).stream("noise"))
    assert all(not np.isclose(first, other.standard_normal(4)).any() for other in others)


@pytest.mark.parametrize(
    ("kind", "effects"), [(Kind.CLEAN, ("a",)), (Kind.SINGLE, ()), (Kind.PAIR, ("a",)), (Kind.OUTSIDE, ("a", "b"))]
)
def test_a_case_hides_as_many_effects_as_its_kind_says(kind: Kind, effects: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="hides"):
        Case("platform", 1, kind, effects)


def test_sizes_are_log_uniform_in_their_range() -> None:
    random = np.random.default_rng(1)
    sizes = np.array([Sizes(0.1, 10.0, "ms").drawn(random) for _ in range(2000)])
    assert sizes.min() >= 0.1
    assert sizes.max() <= 10.0
    assert np.mean(sizes < 1.0) == pytest.approx(0.5, abs=0.04)
    with pytest.raises(ValueError, match="low < high"):
        Sizes(0.0, 1.0, "ms")


def test_the_truth_survives_its_file_and_a_spoilt_one_is_one_line(tmp_path: Path) -> None:
    cause = TrueCause("force_delay", {"value_s": 0.002}, 0.002, "s")
    truth = Truth("platform", 5, Kind.SINGLE, (cause,), {"foot_kg": 20.0, "declared": True, "colour": "white"}, 3.5)
    truth.save(tmp_path / "truth.json")
    assert Truth.load(tmp_path / "truth.json") == truth
    assert truth.case_name == "platform-single-force_delay-5"
    (tmp_path / "truth.json").write_text('{"system": "platform", "seed": "five"}', encoding="utf-8")
    with pytest.raises(UserError, match=r"truth\.json.*seed"):
        Truth.load(tmp_path / "truth.json")
