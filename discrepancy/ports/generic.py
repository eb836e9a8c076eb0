"""The generic library: every effect that can act at a simulation's places, sized by what its recording spans."""

from typing import TYPE_CHECKING

from discrepancy.ports.amplitude import amplitude, rounded
from discrepancy.ports.declared import Term
from discrepancy.ports.friction import friction
from discrepancy.ports.ranges import Spans, spans
from discrepancy.ports.restoring import restoring
from discrepancy.ports.timing import lost, timing
from discrepancy.simulation import Channels

if TYPE_CHECKING:
    from discrepancy.ports.simulation import PortedSimulation


def generic_terms(simulation: "PortedSimulation") -> tuple[Term, ...]:
    """Return the library of a simulation with ports, sized by its recording."""
    return terms_within(spans(simulation), simulation.channels)


def terms_within(whole: Spans, channels: Channels) -> tuple[Term, ...]:
    """Return the library of places that span so much; the order is that in which the terms act on a signal."""
    found: list[Term] = []
    for span in whole.ports:
        others = [each.port for each in whole.ports if each is not span]
        found += [
            *friction(span, whole.substep_s, whole.step_s / whole.substep_s),
            *restoring(span, whole.substep_s, others),
        ]
    for place, name in enumerate(channels.input_names):
        found += amplitude("input", place, channels.input_names, whole.inputs, whole)
        found += timing("input", place, channels.input_names, whole.inputs[name], whole)
    for place, name in enumerate(channels.names):
        found += timing("output", place, channels.names, whole.outputs[name], whole)
        found += amplitude("output", place, channels.names, whole.outputs, whole)
        found += rounded(place, channels.names, channels.values[:, place])
        found += lost(place, channels.names, channels.values[:, place])
    return tuple(found)
