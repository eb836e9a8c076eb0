"""The vibrating platform, as the discrepancy finder takes it."""

from systems.platform.simulation import load

__all__ = ["load"]
