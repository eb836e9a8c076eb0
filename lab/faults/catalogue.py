"""All faults, and the choice of those that come together."""

import itertools
import random

from lab.faults.camera_faults import CAMERA_FAULTS
from lab.faults.daemon_process import Order
from lab.faults.fault import Expect, Fault, HardwareAction
from lab.faults.file_faults import FILE_FAULTS
from lab.faults.hardware import FaultyHardware
from lab.faults.image_faults import IMAGE_FAULTS
from lab.faults.imu_faults import IMU_FAULTS
from lab.faults.outside_faults import CAN_FAULTS, HOST_FAULTS, ZENOH_FAULTS
from lab.faults.signal_faults import SIGNAL_FAULTS
from messages import UserError

CATALOGUE: dict[str, Fault] = {
    fault.name: fault
    for fault in (
        *IMU_FAULTS,
        *SIGNAL_FAULTS,
        *CAMERA_FAULTS,
        *IMAGE_FAULTS,
        *CAN_FAULTS,
        *ZENOH_FAULTS,
        *HOST_FAULTS,
        *FILE_FAULTS,
    )
}
LONGEST_PAIRED_S = 4.0
_MOST_PAIRS_OF_ONE = 3


def named(names: str) -> list[Fault]:
    """Return the faults whose names, or beginnings of names, `names` lists with commas. Raises UserError."""
    found: list[Fault] = []
    for word in names.split(","):
        matching = [fault for name, fault in CATALOGUE.items() if name.startswith(word.strip())]
        if not matching:
            raise UserError(f"--only {word}: no fault of that name; `gaiteyes faults --list` shows them all")
        found += [fault for fault in matching if fault not in found]
    return found


def pairs(count: int, seed: int) -> list[tuple[Fault, Fault]]:
    """Return `count` different pairs of faults that can strike together; each fault is in three of them at most."""
    able = [f for f in CATALOGUE.values() if f.touches and f.expect is not Expect.UNDETECTABLE]
    able = [f for f in able if f.hold_s <= LONGEST_PAIRED_S or f.in_motion]
    possible = [(a, b) for a, b in itertools.combinations(able, 2) if a.touches != b.touches]
    random.Random(seed).shuffle(possible)
    chosen: list[tuple[Fault, Fault]] = []
    for pair in possible:
        used = [fault for earlier in chosen for fault in earlier]
        if len(chosen) < count and all(used.count(fault) < _MOST_PAIRS_OF_ONE for fault in pair):
            chosen.append(pair)
    return chosen


def carry_out(hardware: FaultyHardware, order: Order) -> None:
    """Inject or clear a fault of the catalogue on the simulated hardware."""
    act = CATALOGUE[order.fault].act
    if not isinstance(act, HardwareAction):
        raise TypeError(f"{order.fault} does not happen on the simulated hardware")
    (act.inject if order.inject else act.clear)(hardware)


def expected_together(first: Fault, second: Fault) -> tuple[Expect, float, bool]:
    """Return what two faults at once must lead to: the expectation, its limit and whether it counts in motion.

    The one that is flagged sooner sets the limit. Two of one layer that are tolerated alone may be too much together.
    """
    expects = (first.expect, second.expect)
    if Expect.SILENT in expects:
        return Expect.SILENT, 0.0, False
    flagged = [fault for fault in (first, second) if fault.expect is Expect.FLAGGED]
    if flagged:
        soonest = min(flagged, key=lambda fault: fault.limit_s)
        return Expect.FLAGGED, soonest.limit_s, soonest.in_motion
    if Expect.HONEST in expects or first.layer is second.layer:
        return Expect.HONEST, 0.0, False
    return Expect.TOLERATED, 0.0, False
