"""Where each error stands in the error state of the attitude filter (`kalman`)."""

SIZE = 39
(
    ROTATION,
    GYRO_BIAS,
    VELOCITY,
    DRIFT,
    SF_BIAS,
    GYRO_MATRIX,
    TRAVEL,
    BEGINNING,
    SCALE,
    GROUND,
    GROUND_TURN,
    MOUNT,
    LAG,
) = (
    slice(0, 3),
    slice(3, 6),
    slice(6, 9),
    slice(9, 12),
    slice(12, 15),
    slice(15, 24),
    slice(24, 27),
    slice(27, 30),
    slice(30, 31),
    slice(31, 34),
    slice(34, 35),
    slice(35, 38),
    slice(38, 39),
)
"""Where each error stands in the error state; the gyroscope's matrix row by row. BEGINNING is the rotation's error at
the beginning of the camera's step; SCALE, MOUNT and LAG are those of its distances, its orientation in B and its clock;
GROUND and GROUND_TURN those of the acceleration, and of the turn about the vertical, of the ground that it sees."""
