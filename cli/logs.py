"""Log lines for whoever reads them: a person at a terminal, or the journal, which wants a priority and no more.

Source: sd-daemon(3) for the prefixes, systemd.exec(5) for JOURNAL_STREAM.
"""

import logging
import os
import sys
import threading
from collections.abc import Mapping

log = logging.getLogger("gaiteyes")

_SYSLOG = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}


class JournalFormatter(logging.Formatter):
    """`<priority>message`; each line of a traceback is a record of its own and carries the priority too."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line or lines."""
        priority = f"<{_SYSLOG.get(record.levelno, 6)}>"
        return "\n".join(priority + line for line in super().format(record).splitlines())


def goes_to_journal(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether stderr is the journal's own stream."""
    try:
        stderr = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):
        return False
    return environment.get("JOURNAL_STREAM") == f"{stderr.st_dev}:{stderr.st_ino}"


def configure_logs() -> None:
    """Send the project's log, and the traceback of a thread that dies, to stderr in the reader's form."""
    handler = logging.StreamHandler()
    handler.setFormatter(JournalFormatter() if goes_to_journal() else logging.Formatter("gaiteyes: %(message)s"))
    logging.basicConfig(handlers=[handler])
    threading.excepthook = _tell_of_dead_thread


def _tell_of_dead_thread(dead: threading.ExceptHookArgs) -> None:
    if dead.exc_value is not None:
        name = dead.thread.name if dead.thread is not None else "unknown"
        log.critical("thread %s died", name, exc_info=(dead.exc_type, dead.exc_value, dead.exc_traceback))
