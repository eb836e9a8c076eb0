"""Something is hidden in recordings of the platform, from seeds that nobody knew before: the finder must tell what.

A fresh process gets the files and nothing else. With 120 and more cases `gaiteyes explain court` does the same.
"""

import secrets
from pathlib import Path

from lab.hidden import platform as hidden
from lab.hidden.case import Case, Kind
from tests.bench.trials import prevails


def test_what_is_hidden_is_named_what_is_not_is_not_and_what_nobody_knows_is_unknown(tmp_path: Path) -> None:
    assert prevails("platform", hidden, tmp_path)


def test_two_effects_at_once_are_both_named(tmp_path: Path) -> None:
    assert prevails("platform", hidden, tmp_path, (Kind.PAIR,))


def test_a_case_follows_from_its_seed_alone_and_its_files_tell_nothing_of_it(tmp_path: Path) -> None:
    case = Case("platform", 1000 + secrets.randbelow(2**40), Kind.SINGLE, ("force_gain",))
    print(case)
    first, second = (hidden.write(case, tmp_path / k / "fit", tmp_path / k / "held") for k in ("a", "b"))
    assert first == second
    for place in ("fit", "held"):
        files = sorted((tmp_path / "a" / place).iterdir())
        assert [file.name for file in files] == ["force_plate.csv", "motion.csv", "platform.toml"]
        for file in files:
            assert file.read_bytes() == (tmp_path / "b" / place / file.name).read_bytes()
        assert b"truth" not in (tmp_path / "a" / place / "platform.toml").read_bytes()
