from systems.wearable.simulation import load

__all__ = ["load"]
