"""extended.toml: the extended model as a file that a simulation loads: every parameter with its value and unit."""

import math
import sys
from collections.abc import Mapping
from pathlib import Path

from discrepancy.explanation import Explanation
from discrepancy.simulation import Parameter, Simulation
from discrepancy.verdict import Quantity
from messages.errors import UserError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_HEADING = """\
# The extended model: the base model's own parameters and the effects that were found, each with its 95 % interval.
# `gaiteyes explain simulate` loads it. What is missing has its neutral value.
"""
_FIELDS = ("value", "unit", "low", "high")


def extended_text(explanation: Explanation) -> str:
    """Return the file's text. A value may be infinite; a bound that is unknown is left out."""
    verdict, values = explanation.verdict, explanation.values_after
    lines = [f'system = "{verdict.system}"']
    for name, quantity in verdict.parameters_after.items():
        lines += ["", f"[parameters.{name}]", *_lines(values[name], quantity)]
    for key, quantity in explanation.quantities_after.items():
        lines += ["", f"[effects.{key}]", *_lines(values[key], quantity)]
    return _HEADING + "\n".join(lines) + "\n"


def load_extended(path: Path, simulation: Simulation) -> dict[str, float]:
    """Return the values in `path` as `simulation.predicted` takes them.

    Raises UserError naming file and field where it is another system's, names what the simulation has not, states
    another unit, or a value outside its bounds.
    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UserError(f"{path}: {error}") from error
    if document.get("system") != simulation.system:
        raise UserError(f'{path}: system is {document.get("system")!r}; expected "{simulation.system}"')
    for name in document:
        if name not in ("system", "parameters", "effects"):
            raise UserError(f"{path}: {name} is unknown; expected system, parameters, effects")
    values = _values(path, "parameters", document.get("parameters", {}), simulation.parameters, "")
    effects = {effect.name: effect for effect in simulation.effects}
    for name, table in _table(path, "effects", document.get("effects", {})).items():
        if name not in effects:
            raise UserError(f"{path}: effects.{name} is not in the library of {simulation.system}")
        values |= _values(path, f"effects.{name}", table, effects[name].parameters, f"{name}.")
    return values


def _values(path: Path, place: str, table: object, parameters: tuple[Parameter, ...], prefix: str) -> dict[str, float]:
    known = {parameter.name: parameter for parameter in parameters}
    values = {}
    for name, entry in _table(path, place, table).items():
        field = f"{place}.{name}"
        if name not in known:
            raise UserError(f"{path}: {field} is unknown; expected {', '.join(known) or 'nothing here'}")
        values[prefix + name] = _value(path, field, _table(path, field, entry), known[name])
    return values


def _value(path: Path, field: str, entry: Mapping[str, object], parameter: Parameter) -> float:
    for name in entry:
        if name not in _FIELDS:
            raise UserError(f"{path}: {field}.{name} is unknown; expected {', '.join(_FIELDS)}")
    if entry.get("unit") != parameter.unit:
        raise UserError(f'{path}: {field}.unit is {entry.get("unit")!r}; expected "{parameter.unit}"')
    value = entry.get("value")
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise UserError(f"{path}: {field}.value is {value!r}; expected a number")
    if not (parameter.low <= value <= parameter.high or value == parameter.neutral):
        raise UserError(f"{path}: {field}.value is {value}; expected {parameter.low:g} to {parameter.high:g}")
    return float(value)


def _table(path: Path, field: str, value: object) -> Mapping[str, object]:
    if not isinstance(value, dict):
        raise UserError(f"{path}: {field} is {value!r}; expected a table")
    return value


def _lines(value: float, quantity: Quantity) -> list[str]:
    bounds = (("low", quantity.low), ("high", quantity.high))
    known = [f"{name} = {bound!r}" for name, bound in bounds if bound is not None]
    return [f"value = {float(value)!r}", *known, f'unit = "{quantity.unit}"']
