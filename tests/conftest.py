"""Property tests try the same examples in every run; `pytest --hypothesis-profile=default` looks for new ones.

How long an example takes is no property: a busy machine is slow.
"""

import secrets

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
