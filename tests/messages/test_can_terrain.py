"""Terrain and foothold on CAN: what the receiver of each kind takes, and what it refuses, beside each other."""

import math

import msgspec
import pytest

from messages import NextFoothold, Reason, Refusal, Side, Source, Terrain, TerrainKind
from messages.can_encoder import CanEncoder
from messages.can_estimates import CanEstimate, ReceivedFoothold, ReceivedGround, ReceivedTerrain
from messages.can_frames import CanFrame, CanMessage, packed, profile
from messages.can_receiver import CanReceiver
from tests.bench.can_samples import ground, stamp, terrain

CYCLE_NS = 50_000_000


class Node:
    """Sends ground, foothold and terrain of each cycle to one receiver of each kind."""

    def __init__(self) -> None:
        self.encoder = CanEncoder()
        self.receivers: list[CanReceiver[CanEstimate]] = [
            CanReceiver(kind) for kind in (ReceivedGround, ReceivedFoothold, ReceivedTerrain)
        ]
        self.seq = 0
        self.t_ns = 7_000_000_000
        self.exchange(terrain())

    def frames(self, sent: Terrain) -> list[CanFrame]:
        self.seq += 1
        self.t_ns += CYCLE_NS
        sealed = stamp(seq=self.seq)
        pairs = self.encoder.ground(ground(), sealed, 0.04), self.encoder.foothold(sent, sealed, 0.04)
        return [frame for pair in (*pairs, self.encoder.terrain(sent, sealed, 0.04)) for frame in pair]

    def told(self, frames: list[CanFrame]) -> list[CanEstimate | Refusal]:
        """What each receiver makes of the second half of its kind."""
        found = [[each.feed(frame.can_id, frame.data, self.t_ns) for each in self.receivers] for frame in frames]
        return [found[2 * kind + 1][kind] for kind in range(3)]

    def exchange(self, sent: Terrain) -> list[CanEstimate | Refusal]:
        return self.told(self.frames(sent))


def test_each_receiver_takes_its_own_frames_out_of_all() -> None:
    found, foothold, seen = Node().exchange(terrain())
    assert isinstance(found, ReceivedGround)
    assert isinstance(foothold, ReceivedFoothold)
    assert isinstance(seen, ReceivedTerrain)
    assert found.t_exposure_ns == foothold.t_exposure_ns == seen.t_exposure_ns
    assert {found.source, foothold.source, seen.source} == {Source.LIVE}
    assert [foothold.side, foothold.ahead_m, foothold.left_m] == [Side.RIGHT, pytest.approx(0.62), pytest.approx(-0.09)]
    assert [foothold.rise_m, foothold.rise_sd_m] == pytest.approx([0.0, 0.005])
    assert [foothold.time_to_contact_s, foothold.time_to_contact_sd_s] == pytest.approx([0.3, 0.02])
    assert [foothold.ahead_sd_m, foothold.left_sd_m] == pytest.approx([0.03, 0.02])
    assert seen.kind is TerrainKind.STEP_UP
    assert seen.probability == pytest.approx(0.9)
    assert seen.edge is not None
    assert [seen.edge.distance_m, seen.edge.distance_sd_m] == pytest.approx([1.1, 0.01])
    assert [seen.edge.rise_m, seen.edge.rise_sd_m, seen.edge.bound_only] == [
        pytest.approx(0.17),
        pytest.approx(0.003),
        False,
    ]
    assert (seen.edges_ahead, seen.obstacles_ahead) == (1, 1)
    assert [seen.obstacle_distance_m, seen.obstacle_left_m] == pytest.approx([0.8, -0.2])


def test_a_path_with_nothing_on_it_is_told_as_such() -> None:
    seen = Node().exchange(terrain(edges=(), obstacles=()))[2]
    assert isinstance(seen, ReceivedTerrain)
    assert (seen.edge, seen.edges_ahead, seen.obstacles_ahead) == (None, 0, 0)
    assert math.isnan(seen.obstacle_distance_m)


def test_a_foothold_whose_rise_is_not_known_is_taken_without_it() -> None:
    sample = terrain()
    unknown = msgspec.structs.replace(sample.foothold, rise_m=math.nan, rise_sd_m=math.nan)
    _, foothold, _ = Node().exchange(msgspec.structs.replace(sample, foothold=unknown))
    assert isinstance(foothold, ReceivedFoothold)
    assert foothold.ahead_m == pytest.approx(0.62)
    assert math.isnan(foothold.rise_m)
    assert math.isnan(foothold.rise_sd_m)


def test_while_the_next_step_is_not_known_the_foothold_alone_is_refused() -> None:
    found, foothold, seen = Node().exchange(terrain(foothold=NextFoothold.unknown(Side.RIGHT)))
    assert isinstance(found, ReceivedGround)
    assert foothold is Refusal.NOT_AVAILABLE
    assert isinstance(seen, ReceivedTerrain)


def test_a_terrain_that_is_not_valid_is_refused_and_tells_why() -> None:
    node = Node()
    invalid = terrain().without_numbers(Reason.LOW_TEXTURE)
    assert node.exchange(invalid)[1:] == [Refusal.NOT_VALID, Refusal.NOT_VALID]
    assert [each.reason for each in node.receivers] == ["none", "low_texture", "low_texture"]


def changed(frame: CanFrame, message: CanMessage, name: str, raw: int) -> CanFrame:
    """The frame with another raw value in one signal, protected anew."""
    others = ~int.from_bytes(packed(message, {name: -1}), "little")
    data = int.from_bytes(frame.data, "little") & others | int.from_bytes(packed(message, {name: raw}), "little")
    payload = data.to_bytes(8, "little")
    return CanFrame(frame.can_id, bytes([profile(message).crc(payload)]) + payload[1:])


@pytest.mark.parametrize(
    ("message", "name", "raw"),
    [
        (CanMessage.FOOTHOLD, "side", 0),
        (CanMessage.FOOTHOLD, "left_m", -512),
        (CanMessage.FOOTHOLD_QUALITY, "rise_sd_m", 255),
        (CanMessage.TERRAIN, "edge", 3),
        (CanMessage.TERRAIN, "edge_rise_m", -2048),
        (CanMessage.TERRAIN_QUALITY, "probability", 127),
        (CanMessage.TERRAIN_QUALITY, "obstacle_left_m", -128),
    ],
)
def test_a_valid_pair_that_lacks_something_is_refused(message: CanMessage, name: str, raw: int) -> None:
    node = Node()
    frames = node.frames(terrain())
    order: list[CanMessage] = [
        CanMessage.GROUND,
        CanMessage.GROUND_QUALITY,
        CanMessage.FOOTHOLD,
        CanMessage.FOOTHOLD_QUALITY,
        CanMessage.TERRAIN,
        CanMessage.TERRAIN_QUALITY,
    ]
    place = order.index(message)
    frames[place] = changed(frames[place], message, name, raw)
    told = node.told(frames)
    assert [isinstance(each, Refusal) for each in told] == [kind == place // 2 for kind in range(3)]
    assert told[place // 2] is Refusal.NOT_AVAILABLE


def test_a_kind_of_ground_without_a_name_is_unknown() -> None:
    node = Node()
    frames = node.frames(terrain())
    frames[4] = changed(frames[4], CanMessage.TERRAIN, "kind", 15)
    seen = node.told(frames)[2]
    assert isinstance(seen, ReceivedTerrain)
    assert seen.kind is TerrainKind.UNKNOWN


def test_halves_of_two_kinds_are_never_joined() -> None:
    node = Node()
    frames = node.frames(terrain())
    receiver = node.receivers[1]
    assert receiver.feed(frames[2].can_id, frames[2].data, node.t_ns) is Refusal.FIRST_HALF
    as_foothold = CanFrame(frames[3].can_id, frames[5].data)
    assert receiver.feed(as_foothold.can_id, as_foothold.data, node.t_ns) is Refusal.WRONG_CRC
