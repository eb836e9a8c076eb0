"""Samples and ticks that are taken before the terrain of a frame: told sooner, and no estimate is another."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator

import msgspec
import numpy as np
import pytest

from daemon.pipeline import Pipeline
from messages import Attitude, Estimate, ImuSample, Input, StereoFrame, Terrain, Tick
from sim_rig.walk.scenario import scenario
from sim_rig.wearer import SimulatedWearer
from tests.daemon.told import by_topic, lines, pipeline, run

START_NS = 10_000_000_000


@pytest.fixture(scope="module")
def wearer() -> SimulatedWearer:
    return SimulatedWearer(3, scenario("standing"), START_NS)


@pytest.fixture(scope="module")
def inputs(wearer: SimulatedWearer) -> list[Input]:
    return list(wearer.offline_inputs(2.4))


def told_in_any_order(pipe: Pipeline, inputs: Iterable[Input], rng: np.random.Generator) -> tuple[list[Estimate], int]:
    """Return what is told where some of the samples and ticks have come before a frame is done with, and how many."""
    waiting, first = deque(inputs), 0

    def come_meanwhile() -> Iterator[ImuSample | Tick]:
        nonlocal first
        for _ in range(int(rng.integers(12))):
            oldest = waiting[0] if waiting else None
            if not isinstance(oldest, ImuSample | Tick):
                return
            waiting.popleft()
            first += 1
            yield oldest

    pipe.let_first(come_meanwhile)
    told: list[Estimate] = []
    while waiting:
        told += pipe.step(waiting.popleft())
    return told, first


def gyro_turned_over(message: Input) -> Input:
    if not isinstance(message, ImuSample) or message.t_sample_ns < START_NS + 4_000_000_000:
        return message
    x, y, z = message.w_WB_B_radps
    return msgspec.structs.replace(message, w_WB_B_radps=(-x, y, z))


def test_samples_and_ticks_that_go_before_the_terrain_change_no_estimate(
    wearer: SimulatedWearer, inputs: list[Input]
) -> None:
    undisturbed = run(pipeline(wearer), inputs)
    told, first = told_in_any_order(pipeline(wearer), inputs, np.random.default_rng(5))
    assert first > 100
    assert lines(told) != lines(undisturbed)
    assert by_topic(told) == by_topic(undisturbed)


@pytest.mark.long
@pytest.mark.parametrize("fault", [None, gyro_turned_over])
def test_nor_does_any_change_on_a_walk_whose_gyroscope_turns_over(
    fault: Callable[[Input], Input] | None,
) -> None:
    walker = SimulatedWearer(4, scenario("mixed"), START_NS, rolling_shutter=True)
    inputs = [message if fault is None else fault(message) for message in walker.offline_inputs(7.0)]
    in_turn, any_order = pipeline(walker), pipeline(walker)
    expected = run(in_turn, inputs)
    told, first = told_in_any_order(any_order, inputs, np.random.default_rng(6))
    assert first > 300
    assert by_topic(told) == by_topic(expected)
    assert any_order.learnt == in_turn.learnt


def test_a_silent_chip_is_told_before_the_terrain_of_a_frame(wearer: SimulatedWearer, inputs: list[Input]) -> None:
    pipe, cut_ns = pipeline(wearer), START_NS + 2_000_000_000
    told: list[Estimate] = []
    for message in inputs:
        if isinstance(message, ImuSample) and message.t_arrival_ns > cut_ns:
            break
        told += pipe.step(message)
    silent = Tick(t_ns=cut_ns + 40_000_000)
    frame = next(m for m in inputs if isinstance(m, StereoFrame) and m.header.t_arrival_ns > cut_ns)
    early = msgspec.structs.replace(frame.header, t_exposure_ns=cut_ns - 15_000_000, seq=1000)
    come = [silent]
    pipe.let_first(lambda: iter([come.pop()] if come else []))
    topics = [type(each) for each in pipe.step(StereoFrame(header=early, left=frame.left, right=frame.right))]
    assert topics.index(Attitude) < topics.index(Terrain)
    assert run(pipe, [silent]) == []
