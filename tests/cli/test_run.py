"""`gaiteyes run` by hand, where something is missing: one line that names the next step."""

from pathlib import Path

import pytest

from calib.files import save_calibration
from cli.main import app
from messages import UserError
from sim_rig.unit import draw_unit


def test_what_is_missing_is_told_with_the_next_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    with pytest.raises(UserError, match=r"^gaiteyes\.toml: No such file or directory; `gaiteyes init` finds the"):
        app(["run"], standalone_mode=False)
    Path("gaiteyes.toml").write_text("[imu]\nbus = 254\n", encoding="utf-8")
    with pytest.raises(UserError, match=r"^calibration\.yaml: No such file or directory; `gaiteyes init` makes"):
        app(["run"], standalone_mode=False)
    save_calibration(Path("calibration.yaml"), draw_unit(1).exact_calibration())
    with pytest.raises(UserError, match=r"254.*; `gaiteyes check` looks at each device and says what to do$"):
        app(["run"], standalone_mode=False)
