from lab.hidden.wearable.cases import EFFECTS, LOOK_ALIKES, OUTSIDE, PAIRS, SIZES, write

__all__ = ["EFFECTS", "LOOK_ALIKES", "OUTSIDE", "PAIRS", "SIZES", "write"]
