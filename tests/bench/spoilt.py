"""A file in which one thing is spoilt."""

from collections.abc import Callable
from pathlib import Path

import pytest

from messages.errors import UserError


def check_refused(read: Callable[[Path], object], path: Path, text: str, found: str, written: str, told: str) -> None:
    """Check that `read` refuses a file of this `text`, `written` in place of what is `found`, in one line with its name
    and what is `told` (a regular expression).
    """
    assert found in text
    path.write_text(text.replace(found, written, 1), encoding="utf-8")
    with pytest.raises(UserError, match=told) as refused:
        read(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)
