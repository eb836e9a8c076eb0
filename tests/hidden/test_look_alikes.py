"""What a recording cannot tell apart is declared, with the experiment that could, and not guessed."""

import random
import tempfile
from pathlib import Path

import pytest

from lab.hidden import imu
from lab.hidden.case import Case, Kind
from tests.bench.hidden_cases import (
    LOOK_ALIKE_CASES,
    LOOK_ALIKE_RATE,
    ExplainError,
    Judged,
    described,
    drawn_seed,
    explained,
    fewest_right,
)
from tests.hidden.conftest import Judge

pytestmark = pytest.mark.hidden

PLAIN_RADPS2 = 3e-4
"""A drift of the bias that no recording of a minute hides."""


def judged_without_temperature(case: Case) -> Judged:
    """Judge a drift of the gyroscope's bias whose recordings have no temperature log."""
    source = random.Random(case.seed)
    with tempfile.TemporaryDirectory(prefix="gaiteyes-hidden-") as name:
        folder = Path(name)
        while imu.write(case, folder / "fit", folder / "held_out").causes[0].size < PLAIN_RADPS2:
            case = Case("imu", drawn_seed(source), Kind.SINGLE, case.effects)
        for place in ("fit", "held_out"):
            file = folder / place / "imu.csv"
            rows = [line.rsplit(",", 1)[0] for line in file.read_text(encoding="utf-8").splitlines()]
            file.write_text("\n".join(rows) + "\n", encoding="utf-8")
        try:
            verdict = explained("imu", folder)
        except ExplainError as error:
            return Judged(case, False, f"FAILED: {described(case)}", str(error))
    names = {name for cause in verdict.causes[:1] for name in (cause.name, *cause.equivalents)}
    experiment = verdict.next_experiment or ""
    right = names >= {"gyro_bias_drift", "temperature"} and "temperature" in experiment
    return Judged(
        case,
        right,
        f"{'right' if right else 'WRONG'}: {described(case)}: {' or '.join(sorted(names))}; next: {experiment}",
    )


def test_a_drift_without_a_temperature_log_may_be_either(hidden_seed: int, judge_all: Judge) -> None:
    source = random.Random(f"look-alikes {hidden_seed}")
    cases = [Case("imu", drawn_seed(source), Kind.SINGLE, ("gyro_bias_drift",)) for _ in range(LOOK_ALIKE_CASES)]
    judged = judge_all(judged_without_temperature, cases)
    assert [each.failure for each in judged if each.failure] == []
    assert sum(each.right for each in judged) >= fewest_right({LOOK_ALIKE_RATE: LOOK_ALIKE_CASES})
