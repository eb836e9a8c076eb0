"""What can be asked of an I2C adapter through i2c-dev."""

import fcntl

_I2C_TIMEOUT = 0x0702  # linux/i2c-dev.h, in 10 ms


def set_adapter_timeout(bus_number: int, timeout_s: float) -> None:
    """Tell the kernel how long to wait for the end of a transfer on this adapter."""
    with open(f"/dev/i2c-{bus_number}", "rb") as adapter:
        fcntl.ioctl(adapter, _I2C_TIMEOUT, round(100 * timeout_s))
