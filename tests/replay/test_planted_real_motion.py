"""An effect planted into a real trial by the court's generator is named, though the trial has effects of its own."""

from dataclasses import fields, replace

import msgspec
import numpy as np
import pytest

from discrepancy import explain
from lab.court.change import change
from lab.court.result import Told
from lab.evaluation.measured.broad_recordings import simulation_of
from lab.evaluation.measured.moved_imus import halves
from lab.hidden.imu.planted import Recorded, drawn
from systems.imu.recording import ImuRecording
from systems.imu.simulation import ImuSimulation
from tests.bench.data_folder import shared_data


def with_it(recording: ImuRecording, recorded: Recorded) -> ImuSimulation:
    return simulation_of(replace(recording, **{each.name: getattr(recorded, each.name) for each in fields(Recorded)}))


@pytest.mark.long
def test_a_time_offset_planted_into_a_real_trial_is_told_as_the_change() -> None:
    shared_data("broad")
    trial = halves("broad 18")
    both = trial.first, trial.second
    plain = [Recorded(**{each.name: getattr(half, each.name) for each in fields(Recorded)}) for half in both]
    planting = drawn("time_offset", np.random.default_rng(4), plain[0])
    assert abs(planting.cause.size) > 1e-3
    as_it_is = explain(*(simulation_of(half) for half in both), seed=1).verdict
    planted = (with_it(half, planting.planted(each)) for half, each in zip(both, plain, strict=True))
    after = explain(*planted, seed=1).verdict
    before_told, told = (msgspec.convert(msgspec.to_builtins(verdict), Told) for verdict in (as_it_is, after))
    assert change(planting.cause, before_told, told, {}).named, (planting.cause, before_told, told)
