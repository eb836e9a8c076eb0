"""A calibration file is used only as it was sealed, whatever has changed in it."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.files import format_calibration, load_calibration, parse_calibration, save_calibration, seal_file
from calib.seal import check_seal, sealed
from messages import UserError
from sim_rig.unit import draw_unit

CALIBRATION = draw_unit(4).exact_calibration()
TEXT = sealed(format_calibration(CALIBRATION))


@given(st.integers(0, len(TEXT) - 1), st.characters(codec="utf-8"), st.sampled_from(["replace", "insert", "delete"]))
def test_any_change_of_a_character_is_noticed(place: int, character: str, how: str) -> None:
    """But for the line ends, which reading a file makes equal."""
    kept = TEXT[place if how == "insert" else place + 1 :]
    changed = TEXT[:place] + ("" if how == "delete" else character) + kept
    if changed == TEXT:
        check_seal(changed, "unit.yaml")
        return
    with pytest.raises(UserError, match=r"^unit\.yaml: .*run: gaiteyes calibrate seal unit\.yaml$"):
        check_seal(changed, "unit.yaml")


@given(st.text(st.characters(codec="utf-8", exclude_characters="\r")))
def test_a_sealed_text_passes_and_is_sealed_once(text: str) -> None:
    check_seal(sealed(text), "memory")
    assert sealed(sealed(text)) == sealed(text)


def test_a_changed_digit_is_refused_until_it_is_sealed(tmp_path: Path) -> None:
    path = tmp_path / "unit.yaml"
    save_calibration(path, CALIBRATION)
    assert load_calibration(path) == CALIBRATION
    edited = path.read_text().replace("scale: 0.0", "scale: 0.001") + "# baseline measured anew\n"
    path.write_text(edited)
    with pytest.raises(UserError, match=r"unit\.yaml: does not match its seal: it was changed or damaged since; "):
        load_calibration(path)
    assert seal_file(path) == load_calibration(path) != CALIBRATION
    assert "# baseline measured anew\n" in path.read_text()


def test_a_file_older_than_seals_is_refused_and_a_recordings_text_is_not(tmp_path: Path) -> None:
    path = tmp_path / "old file.yaml"
    path.write_text(format_calibration(CALIBRATION))
    with pytest.raises(UserError, match=r"has no seal: .*, run: gaiteyes calibrate seal '.*'$"):
        load_calibration(path)
    assert parse_calibration(path.read_text(), "recording") == CALIBRATION


def test_what_would_be_refused_is_not_sealed(tmp_path: Path) -> None:
    path = tmp_path / "unit.yaml"
    path.write_text(format_calibration(CALIBRATION).replace("fx_px: ", "fx_px: 9", 1))
    before = path.read_text()
    with pytest.raises(UserError, match=r"stereo\.left\.fx_px is 9"):
        seal_file(path)
    assert path.read_text() == before


def test_other_line_ends_are_no_change(tmp_path: Path) -> None:
    path = tmp_path / "unit.yaml"
    path.write_bytes(TEXT.replace("\n", "\r\n").encode())
    assert load_calibration(path) == CALIBRATION
