"""All the devices of a wearable in this machine, and the files that tell the service where they are.

The wearer stands: the chip measures gravity and nothing else, the camera shows one picture with ever new noise.
"""

from pathlib import Path

import msgspec
import numpy as np

from calib.files import save_calibration
from daemon.config import CameraSettings, Configuration, ImuSettings, format_configuration
from drivers.can.settings import CanInterface, CanSettings
from drivers.zenoh.local_socket import SERVICE_DIRECTORY
from drivers.zenoh.settings import SOCKET
from messages import reduced_stereo
from messages.arrays import FloatArray, GreyImage, IntArray
from sim_rig.kernel.chip_server import INTERRUPT_LINE, gpio_chip_path
from sim_rig.unit import draw_unit
from tests.kernel import can_links, loopback
from tests.kernel.imu_bench import KernelChip
from tests.kernel.shrunk import SEED, SHRINK

SCENE = Path(__file__).with_name("scene.npz")
CAN_NAME = "vcan2"
DEVICE = "kernel-tier"
TAKES = 8
NOISE_GREY = 1.5


class Wearable:
    """The devices, all plugged in, from the making to `close`; `write_files` makes the service's two files.

    `height_m` is the true distance of the left eye above the ground.
    """

    def __init__(self) -> None:
        scene = np.load(SCENE)
        left, right, sf_B = scene["left"], scene["right"], scene["sf_B_mps2"]
        self.height_m = float(scene["height_m"])
        unit = draw_unit(SEED)
        exact = unit.exact_calibration()
        self._calibration = msgspec.structs.replace(exact, stereo=reduced_stereo(exact.stereo, SHRINK))

        def motion(t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
            return np.tile(sf_B, (t_ns.size, 1)), np.zeros((t_ns.size, 3))

        self.chip = KernelChip(motion, unit.chip)
        pictures = [(_noisy(left, take), _noisy(right, TAKES + take)) for take in range(TAKES)]
        self.camera = loopback.FedLoopback((left.shape[1], left.shape[0]), lambda frame: pictures[frame % TAKES])
        can_links.make_vcan(CAN_NAME)
        self.zenoh_endpoint = f"{SOCKET}{SERVICE_DIRECTORY}/{DEVICE}.sock"

    def write_files(self, folder: Path) -> None:
        """Write gaiteyes.toml and calibration.yaml."""
        configuration = Configuration(
            device=DEVICE,
            imu=ImuSettings(bus=self.chip.bus_number, data_ready=f"{gpio_chip_path()}:{INTERRUPT_LINE}"),
            camera=CameraSettings(device=loopback.NODE),
            can=CanSettings(interface=CanInterface.SOCKETCAN, channel=CAN_NAME),
        )
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "gaiteyes.toml").write_text(format_configuration(configuration), encoding="utf-8")
        self.write_calibration(folder / configuration.calibration)

    def write_calibration(self, file: Path) -> None:
        """Write the calibration of this unit, as it was built."""
        save_calibration(file, self._calibration)

    def close(self) -> None:
        """Unplug everything."""
        self.camera.unplug()
        self.chip.unplug()
        can_links.remove(CAN_NAME)


def _noisy(picture: GreyImage, take: int) -> GreyImage:
    """What a sensor makes of the same view each time: no two pictures are equal."""
    noise = np.random.default_rng(take).normal(0.0, NOISE_GREY, picture.shape)
    return np.clip(np.rint(picture + noise), 0, 255).astype(np.uint8)
