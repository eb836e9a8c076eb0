"""docs/api.md says what the docstrings say."""

import subprocess
import sys
from pathlib import Path

HOME = Path(__file__).parents[2]


def test_the_page_of_public_names_is_up_to_date() -> None:
    command = [sys.executable, "docs/make_api.py", "--check"]
    done = subprocess.run(command, cwd=HOME, env={"PYTHONPATH": str(HOME)}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
