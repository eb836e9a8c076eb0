"""The files of a case follow from its seed alone and tell nothing of it."""

import random
from pathlib import Path

import pytest

from lab.hidden import platform
from lab.hidden.case import Case, Kind
from tests.bench.hidden_cases import drawn_seed

pytestmark = pytest.mark.hidden


def test_a_case_follows_from_its_seed_alone_and_its_files_tell_nothing_of_it(tmp_path: Path, hidden_seed: int) -> None:
    case = Case("platform", drawn_seed(random.Random(f"files {hidden_seed}")), Kind.SINGLE, ("force_gain",))
    first, second = (platform.write(case, tmp_path / k / "fit", tmp_path / k / "held") for k in ("a", "b"))
    assert first == second
    for place in ("fit", "held"):
        files = sorted((tmp_path / "a" / place).iterdir())
        assert [file.name for file in files] == ["force_plate.csv", "motion.csv", "platform.toml"]
        for file in files:
            assert file.read_bytes() == (tmp_path / "b" / place / file.name).read_bytes()
        assert b"truth" not in (tmp_path / "a" / place / "platform.toml").read_bytes()
