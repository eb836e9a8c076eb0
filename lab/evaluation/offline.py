"""A simulated walk through the pipeline faster than real time: the same driver, messages and pipeline, no threads."""

from daemon.pipeline import Pipeline
from lab.evaluation.score import Scoreboard
from messages import GroundPlane, UserError
from perception.ground.foothold import FootholdSettings
from sim_rig.depth_wearer import DepthWearer
from sim_rig.walk.scenario import Pace, scenario
from sim_rig.wearer import SimulatedWearer

_START_NS = 10_000_000_000

CAMERAS: dict[str, type[SimulatedWearer] | type[DepthWearer]] = {"stereo": SimulatedWearer, "depth": DepthWearer}
"""Who wears which kind of camera."""


def known_camera(name: str) -> type[SimulatedWearer] | type[DepthWearer]:
    """Return who wears the kind of camera called `name`; raises UserError for a name not in CAMERAS."""
    if name not in CAMERAS:
        raise UserError(f"camera is '{name}', known are {', '.join(CAMERAS)}")
    return CAMERAS[name]


def score_walk(
    seed: int,
    scenario_name: str,
    seconds: float,
    *,
    pace: Pace | None = None,
    perfect_calibration: bool = False,
    camera: str = "stereo",
) -> Scoreboard:
    """Return the errors of `seconds` of one unit's walk with a kind of camera in CAMERAS, with their ground.

    Raises UserError for any other kind.
    """
    wearer = known_camera(camera)(seed, scenario(scenario_name, pace), _START_NS, perfect_calibration)
    foothold = FootholdSettings()
    pipeline = Pipeline(wearer.calibration, foothold)
    board = Scoreboard()
    for message in wearer.offline_inputs(seconds):
        for estimate in pipeline.step(message):
            if isinstance(estimate, GroundPlane) and estimate.frame_seq >= 0:
                truth = wearer.truth_of(estimate)
                board.add(estimate, truth)
    return board
