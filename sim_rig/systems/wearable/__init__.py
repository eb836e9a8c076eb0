from sim_rig.systems.wearable.simulation import load

__all__ = ["load"]
