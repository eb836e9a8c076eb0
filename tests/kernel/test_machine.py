"""The machine itself."""

import os
from pathlib import Path


def test_this_is_debians_kernel_under_systemd() -> None:
    assert os.uname().release.endswith("-amd64")
    assert Path("/proc/1/comm").read_text().strip() == "systemd"
