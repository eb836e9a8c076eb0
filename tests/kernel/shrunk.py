"""The unit whose eyes are shown: seed and size, for the host that renders and the machine that looks."""

SEED = 5
SHRINK = 4
"""The pictures are a quarter as wide and high as a ZED's, for all that handles them is emulated."""
