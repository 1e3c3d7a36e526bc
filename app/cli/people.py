"""The commands `guise people`: who is kept on this computer."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from guise.app.cli.console import Console
from guise.app.cli.options import Json, Quiet, help_without_command

Name = Annotated[str, typer.Argument(metavar="NAME", help="A name of `guise people list`.")]

people = typer.Typer(
    name="people",
    help="The people kept on this computer: enrolled by name, at a camera, or from a video that was swapped.",
)
people.callback(invoke_without_command=True)(help_without_command)


@people.command("list")
def list_people(quiet: Quiet = False, json: Json = False) -> None:
    """List everybody who is kept, and say where."""
    from guise.app.people.kept import everybody, folder

    console, found = Console(quiet=quiet, json=json), everybody()
    rows = [[p.name, p.origin, f"{p.kept:%Y-%m-%d %H:%M}", f"{p.size / 1e6:.1f} MB"] for p in found]
    if rows:
        console.grid("", ["name", "from", "kept", "size"], rows)
    console.say(
        f"Kept in {folder()}, which only you may read: the models are biometric data."
        if found
        else f"Nobody is kept in {folder()} yet: guise enroll VIDEO keeps somebody."
    )
    console.result({"folder": str(folder()), "people": [person.as_json() for person in found]})


@people.command()
def show(name: Name, quiet: Quiet = False, json: Json = False) -> None:
    """Show what the model of a person holds, and where it is."""
    from guise.app.people.info import describe
    from guise.app.people.kept import named

    console, person = Console(quiet=quiet, json=json), named(name)
    facts = describe(person.path)[1]
    console.table(str(person.path), facts.as_rows())
    console.result(asdict(facts))


@people.command()
def rename(
    name: Name,
    new: Annotated[str, typer.Argument(metavar="NEW", help="Another name for the person.")],
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Give a person another name."""
    from guise.app.people import kept
    from guise.app.swapping.donors import gallery

    if new.strip() in gallery():
        raise kept.PeopleError(f"{new.strip()} is a face of the gallery: choose another name")
    console, person = Console(quiet=quiet, json=json), kept.rename(name, new)
    console.say(f"{name} is now {person.name}.")
    console.result(person.as_json())


@people.command()
def delete(
    names: Annotated[list[str] | None, typer.Argument(metavar="NAME...", help="The people.")] = None,
    all_people: Annotated[bool, typer.Option("--all", help="Everybody who is kept.")] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Delete the models of people."""
    from guise.app.people import kept

    if bool(names) == all_people:
        raise typer.BadParameter("give the names of the people to delete, or --all")
    console = Console(quiet=quiet, json=json)
    gone = kept.delete([p.name for p in kept.everybody()] if all_people else names or [])
    console.say("Deleted: " + (", ".join(person.name for person in gone) or "nobody was kept"))
    console.result({"deleted": [person.as_json() for person in gone]})
