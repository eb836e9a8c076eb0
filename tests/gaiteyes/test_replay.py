"""`gaiteyes.replay`: the estimates of a recording, the same as live, typed, and its errors as one line."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pytest

import gaiteyes
from calib.files import format_calibration
from daemon.pipeline import Pipeline
from daemon.recorder import Recorder
from daemon.replay_source import open_source
from daemon.stamping import Stamper
from messages import (
    TOPIC_OF,
    BiasAtTemperature,
    Estimate,
    GroundPlane,
    Health,
    Learnt,
    Source,
    Status,
    UserError,
    capture_ns,
)
from messages.codec import encode, encode_line
from messages.json_receiver import JsonReceiver, Received
from perception.ground.foothold import FootholdSettings
from sim_rig.depth_wearer import DepthWearer
from sim_rig.walk.scenario import scenario
from tests.bench.recorded import INFO


def learnt_before(calibration_id: str) -> Learnt:
    bias = BiasAtTemperature(
        temperature_degC=30.0,
        gyro_bias_radps=(0.01, -0.01, 0.005),
        gyro_std_radps=(1e-3, 1e-3, 1e-3),
        sf_bias_mps2=(0.001, 0.0, 0.002),
        sf_std_mps2=(0.005, 0.005, 0.005),
        seen_s=60.0,
    )
    return Learnt(calibration_id=calibration_id, used_s=60.0, biases=(bias,))


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Estimate]]:
    """A recording of a unit that had learnt something, and what was estimated while it was made."""
    path = tmp_path_factory.mktemp("walk") / "walk.mcap"
    wearer = DepthWearer(5, scenario("standing"), 10_000_000_000)
    calibration = format_calibration(wearer.calibration)
    learnt = learnt_before(wearer.calibration.id)
    info = dataclasses.replace(
        INFO, calibration_text=calibration, configuration_text="device = 'bench'\n", learnt=learnt
    )
    recorder = Recorder(path, info)
    pipeline = Pipeline(wearer.calibration, FootholdSettings(), learnt)
    live: list[Estimate] = []
    for message in wearer.offline_inputs(1.6):
        recorder.offer(message)
        live += pipeline.step(message)
        recorder.drain(timeout_s=0.0)
    recorder.close()
    assert any(isinstance(estimate, GroundPlane) and estimate.status is Status.VALID for estimate in live)
    return path, live


def facts(estimates: Iterator[Estimate] | list[Estimate]) -> list[bytes]:
    return [encode(estimate) for estimate in estimates]


def test_a_recording_gives_what_was_estimated_live(walk: tuple[Path, list[Estimate]]) -> None:
    path, live = walk
    assert facts(gaiteyes.replay(str(path))) == facts(live)


def test_what_the_unit_had_learnt_counts_and_its_id_is_told(walk: tuple[Path, list[Estimate]]) -> None:
    opened = open_source(walk[0], None)
    assert opened.learnt == learnt_before(opened.calibration.id)
    assert {e.learnt_id for e in walk[1] if isinstance(e, Health)} == {opened.learnt.id}
    without = Pipeline(opened.calibration, opened.configuration.foothold)
    assert facts([e for message in opened.inputs() for e in without.step(message)]) != facts(walk[1])


def test_all_that_the_pipeline_calls_valid_passes_a_receiver(walk: tuple[Path, list[Estimate]]) -> None:
    stamper = Stamper("bench", "boot", Source.LIVE)
    for kind in TOPIC_OF:
        estimates = [estimate for estimate in walk[1] if type(estimate) is kind]
        if estimates:
            receiver: JsonReceiver[Estimate] = JsonReceiver(type(estimates[0]), "bench", boot_id="boot")
            for estimate in estimates:
                t_ns = capture_ns(estimate)
                line = encode_line(TOPIC_OF[kind], estimate, stamper.stamp(estimate, t_ns))
                assert isinstance(receiver.feed(line, t_ns, t_ns), Received)


def test_another_configuration_takes_the_place_of_the_recordings_own(
    walk: tuple[Path, list[Estimate]], tmp_path: Path
) -> None:
    config = tmp_path / "nearer.toml"
    config.write_text("[foothold]\nahead_m = 0.6\n")
    nearer = [each for each in gaiteyes.replay(walk[0], config=config) if isinstance(each, GroundPlane)]
    assert {ground.ahead_m for ground in nearer} == {0.6}


def test_damage_is_told_after_the_last_estimate_before_it(walk: tuple[Path, list[Estimate]], tmp_path: Path) -> None:
    data = walk[0].read_bytes()
    damaged = tmp_path / "cut.mcap"
    damaged.write_bytes(data[: len(data) // 2])
    replayed = gaiteyes.replay(damaged)
    found: list[Estimate] = []
    with pytest.raises(UserError, match=r"replayed up to the damage: .*cut\.mcap"):
        found.extend(replayed)
    assert 0 < len(found) < len(walk[1])
    assert facts(found) == facts(walk[1])[: len(found)]


@pytest.mark.parametrize("name", ["absent.mcap", "empty.mcap", "folder"])
def test_what_is_no_recording_is_refused_at_once(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    with pytest.raises(UserError) as refused:
        gaiteyes.replay(tmp_path / name)
    assert str(tmp_path / name) in str(refused.value)
    assert "\n" not in str(refused.value)
