"""A person's own simulation against real data: an empty belt on a force plate, and the cause that is known."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.bench.data_folder import shared_data

HOME = Path(__file__).parents[2]
PUBLISHED_R2 = {"Slow": 0.7208, "Fast": 0.9675}


@pytest.mark.long
@pytest.mark.parametrize("trial", ["Slow", "Fast"])
def test_the_belt_s_acceleration_is_named_and_beats_the_filter(trial: str, tmp_path: Path) -> None:
    data = shared_data("treadmill_belt_acceleration") / f"Random{trial}Speed1.txt.gz"
    command = [sys.executable, str(HOME / "examples" / "treadmill.py"), str(data)]
    environment = os.environ | {"PYTHONPATH": str(HOME)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    r2 = {name: float(value) for name, value in re.findall(r"R² (.+) (-?\d\.\d+)$", done.stdout, re.MULTILINE)}
    causes = list(dict.fromkeys(re.findall(r"^  (\w+)\.", done.stdout, re.MULTILINE)))
    assert lines[0].startswith("The simulation is missing: belt acceleration")
    assert causes == ["belt_acceleration", "roller_imbalance"]
    inertia, low, high = re.search(r"inertia_kgm: (\S+) \| (\S+) to (\S+) \| kg·m", done.stdout).groups()  # type: ignore[union-attr]
    assert 2.7 < float(low) < float(inertia) < float(high) < 3.0
    assert r2["all named causes"] > r2["31-tap filter"] + 0.002
    assert r2["all named causes"] > PUBLISHED_R2[trial]
    assert max(r2["belt_speed"], r2["offset"]) < 0.01
    assert r2["roller_imbalance"] < 0.1 < 0.7 < r2["belt_acceleration"]
