"""What goes into `Pipeline.step`: samples, frames, ticks and the daemon's own decisions.

Every message is frozen and says in its field names which event its time names, in which frame a vector
stands and in which unit. Times are integer nanoseconds of CLOCK_MONOTONIC.
"""

import enum

import msgspec

from messages.arrays import DepthImage, GreyImage

Vec3 = tuple[float, float, float]
Image = GreyImage | DepthImage


class ImuSample(msgspec.Struct, frozen=True, kw_only=True):
    """One sample of the IMU in nominal scale: what the chip says, before the unit's calibration.

    `t_sample_ns` is the instant the sample stands for: the chip's data-ready instant minus the gyroscope's filter
    delay. The accelerometer's differs, by 0.1 ms in an MPU-6050 as it is set up here, by 1.0 ms in its relatives.
    `lost_before` counts samples of the chip that went missing between this sample and the one before it.
    """

    seq: int
    t_sample_ns: int
    t_arrival_ns: int
    sf_B_mps2: Vec3
    w_WB_B_radps: Vec3
    temperature_degC: float
    clipped: bool = False
    lost_before: int = 0


class FrameHeader(msgspec.Struct, frozen=True, kw_only=True):
    """All of a stereo or depth frame but its pixels.

    `t_exposure_ns` is mid-exposure of the middle row; `seq` is the camera's own sequence number.
    """

    seq: int
    t_exposure_ns: int
    t_arrival_ns: int
    exposure_s: float
    width_px: int
    height_px: int


class StereoFrame(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A stereo pair that owns its pixels: `left` and `right` are (height_px, width_px) uint8, unrectified."""

    header: FrameHeader
    left: GreyImage
    right: GreyImage

    @property
    def images(self) -> tuple[Image, ...]:
        """Return left and right."""
        return self.left, self.right


class DepthFrame(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A depth image that owns its pixels, (height_px, width_px) uint16, as the camera gave it.

    A value counts the steps of the calibration's `step_m` along the optical axis; 0 is a pixel without depth.
    """

    header: FrameHeader
    depth: DepthImage

    @property
    def images(self) -> tuple[Image, ...]:
        """Return the one image."""
        return (self.depth,)


Frame = StereoFrame | DepthFrame
"""What a camera delivers; a unit has one of the two kinds, as its calibration says."""


class DropCause(str, enum.Enum):
    """Why a frame never reached the matcher."""

    SUPERSEDED = "superseded"  # a newer frame arrived before this one was taken: the newest wins
    POOL_EXHAUSTED = "pool_exhausted"  # every pixel buffer was still held
    CAMERA_GAP = "camera_gap"  # the camera's sequence number jumped
    CORRUPT = "corrupt"  # error flag, short buffer or wrong size
    UNPAIRED = "unpaired"  # of two cameras, the other eye has no frame exposed at the same time
    LATE = "late"  # arrived after its deadline had passed
    NOT_RECORDED = "not_recorded"  # used live, but the recorder's queue was full: only a recording says so


class RecordingState(str, enum.Enum):
    """Whether the service records what it takes and makes."""

    OFF = "off"
    RECORDING = "recording"
    DISK_FULL = "disk_full"  # stopped: no more than the reserve of free space is left
    DISK_FAILED = "disk_failed"  # stopped: the disk refused to write


class DroppedFrame(msgspec.Struct, frozen=True, kw_only=True):
    """A frame that was lost, kept as its header so that a replay sees the same gap."""

    header: FrameHeader
    cause: DropCause


class GaitPhase(str, enum.Enum):
    """What the ankle controller says its foot is doing."""

    UNKNOWN = "unknown"
    STANCE = "stance"
    SWING = "swing"


class AnkleState(msgspec.Struct, frozen=True, kw_only=True):
    """State of the prosthetic ankle as it reports it on CAN; dorsiflexion is positive."""

    t_sample_ns: int
    ankle_angle_rad: float
    ankle_rate_radps: float
    load_n: float
    phase: GaitPhase


class Tick(msgspec.Struct, frozen=True, kw_only=True):
    """The daemon's 100 Hz timer, which makes silence of the devices visible to the pipeline."""

    t_ns: int


class Load(str, enum.Enum):
    """How much work the pipeline may do on a frame."""

    NORMAL = "normal"
    REDUCED = "reduced"


class LoadLevel(msgspec.Struct, frozen=True, kw_only=True):
    """The daemon's decision to do less, or all, of the work on each frame from now on."""

    t_ns: int
    load: Load


class Reconfigured(msgspec.Struct, frozen=True, kw_only=True):
    """The person's decision to go on with another configuration; `configuration` is the text of its file (TOML)."""

    t_ns: int
    configuration: str


class CanState(str, enum.Enum):
    """Fault confinement of the CAN controller (ISO 11898-1), as far as the backend tells."""

    ACTIVE = "active"
    WARNING = "warning"  # an error counter above 96
    PASSIVE = "passive"  # an error counter above 127: it no longer disturbs others
    BUS_OFF = "bus_off"  # the transmit error counter above 255: it sends nothing
    DOWN = "down"  # no link


class CanBusHealth(msgspec.Struct, frozen=True, kw_only=True):
    """What the CAN link saw since the start; `bus_errors` are error frames and input that is no frame."""

    state: CanState = CanState.ACTIVE
    outages: int = 0
    bus_offs: int = 0
    bus_errors: int = 0
    ankle_refused: int = 0


class ZenohHealth(msgspec.Struct, frozen=True, kw_only=True):
    """What the service sees of those who connect to it on Zenoh since the start.

    `insecure` warns that anything may pose as the service where it listens. `malformed` are queries with parameters or
    a payload, where none belong; `refused` those beyond what is answered in a second. What others publish never comes
    in (access control), and Zenoh does not tell how much that was.
    """

    insecure: bool = False
    malformed: int = 0
    refused: int = 0


class DeviceCounters(msgspec.Struct, frozen=True, kw_only=True):
    """Counters of everything outside the pipeline since the start, told once a second."""

    t_ns: int
    imu_bus_errors: int = 0
    imu_fifo_overflows: int = 0
    imu_frames_refused: int = 0
    imu_resets: int = 0
    imu_edges_missed: int = 0
    frames_dropped: dict[DropCause, int] = {}
    inbox_dropped: int = 0
    recorder_dropped: int = 0
    recording: RecordingState = RecordingState.OFF
    can_errors: int = 0
    can_bus: CanBusHealth = CanBusHealth()
    zenoh_errors: int = 0
    zenoh: ZenohHealth = ZenohHealth()


LastingInput = LoadLevel | Reconfigured
"""A decision that holds until the next one of its kind: it must not get lost on the way or in a recording."""

Input = ImuSample | Frame | DroppedFrame | AnkleState | Tick | LoadLevel | Reconfigured | DeviceCounters
