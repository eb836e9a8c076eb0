"""The inbox keeps the order of arrival, lets one frame wait and never grows."""

import numpy as np

from daemon.inbox import Inbox
from messages import (
    DropCause,
    DroppedFrame,
    FrameHeader,
    ImuSample,
    Input,
    LastingInput,
    Load,
    LoadLevel,
    Reconfigured,
    StereoFrame,
    Tick,
)


def frame(seq: int) -> StereoFrame:
    header = FrameHeader(seq=seq, t_exposure_ns=seq, t_arrival_ns=seq, exposure_s=0.005, width_px=4, height_px=4)
    return StereoFrame(header=header, left=np.zeros((4, 4), np.uint8), right=np.zeros((4, 4), np.uint8))


def sample(seq: int) -> ImuSample:
    return ImuSample(
        seq=seq,
        t_sample_ns=seq,
        t_arrival_ns=seq,
        sf_B_mps2=(0.0, 0.0, 9.81),
        w_WB_B_radps=(0.0, 0.0, 0.0),
        temperature_degC=20.0,
    )


def test_messages_come_out_in_the_order_they_went_in() -> None:
    inbox = Inbox()
    for t in range(5):
        inbox.put(Tick(t_ns=t))
    assert [inbox.get(0.0) for _ in range(5)] == [Tick(t_ns=t) for t in range(5)]
    assert inbox.get(0.0) is None


def test_only_samples_and_ticks_go_first_and_only_while_they_are_the_oldest() -> None:
    inbox = Inbox()
    assert inbox.get_sample_or_tick() is None
    sent: list[Input] = [sample(1), Tick(t_ns=2), frame(1), sample(3)]
    for message in sent:
        inbox.put(message)
    assert [inbox.get_sample_or_tick() for _ in range(4)] == [*sent[:2], None, None]
    assert inbox.get(0.0) is sent[2]
    assert inbox.get_sample_or_tick() is sent[3]


def test_a_newer_frame_supersedes_the_waiting_one_and_leaves_its_header() -> None:
    inbox = Inbox()
    inbox.put(frame(1))
    inbox.put(Tick(t_ns=7))
    newer = frame(2)
    inbox.put(newer)
    dropped = inbox.get(0.0)
    assert isinstance(dropped, DroppedFrame)
    assert (dropped.header.seq, dropped.cause) == (1, DropCause.SUPERSEDED)
    assert inbox.get(0.0) == Tick(t_ns=7)
    assert inbox.get(0.0) is newer
    assert inbox.frames_superseded == 1


def test_a_full_inbox_lets_the_oldest_go_and_counts_it() -> None:
    inbox = Inbox(capacity=3)
    for t in range(5):
        inbox.put(Tick(t_ns=t))
    assert [inbox.get(0.0) for _ in range(3)] == [Tick(t_ns=t) for t in (2, 3, 4)]
    assert inbox.dropped == 2


def test_a_decision_that_holds_is_never_given_up_for_room() -> None:
    inbox = Inbox(capacity=3)
    decisions: list[LastingInput] = [Reconfigured(t_ns=0, configuration=""), LoadLevel(t_ns=1, load=Load.REDUCED)]
    for decision in decisions:
        inbox.put(decision)
    for t in range(5):
        inbox.put(Tick(t_ns=t))
    assert [inbox.get(0.0) for _ in range(4)] == [*decisions, Tick(t_ns=4), None]
    assert inbox.dropped == 4
    for t in range(5):
        inbox.put(LoadLevel(t_ns=t, load=Load.NORMAL))
    assert [inbox.get(0.0) for _ in range(4)] == [*(LoadLevel(t_ns=t, load=Load.NORMAL) for t in (2, 3, 4)), None]
