"""Property tests try the same examples in every run; `pytest --hypothesis-profile=default` looks for new ones."""

import secrets

import pytest
from hypothesis import settings

settings.register_profile("fixed", derandomize=True)
settings.load_profile("fixed")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--hidden-seed",
        type=int,
        default=secrets.randbits(62),
        help="draw the hidden effects of an earlier run again, from the seed that it printed",
    )
