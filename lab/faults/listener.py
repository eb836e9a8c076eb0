"""What a consumer hears on Zenoh and on CAN, each value held against the truth as it comes."""

import itertools
import json
import time
from collections import Counter, deque
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np
import zenoh

from lab.faults.criteria import STALE_S, Errors, Wrong, errors_of, flags, ground_errors, is_wrong_attitude
from lab.faults.daemon_process import DEVICE
from lab.faults.echo import Echo
from messages import TOPICS, Attitude, GroundPlane, GroundTruth, Health, Reason, Stamp, Status
from messages.can_estimates import ReceivedGround
from messages.can_frames import CanFrame, CanMessage, codes
from messages.can_receiver import CanReceiver
from messages.codec import decode
from sim_rig.wearer import SimulatedWearer

_NOTHING_OFF = Errors(0.0, 0.0, False)
_PROMPT_NS = 25_000_000  # without `take` for so long, half a frame, the listener itself was late; see also `Echo`
_SAME_BY_NOW_NS = 100_000_000  # so long after CAN the same ground has come on Zenoh too, if it does,
_AS_ONE_NS = 25_000_000  # exposed within so much, half a frame: on CAN an exposure is told by the time of arrival
_LAST = 8
_KEPT = 4096  # messages of each kind: three minutes of grounds


class Heard(NamedTuple):
    """One ground as heard on Zenoh. `errors` are those of a valid one; `flag`: it tells that something is wrong."""

    t_ns: int
    ground: GroundPlane
    truth: GroundTruth
    errors: Errors
    valid: bool
    stale: bool
    flag: bool


class HeardAttitude(NamedTuple):
    """One attitude as heard on Zenoh."""

    t_ns: int
    valid: bool
    wrong: bool
    reason: Reason


class HeardOnCan(NamedTuple):
    """One ground that the reference receiver took from CAN."""

    t_ns: int
    errors: Errors


class Listener:
    """Hears one daemon after the other. `take` is called over and over; what it finds is appended to the lists.

    What is heard after the listener itself was held up (no `take` for 25 ms, or its own echo late) says nothing about
    when it was sent: its lateness is not judged, on CAN nothing of it; `held_up` counts those messages of all that were
    `heard`. `wrong` counts all that was ever wrong and marked valid.
    """

    def __init__(self, wearer: SimulatedWearer) -> None:
        self.grounds: deque[Heard] = deque(maxlen=_KEPT)
        self.attitudes: deque[HeardAttitude] = deque(maxlen=_KEPT)
        self.on_can: deque[HeardOnCan] = deque(maxlen=_KEPT)
        self.health: Health | None = None
        self._wearer = wearer
        self._receiver = CanReceiver(ReceivedGround, max_age_s=STALE_S, accept_simulated=True)
        self._seqs: deque[int] = deque(maxlen=_KEPT)
        self._waiting: deque[tuple[int, bool, type[msgspec.Struct], bytes]] = deque()
        self._waiting_on_can: deque[tuple[int, bool, ReceivedGround]] = deque(maxlen=_KEPT)
        self._took_ns = 0
        self.heard = self.held_up = 0
        self.wrong = Wrong()
        self._session: zenoh.Session | None = None
        self._echo: Echo | None = None

    def connect(self, endpoint: str) -> None:
        """Subscribe to the daemon that listens there, one that numbers its messages anew."""
        self.close()
        self.take()  # what is left of the daemon before has the same numbers
        self._seqs.clear()
        settings = {
            "mode": "client",
            "connect": {"endpoints": [endpoint]},
            "scouting": {"multicast": {"enabled": False}},
        }
        self._echo = Echo()
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
        for name in ("ground", "attitude", "health"):
            self._subscribe(self._session, name)

    def close(self) -> None:
        """End the session, if there is one."""
        echo, self._echo = self._echo, None
        if echo is not None:
            echo.close()
        session, self._session = self._session, None
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]  # zenoh's stubs leave it bare

    def hear_can(self, frame: CanFrame) -> None:
        """Take one frame of the bus."""
        now_ns = time.monotonic_ns()
        received = self._receiver.feed(frame.can_id, frame.data, now_ns)
        if isinstance(received, ReceivedGround):
            self._waiting_on_can.append((now_ns, self._is_prompt(now_ns), received))

    def take(self) -> None:
        """Judge what has been heard since the last call."""
        while self._waiting:
            t_ns, prompt, kind, payload = self._waiting.popleft()
            self.heard += 1
            self.held_up += not prompt
            if kind is GroundPlane:
                self._take_ground(t_ns, prompt, decode(payload, GroundPlane), decode(payload, Stamp))
            elif kind is Attitude:
                self._take_attitude(t_ns, decode(payload, Attitude))
            else:
                self.health = decode(payload, Health)
        now_ns = time.monotonic_ns()
        while self._waiting_on_can and now_ns - self._waiting_on_can[0][0] > _SAME_BY_NOW_NS:
            self._take_can(*self._waiting_on_can.popleft())
        self._took_ns = now_ns

    def counted(self) -> Counter[str]:
        """Return the counters of the last health message, by name."""
        if self.health is None:
            return Counter()
        return Counter(dict(_flat(msgspec.to_builtins(self.health))))

    def _subscribe(self, session: zenoh.Session, name: str) -> None:
        topic = TOPICS[name]

        def hear(sample: zenoh.Sample) -> None:
            now_ns = time.monotonic_ns()
            self._waiting.append((now_ns, self._is_prompt(now_ns), topic.message, sample.payload.to_bytes()))

        session.declare_subscriber(topic.key(DEVICE), hear)

    def _is_prompt(self, now_ns: int) -> bool:
        echoes = self._echo is None or self._echo.is_prompt(now_ns)
        return echoes and now_ns - self._took_ns < _PROMPT_NS

    def _take_ground(self, t_ns: int, prompt: bool, ground: GroundPlane, stamp: Stamp) -> None:
        truth = self._wearer.truth_of(ground)
        valid = ground.status is Status.VALID
        repeated = stamp.seq in self._seqs
        self._seqs.append(stamp.seq)
        too_old = prompt and (t_ns - ground.t_exposure_ns) * 1e-9 > STALE_S
        errors = errors_of(ground, truth) if valid else _NOTHING_OFF
        self.wrong += Wrong(zenoh=errors.wrong)
        stale = valid and (too_old or repeated)
        self.grounds.append(Heard(t_ns, ground, truth, errors, valid, stale, flags(ground, truth)))

    def _take_can(self, t_ns: int, prompt: bool, received: ReceivedGround) -> None:
        """Judge a ground of CAN, which does not tell its place, by the place that the same one tells on Zenoh."""
        same = heard_of(self.grounds, received) or heard_at(self.grounds, received.t_exposure_ns)
        truth = self._wearer.truth(received.t_exposure_ns) if same is None else same.truth
        numbers = (received.slope_sagittal_rad, received.slope_frontal_rad, received.height_m)
        deviations = (received.slope_sagittal_sd_rad, received.slope_frontal_sd_rad, received.height_sd_m)
        errors = ground_errors(numbers, deviations, truth) if prompt else _NOTHING_OFF
        self.on_can.append(HeardOnCan(t_ns, errors))
        self.wrong += Wrong(can=errors.wrong)

    def _take_attitude(self, t_ns: int, attitude: Attitude) -> None:
        valid = attitude.status is Status.VALID
        wrong = valid and is_wrong_attitude(
            attitude, self._wearer.gait.at(np.array([attitude.t_sample_ns], dtype=np.int64)).R_WB[0]
        )
        self.wrong += Wrong(attitudes=wrong)
        self.attitudes.append(HeardAttitude(t_ns, valid, wrong, attitude.reason))


def heard_of(grounds: Sequence[Heard], received: ReceivedGround) -> Heard | None:
    """Return the newest of the last `grounds`, if valid, whose slopes and height are on CAN those `received`, or None.

    However late it came on CAN, and whichever frame's exposure it seems to have, it is that one.
    """
    numbers = _on_can(received)
    newest = itertools.islice(reversed(grounds), _LAST)
    return next((heard for heard in newest if heard.valid and _on_can(heard.ground) == numbers), None)


def _on_can(told: GroundPlane | ReceivedGround) -> tuple[int | None, ...]:
    """Return slopes and height in CAN's own steps."""
    signals = codes(CanMessage.GROUND)
    return (
        signals["slope_sagittal_rad"].raw(told.slope_sagittal_rad),
        signals["slope_frontal_rad"].raw(told.slope_frontal_rad),
        signals["height_m"].raw(told.height_m),
    )


def heard_at(grounds: Sequence[Heard], t_exposure_ns: int) -> Heard | None:
    """Return that of the last `grounds` whose exposure is nearest to this one; None where all are of other frames."""

    def apart_ns(heard: Heard) -> int:
        return abs(heard.ground.t_exposure_ns - t_exposure_ns)

    nearest = min(itertools.islice(reversed(grounds), _LAST), key=apart_ns, default=None)
    return None if nearest is None or apart_ns(nearest) > _AS_ONE_NS else nearest


def _flat(health: dict[str, object]) -> list[tuple[str, int]]:
    """Return every counter of a health message, those in tables as `table.name`."""
    found: list[tuple[str, int]] = []
    for name, value in health.items():
        if isinstance(value, dict):
            found += [(f"{name}.{key}", count) for key, count in value.items() if isinstance(count, int)]
        elif isinstance(value, int) and name != "t_ns":
            found.append((name, value))
    return found
