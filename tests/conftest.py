"""Property tests try the same examples in every run; `pytest --hypothesis-profile=default` looks for new ones."""

import secrets
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--hidden-seed",
        type=int,
        default=secrets.randbits(62),
        help="draw the hidden effects of an earlier run again, from the seed that it printed",
    )


_TESTS = Path(__file__).parent
_NUMERICAL = [
    _TESTS / name
    for name in (
        "calib",
        "discrepancy",
        "impedance",
        "lab/thesis",
        "perception",
        "replay/test_frozen_walk.py",
        "systems",
    )
]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what may depend on the last bits of the processor's arithmetic."""
    for item in items:
        if any(item.path.is_relative_to(place) for place in _NUMERICAL):
            item.add_marker(pytest.mark.numerical)
