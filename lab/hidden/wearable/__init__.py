from lab.hidden.case import SHARES
from lab.hidden.wearable.cases import EFFECTS, LOOK_ALIKES, OUTSIDE, PAIRS, SIZES, write

WITHHELD = EFFECTS

__all__ = ["EFFECTS", "LOOK_ALIKES", "OUTSIDE", "PAIRS", "SHARES", "SIZES", "WITHHELD", "write"]
