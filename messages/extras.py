"""What an installation without extras lacks, told in one line with what to install."""

from importlib import import_module

from messages.errors import UserError

EXTRA_OF = {
    "skimage": "rig",
    "mujoco": "lab",
    "matplotlib": "lab",
    "jinja2": "lab",
    "ezc3d": "c3d",
    "distributed": "cluster",
    "pysindy": "baselines",
    "sklearn": "baselines",
    "vqf": "baselines",
}
"""The extra of pyproject.toml that brings each package, by the name under which it is imported."""


def needs(what: str, package: str) -> None:
    """Return if `package` is installed; otherwise raise UserError: `what` needs the extra that brings it."""
    try:
        import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise
        extra = EXTRA_OF[package]
        raise UserError(f"{what} needs the extra '{extra}': pip install 'gaiteyes[{extra}]'") from error
