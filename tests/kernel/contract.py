"""A contract's tests, taken over by a test module of this folder that has a fixture of the same name."""

import inspect
from collections.abc import Callable
from types import ModuleType


def contract_tests(module: ModuleType, fixture: str) -> dict[str, Callable[..., None]]:
    """Return the tests of `module` that ask for `fixture`, by name, to be added to the caller's globals."""
    return {
        name: test
        for name, test in vars(module).items()
        if name.startswith("test_") and fixture in inspect.signature(test).parameters
    }
