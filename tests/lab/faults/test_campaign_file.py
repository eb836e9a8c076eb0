"""A campaign goes on from its file, wherever it was ended."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lab.faults.campaign_file import CampaignFile
from messages import UserError
from tests.lab.faults.made_up import attempt

MADE = [attempt("a"), attempt("b", void="busy"), attempt("c", failures=["did not recover"])]


def written(path: Path) -> bytes:
    path.unlink(missing_ok=True)
    file = CampaignFile(path, 1, "ramps")
    for made in MADE:
        file.add(made)
    return path.read_bytes()


def test_what_was_kept_is_there_again_and_what_was_void_is_not_done(tmp_path: Path) -> None:
    written(tmp_path / "f")
    again = CampaignFile(tmp_path / "f", 1, "ramps")
    assert again.attempts == MADE
    assert again.done == {"a", "c"}


@given(cut=st.integers(0, 4000))
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_file_cut_anywhere_keeps_its_whole_lines_and_goes_on(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "f"
    whole = written(path)
    path.write_bytes(whole[:cut])
    file = CampaignFile(path, 1, "ramps")
    kept = max(0, whole[:cut].count(b"\n") - 1)
    assert file.attempts == MADE[:kept]
    for made in MADE[kept:]:
        file.add(made)
    assert path.read_bytes() == whole


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b'{"seed":2,"scenario":"ramps"}\n', "it is of seed 2, scenario ramps; this is seed 1"),
        (b"seconds,frames\n", "line 1 is not of a campaign"),
        (b'{"seed":1,"scenario":"ramps"}\n{"trial":3}\n', "line 2 is not of a campaign"),
        (b'{"seed":1,"scenario":"ramps"}\n\xff\n', "line 2 is not of a campaign"),
    ],
)
def test_another_file_is_refused_in_one_line_and_left_as_it_is(tmp_path: Path, text: bytes, said: str) -> None:
    path = tmp_path / "f"
    path.write_bytes(text)
    with pytest.raises(UserError, match="--file") as refusal:
        CampaignFile(path, 1, "ramps")
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert path.read_bytes() == text


def test_a_file_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="No such file"):
        CampaignFile(tmp_path / "nowhere" / "f", 1, "ramps")
