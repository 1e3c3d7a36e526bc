"""What a call of the API has in common with all others: it takes only options that it knows, can be cancelled, and says
what went wrong in Python's words.

The engine names what a user can change as the command line does: `--renderer cpu`, `guise people find`.  That is a
notation with one reading in Python, as each command has its call (`COMMANDS`) and each option a parameter of the same
name (`RENAMED` are those that Python has to call otherwise).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache, wraps
from importlib import import_module
from inspect import Parameter, signature, unwrap
from typing import Any, ParamSpec, TypeVar

from guise.common.errors import GuiseError
from guise.common.progress import Progress, Say, mute, silent

P = ParamSpec("P")
R = TypeVar("R")

# By command the call that does the same, and in which module below guise.api it is.
COMMANDS: dict[str, str] = {
    "enroll": "faces.enroll",
    "info": "faces.info",
    "landmarks": "points.landmarks_file",
    "people find": "faces.find_people",
    "people list": "faces.people",
    "people show": "faces.info",
    "people rename": "faces.rename_person",
    "people delete": "faces.delete_people",
    "swap": "videos.swap_file",
    "puppet": "videos.puppet_file",
    "deidentify": "hiding.deidentify",
    "measure": "hiding.measure",
    "live": "live.LiveSession",
    "studio": "tools.studio",
    "rig from-video": "rigs.rig_from_video",
    "rig live": "rigs.rig_live",
    "analogy image": "photos.transfer_photo",
    "analogy animate": "photos.animate_photo",
    "analogy mesh transfer": "heads.transfer_mesh",
    "analogy mesh rig": "heads.transfer_rig",
    "analogy mesh sequence": "heads.transfer_sequence",
    "analogy mesh register": "heads.register_mesh",
    "analogy mesh landmarks": "heads.mesh_landmarks",
    "analogy mesh preview": "heads.preview_mesh",
    "demo": "tools.demo",
    "doctor": "tools.doctor",
    "bench": "tools.bench",
}
RENAMED = {"force": "overwrite", "from": "start", "to": "end", "o": "output"}
_OPTION = re.compile(r"(?<![\w-])(?:--([a-z][a-z0-9-]*)|-(o)\b)(?:[ =](?=\S)([^\s,;()]*[^\s,;().:]))?")
_PLACE = r"(?:[A-Z][A-Z0-9_]*\b|[^\s,;()-][^\s,;()]*[./][^\s,;()]*\w)"  # a metavariable or a file
_COMMAND = re.compile(
    rf"`?\bguise ({'|'.join(sorted(COMMANDS, key=len, reverse=True))})\b"
    rf"((?: (?:{_PLACE}|--?[a-z-]+(?: {_PLACE})?(?![a-z])))*)`?"
)


class Cancelled(GuiseError):
    """A call that was cancelled."""


class _Cancel(BaseException):
    """Goes through all that survives the failure of a part."""


def call(function: Callable[P, R]) -> Callable[P, R]:
    """A function of the API, with what all have in common."""
    known = parameters_of(function)

    @wraps(function)
    def run(*given: P.args, **options: P.kwargs) -> R:
        for name, value in options.items():
            if name not in known:
                raise TypeError(f"{function.__name__}() got an unexpected keyword argument {name!r}")
            _require_choice(name, value, known[name])
        with speaking:
            return function(*given, **_watched(options))

    return run


def _require_choice(name: str, value: object, kind: str) -> None:
    """Raise GuiseError for a value that is none of those of a parameter's type, as it is written.

    >>> _require_choice("eyes", "own", "Literal['donor', 'source'] | None")
    Traceback (most recent call last):
    guise.common.errors.GuiseError: eyes must be "donor" or "source", got 'own'
    """
    found = re.fullmatch(r"Literal\[(.*?)\]( \| None)?", kind)
    if found is None or (value is None and found[2]):
        return
    able = re.findall(r"[^\s,'\"]+", found[1])
    if value not in able:
        *others, last = [f'"{one}"' for one in able]
        raise GuiseError(f"{name} must be {', '.join(others)} or {last}, got {value!r}")


def parameters_of(function: Callable[..., Any]) -> dict[str, str]:
    """The names that a call takes, those of its options among them, each with its type as it is written."""
    found: dict[str, str] = {}
    for name, one in signature(function).parameters.items():
        kind = str(one.annotation)
        if one.kind is Parameter.VAR_KEYWORD:
            options = unwrap(function).__globals__[kind.removeprefix("Unpack[").removesuffix("]")]
            found |= {
                key: getattr(hint, "__forward_arg__", str(hint))
                for key, hint in options.__annotations__.items()
            }
        elif name != "self":
            found[name] = kind
    return found


class _Speaking:
    """Inside, errors speak Python, and a cancelled call raises `Cancelled`."""

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if error is None:
            return
        if isinstance(error, GuiseError):
            error.args = (in_python(str(error)), *error.args[1:])
        elif isinstance(error, _Cancel):
            raise Cancelled("the call was cancelled; nothing was written") from None


speaking = _Speaking()


def _watched(options: dict[str, Any]) -> dict[str, Any]:
    """The options with notes in Python's words, and progress that ends the work once it is cancelled."""
    cancel, tell, say = options.pop("cancel", None), options.get("progress", silent), options.get("say", mute)

    def told(stage: str, share: float) -> None:
        if cancel is not None and cancel.is_set():
            raise _Cancel
        tell(stage, share)

    def said(text: str) -> None:
        say(in_python(text))

    more: dict[str, Any] = {} if cancel is None and tell is silent else {"progress": told}
    return options | more | ({} if say is mute else {"say": said})


def watch_of(options: dict[str, Any]) -> tuple[Progress, Say]:
    """What is called with progress and with notes, taken out of the options."""
    return options.pop("progress", silent), options.pop("say", mute)


def in_python(text: str) -> str:
    """A sentence of the engine in Python's words.

    >>> in_python("use --force to replace it, -o to write elsewhere or choose --renderer cpu")
    'use overwrite=True to replace it, output=... to write elsewhere or choose renderer="cpu"'
    >>> in_python("give a number: guise people find draws them")
    'give a number: guise.find_people() draws them'
    """
    return _OPTION.sub(_argument, _COMMAND.sub(_as_call, text))


def _as_call(found: re.Match[str]) -> str:
    """The call of a command with what follows it."""
    given = [_value(word) for word in _OPTION.sub("", found[2]).split()]
    options = [_argument(option) for option in _OPTION.finditer(found[2])]
    return f"guise.{COMMANDS[found[1]].partition('.')[2]}({', '.join([*given, *options])})"


def _argument(found: re.Match[str]) -> str:
    """An option as an argument, with the word after it if that is its value."""
    name, word = found[1] or found[2], found[3] or ""
    name, value = _parameter(name)
    rest = found[0][len(found[0]) - len(word) - 1 :] if word else ""
    kind = _kinds().get(name)
    if kind is None:
        return found[0]
    if value:
        return f"{name}={value}{rest}"
    if re.search(r"\bbool\b", kind):
        return f"{name}=True{rest}"
    is_value = (
        repr(word) in kind.replace('"', "'")
        or re.search(r"^[A-Z][A-Z0-9_:=.]*$|[\d./:]", word) is not None
        or found.string[found.end() :].startswith(":")  # and what is wrong with it
    )
    return f"{name}={_value(word)}" if word and is_value else f"{name}=...{rest}"


def _parameter(option: str) -> tuple[str, str]:
    """The parameter that an option is, and its value if the name tells that."""
    name = RENAMED.get(option, option.replace("-", "_"))
    return (name.removeprefix("no_"), "False") if name.startswith("no_") else (name, "")


def _value(word: str) -> str:
    """A word as Python writes it; what stands for a value stays."""
    return word if re.fullmatch(r"[A-Z][A-Z0-9_.]*|[\d.]+", word) else f'"{word}"'


@cache
def _kinds() -> dict[str, str]:
    """By name the types of all parameters of all calls that stand for a command."""
    return {name: kind for command in COMMANDS for name, kind in parameters_of(call_of(command)).items()}


def call_of(command: str) -> Callable[..., Any]:
    """What does in Python as a command does; a class is called by its constructor."""
    module, name = COMMANDS[command].split(".")
    found: Callable[..., Any] = getattr(import_module(f"guise.api.{module}"), name)
    return vars(found)["__init__"] if isinstance(found, type) else found
