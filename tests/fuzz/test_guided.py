"""Fuzzing that is guided by coverage runs, reaches code, and tells a process that failed."""

from pathlib import Path

import pytest

from tests.fuzz.guided import fuzz


@pytest.mark.long
def test_inputs_reach_branches_of_the_decoder(tmp_path: Path) -> None:
    pytest.importorskip("atheris")
    done = fuzz("state file", tmp_path, 3)
    assert done.exit_code == 0
    assert done.inputs > 0
    assert done.branches > 10
    assert len([*(tmp_path / "state-file" / "corpus").iterdir()]) > 1


@pytest.mark.long
def test_a_process_that_fails_is_told(tmp_path: Path) -> None:
    assert fuzz("none", tmp_path, 1).exit_code != 0
