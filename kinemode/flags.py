"""Options as flags of the command line: the types by which it reads them, and commands made from requests."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from kinemode.option import Option, options_of

SubjectOption = Annotated[str, Parameter(help="A built-in name (see `kinemode subjects`) or a URDF file.")]
Files = Annotated[list[str] | None, Parameter(consume_multiple=True, negative="")]
Ids = Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")]
Names = Annotated[list[str], Parameter(consume_multiple=True, negative="")]


def _no_option(_: object, value: str | None) -> None:
    if value is not None and value.startswith("--"):
        raise ValueError("x, y, z, -x, -y, -z or a direction is needed")


UpOption = Annotated[str | None, Parameter(allow_leading_hyphen=True, validator=_no_option)]
"""An axis, which may start with a minus."""
Flag = Annotated[bool, Parameter(negative="")]

TYPES: Mapping[str, Any] = {
    "PathLike": Path, "OutPath": Path, "SubjectLike": str, "Clips": Files, "Keypoints": Files, "Named": Files,
    "MarkersLike": str, "Pairs": Files,
    "Sizes": Files, "Rates": Files, "Offsets": Files, "Cameras": Path | None, "Persons": Ids,
    "Layout": str, "CueNames": str, "Names": Names, "Changes": Path | None,
    "Direction": UpOption, "ReferenceLike": Path | None,
    "Device": str, "MotionLike": Path, "KeypointsOrSource": Path | None, "Literal": Literal,
    "RunLike": Path, "KnownMotion": Path, "JointNames": str | None, "CameraName": str,
    "BoardSize": str, "Rig": Path, "LimbNames": str, "Formats": str, "Rows": Path,
}  # fmt: skip
"""The type by which the command line reads values, by the type's name in a declaration; it has no flag for others."""
_BUILT_IN = frozenset({"bool", "int", "float", "str", "None"})


@cache
def flag_types(request: type) -> Mapping[str, Any]:
    """The types of the flags of a request's options by name, without those that only Python has."""
    types = {}
    for name, declared in options_of(request).items():
        if all(part in TYPES or part in _BUILT_IN or part.startswith("Literal[") for part in declared.parts):
            types[name] = _type_of(declared)
    return types


def _type_of(declared: Option) -> Any:
    holder = type("Declared", (), {"__annotations__": {"value": declared.type}})
    hint = typing.get_type_hints(holder, globalns=dict(TYPES), include_extras=True)["value"]
    return Flag if hint is bool and declared.default is False else hint


def flags_of(
    request: type,
    *,
    needed: tuple[str, ...] = (),
    arguments: tuple[str, ...] = (),
    clips: tuple[str, str] | None = None,
    **defaults: Any,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A function of a request's options, given by name, as a command with a flag for each.

    needed: options that the command must be given. arguments: those that are given without a name, as clips are, of
    which clips has name and help where they are not the declared ones. defaults: values that differ from Python's.
    Options of its own that the function has come last.
    """

    def decorated(function: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(function, eval_str=True).parameters.values()
        parameters = [
            _parameter(options_of(request)[name], hint, needed, arguments, defaults)
            for name, hint in flag_types(request).items()
        ]
        parameters += [p for p in own if p.kind is p.KEYWORD_ONLY]
        if clips is not None:
            renamed: Any = Annotated[str, Parameter(name=clips[0], help=clips[1])]
            parameters = [p.replace(annotation=renamed) if p.name == "clips" else p for p in parameters]
        parameters.sort(key=lambda p: p.kind)  # arguments first

        def command(*files: Any, **given: Any) -> None:
            first = {"clips": files} if "clips" in flag_types(request) else dict(zip(arguments, files, strict=False))
            usual = {p.name: p.default for p in parameters if p.default is not p.empty}
            names = {o.flag.replace("-", "_"): name for name, o in options_of(request).items()}
            values: dict[str, Any] = usual | first | given
            function(**{names.get(name, name): value for name, value in values.items()})

        command.__name__, command.__doc__, command.__module__ = function.__name__, function.__doc__, function.__module__
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {p.name: p.annotation for p in parameters}
        return command

    return decorated


def _parameter(
    declared: Option, hint: Any, needed: tuple[str, ...], arguments: tuple[str, ...], defaults: Mapping[str, Any]
) -> inspect.Parameter:
    text = f"{declared.help} ({declared.range})" if declared.range else declared.help
    if declared.name == "clips":
        annotation: Any = Annotated[str, Parameter(name="clip", help=text)]
        return inspect.Parameter("clips", inspect.Parameter.VAR_POSITIONAL, annotation=annotation)
    default = defaults.get(declared.name, declared.default)
    if declared.name in needed or (declared.is_needed and declared.name not in defaults):
        default = inspect.Parameter.empty
    if declared.name in needed:
        hint = next(kind for kind in (*typing.get_args(hint), hint) if kind is not type(None))
    annotation = Annotated[hint, Parameter(help=text)]
    kind = inspect.Parameter.POSITIONAL_ONLY if declared.name in arguments else inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(declared.flag.replace("-", "_"), kind, default=default, annotation=annotation)
