"""A pendulum driven by a torque: the simulation knows its weight and an oil damper, and nothing else."""

import numpy as np

import gaiteyes


def derivative(
    state: gaiteyes.Rows, inputs: gaiteyes.Rows, values: gaiteyes.Arrays, act: gaiteyes.Act
) -> tuple[gaiteyes.FloatArray, ...]:
    """Return the rates of angle and speed, from the torques."""
    angle, rate = state
    (drive,) = inputs
    torque = drive - values["weight_Nm"] * np.sin(angle) - values["damping_Nms"] * rate + act("joint", angle, rate)
    return rate, torque / 0.1


JOINT = gaiteyes.Port(
    "joint",
    "N m",
    "the joint",
    (gaiteyes.Signal("angle", "rad", "position"), gaiteyes.Signal("rate", "rad/s", "velocity")),
)


def simulation(table: gaiteyes.Table) -> gaiteyes.PortedSimulation:
    """Return the pendulum, held against a table of t_s, drive_Nm and angle_rad; it begins at rest."""
    return gaiteyes.PortedSimulation(
        "pendulum",
        table.channels(["angle_rad"], ["drive_Nm"]),
        gaiteyes.Ode(start=(0.0, 0.0), derivative=derivative, output=(0,)),
        (JOINT,),
        (
            gaiteyes.Parameter("weight_Nm", "N m", neutral=1.0, low=0.1, high=10.0, scale=0.01),
            gaiteyes.Parameter("damping_Nms", "N m s/rad", neutral=0.05, low=0.0, high=1.0, scale=0.001),
        ),
    )
