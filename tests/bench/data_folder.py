"""A test that needs real measurements skips without them."""

from pathlib import Path

import pytest

from lab.evaluation.measured.data_folder import data_folder
from messages.errors import UserError


def shared_data(name: str) -> Path:
    """Return the folder of one real data set, or skip the calling test with one line where it is absent."""
    try:
        return data_folder(name)
    except UserError as absent:
        pytest.skip(str(absent))
