"""Faults of IMU and camera, alone and in pairs, lasting or ending: is any ground, or attitude, wrong and yet valid?

    python -m benchmarks.fault_trials [--cases black black+gyro-step-5 pair-0 …] [--seeds 1000-1009] [--seconds 10]
        [--file F]

The whole pipeline, faster than real time, on units of the rig with the calibration that they would have. Each seed
walks on level ground, on ramps or over mixed ground, and all its cases see the same walk; faults change its messages
(`lab.faults.message_faults`). They begin after 3.5 to 4 s; half of them, as the seed draws, end after 1.5 to 4 s,
those of the camera alone after 0.3 to 4 s. `A+B` are two at once; `pair-N` draws a fault of the IMU and one that leaves
the camera out of order, the second up to 1.5 s after the first. Wrong is what `lab.faults.criteria` calls so. A frame
is answerable, away from an edge of the ground, while all that strikes is said to leave it so, and from 2 s after the
last other fault on. One line of JSON is added to F for each finished trial; those there are not repeated. Seeds below
1000 are for tuning, from 1000 on for judging. The bound is that of Clopper and Pearson, at 95 %, on the share of trials
with any wrong and valid ground; cases that nothing could show are counted apart.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import cv2
import msgspec
import numpy as np
from scipy.stats import beta

from daemon.pipeline import Pipeline
from lab.faults.message_faults import CAMERA_KINDS, IMU_KINDS, KINDS, OUT_OF_ORDER
from lab.faults.offline import (
    FOR_EVER_NS,
    START_NS,
    WALKS,
    Judged,
    Message,
    OfflineWalk,
    Strike,
    in_a_copy,
    keep_trial,
    known_trials,
    own_time_ns,
    struck,
)
from messages import Attitude, GroundPlane

RECOVERY_NS = 2_000_000_000
STEADY_FRAMES = 5
PAIRS = tuple(f"pair-{number}" for number in range(12))
NAMED_PAIRS = (
    *(f"right-late+gyro-step-{dps}" for dps in ("0.8", "2", "5")),
    *(f"black+gyro-step-{dps}" for dps in ("0.8", "2", "5")),
    "frozen+gyro-drift-5",
    "frames-gone+gyro-half",
    "right-late+accel-step-0.1",
)
CASES = ("none", *KINDS, *NAMED_PAIRS, *PAIRS)


class Trial(Judged, kw_only=True):
    """One walk with its faults, counted from the first one's beginning on.

    `faults` are their names, `ended_s` when the last that ended did, after the first began, None where none does.
    `recovered_s` is how long after it the first of STEADY_FRAMES right grounds in a row came. `answerable` counts
    frames, `answered` those of them that were valid and right.
    """

    case: str
    seed: int
    seconds: float
    walk: str
    faults: list[str] = msgspec.field(default_factory=list)
    ended_s: float | None = None
    recovered_s: float | None = None
    answerable: int = 0
    answered: int = 0
    wrong_from_s: float | None = None

    @property
    def undetectable(self) -> bool:
        """Return whether all that strikes, or one of it alone, is what nothing could show."""
        return any(KINDS[name].undetectable for name in self.faults)


def names_of(case: str, chance: np.random.Generator) -> list[str]:
    """Return the names of the faults of a case."""
    if case in PAIRS:
        imu = [name for name, kind in IMU_KINDS.items() if not kind.undetectable]
        return [str(chance.choice(OUT_OF_ORDER)), str(chance.choice(imu))]
    return [] if case == "none" else case.split("+")


def drawn_strikes(trial: Trial, onset_ns: int, walk: OfflineWalk) -> list[Strike]:
    """Draw what strikes from `onset_ns` on."""
    chance = np.random.default_rng([trial.seed, *trial.case.encode()])
    trial.faults = names_of(trial.case, chance)
    stereo, ends = walk.wearer.unit.stereo, bool(chance.integers(2))
    least_s = 0.3 if all(name in CAMERA_KINDS for name in trial.faults) else 1.5
    strikes: list[Strike] = []
    for name in trial.faults:
        from_ns = onset_ns + (round(1e9 * chance.uniform(0.0, 1.5)) if strikes else 0)
        until_ns = from_ns + round(1e9 * chance.uniform(least_s, 4.0)) if ends else FOR_EVER_NS
        strikes.append(Strike(KINDS[name].draw(chance, stereo), from_ns, until_ns))
    if ends and strikes:
        trial.ended_s = 1e-9 * (max(strike.until_ns for strike in strikes) - onset_ns)
    return strikes


class Judge:
    """Judges what the pipeline says in one trial."""

    def __init__(self, trial: Trial, walk: OfflineWalk, onset_ns: int, strikes: Sequence[Strike]) -> None:
        self._trial, self._wearer, self._onset_ns = trial, walk.wearer, onset_ns
        others = [s.until_ns for s, name in zip(strikes, trial.faults, strict=True) if not KINDS[name].answerable]
        self._answerable_from_ns = min(FOR_EVER_NS, max(others, default=onset_ns - RECOVERY_NS) + RECOVERY_NS)
        self._ended_ns = onset_ns if trial.ended_s is None else onset_ns + round(1e9 * trial.ended_s)
        self._steady = list[int]()

    def add_ground(self, ground: GroundPlane) -> None:
        """Judge one frame's ground."""
        t_ns, trial = ground.t_exposure_ns, self._trial
        truth = self._wearer.truth_of(ground)
        since_s = 1e-9 * (t_ns - self._onset_ns)
        wrong_before = trial.wrong
        right = trial.add(ground, truth, since_s)
        if trial.wrong > wrong_before and trial.wrong_from_s is None:
            trial.wrong_from_s = since_s
        if t_ns >= self._answerable_from_ns and not truth.transition:
            trial.answerable += 1
            trial.answered += right
        if t_ns < self._ended_ns or trial.recovered_s is not None:
            return
        self._steady = [*self._steady, t_ns] if right else self._steady if truth.transition else []
        if len(self._steady) == STEADY_FRAMES and trial.ended_s is not None:
            trial.recovered_s = 1e-9 * (self._steady[0] - self._ended_ns)


def tried(trial: Trial, walk: OfflineWalk, pipeline: Pipeline, onset_ns: int, rest: Sequence[Message]) -> Trial:
    """Return what `pipeline`, come as far as `onset_ns`, makes of the `rest` of the walk."""
    strikes = drawn_strikes(trial, onset_ns, walk)
    judge = Judge(trial, walk, onset_ns, strikes)
    for message in struck(rest, strikes):
        for told in pipeline.step(message):
            if isinstance(told, Attitude):
                trial.add_attitude(told, walk.wearer)
            elif isinstance(told, GroundPlane) and told.frame_seq >= 0 and told.t_exposure_ns >= onset_ns:
                judge.add_ground(told)
    return trial


def tried_all(trials: Sequence[Trial], walk: OfflineWalk, file: Path | None) -> list[Trial]:
    """Return what the pipeline makes of all `trials` on one walk, as far as the fault begins done once."""
    seed = trials[0].seed
    onset_ns = START_NS + round(1e9 * np.random.default_rng([seed, 4]).uniform(3.5, 4.0))
    first = next(k for k, message in enumerate(walk.inputs) if own_time_ns(message) >= onset_ns)
    pipeline = walk.new_pipeline()
    for message in walk.inputs[:first]:
        for _ in pipeline.step(message):
            pass
    finished = []
    for trial in trials:
        done = in_a_copy(lambda trial=trial: tried(trial, walk, pipeline, onset_ns, walk.inputs[first:]))  # type: ignore[misc]
        keep_trial(file, done)
        finished.append(done)
    return finished


def upper_bound(wrong: int, of: int, confidence: float = 0.95) -> float:
    """Return the upper end of Clopper and Pearson's two-sided interval of a share, `wrong` of `of`."""
    return 1.0 if wrong >= of else float(beta.ppf(0.5 + 0.5 * confidence, wrong + 1, of - wrong))


def line(name: str, trials: Sequence[Trial]) -> str:
    """Return one line of the table."""
    wrong = [trial for trial in trials if trial.wrong]
    times = [trial.noticed_s for trial in trials if trial.noticed_s is not None]
    back = [trial.recovered_s for trial in trials if trial.recovered_s is not None]
    ended = sum(trial.ended_s is not None for trial in trials)
    answerable = sum(trial.answerable for trial in trials)
    answered = f"{sum(trial.answered for trial in trials) / answerable:8.1%}" if answerable else "       –"
    reasons: Counter[str] = Counter()
    for trial in trials:
        reasons.update(trial.seen)
    return (
        f"{name:26}{len(wrong):4} of {len(trials):<4}{sum(trial.wrong for trial in wrong):7}"
        f"{upper_bound(len(wrong), len(trials)):7.1%}{sum(t.wrong_attitudes > 0 for t in trials):6}"
        f"{sum(t.wrong_attitudes for t in trials):7}{max(t.worst_tilt_deg for t in trials):6.1f}°{answered}"
        f"{len(times):5} {np.median(times or [np.nan]):6.2f}{len(back):4} of {ended:<3}"
        f"{np.median(back or [np.nan]):5.2f} {max(back, default=np.nan):5.2f}  "
        + ", ".join(f"{reason} {count}" for reason, count in reasons.most_common(4))
    )


def table(trials: Sequence[Trial]) -> None:
    """Print one line for each case, and for all that could be shown; then each trial with a wrong and valid ground."""
    print(
        f"{'':26}trials wrong  frames  bound   attitudes wrong  worst  valid of  noticed   recovered   median  most\n"
        f"{'':26}                            trials, samples         answerable  after s"
    )
    for case in dict.fromkeys(trial.case for trial in trials):
        print(line(case, [trial for trial in trials if trial.case == case]))
    faulty = [trial for trial in trials if trial.faults]
    for name, of_sort in (
        ("all that could be shown", [trial for trial in faulty if not trial.undetectable]),
        ("what nothing could show", [trial for trial in faulty if trial.undetectable]),
    ):
        if of_sort:
            print(line(name, of_sort))
    for trial in trials:
        if trial.wrong or trial.wrong_attitudes:
            ends = "lasts" if trial.ended_s is None else f"ends after {trial.ended_s:.1f} s"
            print(
                f"  {' + '.join(trial.faults) or 'none'}, seed {trial.seed} ({trial.case}, {trial.walk}), {ends}: "
                f"{trial.wrong} grounds wrong from {trial.wrong_from_s or np.nan:.2f} s on, worst "
                f"{trial.worst_deg:.1f}° (stated {trial.stated_deg:.1f}°); {trial.wrong_attitudes} attitudes"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=list(CASES), metavar="CASE")
    parser.add_argument("--seeds", default="1000-1009", help="rig units, first-last")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--file", type=Path, help="finished trials, kept and gone on from")
    options = parser.parse_args()
    for case in options.cases:
        if case not in CASES and not all(name in KINDS for name in case.split("+")):
            parser.error(f"--cases {case}: none of {', '.join(CASES)}")
    cv2.setNumThreads(1)
    first, last = map(int, options.seeds.split("-"))
    trials = known_trials(options.file, Trial)
    for seed in range(first, last + 1):
        walk = WALKS[seed % len(WALKS)]
        done = {t.case for t in trials if (t.seed, t.seconds) == (seed, options.seconds)}
        missing = [
            Trial(case=case, seed=seed, seconds=options.seconds, walk=walk)
            for case in options.cases
            if case not in done
        ]
        if missing:
            trials += tried_all(missing, OfflineWalk(seed, walk, options.seconds), options.file)
    trials = [t for t in trials if first <= t.seed <= last and t.case in options.cases and t.seconds == options.seconds]
    trials.sort(key=lambda t: options.cases.index(t.case))
    table(trials)


if __name__ == "__main__":
    main()
