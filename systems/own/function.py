"""MODULE:FUNCTION on a command line: the user's function, found in the current folder, called with a table."""

import importlib
import inspect
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

from discrepancy.simulation import Simulation
from messages.errors import UserError, unknown_name
from systems.own.table import Table


def function_of(text: str) -> Callable[..., object]:
    """Return the function that `MODULE:FUNCTION` names, the current folder searched first.

    Raises UserError where the text is of another form, the module cannot be imported, or has no such function.
    """
    module_name, colon, name = text.partition(":")
    if not (colon and module_name and name):
        raise UserError(f"{text}: expected MODULE:FUNCTION, such as pendulum:simulation for pendulum.py")
    module_name = module_name.removesuffix(".py").replace("/", ".")
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name != module_name.partition(".")[0] and error.name != module_name:
            raise UserError(f"{module_name}: imports {error.name}, which is not installed") from error
        raise UserError(f"{module_name}: no module of this name in {here}") from error
    except Exception as error:
        raise UserError(_told(f"{module_name}: cannot be imported", error)) from error
    functions = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
    found = getattr(module, name, None)
    if not callable(found):
        raise unknown_name(f"{module_name}: function {name}", name, functions)
    return found  # type: ignore[no-any-return]


def source_of(function: Callable[..., object]) -> tuple[Path, ...]:
    """Return the file that a function is written in, relative to the current folder where it is below it; none for a
    built-in.
    """
    try:
        file = inspect.getsourcefile(function)
    except TypeError:  # of a built-in or a callable object
        return ()
    if file is None:
        return ()
    here = Path.cwd()
    return (Path(file).relative_to(here) if Path(file).is_relative_to(here) else Path(file),)


def simulation_of(function: Callable[..., object], path: Path) -> Simulation:
    """Return the simulation that a function makes of the recording at `path`.

    The function takes one `Table`, or columns by the names of its arguments. Raises UserError where it wants a column
    that the file has not, fails, or returns anything else.
    """
    table = Table.load(path)
    name = getattr(function, "__name__", "the function")
    wanted = [p.name for p in inspect.signature(function).parameters.values() if p.default is p.empty]
    given = [table] if len(wanted) == 1 and wanted[0] not in table.columns else [table[each] for each in wanted]
    try:
        found = function(*given)
    except UserError:
        raise
    except Exception as error:
        raise UserError(_told(f"{name}: failed on {path}", error)) from error
    if not all(hasattr(found, each) for each in ("system", "channels", "parameters", "effects", "predicted")):
        raise UserError(
            f"{name}: returned {type(found).__name__}; expected a simulation (PortedSimulation or OwnSimulation)"
        )
    return found  # type: ignore[return-value]


def _told(what: str, error: Exception) -> str:
    """Return an error of the user's own code with the line that it came from."""
    frames = traceback.extract_tb(error.__traceback__)
    at = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{what}: {type(error).__name__}: {error}{at}"
