"""Property tests try the same examples in every run; `pytest --hypothesis-profile=default` looks for new ones.

How long an example takes is no property: a busy machine is slow.
"""

import os
import secrets
import tempfile

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("fixed", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("fixed")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--hidden-seed",
        type=int,
        default=secrets.randbits(62),
        help="draw the hidden effects of an earlier run again, from the seed that it printed",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Let services of this process meet in a directory of its own: those of tests in another are none of its business.

    Below the usual one for such files, because pytest's own paths are too long for sockets.
    """
    meeting = tempfile.TemporaryDirectory(prefix="gaiteyes-")
    os.environ["XDG_RUNTIME_DIR"] = meeting.name
    config.add_cleanup(meeting.cleanup)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that hold long tests, so that none of them is still running when all else has ended."""
    long = {item.path for item in items if item.get_closest_marker("long")}
    items.sort(key=lambda item: item.path not in long)
