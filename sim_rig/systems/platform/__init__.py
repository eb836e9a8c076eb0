"""The vibrating platform, as the discrepancy finder takes it."""

from sim_rig.systems.platform.simulation import load

__all__ = ["load"]
