"""A recording through the pipeline, as a library call: `replay`."""

from collections.abc import Iterator
from pathlib import Path

from daemon.config import load_configuration
from daemon.pipeline import Pipeline
from daemon.replay_source import ReplaySource, open_source
from daemon.setpoints import modulator_of_recording
from messages import Estimate, UserError


def replay(source: Path | str, *, config: Path | str | None = None) -> Iterator[Estimate]:
    """Return an iterator over every estimate that the recording `source` gives, in the order of the pipeline.

    `source` is an MCAP recording of GaitEyes or a folder in the EuRoC/ASL layout; `config` is a configuration file in
    place of the recording's own. The same source gives the same estimates, as `gaiteyes replay` writes them.

    Raises UserError, in one line, at once if `source` or `config` cannot be opened; and in the iteration, after the
    last estimate before it, at the place where the recording is damaged.
    """
    opened = open_source(Path(source), None if config is None else load_configuration(Path(config)))
    return _estimates(opened)


def _estimates(opened: ReplaySource) -> Iterator[Estimate]:
    pipeline = Pipeline(
        opened.calibration,
        opened.configuration.foothold,
        opened.learnt,
        setpoints=modulator_of_recording(opened.configuration.setpoint),
    )
    for message in opened.inputs():
        yield from pipeline.step(message)
    damage = opened.damage()
    if damage is not None:
        raise UserError(f"replayed up to the damage: {damage}")
