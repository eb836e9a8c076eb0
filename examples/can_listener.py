"""Prints the ground ahead as GaitEyes sends it on CAN, and says why a frame gives nothing to act on."""

import argparse
import time

import can

from gaiteyes import GroundReceiver, Refusal

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--interface", default="slcan", help="of python-can: slcan, socketcan, udp_multicast")
arguments.add_argument("--channel", default="socket://127.0.0.1:29536", help="as /dev/ttyACM0, can0, 239.74.163.2")
arguments.add_argument("--accept-simulated", action="store_true")
options = arguments.parse_args()
receiver = GroundReceiver(accept_simulated=options.accept_simulated)
try:
    with can.Bus(options.channel, options.interface) as bus:
        fresh_s = time.monotonic() + 0.5
        while time.monotonic() < fresh_s:  # what came in while the bus was being opened is old
            bus.recv(0.1)
        for frame in bus:
            ground = receiver.feed(frame.arbitration_id, bytes(frame.data), time.monotonic_ns())
            if not isinstance(ground, Refusal):
                slope = f"slope {ground.slope_sagittal_rad:.3f} ± {ground.slope_sagittal_sd_rad:.3f} rad"
                height = f"height {ground.height_m:.3f} ± {ground.height_sd_m:.3f} m"
                print("ground", ground.source.value, slope, height, f"age {ground.age_s:.3f} s", flush=True)
            elif ground not in (Refusal.FIRST_HALF, Refusal.OTHER_MESSAGE):
                print("refused", ground.value, receiver.reason, flush=True)
except (can.CanError, OSError, ValueError) as error:
    arguments.exit(2, f"CAN {options.interface}:{options.channel}: {' '.join(str(error).split())}\n")
