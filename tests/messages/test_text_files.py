"""Small text files: whatever a file holds, what is said of it is one short line."""

from pathlib import Path

import pytest

from daemon.config import parse_configuration
from messages.errors import LONGEST_LINE, UserError
from messages.text_files import LARGEST_TEXT_BYTES, check_sizes, parse_toml, read_text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a = " + "[" * 500 + "]" * 500, "nested too deeply"),
        ("a." * 1200 + "b = 1", "nested too deeply"),
        ("a = " + "9" * 5000, "not TOML: Exceeds the limit (4300 digits)"),
        ("a = {b = [0, 0x" + "f" * 5000 + "]}", "a.b[1] is a whole number of 20000 bits, allowed 64"),
        ("a = 1\na = 2", "not TOML: Cannot overwrite a value"),
    ],
)
def test_toml_that_cannot_be_read_is_one_line(text: str, said: str) -> None:
    with pytest.raises(UserError) as refused:
        parse_toml(text, "x.toml")
    assert str(refused.value).startswith(f"x.toml: {said}") or said in str(refused.value)


def test_a_deeply_nested_configuration_refuses_a_reload() -> None:
    with pytest.raises(UserError, match=r"^gaiteyes\.toml: not TOML: nested too deeply$"):
        parse_configuration("camera = " + "[" * 500 + "]" * 500, "gaiteyes.toml")


@pytest.mark.parametrize("quoted", ["x" * 5000, "\0" * 300, "\N{LINE SEPARATOR}" * 5000])
def test_an_error_is_one_short_printable_line_that_keeps_both_ends(quoted: str) -> None:
    line = str(UserError(f"unit.yaml: a\nb\x1b[31m x{quoted}x, allowed 1 to 2"))
    assert line.isprintable()
    assert len(line) <= LONGEST_LINE
    assert line.startswith(r"unit.yaml: a\nb\x1b[31m x")
    assert line.endswith("x, allowed 1 to 2")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -2e6, 10**7])
def test_numbers_beyond_a_size_are_named(value: float) -> None:
    check_sizes({"a": [1.0, {"b": -1e6}], "c": "text"}, 1e6, "x")
    with pytest.raises(UserError, match=r"^x: a\[1\]\.b is .*, allowed up to ±1e\+06$"):
        check_sizes({"a": [1.0, {"b": value}]}, 1e6, "x")


def test_a_file_without_end_is_refused() -> None:
    with pytest.raises(UserError, match=rf"^/dev/zero: is larger than {LARGEST_TEXT_BYTES >> 20} MB"):
        read_text(Path("/dev/zero"))
