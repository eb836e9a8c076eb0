"""Going on with another configuration: what can change takes effect, the IMU's stream and the attitude go on."""

import logging
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from calib.files import load_calibration
from cli.devices import camera_opener
from cli.wiring import Outlets
from daemon.config import Configuration, format_configuration, load_configuration
from daemon.replaceable_camera import ReplaceableCamera
from daemon.service import Service
from messages import Reconfigured, UnitCalibration, UserError

log = logging.getLogger("gaiteyes")

AT_THE_NEXT_START = ("device", "imu", "learnt", "realtime", "setpoint", "view")


class Reloader:
    """Reads the configuration's file anew when SIGHUP has come.

    A file that is wrong changes nothing and is said in one line. What belongs to `AT_THE_NEXT_START` is said so, and
    so is another calibration: the attitude filter lives by it, and would have to start anew.
    """

    def __init__(
        self,
        path: Path,
        configuration: Configuration,
        calibration: UnitCalibration,
        service: Service,
        camera: ReplaceableCamera,
        outlets: Outlets,
    ) -> None:
        self._path = path
        self._configuration = configuration
        self._calibration = calibration
        self._service = service
        self._camera = camera
        self._zenoh = outlets.zenoh
        self._can = outlets.can
        self._link = outlets.link
        self._asked = threading.Event()

    @property
    def asked(self) -> bool:
        """Return whether a reload is due."""
        return self._asked.is_set()

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Let SIGHUP ask for a reload."""

        def ask(_number: int, _frame: FrameType | None) -> None:
            self._asked.set()

        before = signal.signal(signal.SIGHUP, ask)
        try:
            yield
        finally:
            signal.signal(signal.SIGHUP, before)

    def reload(self) -> None:
        """Read the file and go over to what it says."""
        self._asked.clear()
        try:
            new = load_configuration(self._path)
            calibration = load_calibration(self._path.parent / new.calibration)
            if new.zenoh != self._configuration.zenoh:
                self._zenoh.listen_anew(new.zenoh)
        except UserError as error:
            log.error("reload refused, nothing has changed: %s", error)
            return
        old, self._configuration = self._configuration, new
        if new.camera != old.camera:
            self._camera.replace(camera_opener(new.camera, self._calibration))
        if new.can != old.can:
            self._can.fd = new.can.fd
            self._link.reconfigure(new.can)
        self._zenoh.set_configuration(new)
        self._service.put(Reconfigured(t_ns=time.monotonic_ns(), configuration=format_configuration(new)))
        if calibration.id != self._calibration.id:
            log.warning("reload: calibration %s takes effect at the next start", calibration.id)
        if new.foothold.matching_width_px != old.foothold.matching_width_px:
            log.warning("reload: the new foothold.matching_width_px takes effect at the next start")
        for section in AT_THE_NEXT_START:
            if getattr(new, section) != getattr(old, section):
                log.warning("reload: the new %s takes effect at the next start", section)
        log.warning("configuration read again from %s", self._path)
