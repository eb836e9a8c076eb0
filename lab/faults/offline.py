"""Trials faster than real time: the whole pipeline on a walk of the rig whose messages a fault changes.

A walk is rendered once, and what the pipeline has become when the fault begins is copied for each trial.
"""

import heapq
import itertools
import json
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from lab.faults.criteria import WRONG_TILT_RAD, errors_of, flags, is_wrong_attitude, tilt_error_rad
from lab.faults.faulty_camera import ImageChange
from messages import Attitude, Frame, GroundPlane, GroundTruth, ImuSample, Status, StereoFrame, Tick
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer

START_NS = 10_000_000_000
SETTLED_NS = 2_000_000_000
FOR_EVER_NS = 2**62
WALKS = ("level", "ramps", "mixed")
"""What seeds walk on by turns."""

Message = ImuSample | Tick | Frame
MessageFault = Callable[[Message, float], Sequence[Message]]
"""From a message and the seconds since the fault began to what arrives in its place: nothing, it or others."""
TrialT = TypeVar("TrialT", bound="Judged")
_T = TypeVar("_T")


class Judged(msgspec.Struct, kw_only=True):
    """Frames from the beginning of a fault on: how many were valid, how many of those wrong; and valid attitudes.

    `noticed_s` is when the first flag came, None if none did; `worst_deg` the largest slope error of a valid frame away
    from edges, beside its stated deviation; `seen` counts the reasons of frames that are not valid. `worst_tilt_deg` is
    the largest error of a valid attitude.
    """

    frames: int = 0
    valid: int = 0
    wrong: int = 0
    noticed_s: float | None = None
    worst_deg: float = 0.0
    stated_deg: float = 0.0
    seen: dict[str, int] = msgspec.field(default_factory=dict)
    attitudes: int = 0
    wrong_attitudes: int = 0
    worst_tilt_deg: float = 0.0

    def add_attitude(self, attitude: Attitude, wearer: SimulatedWearer) -> None:
        """Judge one sample's attitude."""
        if attitude.status is not Status.VALID:
            return
        R_WB = wearer.gait.at(np.array([attitude.t_sample_ns], dtype=np.int64)).R_WB[0]
        tilt_rad = tilt_error_rad(attitude, R_WB)
        self.attitudes += 1
        self.worst_tilt_deg = max(self.worst_tilt_deg, float(np.degrees(tilt_rad)))
        self.wrong_attitudes += tilt_rad > WRONG_TILT_RAD and is_wrong_attitude(attitude, R_WB)

    def add(self, ground: GroundPlane, truth: GroundTruth, since_s: float) -> bool:
        """Judge one frame's ground, `since_s` after the fault began; return whether it is valid and right."""
        self.frames += 1
        right = False
        if ground.status is Status.VALID:
            errors = errors_of(ground, truth)
            right = not errors.wrong
            self.valid += 1
            self.wrong += errors.wrong
            if not truth.transition and np.degrees(errors.slope_rad) > self.worst_deg:
                self.worst_deg = float(np.degrees(errors.slope_rad))
                self.stated_deg = float(np.degrees(np.sqrt(max(ground.covariance[0], ground.covariance[3]))))
        else:
            self.seen[ground.reason.value] = self.seen.get(ground.reason.value, 0) + 1
        if flags(ground, truth) and self.noticed_s is None:
            self.noticed_s = since_s
        return right


class OfflineWalk:
    """The first `seconds` of a unit's walk: who walks, and all that the pipeline is given, in order of arrival."""

    def __init__(self, seed: int, name: str, seconds: float) -> None:
        self.wearer = SimulatedWearer(seed, scenario(name), START_NS)
        self.inputs: list[Message] = list(self.wearer.offline_inputs(seconds))

    def new_pipeline(self) -> Pipeline:
        """Return a pipeline that knows of the unit what its calibration says."""
        return Pipeline(self.wearer.calibration, FootholdSettings())


@dataclass(frozen=True)
class Strike:
    """A fault that changes the messages whose own time, `t_ns`, is in [from_ns, until_ns)."""

    fault: MessageFault
    from_ns: int
    until_ns: int

    def changed(self, message: Message) -> Sequence[Message]:
        """Return what arrives in place of `message`."""
        t_ns = own_time_ns(message)
        if isinstance(message, Tick) or not self.from_ns <= t_ns < self.until_ns:
            return (message,)
        return self.fault(message, 1e-9 * (t_ns - self.from_ns))


def own_time_ns(message: Message) -> int:
    """Return the instant that a message stands for."""
    if isinstance(message, Tick):
        return message.t_ns
    return message.t_sample_ns if isinstance(message, ImuSample) else message.header.t_exposure_ns


def arrival_ns(message: Message) -> int:
    """Return when a message arrives."""
    if isinstance(message, Tick):
        return message.t_ns
    return message.t_arrival_ns if isinstance(message, ImuSample) else message.header.t_arrival_ns


def struck(inputs: Iterable[Message], strikes: Sequence[Strike]) -> Iterator[Message]:
    """Yield `inputs` as they arrive when faults strike, one after the other: what comes late comes after the others."""
    waiting: list[tuple[int, int, Message]] = []
    order = itertools.count()
    for message in inputs:
        changed: Sequence[Message] = (message,)
        for strike in strikes:
            changed = [after for before in changed for after in strike.changed(before)]
        for each in changed:
            heapq.heappush(waiting, (max(arrival_ns(each), arrival_ns(message)), next(order), each))
        while waiting and waiting[0][0] <= arrival_ns(message):
            yield heapq.heappop(waiting)[2]


def pictures(change: ImageChange) -> MessageFault:
    """Return the fault that changes the pictures of each stereo frame."""

    def fault(message: Message, _since_s: float) -> Sequence[Message]:
        if not isinstance(message, StereoFrame):
            return (message,)
        left, right = change((message.left, message.right))
        return (msgspec.structs.replace(message, left=left, right=right),)

    return fault


def in_a_copy(work: Callable[[], _T]) -> _T:
    """Return what `work` returns in a forked copy of this process: whatever it changes stays as it is here.

    Raises RuntimeError where the copy ends without an answer.
    """
    forking = multiprocessing.get_context("fork")
    answer, told = forking.Pipe(duplex=False)
    process = forking.Process(target=lambda: told.send(work()))
    process.start()
    told.close()
    try:
        found: _T = answer.recv()
    except EOFError as end:
        raise RuntimeError("a trial ended without a result") from end
    finally:
        process.join()
        answer.close()
    return found


def known_trials(file: Path | None, of: type[TrialT]) -> list[TrialT]:
    """Return the trials that `file` holds, one line of JSON each."""
    lines = file.read_text().splitlines() if file is not None and file.exists() else []
    return [msgspec.json.decode(line, type=of) for line in lines]


def keep_trial(file: Path | None, trial: Judged) -> None:
    """Add a finished trial to `file`."""
    if file is not None:
        with file.open("a") as lines:
            lines.write(json.dumps(msgspec.to_builtins(trial)) + "\n")
