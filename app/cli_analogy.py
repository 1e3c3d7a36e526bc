"""The commands `guise analogy`: expressions from one face to another, on 3-D heads."""

from __future__ import annotations

import typer

from app.cli_mesh import mesh
from app.cli_options import help_without_command

analogy = typer.Typer(help="Expressions from one face to another, offline.")
analogy.callback(invoke_without_command=True)(help_without_command)
analogy.add_typer(mesh, name="mesh")
