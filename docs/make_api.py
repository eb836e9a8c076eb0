"""Writes docs/api.md, the public names of `gaiteyes`, from their sources: `python docs/make_api.py`."""

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

import gaiteyes

HOME = Path(__file__).parents[1]
PAGE = HOME / "docs" / "api.md"

SECTIONS = {
    "Listen to the service": [
        "listen", "Listener", "Credentials", "Received", "Refusal",
        "listen_can", "CanListener", "CanReceiver", "CanEstimate", "ReceivedGround",
        "ReceivedPropagatedGround", "ReceivedFoothold",
        "ReceivedTerrain", "ReceivedEdge", "ReceivedSetpoint", "SetpointReceiver",
    ],
    "Replay a recording": ["replay", "Pipeline", "load_calibration", "FootholdSettings"],
    "Explain what a simulation gets wrong": [
        "explain", "PortedSimulation", "Ode", "Whole", "Port", "Signal", "PortTerm", "SignalTerm", "Act", "Arrays",
        "Rows", "Table", "OwnSimulation", "Channels", "Effect", "Parameter", "Values", "FloatArray", "Simulation",
        "Explanation", "Verdict", "Cause", "Quantity", "Gain", "Remainder", "Signature", "headline",
        "quantity_text", "write_report",
    ],
    "Messages out of the pipeline": [
        "Estimate", "GroundPlane", "PropagatedGround", "Attitude", "Motion", "Terrain", "TerrainEdge",
        "TerrainObstacle", "TerrainKind", "NextFoothold", "Side", "Setpoint",
        "Health", "Status", "Reason", "Stamp", "Source", "Covariance3",
        "Quaternion",
    ],
    "Messages into the pipeline": [
        "Input", "ImuSample", "Frame", "StereoFrame", "DepthFrame", "FrameHeader", "DroppedFrame", "DropCause",
        "AnkleState", "GaitPhase", "Tick", "LoadLevel", "Load", "Reconfigured", "DeviceCounters", "CanBusHealth",
        "ZenohHealth", "CanState", "Vec3",
    ],
    "Calibration": [
        "UnitCalibration", "Calibration", "DepthUnitCalibration", "StereoCalibration", "DepthCalibration", "Lens",
        "ImuCalibration", "Pose", "Residual", "Matrix3", "Learnt", "BiasAtTemperature", "DepthScale",
        "WearerHeight",
    ],
    "Errors": ["UserError"],
}  # fmt: skip

HEAD = """# Public names

What `import gaiteyes` gives. Each name loads what it needs when it is first used. This page is made from the docstrings
by `python docs/make_api.py`. Frames, units and times are explained in [architecture.md](architecture.md).
"""


LONGEST_SIGNATURE = 100


def page() -> str:
    """Return the page; raises ValueError if a public name stands in no section, or one of a section is not public."""
    listed = [name for names in SECTIONS.values() for name in names]
    if sorted([*listed, "__version__"]) != sorted(gaiteyes.__all__):
        raise ValueError(f"in one place only: {sorted(set(listed) ^ set(gaiteyes.__all__))}")
    parts = [HEAD]
    for title, names in SECTIONS.items():
        parts.append(f"## {title}\n")
        parts += [f"### {name}\n\n{_described(name, getattr(gaiteyes, name))}" for name in names]
    return "\n".join(parts)


def _described(name: str, found: Any) -> str:
    if (inspect.isclass(found) and not get_args(found)) or inspect.isfunction(found):
        source = textwrap.dedent(inspect.getsource(found))
        (node,) = ast.parse(source).body
        if isinstance(node, ast.FunctionDef):
            return f"{_python(_signature(node))}\n{ast.get_docstring(node)}\n"
        assert isinstance(node, ast.ClassDef)
        parts = [f"{ast.get_docstring(node)}\n", _values(source), _fields(node), _made_by(node), _methods(node)]
        return "\n".join(part for part in parts if part)
    value, told = _alias(name)
    return _python(f"{name} = {ast.unparse(value)}") + (f"\n{told}\n" if told else "")


def _python(code: str) -> str:
    return f"```python\n{code}\n```\n"


def _signature(function: ast.FunctionDef, name: str | None = None) -> str:
    arguments = function.args
    arguments.args = [each for each in arguments.args if each.arg != "self"]
    back = "" if function.returns is None or name is not None else f" -> {ast.unparse(function.returns)}"
    line = f"{name or function.name}({ast.unparse(arguments)}){back}"
    if len(line) <= LONGEST_SIGNATURE:
        return line
    # A comma within brackets does not part two arguments.
    arguments_apart = re.sub(r", (?![^\[(]*[\])])", ",\n    ", ast.unparse(arguments))
    return f"{function.name}(\n    {arguments_apart},\n){back}"


def _values(source: str) -> str:
    """Return an enumeration's values, each with the comment behind it."""
    members = re.findall(r'^    [A-Z_]+ = "(\w+)"(?:  # (.*))?$', source, re.MULTILINE)
    return _table(("value", "meaning"), [(f"`{value}`", meaning) for value, meaning in members]) if members else ""


def _fields(node: ast.ClassDef) -> str:
    rows = []
    for each in node.body:
        if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name):
            kind = re.sub(r"Annotated\[(.*?), msgspec\.Meta\(.*?\)\]", r"\1", ast.unparse(each.annotation))
            default = "" if each.value is None else f"`{ast.unparse(each.value)}`"
            rows.append((f"`{each.target.id}`", f"`{kind}`", default))
    return _table(("field", "type", "default"), rows) if rows else ""


def _made_by(node: ast.ClassDef) -> str:
    made = [each for each in _functions(node) if each.name == "__init__"]
    return _python(_signature(made[0], node.name)) if made else ""


def _methods(node: ast.ClassDef) -> str:
    lines = []
    for each in _functions(node):
        if not each.name.startswith("_"):
            is_property = any(isinstance(by, ast.Name) and by.id == "property" for by in each.decorator_list)
            call = each.name if is_property else " ".join(_signature(each).split())
            lines.append(f"- `{call}`: {' '.join((ast.get_docstring(each) or '').split())}\n")
    return "".join(lines)


def _functions(node: ast.ClassDef) -> Iterator[ast.FunctionDef]:
    return (each for each in node.body if isinstance(each, ast.FunctionDef))


def _alias(name: str) -> tuple[ast.expr, str]:
    """Return what the type alias `name` stands for, and the text below it."""
    for package in ("messages", "discrepancy"):
        for path in sorted((HOME / package).rglob("*.py")):
            body = ast.parse(path.read_text(encoding="utf-8")).body
            for each, below in zip(body, [*body, ast.Pass()][1:], strict=True):
                if isinstance(each, ast.Assign) and ast.unparse(each.targets[0]) == name:
                    told = ast.literal_eval(below.value) if isinstance(below, ast.Expr) else ""
                    return each.value, inspect.cleandoc(told)
    raise ValueError(f"{name}: no such alias")


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


if __name__ == "__main__":
    if sys.argv[1:] == ["--check"]:
        is_new = PAGE.read_text(encoding="utf-8") == page()
        sys.exit(0 if is_new else f"{PAGE}: out of date; run python docs/make_api.py")
    PAGE.write_text(page(), encoding="utf-8")
