"""The commands `guise analogy`: expression transfer between 3-D heads, photos and clips."""

from __future__ import annotations

import typer

from guise.app.cli.former import Command
from guise.app.cli.image import animate, image
from guise.app.cli.mesh import mesh
from guise.app.cli.options import help_without_command

analogy = typer.Typer(
    name="analogy", help="Transfer expressions from one face to another: 3-D heads, photos and clips."
)
analogy.callback(invoke_without_command=True)(help_without_command)
analogy.add_typer(mesh, name="mesh")
analogy.command(cls=Command)(image)
analogy.command(cls=Command)(animate)
