"""Hidden effects of the wearable: drawn where the finder cannot see them, found by a fresh process in files alone.

A case is two recordings of pictures to render and to match, some 20 s: so all is drawn from, and little often.
"""

from pathlib import Path

from lab.hidden import wearable as hidden
from tests.bench.trials import prevails


def test_what_is_hidden_is_named_what_is_not_is_not_and_what_nobody_knows_is_unknown(tmp_path: Path) -> None:
    assert prevails("wearable", hidden, tmp_path)
