"""The generic library: every effect that can act at a simulation's places, sized by what its recording spans."""

from typing import TYPE_CHECKING

from discrepancy.ports.amplitude import amplitude, rounded
from discrepancy.ports.declared import Term
from discrepancy.ports.friction import friction
from discrepancy.ports.ranges import spans
from discrepancy.ports.restoring import restoring
from discrepancy.ports.timing import lost, timing

if TYPE_CHECKING:
    from discrepancy.ports.simulation import PortedSimulation


def generic_terms(simulation: "PortedSimulation") -> tuple[Term, ...]:
    """Return the library of a simulation with ports; the order is that in which they act on a signal."""
    whole = spans(simulation)
    channels = simulation.channels
    found: list[Term] = []
    for span in whole.ports:
        found += [*friction(span, whole.substep_s), *restoring(span, whole.substep_s)]
    for place, name in enumerate(channels.input_names):
        found += amplitude("input", place, channels.input_names, whole.inputs, whole)
        found += timing("input", place, channels.input_names, whole.inputs[name], whole)
    for place, name in enumerate(channels.names):
        found += timing("output", place, channels.names, whole.outputs[name], whole)
        found += amplitude("output", place, channels.names, whole.outputs, whole)
        found += rounded(place, channels.names, channels.values[:, place])
        found += lost(place, channels.names, channels.values[:, place])
    return tuple(found)
