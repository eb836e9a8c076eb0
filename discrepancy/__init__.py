"""What a simulation gets wrong, held against its recording. Each name loads what it needs when it is first used."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from discrepancy.explanation import Explanation as Explanation
    from discrepancy.finder import explain as explain
    from discrepancy.own_simulation import OwnSimulation as OwnSimulation
    from discrepancy.ports.declared import Port as Port
    from discrepancy.ports.declared import PortTerm as PortTerm
    from discrepancy.ports.declared import Signal as Signal
    from discrepancy.ports.declared import SignalTerm as SignalTerm
    from discrepancy.ports.ode import Ode as Ode
    from discrepancy.ports.ode import Whole as Whole
    from discrepancy.ports.simulation import PortedSimulation as PortedSimulation
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
    "Ode": "discrepancy.ports.ode",
    "OwnSimulation": "discrepancy.own_simulation",
    "Parameter": "discrepancy.simulation",
    "Port": "discrepancy.ports.declared",
    "PortTerm": "discrepancy.ports.declared",
    "PortedSimulation": "discrepancy.ports.simulation",
    "Quantity": "discrepancy.verdict",
    "Signal": "discrepancy.ports.declared",
    "SignalTerm": "discrepancy.ports.declared",
    "Simulation": "discrepancy.simulation",
    "Values": "discrepancy.simulation",
    "Verdict": "discrepancy.verdict",
    "Whole": "discrepancy.ports.ode",
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
