"""The state file: what is written is read, whatever is broken is noticed, said in one line and set aside."""

import functools
import hashlib
import logging
import os
from datetime import datetime, timezone
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from daemon.config import Configuration
from daemon.state_file import (
    BrokenStateError,
    StateKeeper,
    format_learnt,
    parse_learnt,
    read_state,
    state_path,
    write_state,
)
from messages import BiasAtTemperature, DepthScale, Learnt, UserError
from sim_rig.unit import draw_unit

CALIBRATION = draw_unit(1).calibration(np.random.default_rng(1))
NOW = datetime(2026, 11, 22, 5, 30, tzinfo=timezone.utc)

small = st.floats(-0.01, 0.01)
axes = st.tuples(small, small, small)
std = st.floats(0.0, 0.1)
stds = st.tuples(std, std, std)


@st.composite
def states(draw: st.DrawFn) -> Learnt:
    temperatures = sorted(draw(st.sets(st.floats(-40.0, 85.0), max_size=5)))
    seen = st.floats(0.0, 1e7)
    return Learnt(
        calibration_id=CALIBRATION.id,
        used_s=draw(seen),
        biases=tuple(
            BiasAtTemperature(
                temperature_degC=temperature_degC,
                gyro_bias_radps=draw(axes),
                gyro_std_radps=draw(stds),
                sf_bias_mps2=draw(axes),
                sf_std_mps2=draw(stds),
                seen_s=draw(seen),
            )
            for temperature_degC in temperatures
        ),
        depth_scale=draw(st.none() | st.builds(DepthScale, scale=small, std=st.floats(1e-6, 0.01), seen_s=seen)),
    )


LEARNT = Learnt(
    calibration_id=CALIBRATION.id,
    used_s=120.0,
    biases=(
        BiasAtTemperature(
            temperature_degC=31.4,
            gyro_bias_radps=(0.01, -0.02, 0.003),
            gyro_std_radps=(5e-4, 5e-4, 5e-4),
            sf_bias_mps2=(0.01, 0.0, -0.01),
            sf_std_mps2=(0.004, 0.004, 0.004),
            seen_s=118.0,
        ),
    ),
    depth_scale=DepthScale(scale=0.003, std=0.0004, seen_s=116.0),
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "learnt.json"


def written(path: Path, learnt: Learnt = LEARNT) -> bytes:
    write_state(path, learnt, NOW)
    return path.read_bytes()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=50)
@given(learnt=states())
def test_what_is_written_is_read(path: Path, learnt: Learnt) -> None:
    written(path, learnt)
    state = read_state(path, CALIBRATION)
    assert state is not None
    assert (state.learnt, state.learnt.id, state.written) == (learnt, learnt.id, NOW)
    assert parse_learnt(format_learnt(learnt), "recording") == learnt
    assert [each.name for each in path.parent.iterdir()] == [path.name]


@functools.cache
def body_and_checksum(path: Path) -> bytes:
    return written(path)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200)
@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7), cut=st.booleans())
def test_any_cut_and_any_flipped_bit_is_noticed_and_does_no_harm(path: Path, place: float, bit: int, cut: bool) -> None:
    data = bytearray(body_and_checksum(path))
    k = int(place * len(data))
    if cut:
        del data[k:]
    else:
        data[k] ^= 1 << bit
    path.write_bytes(data)
    with pytest.raises(BrokenStateError, match=r"learnt\.json: does not match its checksum$"):
        read_state(path, CALIBRATION)
    assert StateKeeper(path, CALIBRATION).load() is None
    assert not path.exists()
    assert path.with_name("learnt.json.broken").read_bytes() == data


def test_a_broken_file_is_said_in_one_line_and_the_unit_learns_anew(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path.write_bytes(b"\x00" * 4096)  # what a brown-out leaves of a file whose blocks were never written
    keeper = StateKeeper(path, CALIBRATION)
    with caplog.at_level(logging.WARNING):
        assert keeper.load() is None
    (record,) = caplog.records
    assert record.getMessage() == (
        f"{path}: does not match its checksum; set aside as learnt.json.broken, the unit learns anew"
    )
    keeper.keep(LEARNT)
    assert StateKeeper(path, CALIBRATION).load() == LEARNT


def test_what_was_learnt_beside_another_calibration_is_dropped_in_one_line(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    written(path)
    other = draw_unit(2).exact_calibration()
    with caplog.at_level(logging.WARNING):
        assert StateKeeper(path, other).load() is None
    (record,) = caplog.records
    assert record.getMessage() == (
        f"{path}: learnt beside calibration {CALIBRATION.id}, the unit's is {other.id}; not used, the unit learns anew"
    )


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda body: body.replace(b'"format":1', b'"format":2'), "its format is '2', allowed '1'"),
        (lambda body: body.replace(b"31.4", b"314.0"), "learnt.biases"),
        (lambda body: body.replace(b"-0.02", b"-0.2"), "gyro_bias_radps at 31.4 °C is 0.01, -0.2, 0.003; "),
        (lambda body: body.replace(b'"used_s"', b'"usd_s"'), "learnt.usd_s is not a known field; "),
        (lambda _body: b"[]", "its format is 'None', allowed '1'"),
        (lambda _body: b"{", "not JSON: "),
    ],
)
def test_a_sound_file_that_says_what_cannot_be_is_not_used(path: Path, change: object, line: str) -> None:
    assert callable(change)
    write_body(path, change(written(path).partition(b"\n")[0]))
    with pytest.raises(UserError) as refused:
        read_state(path, CALIBRATION)
    assert not isinstance(refused.value, BrokenStateError)
    assert str(refused.value).startswith(f"{path}: {line}")
    assert "\n" not in str(refused.value)
    assert StateKeeper(path, CALIBRATION).load() is None


def write_body(path: Path, body: bytes) -> None:
    path.write_bytes(body + b"\n" + hashlib.sha256(body).hexdigest().encode() + b"\n")


def test_no_file_is_nothing_learnt_and_nothing_to_say(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert read_state(path, CALIBRATION) is None
    assert StateKeeper(path, CALIBRATION).load() is None
    assert not caplog.records


def test_only_what_is_new_is_written(path: Path) -> None:
    keeper = StateKeeper(path, CALIBRATION)
    keeper.keep(Learnt(calibration_id=CALIBRATION.id))
    assert not path.exists()
    keeper.keep(LEARNT)
    path.unlink()
    keeper.keep(LEARNT)
    assert not path.exists()
    keeper.keep(msgspec.structs.replace(LEARNT, used_s=130.0))
    assert path.exists()


def test_an_end_before_the_last_step_leaves_the_old_state(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = written(path)

    def brown_out(*_: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "replace", brown_out)
    with pytest.raises(UserError, match="Input/output error"):
        write_state(path, msgspec.structs.replace(LEARNT, used_s=999.0), NOW)
    assert path.read_bytes() == before


def test_a_disk_that_fails_is_said_once_until_it_works_again(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    keeper = StateKeeper(path.parent / "gone" / "learnt.json", CALIBRATION)
    for used_s in (1.0, 2.0):
        keeper.keep(msgspec.structs.replace(LEARNT, used_s=used_s))
    path.with_name("gone").mkdir()
    keeper.keep(LEARNT)
    assert keeper.load() == LEARNT
    (record,) = caplog.records
    assert record.getMessage().startswith("what the unit learns cannot be kept: ")


def test_the_file_lies_where_the_service_may_write_or_beside_the_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = tmp_path / "etc" / "gaiteyes.toml"
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    assert state_path(config, Configuration()) == tmp_path / "etc" / "learnt.json"
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/gaiteyes:/var/lib/other")
    assert state_path(config, Configuration()) == Path("/var/lib/gaiteyes/learnt.json")
    assert state_path(config, Configuration(learnt="/mnt/unit.json")) == Path("/mnt/unit.json")


@pytest.mark.parametrize(
    "change",
    [
        {"gyro_bias_radps": (float("nan"), 0.0, 0.0)},
        {"sf_std_mps2": (0.1, -0.1, 0.1)},
        {"gyro_std_radps": (float("inf"), 0.1, 0.1)},
        {"sf_bias_mps2": (1e200, 0.0, 0.0)},
    ],
)
def test_what_is_no_measurement_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="allowed three numbers from"):
        msgspec.structs.replace(LEARNT.biases[0], **change)
    with pytest.raises(ValueError, match="rising temperatures"):
        msgspec.structs.replace(LEARNT, biases=LEARNT.biases * 2)
