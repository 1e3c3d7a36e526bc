"""The commands `guise people`: who is in a video, and who is saved on this computer."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from guise.app.cli.console import Stages
from guise.app.cli.options import Force, Shown, Video, help_without_command, takes

Name = Annotated[str, typer.Argument(metavar="NAME", help="A name of `guise people list`.")]


class _FindByDefault(TyperGroup):
    """What is no command is a video whose people are found: `guise people VIDEO`."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        known = args and (args[0] in self.commands or args[0].startswith("-"))
        return super().resolve_command(ctx, args if known else ["find", *args])


people = typer.Typer(
    name="people",
    cls=_FindByDefault,
    help="Find the people in a video, and manage those who are saved on this computer.",
)
people.callback(invoke_without_command=True)(help_without_command)


@people.command()
@takes
def find(
    *,
    video: Video,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="OUT.png", help="Picture of the people; default: VIDEO-people.png."
        ),
    ] = None,
    force: Force = False,
    console: Shown,
) -> None:
    """Find the people in a video and draw them with the numbers that `--map` and `--person` take."""
    from guise.app.media import open_input
    from guise.app.media.pictures import save_picture
    from guise.app.people.finding import find_people, people_sheet
    from guise.common.files import fitting_name, require_free

    output = output or Path(fitting_name(video.stem, "-people.png"))
    require_free(output, force=force)
    with open_input(video) as media, Stages(console) as stages:
        found = find_people(media, lambda share: stages("faces", share))
    rows = [
        [
            str(p.number),
            f"{len(p.frames)} of {found.count}",
            f"{p.frames[0]} to {p.frames[-1]}",
            f"{p.width:.0f}",
        ]
        for p in found.people
    ]
    if rows:
        save_picture(output, people_sheet(found))
        console.grid("", ["person", "frames", "from", "pixels wide"], rows)
    console.say(f"{output} shows them." if rows else f"Nobody is in {video} for long enough.")
    people = [
        {
            "number": p.number, "frames": len(p.frames), "first": int(p.frames[0]), "last": int(p.frames[-1]),
            "width": round(p.width, 1), "first_x": round(p.first_x, 1),
        }
        for p in found.people
    ]  # fmt: skip
    console.result({"frames": found.count, "people": people, "picture": str(output) if rows else None})


@people.command("list")
@takes
def list_people(console: Shown) -> None:
    """List the people who are saved on this computer, and where."""
    from guise.app.people.kept import everybody, folder

    found = everybody()
    rows = [[p.name, p.origin, f"{p.kept:%Y-%m-%d %H:%M}", f"{p.size / 1e6:.1f} MB"] for p in found]
    if rows:
        console.grid("", ["name", "from", "saved", "size"], rows)
    console.say(
        f"Saved in {folder()}, which only you can read: the models are biometric data."
        if found
        else f"Nobody is saved in {folder()} yet: guise enroll VIDEO saves a person."
    )
    console.result({"folder": str(folder()), "people": [person.as_json() for person in found]})


@people.command()
@takes
def show(name: Name, console: Shown) -> None:
    """Show what is in a person's model, and where it is."""
    from guise.app.people.info import describe
    from guise.app.people.kept import named

    person = named(name)
    facts = describe(person.path)[1]
    console.table(str(person.path), facts.as_rows())
    console.result(asdict(facts))


@people.command()
@takes
def rename(
    *,
    name: Name,
    new: Annotated[str, typer.Argument(metavar="NEW", help="The new name.")],
    console: Shown,
) -> None:
    """Rename a person."""
    from guise.app.swapping.donors import rename_kept

    person = rename_kept(name, new)
    console.say(f"{name} is now {person.name}.")
    console.result(person.as_json())


@people.command()
@takes
def delete(
    *,
    names: Annotated[list[str] | None, typer.Argument(metavar="NAME...", help="The people.")] = None,
    all_people: Annotated[bool, typer.Option("--all", help="Delete everybody.")] = False,
    console: Shown,
) -> None:
    """Delete people's models."""
    from guise.app.people import kept

    if bool(names) == all_people:
        raise typer.BadParameter("give the names of the people to delete, or --all")
    gone = kept.delete([p.name for p in kept.everybody()] if all_people else names or [])
    console.say("Deleted: " + (", ".join(person.name for person in gone) or "nobody was saved"))
    console.result({"deleted": [person.as_json() for person in gone]})
