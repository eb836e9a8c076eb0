"""What a simulation gets wrong, held against its recording. Each name loads what it needs when it is first used."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from discrepancy.explanation import Explanation as Explanation
    from discrepancy.finder import explain as explain
    from discrepancy.own_simulation import OwnSimulation as OwnSimulation
    from discrepancy.simulation import Channels as Channels
    from discrepancy.simulation import Effect as Effect
    from discrepancy.simulation import Parameter as Parameter
    from discrepancy.simulation import Simulation as Simulation
    from discrepancy.simulation import Values as Values
    from discrepancy.verdict import Cause as Cause
    from discrepancy.verdict import Quantity as Quantity
    from discrepancy.verdict import Verdict as Verdict

_HOMES = {
    "Cause": "discrepancy.verdict",
    "Channels": "discrepancy.simulation",
    "Effect": "discrepancy.simulation",
    "Explanation": "discrepancy.explanation",
    "OwnSimulation": "discrepancy.own_simulation",
    "Parameter": "discrepancy.simulation",
    "Quantity": "discrepancy.verdict",
    "Simulation": "discrepancy.simulation",
    "Values": "discrepancy.simulation",
    "Verdict": "discrepancy.verdict",
    "explain": "discrepancy.finder",
}

__all__ = list(_HOMES)

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name not in _HOMES:
            raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
        globals()[name] = value = getattr(import_module(_HOMES[name]), name)
        return value

    def __dir__() -> list[str]:
        return __all__
