"""extended.toml: the extended model as a file that a simulation loads: every parameter with its value and unit."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from discrepancy.construct.construction import ported
from discrepancy.construct.forms import FORMS, LEARNED, form_of
from discrepancy.construct.terms import CONSTANTS, Constants, rebuilt
from discrepancy.explanation import Explanation
from discrepancy.joint import OF
from discrepancy.simulation import Parameter, Simulation
from discrepancy.verdict import Quantity
from messages.errors import UserError, unknown_name
from messages.text_files import parse_toml, read_text

_HEADING = """\
# The extended model: the base model's own parameters and the effects that were found, each with its 95 % interval.
# `gaiteyes explain simulate` loads it. A parameter that is not here has its neutral value.
"""
_SEVERAL = "# What belongs to each recording has its value in the first one.\n"
_TABLES = ("system", "parameters", "effects", "constructed")
_TERM = ("port", "form", "signals", "formula", "constants")
_FIELDS = ("value", "unit", "low", "high")
Entry = tuple[float, str]
"""A value and its unit."""


def extended_text(explanation: Explanation) -> str:
    """Return the file's text. A value may be infinite; a bound that is unknown is left out."""
    verdict, values = explanation.verdict, explanation.values_after
    lines = [f'system = "{verdict.system}"']
    for name, quantity in verdict.parameters_after.items():
        if OF in name:  # it belongs to a further recording; the file tells of the first
            continue
        lines += ["", f"[parameters.{name}]", *_lines(values[name], quantity)]
    for key, quantity in explanation.quantities_after.items():
        lines += ["", f"[effects.{key}]", *_lines(values[key], quantity)]
    for term in verdict.constructed:
        signals = ", ".join(f'"{signal}"' for signal in term.signals)
        lines += ["", f"[constructed.{term.name}]", f'port = "{term.port}"', f'form = "{term.form}"']
        lines += [f"signals = [{signals}]", f'formula = "{term.formula}"']
        if term.constants:
            lines += ["", f"[constructed.{term.name}.constants]"]
            lines += [f"{name} = {float(value)!r}" for name, value in term.constants.items()]
    several = _SEVERAL if any(OF in name for name in verdict.parameters_after) else ""
    return _HEADING + several + "\n".join(lines) + "\n"


@dataclass(frozen=True)
class TermEntry:
    """A constructed term as extended.toml names it."""

    port: str
    form: str
    signals: tuple[str, ...]
    constants: dict[str, float]


@dataclass(frozen=True)
class Extended:
    """What extended.toml says: of base model and effects every parameter's value and unit, and the terms that were
    constructed, by the name that they have among the effects.
    """

    parameters: dict[str, Entry]
    effects: dict[str, dict[str, Entry]]
    constructed: dict[str, TermEntry]


def read_extended(path: Path, system: str) -> Extended:
    """Return what `path` says, for whoever simulates `system`; raises UserError, naming the field, for another form."""
    document = parse_toml(read_text(path), str(path))
    if document.get("system") != system:
        raise UserError(f'{path}: system is {document.get("system")!r}; expected "{system}"')
    for name in document:
        if name not in _TABLES:
            raise unknown_name(f"{path}: {name}", name, _TABLES)
    effects = _table(path, "effects", document.get("effects", {}))
    return Extended(
        _entries(path, "parameters", document.get("parameters", {})),
        {name: _entries(path, f"effects.{name}", table) for name, table in effects.items()},
        {
            name: _term(path, f"constructed.{name}", table)
            for name, table in _table(path, "constructed", document.get("constructed", {})).items()
        },
    )


def load_extended(path: Path, simulation: Simulation) -> dict[str, float]:
    """Return the values that `path` tells, for `discrepancy.values.predicted` with `with_constructed`'s simulation.

    Raises UserError naming file and field where it is another system's, names what the simulation has not, states
    another unit, or a value outside its bounds.
    """
    told = read_extended(path, simulation.system)
    values = _values(path, "parameters", told.parameters, simulation.parameters, "")
    effects = {effect.name: effect for effect in simulation.effects}
    for name, entries in told.effects.items():
        if name not in effects:
            raise unknown_name(f"{path}: effects.{name}", name, effects)
        values |= _values(path, f"effects.{name}", entries, effects[name].parameters, f"{name}.")
    return values


def with_constructed(path: Path, simulation: Simulation) -> Simulation:
    """Return a simulation with the terms that `path` tells were constructed at its ports, itself if there are none.

    Raises UserError, naming file and field, where the simulation has not what they need.
    """
    terms = read_extended(path, simulation.system).constructed
    if not terms:
        return simulation
    whole = ported(simulation)
    if whole is None:
        raise UserError(f"{path}: constructed: {simulation.system} has no ports")
    ports = {port.name: port for port in whole.ports}
    made = []
    for name, told in terms.items():
        field = f"{path}: constructed.{name}"
        if told.port not in ports:
            raise unknown_name(f"{field}.port {told.port}", told.port, ports)
        if told.form not in (*FORMS, LEARNED):
            raise unknown_name(f"{field}.form {told.form}", told.form, (*FORMS, LEARNED))
        signals = {signal.name: signal for signal in ports[told.port].signals}
        for each in told.signals:
            if each not in signals:
                raise unknown_name(f"{field}.signals {each}", each, signals)
        for each in told.constants:
            if each not in CONSTANTS:
                raise unknown_name(f"{field}.constants.{each}", each, CONSTANTS)
        constants = replace(Constants(), **told.constants)
        form = form_of(told.form, constants.low, constants.high)
        if len(told.signals) != form.arity:
            raise UserError(f"{field}.signals: {len(told.signals)}; expected {form.arity}")
        found = rebuilt(ports[told.port], form, tuple(signals[each] for each in told.signals), constants)
        if found.effect.name != name:
            raise UserError(f"{field}: expected constructed.{found.effect.name}, as its port, form and signals say")
        made.append(found.term())
    return whole.with_terms((*whole.library, *made))


def _values(
    path: Path, place: str, entries: Mapping[str, Entry], parameters: tuple[Parameter, ...], prefix: str
) -> dict[str, float]:
    known = {parameter.name: parameter for parameter in parameters}
    values = {}
    for name, (value, unit) in entries.items():
        field = f"{place}.{name}"
        if name not in known:
            raise unknown_name(f"{path}: {field}", name, known)
        parameter = known[name]
        if unit != parameter.unit:
            raise UserError(f'{path}: {field}.unit is {unit!r}; expected "{parameter.unit}"')
        if not (parameter.low <= value <= parameter.high or value == parameter.neutral):
            raise UserError(f"{path}: {field}.value is {value}; expected {parameter.low:g} to {parameter.high:g}")
        values[prefix + name] = value
    return values


def _term(path: Path, field: str, value: object) -> TermEntry:
    table = _table(path, field, value)
    for name in table:
        if name not in _TERM:
            raise unknown_name(f"{path}: {field}.{name}", name, _TERM)
    port, form, signals = table.get("port"), table.get("form"), table.get("signals")
    constants = _table(path, f"{field}.constants", table.get("constants", {}))
    for name, each in (("port", port), ("form", form)):
        if not isinstance(each, str):
            raise UserError(f"{path}: {field}.{name} is {each!r}; expected a text")
    if not isinstance(signals, list) or not all(isinstance(each, str) for each in signals):
        raise UserError(f"{path}: {field}.signals is {signals!r}; expected a list of names")
    numbers = {}
    for name, each in constants.items():
        if isinstance(each, bool) or not isinstance(each, int | float) or not math.isfinite(each):
            raise UserError(f"{path}: {field}.constants.{name} is {each!r}; expected a number")
        numbers[name] = float(each)
    return TermEntry(str(port), str(form), tuple(signals), numbers)


def _entries(path: Path, place: str, table: object) -> dict[str, Entry]:
    entries = {}
    for name, each in _table(path, place, table).items():
        field = f"{place}.{name}"
        entry = _table(path, field, each)
        for key in entry:
            if key not in _FIELDS:
                raise unknown_name(f"{path}: {field}.{key}", key, _FIELDS)
        value, unit = entry.get("value"), entry.get("unit")
        if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
            raise UserError(f"{path}: {field}.value is {value!r}; expected a number")
        if not isinstance(unit, str):
            raise UserError(f"{path}: {field}.unit is {unit!r}; expected a text")
        entries[name] = (float(value), unit)
    return entries


def _table(path: Path, field: str, value: object) -> Mapping[str, object]:
    if not isinstance(value, dict):
        raise UserError(f"{path}: {field} is {value!r}; expected a table")
    return value


def _lines(value: float, quantity: Quantity) -> list[str]:
    bounds = (("low", quantity.low), ("high", quantity.high))
    known = [f"{name} = {bound!r}" for name, bound in bounds if bound is not None]
    return [f"value = {float(value)!r}", *known, f'unit = "{quantity.unit}"']
