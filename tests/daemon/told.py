"""What a pipeline tells of inputs, as estimates and as bytes."""

from collections.abc import Iterable

from daemon.pipeline import Pipeline
from messages import TOPIC_OF, Estimate, Input
from messages.codec import encode_line
from perception.ground.foothold import FootholdSettings
from sim_rig.wearer import SimulatedWearer


def pipeline(wearer: SimulatedWearer) -> Pipeline:
    """Return a new pipeline with the wearer's calibration and the usual foothold."""
    return Pipeline(wearer.calibration, FootholdSettings())


def run(pipe: Pipeline, inputs: Iterable[Input]) -> list[Estimate]:
    """Return all that `pipe` tells of `inputs`."""
    return [estimate for message in inputs for estimate in pipe.step(message)]


def lines(estimates: Iterable[Estimate]) -> list[bytes]:
    """Return the bytes of each estimate, in their order."""
    return [encode_line(TOPIC_OF[type(estimate)], estimate) for estimate in estimates]


def by_topic(estimates: Iterable[Estimate]) -> dict[str, list[bytes]]:
    """Return the bytes of each topic's estimates, in their order."""
    told: dict[str, list[bytes]] = {}
    for estimate in estimates:
        topic = TOPIC_OF[type(estimate)]
        told.setdefault(topic.name, []).append(encode_line(topic, estimate))
    return told
