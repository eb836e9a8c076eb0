"""Runs a court: all slots that have no result yet, on this machine's processes or on a cluster's."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

from lab.court.plan import DEVELOPMENT_SEEDS, Slot
from lab.court.result import Result
from lab.court.trial import judged
from messages.errors import UserError
from messages.extras import needs


@contextmanager
def executor(workers: int, scheduler: str | None) -> Iterator[Executor]:
    """Give local processes, or an existing dask cluster's workers behind the same interface.

    Raises UserError where dask.distributed is not installed or nobody answers.
    """
    if scheduler is None:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            yield pool
        return
    needs("--scheduler", "distributed")
    from distributed import Client

    try:
        client = Client(scheduler)
    except OSError as error:
        raise UserError(f"--scheduler {scheduler}: {error}") from error
    with client:
        yield client.get_executor()


def run(
    slots: Sequence[Slot],
    folder: Path,
    workers: Executor,
    *,
    development: bool,
    tell: Callable[[Result], None],
) -> None:
    """Judge the slots that have no file in `folder` yet, write one file for each, and tell of each as it ends.

    Seeds are drawn here and become known with the results. What was stopped goes on where it was.
    """
    waiting = {
        workers.submit(judged, slot, slot.case(development=development)): slot
        for slot in slots
        if not (folder / slot.file_name).exists()
    }
    try:
        for future in as_completed(waiting):
            slot, result = waiting[future], future.result()
            result.save(folder / slot.file_name)
            tell(result)
    finally:
        for future in waiting:  # of a court that is stopped
            future.cancel()


def check_same_court(slots: Sequence[Slot], folder: Path, *, development: bool) -> None:
    """Raise UserError if `folder` holds a result of another court: other cases, or seeds of the other kind."""
    for slot in slots:
        file = folder / slot.file_name
        if not file.exists():
            continue
        truth = Result.load(file).truth
        if (truth.kind, {cause.name for cause in truth.causes}) != (slot.kind, set(slot.effects)):
            raise UserError(f"{file}: belongs to other cases ({truth.case_name}); choose another --out")
        if (truth.seed in DEVELOPMENT_SEEDS) != development:
            raise UserError(f"{file}: its seed is {'not ' * development}one of --development; choose another --out")


def results(slots: Sequence[Slot], folder: Path) -> list[Result]:
    """Return the results of all slots that are there."""
    files = (folder / slot.file_name for slot in slots)
    return [Result.load(file) for file in files if file.exists()]
