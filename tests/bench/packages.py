"""The packages of the project that are the product, in the order of their names."""

from pathlib import Path
from typing import Final

PROJECT: Final = Path(__file__).parents[2]
_NOT_THE_PRODUCT = ("tests", "benchmarks")

PACKAGES: Final = tuple(
    sorted(init.parent.name for init in PROJECT.glob("*/__init__.py") if init.parent.name not in _NOT_THE_PRODUCT)
)
