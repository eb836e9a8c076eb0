"""The virtual prosthesis as a process of its own on a CAN bus, in real time."""

import contextlib
import logging
import multiprocessing
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection

import can

from drivers.can.bus import close_bus, discard_input, open_bus
from drivers.can.settings import CanInterface, CanSettings
from drivers.protocols import DeviceError
from messages import Side, UserError
from messages.can_frames import CanFrame, CanMessage, can_id
from sim_rig.children import without_interrupt
from sim_rig.prosthesis.bus_faults import BusFaults
from sim_rig.prosthesis.node import NodeFacts, ProsthesisNode, SetpointControls
from sim_rig.prosthesis.prosthesis import VirtualProsthesis
from sim_rig.walk.footholds import Footholds
from sim_rig.walk.scenario import Scenario

log = logging.getLogger("gaiteyes")

PERIOD_NS = 2_000_000
"""The process goes on with the walk, and looks at the bus, each time this much has passed."""

_HEARD = tuple(can_id(message) for message in (CanMessage.SETPOINT, CanMessage.SETPOINT_QUALITY))
_GOODBYE_S = 5.0


@dataclass(frozen=True)
class Worn:
    """Who wears the prosthesis on which side, and walks what from `start_ns` on; `seed` draws the person."""

    seed: int
    scenario: Scenario
    start_ns: int
    side: Side
    mass_kg: float

    def node(self, faults: BusFaults) -> ProsthesisNode:
        """Return the prosthesis as a node. Raises UserError for a walk that it cannot walk."""
        gait = self.scenario.gait(self.seed, self.start_ns)
        footholds = Footholds(self.scenario.world, gait, self.seed)
        controls = SetpointControls(self.mass_kg, self.start_ns)
        prosthesis = VirtualProsthesis(
            self.scenario, gait, footholds, controls, side=self.side, mass_kg=self.mass_kg, seed=self.seed
        )
        return ProsthesisNode(controls, prosthesis, faults, self.seed)


def check_worn(worn: Worn, settings: CanSettings, faults: BusFaults) -> None:
    """Raise UserError for a walk that cannot be walked, or a bus that is not shared."""
    if settings.interface is CanInterface.VIRTUAL:
        raise UserError(
            f"prosthesis: CAN {settings.name} ends with this process; choose slcan, udp_multicast or socketcan"
        )
    worn.node(faults)


class ProsthesisProcess:
    """A process that walks with the prosthesis until it is closed. Raises what `check_worn` does."""

    def __init__(self, worn: Worn, settings: CanSettings, faults: BusFaults) -> None:
        check_worn(worn, settings, faults)
        context = multiprocessing.get_context("spawn")
        self._pipe, childs_end = context.Pipe()
        self._process = context.Process(
            target=_walk, args=(childs_end, worn, settings, faults), name="gaiteyes-prosthesis", daemon=True
        )
        with without_interrupt():
            self._process.start()
        childs_end.close()

    def close(self) -> NodeFacts | None:
        """End the process; return what it did, or None where it did not end well."""
        facts: NodeFacts | None = None
        try:
            self._pipe.send(None)
            if self._pipe.poll(_GOODBYE_S):
                facts = self._pipe.recv()
        except (EOFError, OSError):
            facts = None
        self._pipe.close()
        self._process.join(_GOODBYE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        return facts


def _walk(pipe: Connection, worn: Worn, settings: CanSettings, faults: BusFaults) -> None:
    node = worn.node(faults)
    try:
        bus, send = open_bus(settings, _HEARD)
    except DeviceError as error:
        log.error("prosthesis: %s", error)
        return
    due_ns = time.monotonic_ns()
    try:
        while not pipe.poll():
            due_ns = max(due_ns + PERIOD_NS, time.monotonic_ns())
            _listen(bus, node, due_ns)
            for frame in node.advance_to(time.monotonic_ns()):
                with contextlib.suppress(can.CanError, OSError):  # a full or lost bus: the frame is
                    send(frame)
        pipe.send(node.facts())
    except (EOFError, BrokenPipeError, ConnectionResetError):
        pass  # the parent has gone
    finally:
        close_bus(bus)


def _listen(bus: can.BusABC, node: ProsthesisNode, until_ns: int) -> None:
    """Hand on what comes until `until_ns`."""
    while (left_ns := until_ns - time.monotonic_ns()) > 0:
        try:
            message = bus.recv(1e-9 * left_ns)
        except ValueError:  # an slcan line that is no frame
            discard_input(bus)
            continue
        except (can.CanError, OSError):
            time.sleep(1e-9 * left_ns)
            continue
        if message is not None and not message.is_error_frame:
            node.hear(CanFrame(message.arbitration_id, bytes(message.data)), time.monotonic_ns())
