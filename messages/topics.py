"""The one table of topics: who speaks, how often, how soon it must arrive and what is dropped under pressure."""

import enum

import msgspec

from messages.estimates import Attitude, GroundPlane, GroundTruth, Health, Motion, PropagatedGround
from messages.inputs import (
    AnkleState,
    DepthFrame,
    DeviceCounters,
    DroppedFrame,
    FrameHeader,
    ImuSample,
    LoadLevel,
    Reconfigured,
    StereoFrame,
    Tick,
)
from messages.setpoint import Setpoint
from messages.terrain import Terrain

INTERFACE_VERSION = 2
"""What a published message means, on Zenoh (the end of every key) and on CAN (VERSION of the DBC). In version 1 the
ground was that of a fixed region ahead; since version 2 it is the surface under the next foothold."""


class DropRule(str, enum.Enum):
    """What a full queue gives up."""

    NEWEST_WINS = "newest_wins"  # one place: a newer message replaces the waiting one
    OLDEST_GOES = "oldest_goes"  # a ring: the oldest message leaves


class Topic(msgspec.Struct, frozen=True, kw_only=True):
    """One row of the table. `rate_hz` 0 means on change; `deadline_s` counts from the event its time names."""

    name: str
    message: type[msgspec.Struct]
    rate_hz: float
    deadline_s: float
    drop: DropRule
    published: bool = False

    @property
    def period_ns(self) -> int:
        """Return the time from one message to the next. Raises ZeroDivisionError for a topic on change."""
        return round(1e9 / self.rate_hz)

    def key(self, device: str, *, replay: bool = False) -> str:
        """Return the Zenoh key under which `device` publishes; a replay has a branch of its own."""
        return f"gaiteyes/{device}/{'replay/' if replay else ''}{self.name}/v{INTERFACE_VERSION}"


_ROWS = (
    Topic(name="imu", message=ImuSample, rate_hz=100.0, deadline_s=0.030, drop=DropRule.OLDEST_GOES),
    Topic(name="frame", message=StereoFrame, rate_hz=20.0, deadline_s=0.100, drop=DropRule.NEWEST_WINS),
    Topic(name="depth_frame", message=DepthFrame, rate_hz=20.0, deadline_s=0.100, drop=DropRule.NEWEST_WINS),
    Topic(name="frame_header", message=FrameHeader, rate_hz=20.0, deadline_s=0.100, drop=DropRule.NEWEST_WINS),
    Topic(name="dropped_frame", message=DroppedFrame, rate_hz=0.0, deadline_s=0.200, drop=DropRule.OLDEST_GOES),
    Topic(name="ankle", message=AnkleState, rate_hz=100.0, deadline_s=0.030, drop=DropRule.OLDEST_GOES),
    Topic(name="tick", message=Tick, rate_hz=100.0, deadline_s=0.020, drop=DropRule.OLDEST_GOES),
    Topic(name="load", message=LoadLevel, rate_hz=0.0, deadline_s=0.100, drop=DropRule.OLDEST_GOES),
    Topic(name="reconfigured", message=Reconfigured, rate_hz=0.0, deadline_s=0.100, drop=DropRule.OLDEST_GOES),
    Topic(name="device_counters", message=DeviceCounters, rate_hz=1.0, deadline_s=1.0, drop=DropRule.OLDEST_GOES),
    Topic(
        name="attitude",
        message=Attitude,
        rate_hz=100.0,
        deadline_s=0.060,
        drop=DropRule.NEWEST_WINS,
        published=True,
    ),
    Topic(
        name="ground",
        message=GroundPlane,
        rate_hz=20.0,
        deadline_s=0.100,
        drop=DropRule.NEWEST_WINS,
        published=True,
    ),
    Topic(
        name="propagated_ground",
        message=PropagatedGround,
        rate_hz=100.0,
        deadline_s=0.060,
        drop=DropRule.NEWEST_WINS,
        published=True,
    ),
    Topic(name="motion", message=Motion, rate_hz=20.0, deadline_s=0.100, drop=DropRule.NEWEST_WINS, published=True),
    Topic(name="terrain", message=Terrain, rate_hz=20.0, deadline_s=0.100, drop=DropRule.NEWEST_WINS, published=True),
    Topic(name="setpoint", message=Setpoint, rate_hz=20.0, deadline_s=0.150, drop=DropRule.NEWEST_WINS, published=True),
    Topic(name="health", message=Health, rate_hz=1.0, deadline_s=2.0, drop=DropRule.NEWEST_WINS, published=True),
    Topic(name="truth", message=GroundTruth, rate_hz=20.0, deadline_s=0.100, drop=DropRule.OLDEST_GOES),
)

TOPICS: dict[str, Topic] = {row.name: row for row in _ROWS}
TOPIC_OF: dict[type[msgspec.Struct], Topic] = {row.message: row for row in _ROWS}
