"""One unit's walk with a prosthesis, told by its eyes, by its own foot, and with the camera covered on the way."""

import msgspec
import numpy as np

from daemon.pipeline import Pipeline
from impedance.modulation.modulator import Modulator
from impedance.modulation.table import published
from lab.prosthesis.judge import JudgedStep
from lab.prosthesis.loop import START_NS, Covered, Fitted, Loop
from messages import Refusal, Side
from perception.ground.foothold import FootholdSettings
from sim_rig.prosthesis.bus_faults import BusFaults
from sim_rig.walk.loop_walks import loop_walk
from sim_rig.wearer import SimulatedWearer

ON_RAMP_SHARE = 0.4
"""So far up the ramp the hip is when the camera is covered."""
AFTER_COVER_S = 3.5
ONE_STEP_S = 0.8
"""A contact so long after the camera was covered is walked as on level ground."""


class LoopTrial(msgspec.Struct, kw_only=True):
    """What one unit did: steps by who told the ground, set-points heard, contacts and how many of them followed one,
    what was refused, and the ankle's states that the service took and refused."""

    seed: int
    mass_kg: float
    side: Side
    eyes: list[JudgedStep]
    foot: list[JudgedStep]
    truth: list[JudgedStep]
    heard: int
    contacts: int
    followed: int
    refused: dict[Refusal, int]
    ankle_states: int
    ankle_refused: int


class CoveredTrial(msgspec.Struct, kw_only=True):
    """What one unit did after its camera was covered on a ramp: seconds from there to each contact, and whether it
    followed a set-point; `before` counts the contacts before that did."""

    seed: int
    before: int
    after: list[tuple[float, bool]]


def loop_trial(seed: int, faults: BusFaults) -> LoopTrial:
    """Return what the unit of `seed` did with these faults of its bus."""
    walk, fitted = loop_walk(seed), fitted_unit(seed)
    until_ns = START_NS + round(1e9 * walk.seconds)
    loop = new_loop(fitted, faults)
    loop.run(fitted.wearer.offline_inputs(walk.seconds))
    loop.judged.advance_to(until_ns)
    foot, truth = fitted.told_by_foot(), fitted.told_by_truth()
    for judged in (foot, truth):
        judged.advance_to(until_ns)
    facts = loop.node.facts()
    return LoopTrial(
        seed=seed,
        mass_kg=fitted.mass_kg,
        side=fitted.side,
        eyes=loop.judged.steps(),
        foot=foot.steps(),
        truth=truth.steps(),
        heard=facts.set_points,
        contacts=facts.contacts,
        followed=facts.followed,
        refused=facts.refused,
        ankle_states=loop.ankle_states,
        ankle_refused=loop.ankle_refused,
    )


def covered_trial(seed: int, faults: BusFaults) -> CoveredTrial:
    """Return what the unit of `seed` did when its camera was covered on the ramp up."""
    walk, fitted = loop_walk(seed), fitted_unit(seed)
    at_m = walk.ramp_m[0] + ON_RAMP_SHARE * (walk.ramp_m[1] - walk.ramp_m[0])
    t_s = np.arange(0.0, walk.seconds, 0.05)
    cover_s = float(t_s[np.searchsorted(fitted.wearer.gait.course(t_s).xy_m[:, 0], at_m)])
    cover_ns = START_NS + round(1e9 * cover_s)
    loop = new_loop(fitted, faults)
    loop.run(fitted.wearer.offline_inputs(cover_s + AFTER_COVER_S, Covered(fitted.wearer, cover_ns)))
    contacts = [(1e-9 * (t_ns - cover_ns), followed) for t_ns, followed in loop.node.controls.contacts]
    return CoveredTrial(
        seed=seed,
        before=sum(followed for since_s, followed in contacts if since_s < 0.0),
        after=[contact for contact in contacts if contact[0] >= 0.0],
    )


def fitted_unit(seed: int) -> Fitted:
    """Return the unit of `seed` on its walk, its person's mass and the prosthesis's side."""
    chance = np.random.default_rng([seed, 44])
    wearer = SimulatedWearer(seed, loop_walk(seed).scenario, START_NS)
    side = Side.RIGHT if chance.random() < _RIGHT_SHARE else Side.LEFT
    return Fitted(wearer, seed, float(chance.uniform(*_MASSES_KG)), side)


def new_loop(fitted: Fitted, faults: BusFaults) -> Loop:
    """Return the loop of a unit, its pipeline new."""
    setpoints = Modulator(published(), fitted.mass_kg)
    pipeline = Pipeline(fitted.wearer.calibration, FootholdSettings(side=fitted.side), setpoints=setpoints)
    return Loop(fitted, faults, pipeline)


_MASSES_KG = (55.0, 100.0)
_RIGHT_SHARE = 0.5
