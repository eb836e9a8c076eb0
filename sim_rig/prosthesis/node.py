"""The prosthesis as a node on CAN: frames in, ANKLE_STATE out, in whatever time it is told. No bus, no clock.

What it hears goes through the receiver that any integrator would use, checks and all, and then through the state
machine of `impedance.modulation.follower`: trust, hold, fall back.
"""

from collections import Counter
from collections.abc import Callable, Iterator

import msgspec
import numpy as np

from impedance.modulation.curve import Impedance, Limits
from impedance.modulation.follower import Follower, Trust
from impedance.modulation.table import published
from messages import TOPICS, GaitPhase, Refusal
from messages.can_encoder import CanEncoder
from messages.can_frames import CanFrame
from messages.can_setpoint import ReceivedSetpoint, SetpointReceiver
from sim_rig.prosthesis.bus_faults import Arrived, Babbler, BusFaults, FaultyWay
from sim_rig.prosthesis.prosthesis import VirtualProsthesis

STATE_NS = TOPICS["ankle"].period_ns


class NodeFacts(msgspec.Struct):
    """What the node did: contacts, of these on a set-point; set-points and refused frames heard; states told; frames
    that its bus lost; stumbles."""

    contacts: int = 0
    followed: int = 0
    set_points: int = 0
    refused: dict[Refusal, int] = {}
    states: int = 0
    lost_frames: int = 0
    stumbles: int = 0


class SetpointControls:
    """Controls that follow what they hear of set-points, as an ankle of `mass_kg` with the published table should."""

    def __init__(self, mass_kg: float, t_ns: int) -> None:
        self.refused: Counter[Refusal] = Counter()
        self.heard = 0
        self.contacts: list[tuple[int, bool]] = []
        """When the foot landed, and whether a set-point was held from then on."""
        self._receiver = SetpointReceiver(accept_simulated=True)
        self._follower = Follower(Limits(published().level(mass_kg)), t_ns)
        self._phase = GaitPhase.STANCE

    def hear(self, arrived: Arrived) -> None:
        """Take a frame."""
        found = self._receiver.feed(arrived.frame.can_id, arrived.frame.data, arrived.t_ns)
        if isinstance(found, ReceivedSetpoint):
            points = np.column_stack((found.equilibrium_rad, found.stiffness_nm_per_rad, found.damping_nms_per_rad))
            self._follower.take(points, found.t_exposure_ns)
            self.heard += 1
        elif found not in (Refusal.OTHER_MESSAGE, Refusal.FIRST_HALF):
            self.refused[found] += 1
            if found is Refusal.NOT_VALID:
                self._follower.refuse()

    def impedance(self, t_ns: int, phase: GaitPhase, share: float) -> Impedance:
        """Return what to act with."""
        impedance = self._follower.step(t_ns, phase, share)
        if phase is GaitPhase.STANCE and self._phase is not GaitPhase.STANCE:
            self.contacts.append((t_ns, self._follower.state is Trust.HOLD))
        self._phase = phase
        return impedance


class ProsthesisNode:
    """A prosthesis with these `controls`, on a bus with `faults`, which `seed` draws.

    `advance` takes the place of the prosthesis's own `advance_to`.
    """

    def __init__(
        self,
        controls: SetpointControls,
        prosthesis: VirtualProsthesis,
        faults: BusFaults,
        seed: int,
        advance: Callable[[int], None] | None = None,
    ) -> None:
        self.controls, self.prosthesis = controls, prosthesis
        self._advance = advance or prosthesis.advance_to
        self._heard, self._told = FaultyWay(faults, seed), FaultyWay(faults, seed + 1)
        self._babbler = Babbler(faults, seed, prosthesis.t_ns)
        self._encoder = CanEncoder()
        self._next_state_ns = prosthesis.t_ns
        self._states = 0

    def hear(self, frame: CanFrame, t_ns: int) -> None:
        """Take a frame from the bus at `t_ns`."""
        self._heard.put(frame, t_ns)

    def advance_to(self, t_ns: int) -> Iterator[CanFrame]:
        """Go on to `t_ns`; yield the frames that reach the bus meanwhile. A state that is late is not told."""
        while self._next_state_ns <= t_ns:
            self._walk_to(self._next_state_ns)
            if t_ns - self._next_state_ns < STATE_NS:
                self._told.put(self._encoder.ankle(self.prosthesis.state()), self._next_state_ns)
                self._states += 1
            self._next_state_ns += STATE_NS
        self._walk_to(t_ns)
        for frame in self._babbler.due(t_ns):
            self._heard.put(frame, t_ns)
            yield frame
        for arrived in self._told.due(t_ns):
            yield arrived.frame

    def _walk_to(self, t_ns: int) -> None:
        for arrived in self._heard.due(t_ns):
            self._advance(arrived.t_ns)
            self.controls.hear(arrived)
        self._advance(t_ns)

    def facts(self) -> NodeFacts:
        """Return what was done so far."""
        controls = self.controls
        return NodeFacts(
            contacts=len(controls.contacts),
            followed=sum(followed for _, followed in controls.contacts),
            set_points=controls.heard,
            refused=dict(controls.refused),
            states=self._states,
            lost_frames=self._heard.lost + self._told.lost,
            stumbles=len(self.prosthesis.stumbles_ns),
        )
