"""A direct-current motor that turns a load through a gearbox: one inertia on the motor's side, a voltage in."""

import gaiteyes


def derivative(
    state: gaiteyes.Rows, inputs: gaiteyes.Rows, values: gaiteyes.Arrays, act: gaiteyes.Act
) -> tuple[gaiteyes.FloatArray, ...]:
    """Return the rates of angle, speed and current."""
    angle, speed, current = state
    (voltage,) = inputs
    torque = values["torque_per_A"] * current - values["viscous_Nms"] * speed + act("shaft", angle, speed, current)
    return speed, torque / 2e-4, (voltage - 1.5 * current - values["torque_per_A"] * speed) / 5e-3


SHAFT = gaiteyes.Port(
    "shaft",
    "N m",
    "the motor's shaft",
    (
        gaiteyes.Signal("angle", "rad", "position"),
        gaiteyes.Signal("speed", "rad/s", "velocity"),
        gaiteyes.Signal("current", "A"),
    ),
)


def simulation(table: gaiteyes.Table) -> gaiteyes.PortedSimulation:
    """Return the motor, held against a table of t_s, voltage_V, speed_radps and current_A; it begins at rest."""
    return gaiteyes.PortedSimulation(
        "motor",
        table.channels(["speed_radps", "current_A"], ["voltage_V"]),
        gaiteyes.Ode(start=(0.0, 0.0, 0.0), derivative=derivative, output=(1, 2)),
        (SHAFT,),
        (
            gaiteyes.Parameter("torque_per_A", "N m/A", neutral=0.05, low=0.01, high=0.2, scale=1e-4),
            gaiteyes.Parameter("viscous_Nms", "N m s/rad", neutral=1e-4, low=0.0, high=1e-2, scale=2e-6),
        ),
    )
