"""`gaiteyes platform`: the vibrating platform that identifies the inertia and the impedance of foot and ankle."""

import typer

from cli.platform_ankle import ankle
from cli.platform_identify import design, identify
from cli.platform_import import import_c3d
from cli.platform_simulate import simulate
from cli.platform_tables import tables
from cli.summaries import Commands

platform = typer.Typer(help="Identify inertia and impedance on the vibrating platform.", no_args_is_help=True)
platform.command()(simulate)
platform.command("import")(import_c3d)
platform.command()(tables)
platform.command()(identify)
platform.command()(design)
platform.add_typer(ankle, name="ankle", cls=Commands)
