"""CAN links of the kernel: virtual ones, and two emulated controllers on one bus."""

from pathlib import Path

from tests.kernel.modules import load_module, system

NETWORK = Path("/sys/class/net")
CONTROLLERS = ("can0", "can1")


def make_vcan(name: str) -> None:
    """Add a virtual link and set it up."""
    load_module("vcan")
    system("ip", "link", "add", name, "type", "vcan")
    system("ip", "link", "set", name, "up")


def remove(name: str) -> None:
    """Take a link away, as when its adapter is unplugged."""
    system("ip", "link", "del", name)


def set_state(name: str, state: str) -> None:
    """Set a link "up" or "down"."""
    system("ip", "link", "set", name, state)


def start_controllers() -> None:
    """Set up both emulated Kvaser controllers, at 500 kbit/s."""
    load_module("kvaser_pci")
    for name in CONTROLLERS:
        set_state(name, "down")
        system("ip", "link", "set", name, "type", "can", "bitrate", "500000")
        set_state(name, "up")
