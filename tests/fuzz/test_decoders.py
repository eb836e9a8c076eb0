"""No decoder falls over damaged input: a short run of what `make fuzz` does at length."""

from pathlib import Path

import pytest

from messages.errors import UserError
from tests.fuzz.campaign import run
from tests.fuzz.decoders import DECODERS, Decoder

SEED, INPUTS, C3D_INPUTS = 7, 12, 1


@pytest.mark.parametrize("decoder", DECODERS, ids=lambda decoder: decoder.name)
def test_damaged_input_is_taken_or_refused_in_one_line(decoder: Decoder) -> None:
    if decoder.name == "C3D":
        pytest.importorskip("ezc3d")
    tally = run(decoder, C3D_INPUTS if decoder.name == "C3D" else INPUTS, SEED)
    assert not tally.faults
    assert tally.inputs >= C3D_INPUTS


@pytest.mark.parametrize("decoder", DECODERS, ids=lambda decoder: decoder.name)
def test_what_is_sound_is_taken(decoder: Decoder, tmp_path: Path) -> None:
    if decoder.name.startswith("C3D"):
        pytest.importorskip("ezc3d")
    for sample in decoder.samples():
        assert decoder.decode(sample, tmp_path)


def _falls_over(data: bytes, _folder: Path) -> bool:
    if len(data) > 2:
        raise KeyError("x")
    return True


def _says_two_lines(_data: bytes, _folder: Path) -> bool:
    refusal = UserError("one")
    refusal.args = ("one\ntwo",)
    raise refusal


@pytest.mark.parametrize("decode", [_falls_over, _says_two_lines])
def test_a_fault_is_found(decode: object) -> None:
    assert run(Decoder("made up", lambda: (b"abc",), decode), 50, SEED).faults  # type: ignore[arg-type]
