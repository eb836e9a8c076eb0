"""What a fault is: what it acts on, how, and what a daemon that may be walked on must do about it."""

import enum
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lab.faults.hardware import FaultyHardware
from messages import Reason

if TYPE_CHECKING:
    from lab.faults.daemon_process import DaemonPlan
    from lab.faults.surroundings import Surroundings

BUS_FLAG_S = 0.050
"""A fault of a bus must be flagged this soon, counted from the fault to the hearing of the flag."""
FRAME_FLAG_S = 0.150
"""The same for frames, or samples, that are missing or never change."""
MOTION_FLAG_S = 3.0
"""The same for data that contradict each other, in seconds of walking: who stands gives nothing to compare."""
RECOVERY_S = 2.0
"""After the cause is gone the ground must be valid again, and stay so, this soon."""
USB_RECOVERY_S = 10.0
"""The same where a USB device has to be enumerated anew, or the whole process to be started."""


class Layer(str, enum.Enum):
    """What a fault acts on."""

    IMU = "IMU"
    CAMERA = "camera"
    CAN = "CAN"
    ZENOH = "Zenoh"
    HOST = "host"
    FILES = "files"


FOREIGN: dict[Layer, frozenset[Reason]] = {
    Layer.IMU: frozenset({Reason.NO_FRAME, Reason.FROZEN_FRAME, Reason.EYES_SWAPPED, Reason.WRONG_SIZE}),
    Layer.CAMERA: frozenset({Reason.NO_IMU, Reason.NOT_AT_REST, Reason.STARTING}),
    Layer.FILES: frozenset({Reason.NO_FRAME, Reason.NO_IMU, Reason.NOT_AT_REST, Reason.STARTING}),
}
"""Flag reasons that a fault of a layer cannot cause: such a flag came by chance."""


class Expect(str, enum.Enum):
    """What must follow. In every case no wrong and no stale value may be marked valid, UNDETECTABLE excepted."""

    FLAGGED = "flagged"  # an invalid ground or attitude is heard within the limit
    SILENT = "silent"  # the daemon cannot speak: whatever it says afterwards is neither wrong nor stale
    TOLERATED = "tolerated"  # the ground stays valid throughout
    HONEST = "honest"  # it may drop out for a while or not, for either may be right
    UNDETECTABLE = "undetectable"  # nothing that is measured contradicts it; what it costs is measured
    REFUSED = "refused"  # the start, or the command, ends with one clear line


@dataclass(frozen=True)
class HardwareAction:
    """Makes a fault in the daemon's process, on the simulated hardware, and takes it back."""

    inject: Callable[[FaultyHardware], None]
    clear: Callable[[FaultyHardware], None] = lambda _hardware: None


@dataclass(frozen=True)
class OutsideAction:
    """Makes a fault around the daemon's process and takes it back."""

    inject: "Callable[[Surroundings], None]"
    clear: "Callable[[Surroundings], None]" = lambda _surroundings: None


@dataclass(frozen=True)
class Restart:
    """A fault that the daemon is started with: `change` makes its plan of a faultless one and an empty folder.

    `then` is done with that folder once the ground is valid. A start that is to be REFUSED happens beside the daemon
    that runs.
    """

    change: "Callable[[DaemonPlan, Path], DaemonPlan]"
    then: Callable[[Path], None] = lambda _folder: None


@dataclass(frozen=True)
class Command:
    """A fault met by the command line: `prepare` lays it out in an empty folder and returns gaiteyes' arguments.

    `codes` are the exit codes that are in order; `work` is what lines of progress begin with, beside the one of the
    error.
    """

    prepare: "Callable[[DaemonPlan, Path], list[str]]"
    codes: tuple[int, ...] = (2,)
    work: str | None = None


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One row of the catalogue.

    `how` says in one line what happens on the hardware, `reason` why it is expected to be tolerated, to be either, or
    to go unnoticed. It lasts `hold_s`; `limit_s` is that of FLAGGED. `in_motion`: it begins while the wearer walks,
    and only walking time counts. Two faults with different `touches` may come together; one without never does.
    `share` of the frames remains while it lasts. One that `burdens_host` holds up the rig and the campaign as well, so
    that the host is judged before it.
    """

    name: str
    layer: Layer
    how: str
    act: HardwareAction | OutsideAction | Restart | Command
    expect: Expect
    limit_s: float = 0.0
    hold_s: float = 1.5
    recovery_s: float = RECOVERY_S
    in_motion: bool = False
    reason: str = ""
    touches: str = ""
    share: float = 1.0
    burdens_host: bool = False
