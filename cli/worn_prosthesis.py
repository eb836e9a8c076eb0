"""The virtual prosthesis of `gaiteyes demo --prosthesis`: who wears it, and what is told of it at the end."""

import msgspec

from cli.console import console, table
from daemon.config import Configuration
from sim_rig.prosthesis.node import NodeFacts
from sim_rig.prosthesis.process import Worn
from sim_rig.walk.scenario import Scenario

USUAL_MASS_KG = 75.0


def with_set_points(configuration: Configuration) -> Configuration:
    """Return a configuration that asks for set-points, of a usual mass where it names none."""
    if configuration.setpoint.mass_kg is not None:
        return configuration
    setpoint = msgspec.structs.replace(configuration.setpoint, mass_kg=USUAL_MASS_KG)
    return msgspec.structs.replace(configuration, setpoint=setpoint)


def worn_by(configuration: Configuration, seed: int, scenario: Scenario, start_ns: int) -> Worn:
    """Return who wears the prosthesis, and walks from `start_ns` on."""
    mass_kg = configuration.setpoint.mass_kg or USUAL_MASS_KG
    return Worn(seed, scenario, start_ns, configuration.foothold.side, mass_kg)


def tell_prosthesis(facts: NodeFacts | None, states_heard: int) -> None:
    """Print what the prosthesis did, of whose states the service heard some."""
    if facts is None:
        console.print("The prosthesis ended early; what it did is not known.", style="bold", soft_wrap=True)
        return
    refused = ", ".join(f"{count} {reason.value}" for reason, count in sorted(facts.refused.items())) or "none"
    table(
        "Prosthesis",
        ["", ""],
        [
            ["contacts, of them on a set-point", f"{facts.contacts}, {facts.followed}"],
            ["set-points heard", str(facts.set_points)],
            ["frames refused", refused],
            ["frames lost on its bus", str(facts.lost_frames)],
            ["ankle states told, heard by the service", f"{facts.states}, {states_heard}"],
            ["stumbles", str(facts.stumbles)],
        ],
    )
