"""Real measurements live beside the repository and are never copied into it; a test that needs them skips without."""

import os
from pathlib import Path

import pytest


def shared_data(name: str) -> Path:
    """Return the folder of one real data set, or skip the calling test with one line where it is absent."""
    beside = Path(__file__).resolve().parents[2].parent / "shared" / "data"
    folder = Path(os.environ.get("GAITEYES_DATA", beside)) / name
    if not folder.is_dir():
        pytest.skip(f"real data set '{name}' not found under {folder.parent} (set GAITEYES_DATA)")
    return folder
