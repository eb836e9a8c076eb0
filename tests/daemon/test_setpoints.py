"""Set-points in the service: asked for by the configuration, made in the pipeline, in recordings as in a replay."""

import math
from pathlib import Path

import msgspec
import pytest

from daemon.config import Configuration, format_configuration, parse_configuration
from daemon.outgoing import STALE_NS, withdrawn_if_late
from daemon.pipeline import Pipeline
from daemon.setpoints import SetpointSettings, modulator, modulator_of_recording
from impedance.ankle.table import save_table
from impedance.modulation.table import published
from messages import TOPICS, GroundPlane, Reason, Setpoint, Side, Tick, UserError
from messages.can_encoder import CanEncoder
from messages.can_setpoint import ReceivedSetpoint, SetpointReceiver
from perception.ground.foothold import FootholdSettings
from sim_rig.walk.scenario import scenario
from sim_rig.walk.terrain_walks import terrain_walk
from sim_rig.wearer import SimulatedWearer
from tests.bench.can_samples import setpoint, stamp
from tests.bench.straight_trial import trial

START_NS = 10_000_000_000


def test_without_a_mass_there_are_no_set_points() -> None:
    assert modulator(Configuration().setpoint) is None


def test_own_trials_are_read_from_the_folder_of_the_configuration(tmp_path: Path) -> None:
    save_table(tmp_path / "level.toml", trial(0.0))
    settings = SetpointSettings(mass_kg=75.0, tables=["level.toml"])
    made, usual = modulator(settings, tmp_path), modulator(SetpointSettings(mass_kg=75.0))
    assert made is not None
    assert usual is not None
    assert usual.table_id == published().id != made.table_id


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[setpoint]\nmass_kg = 20", "setpoint.mass_kg is 20, allowed a number from 30 to 150"),
        ("[setpoint]\nmass = 75", "setpoint.mass is not a known field; did you mean 'mass_kg'?"),
        ("[can]\ninterface = 'slcan'\nchannel = '/dev/ttyACM0'\nfd = true", "fd is true, allowed false with"),
    ],
)
def test_a_mistake_is_one_line(text: str, told: str) -> None:
    with pytest.raises(UserError, match=r"^c\.toml: ") as raised:
        parse_configuration(text, "c.toml")
    assert told in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (SetpointSettings(tables=["level.toml"]), "without setpoint.mass_kg"),
        (SetpointSettings(mass_kg=75.0, tables=["absent.toml"]), "absent.toml"),
    ],
)
def test_tables_that_cannot_be_used_are_refused_and_a_replay_goes_without(
    settings: SetpointSettings, told: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(UserError, match=told):
        modulator(settings, tmp_path)
    assert modulator_of_recording(settings) is None
    assert "replayed without set-points" in caplog.text


def test_the_configuration_comes_back_from_its_text() -> None:
    told = Configuration(setpoint=SetpointSettings(mass_kg=80.5, tables=["a.toml", "b.toml"]))
    assert parse_configuration(format_configuration(told), "c.toml") == told


def test_a_set_point_that_comes_too_late_has_no_numbers() -> None:
    sent = setpoint()
    assert withdrawn_if_late(sent, sent.t_exposure_ns + STALE_NS) is sent
    late = withdrawn_if_late(sent, sent.t_exposure_ns + STALE_NS + 1)
    assert isinstance(late, Setpoint)
    assert (late.reason, math.isnan(late.slope_rad)) == (Reason.LATE, True)


def test_without_a_camera_each_ground_has_a_set_point_with_its_reason() -> None:
    calibration = SimulatedWearer(3, scenario("standing"), START_NS).calibration
    pipeline = Pipeline(calibration, FootholdSettings(), setpoints=modulator(SetpointSettings(mass_kg=75.0)))
    told = [
        estimate for n in range(600) for estimate in pipeline.step(Tick(t_ns=START_NS + n * TOPICS["tick"].period_ns))
    ]
    grounds = [estimate for estimate in told if isinstance(estimate, GroundPlane)]
    setpoints = [estimate for estimate in told if isinstance(estimate, Setpoint)]
    assert len(grounds) > 50
    assert [each.reason for each in setpoints] == [ground.reason for ground in grounds]
    assert {each.reason for each in setpoints} == {Reason.STARTING, Reason.NO_FRAME}


@pytest.fixture(scope="module")
def ramp() -> tuple[SimulatedWearer, list[Setpoint]]:
    """Return who walked down a ramp of 4.7° and off it, and all set-points."""
    walk = terrain_walk(18)
    wearer = SimulatedWearer(18, walk.scenario, START_NS)
    pipeline = Pipeline(
        wearer.calibration, FootholdSettings(side=Side.RIGHT), setpoints=modulator(SetpointSettings(mass_kg=75.0))
    )
    inputs = wearer.offline_inputs(walk.seconds)
    return wearer, [e for message in inputs for e in pipeline.step(message) if isinstance(e, Setpoint)]


@pytest.mark.long
@pytest.mark.parametrize("fd", [False, True])
def test_a_receiver_on_can_hears_of_the_ramp_before_the_foot_lands_on_it(
    ramp: tuple[SimulatedWearer, list[Setpoint]], fd: bool
) -> None:
    wearer, told = ramp
    encoder, receiver = CanEncoder(), SetpointReceiver()
    off, landed = list[float](), set[int]()
    for seq, sent in enumerate(told):
        stamped, t_ns = msgspec.structs.replace(stamp(), seq=seq), sent.t_exposure_ns + 60_000_000
        frames = (encoder.setpoint_fd(sent, stamped, 0.06),) if fd else encoder.setpoint(sent, stamped, 0.06)
        found = [receiver.feed(frame.can_id, frame.data, t_ns) for frame in frames][-1]
        truth = wearer.terrain(sent.t_exposure_ns, Side.RIGHT).foothold
        lands_s = math.nan if truth is None else 1e-9 * (truth.t_land_ns - sent.t_exposure_ns)
        if isinstance(found, ReceivedSetpoint) and truth is not None and 0.1 < lands_s < 0.4:
            off.append(found.slope_rad - truth.slope_sagittal_rad)
            landed.add(truth.t_land_ns)
    assert len(landed) >= 4
    assert len(off) >= 15
    assert sum(abs(each) < math.radians(1.5) for each in off) >= 0.8 * len(off)
