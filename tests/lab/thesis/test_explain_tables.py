"""The search for what made the printed tables: its signals, its tolerances, and a planted cause that it must find."""

import json
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import decimate

from messages.arrays import FloatArray

pytest.importorskip("mujoco")

import mujoco

from impedance.body import geometry
from impedance.body.kinematics import Kinematics
from lab.thesis import hypotheses, search, signals, tape
from lab.thesis.causes import CAUSES, changed
from lab.thesis.hypotheses import CELLS, PINNED, Misfit, Sizes, Study, printed_cells, tolerances
from lab.thesis.printed import FOOT
from lab.thesis.signals import Signals
from lab.thesis.verdict import Effort, judged
from messages.errors import UserError
from sim_rig.platform.excitation import random_steps
from sim_rig.platform.model import SENSORS, model_of
from sim_rig.platform.rig import FOOT as FOOT_BODY
from sim_rig.platform.rig import Rig
from sim_rig.platform.run import RunSettings, measured, simulate
from systems.platform.memory import last_kept, with_play

SHORT_S = 4.0


@pytest.fixture(scope="module")
def loaded() -> Signals:
    return Signals.of_run(simulate(RunSettings(rig=Rig(foot=FOOT_BODY), duration_s=SHORT_S), 5), 6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("tables")


def test_a_tolerance_is_spread_and_rounding_and_a_value_at_its_bound_has_its_twins() -> None:
    by_cell = dict(zip(CELLS, tolerances().tolist(), strict=True))
    assert by_cell["foot m"] == pytest.approx(np.sqrt(0.06**2 + 0.01**2 / 12))
    assert by_cell["foot Jx"] == by_cell["foot Jz"] > 5.0
    assert np.std(np.array(FOOT.experiment)[:, 4]) == 0.0
    assert min(by_cell.values()) >= 0.1 / np.sqrt(12) * 0.1


def test_the_printed_columns_meet_themselves_and_the_reference_does_not() -> None:
    assert Misfit.of(printed_cells()).reproduces
    off = printed_cells()
    off[:, PINNED] = 81.1
    assert Misfit.of(off).missed == ["foot Jx"]
    assert not Misfit.of(off).pinned


def test_filters_do_what_their_names_say() -> None:
    t_s = np.arange(3500) / 350.0
    wave = np.sin(2 * np.pi * 7.0 * t_s)[:, None]
    inside = slice(300, -300)
    late = np.sin(2 * np.pi * 7.0 * (t_s - 0.0031))[:, None]
    np.testing.assert_allclose(signals.delayed(wave, 0.0031)[inside], late[inside], atol=1e-3)
    np.testing.assert_allclose(
        np.abs(signals.smoothed(wave, 1 / 7.0)[inside]).max(), 0.5, atol=1e-3
    )  # half at the cut-off, forward and back
    gain = 1.0 / np.hypot(1.0, 2 * np.pi * 7.0 * 0.01)
    np.testing.assert_allclose(np.abs(signals.lagged(wave, 0.01)[inside]).max(), gain, atol=2e-3)
    ahead = np.sin(2 * np.pi * 7.0 * (5.0 + (t_s - 5.0) / 1.001))[:, None]
    np.testing.assert_allclose(signals.drifted(wave, 1e-3)[inside], ahead[inside], atol=5e-3)


def test_play_and_held_samples_equal_their_loops() -> None:
    rng = np.random.default_rng(3)
    x = rng.standard_normal((400, 2)).cumsum(axis=0)
    half = np.array([0.7, 2.0])
    y, expected = np.zeros(2), []
    for sample in x:
        y = np.clip(y, sample - half, sample + half)
        expected.append(y)
    np.testing.assert_allclose(with_play(x, half, 0.0), expected, atol=1e-12)

    lost = rng.random(400) < 0.3
    lost[0] = False
    last, kept = x[0], []
    for sample, gone in zip(x, lost, strict=True):
        last = last if gone else sample
        kept.append(last)
    np.testing.assert_array_equal(x[last_kept(lost)], kept)


def test_every_cause_is_nothing_at_its_neutral_size_and_something_at_its_ends(loaded: Signals) -> None:
    plain = changed(loaded, {}).recorded
    for cause in CAUSES.values():
        if cause.name == "aliasing":
            continue  # another run
        still = changed(loaded, {cause.name: cause.neutral}).recorded
        np.testing.assert_allclose(still.wrench, plain.wrench, atol=1e-7, err_msg=cause.name)
        assert still.foot is not None
        assert plain.foot is not None
        np.testing.assert_allclose(still.foot.columns, plain.foot.columns, atol=1e-9, err_msg=cause.name)
        assert cause.neutral in cause.knots
        assert list(cause.knots) == sorted(cause.knots)
        end = changed(loaded, {cause.name: cause.knots[-1]}).recorded
        assert end.foot is not None
        moved = max(
            float(np.abs(end.wrench - plain.wrench).max()),
            float(np.abs(end.plate.columns - plain.plate.columns).max()),
            float(np.abs(end.foot.columns - plain.foot.columns).max()),
        )
        assert moved > 1e-5, cause.name


def test_a_stiff_tape_is_no_tape_and_a_soft_one_amplifies(loaded: Signals) -> None:
    rigid = loaded.wrench[:, 5]
    for axis, channel in ((2, 5), (0, 3)):
        stiff = tape.on_rocking_tape(loaded, axis, 1e-3, 0.1, seen=False).wrench
        soft = tape.on_rocking_tape(loaded, axis, 1 / 40.0, 0.1, seen=False).wrench
        assert np.abs(stiff - loaded.wrench).max() < 0.05 * np.abs(rigid).max()
        assert soft[:, channel].std() > 1.1 * loaded.wrench[:, channel].std()


@pytest.mark.parametrize(("axis", "rocking"), [(2, True), (0, True), (0, False), (2, False)])
def test_a_foot_on_its_tape_gives_the_wrench_that_the_engine_gives_it(axis: int, rocking: bool, tmp_path: Path) -> None:
    """MuJoCo puts the foot on a sprung hinge or slide in the plate's surface; the formula knows the plate's motion."""
    resonance_hz, damping_ratio, step_s = 45.0, 0.1, 1.0 / 3500.0
    rig = Rig(foot=FOOT_BODY)
    moved = FOOT_BODY.seen_from(np.eye(3), np.array(rig.foot_origin_m)).vector[4 + axis if rocking else 0]
    W0 = 2.0 * np.pi * resonance_hz
    xml = tmp_path / "rig.xml"
    mujoco.mj_saveLastXML(str(xml), model_of(rig, step_s, direct=False))
    along = " ".join(map(str, np.eye(3)[axis]))
    joint = (
        f'<joint type="{"hinge" if rocking else "slide"}" axis="{along}" pos="0 {-rig.foot_origin_m[1]} 0" '
        f'stiffness="{moved * W0**2}" damping="{2.0 * damping_ratio * moved * W0}"/>'
    )
    text = re.sub(r'(<body name="foot"[^>]*>)', rf"\1{joint}", xml.read_text())
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    steps = 5 * 3500
    torque_nm = random_steps(40.0, (220.0, 120.0), step_s * steps, 7)(step_s * np.arange(steps, dtype=np.float64))
    sensors = np.empty((steps, model.nsensordata))
    for k, torque in enumerate(torque_nm):
        data.ctrl[:] = torque
        mujoco.mj_step(model, data)
        sensors[k] = data.sensordata
    seen = decimate(sensors, 10, ftype="fir", axis=0)
    angles = seen[:, SENSORS["angles"]]
    p_m, euler = geometry.joint_pose(angles[:, 0], angles[:, 1], rig.joint_to_surface_m)
    R_IP = geometry.rotation_IP(*euler.T)
    g_P = geometry.GRAVITY_I_MPS2 @ R_IP
    alpha = (seen[:, None, SENSORS["alpha_I"]] @ R_IP)[:, 0]
    motion = Kinematics(seen[:, SENSORS["specific_force"]] + g_P, seen[:, SENSORS["w"]], alpha, g_P)
    rigid = motion.regressor @ rig.above_sensor.vector
    poses = np.hstack((p_m, euler))
    recording = measured(simulate(RunSettings(rig=rig, duration_s=1.0), 1), None)
    streams = Signals(recording, angles, motion, poses, poses.copy(), rigid, seed=1)
    on_tape = tape.on_rocking_tape if rocking else tape.on_sliding_tape
    told = on_tape(streams, axis, 1.0 / resonance_hz, damping_ratio, seen=False).wrench
    inside = slice(700, -100)
    true = seen[inside, SENSORS["wrench"]]
    for column in (5, 0) if (axis == 2) == rocking else (3, 2):
        excess = np.std(true[:, column] - rigid[inside, column])
        assert excess > 0.1 * np.std(rigid[inside, column])
        assert np.std(true[:, column] - told[inside, column]) < 0.05 * excess


def _ran(steps: Iterable[Sizes], count: int, what: str) -> None:
    assert what
    assert len(list(steps)) == count


@pytest.mark.long
def test_a_planted_pair_is_found_and_is_not_simulated_twice(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = Study(folder, 3, SHORT_S)
    study.prepare()
    planted = {"force_gain tz": 0.05, "hidden_mass in the foot": 0.4}
    cells = study.columns(planted).cells(False)
    tight = np.maximum(1e-3 * np.abs(cells).max(axis=0), 1e-2)
    for module in (hypotheses, search):
        monkeypatch.setattr(module, "printed_cells", lambda: cells)
        monkeypatch.setattr(module, "tolerances", lambda: tight)
    names = ("force_gain tz", "reference_height", "hidden_mass in the foot", "plate_rotation y")
    effort = Effort(best=1, random=1, flips=19, processes=1)
    found = judged(study, effort, _ran, names)
    assert set(found.best.names) == set(planted)
    for name, size in planted.items():
        assert found.best.sizes[name] == pytest.approx(size, rel=0.1)
    assert found.best.misfit.fit < 0.1 * found.base.misfit.fit
    assert found.best.misfit.foot_test < 3.0
    assert found.hypotheses == 2 * (4 + 6)
    assert found.verdict == "unknown"  # no Jx at 0.0 here, so not the tables
    assert len(found.all_pairs) == 6
    assert len(json.dumps(found.facts)) > 1000

    written = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    again = judged(study, effort, _ran, names)
    assert {path: path.stat().st_mtime_ns for path in written} == {
        path: stamp if path.name != "study.txt" else path.stat().st_mtime_ns for path, stamp in written.items()
    }
    assert again.best.sizes == found.best.sizes


def test_curves_pass_through_what_was_simulated(folder: Path) -> None:
    study = Study(folder, 3, SHORT_S)
    study.prepare()
    curves = search.Curves.of(study, ("force_gain tz",))
    for size in CAUSES["force_gain tz"].knots:
        exact: FloatArray = study.columns({} if size == 0.0 else {"force_gain tz": size}).cells(False)
        np.testing.assert_allclose(curves.cells({"force_gain tz": size}, False), exact, atol=1e-9)


def test_another_studys_folder_is_refused(folder: Path) -> None:
    Study(folder, 3, SHORT_S).prepare()
    with pytest.raises(UserError, match=r"study\.txt"):
        replace(Study(folder, 3, SHORT_S), seed=4).prepare()
