"""Where real measurements are: beside the repository, never copied into it."""

import os
from pathlib import Path

from messages.errors import UserError

_BESIDE = Path(__file__).resolve().parents[3].parent / "shared" / "data"


def data_folder(name: str) -> Path:
    """Return the folder of a data set, in $GAITEYES_DATA or beside the repository; raises UserError without it."""
    folder = Path(os.environ.get("GAITEYES_DATA", _BESIDE)) / name
    if not folder.is_dir():
        raise UserError(f"real data set '{name}' not found under {folder.parent} (set GAITEYES_DATA)")
    return folder
