"""Options that are declared once, as fields of a request: the Python side of a declaration.

`kinemode.request` has the declarations, `kinemode.flags` the command-line side.
"""

from __future__ import annotations

import inspect
import os
import re
import textwrap
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

from humanoid.support.errors import InputError, misplaced, shown
from kinemode import kinds
from kinemode.kinds import Kind
from kinemode.named import named_pairs, words_of

Given = ParamSpec("Given")
Request = TypeVar("Request")
Result = TypeVar("Result")

MOST = 2**63 - 1  # of whole numbers
_KEY = "option"
_WIDTH = 120
_FLAG_NAME = re.compile(r"--([a-z]+(?:-[a-z]+)*)")
_ANYTHING = Kind(lambda _: True, "a value, NAME=VALUE texts, or a mapping by name")  # checked where it is read
KINDS: dict[str, Kind] = {
    "bool": kinds.FLAG,
    "int": kinds.WHOLE,
    "float": kinds.NUMBER,
    "str": kinds.TEXT,
    "PathLike": Kind(kinds.is_path, "the path of a file"),
    "OutPath": Kind(kinds.can_be_opened, "the path of a file to write"),
    "MarkersLike": Kind(kinds.is_path, "the name of a set of markers, or the path of a TOML file"),
    "SubjectLike": kinds.SUBJECT,
    "Clips": Kind(
        kinds.are_clips,
        "a path, a list of paths, an array (T, H, W, 3), an iterator of pictures, or a mapping of names to such",
    ),
    "Keypoints": Kind(
        kinds.are_keypoints, "a path, a list of paths, an array (T, K, 3), or a mapping of names to such"
    ),
    "Named": kinds.FILES,
    "Pairs": Kind(
        kinds.are_pairs, "a text LEFT=RIGHT, a list of such texts, or a mapping of left cameras to right ones"
    ),
    "Cameras": kinds.CAMERAS,
    "Persons": kinds.PERSONS,
    "Sizes": _ANYTHING,
    "Rates": _ANYTHING,
    "Offsets": _ANYTHING,
    "Layout": kinds.LAYOUT,
    "CueNames": kinds.NAMES,
    "Names": kinds.NAMES,
    "Changes": kinds.CHANGES,
    "Direction": Kind(kinds.or_none(kinds.is_text), "a text"),
    "MotionLike": kinds.MOTION,
    "Reporter": kinds.REPORTER,
    "Ready": Kind(callable, "a function of a text"),
    "Size": Kind(kinds.or_none(kinds.is_size), "(width, height) in pixels"),
    "Jitter": Kind(kinds.or_none(kinds.is_jitter), "a number of pixels, or a mapping of camera names to numbers"),
    "Device": Kind(
        kinds.either(kinds.is_whole, kinds.is_path),
        "the number of a camera, or the path of a video or of a folder of images",
    ),
    "KeypointsOrSource": Kind(
        kinds.or_none(kinds.either(callable, kinds.is_path)), "the path of a keypoint file, or a function"
    ),
    "Camera": Kind(
        kinds.instance_of("estimator.data.cameras.camera", "Camera"),
        "a kinemode.Camera; cameras takes the path of a camera file",
    ),
    "ReferenceLike": kinds.REFERENCE,
    "CameraName": Kind(kinds.is_text, "the name of a camera"),
    "RunLike": Kind(kinds.RUN, "a run, or the path of a run file"),
    "KnownMotion": Kind(lambda value: value is not None and kinds.REFERENCE.fits(value), kinds.REFERENCE.taken),
    "JointNames": Kind(kinds.or_none(kinds.are_texts), "names of joints, or parts of them"),
    "LandmarkNames": Kind(kinds.or_none(kinds.are_texts), "names of landmarks"),
    "Scales": Kind(kinds.or_none(kinds.is_mapping), "a mapping of joints to scales"),
    "FleshShape": Kind(kinds.or_none(kinds.is_mapping), "a mapping of parts to nine parameters each"),
    "SceneLike": kinds.settings("SceneSettings"),
    "ViewLike": kinds.settings("ViewSettings"),
    "ErrorsLike": kinds.settings("DetectorSettings"),
    "BoardSize": Kind(kinds.is_pair, 'a text such as "9x6", or two whole numbers'),
    "Rig": Kind(lambda value: value is not None and kinds.CAMERAS.fits(value), kinds.CAMERAS.taken),
    "LimbNames": Kind(kinds.are_texts, "a text with commas, or a list of names"),
    "Formats": Kind(kinds.are_texts, "names of formats, or one text with commas"),
    "Rows": Kind(lambda value: not isinstance(value, (int, float)), "a CSV or TOML file, or a mapping for each clip"),
}
"""The kind of values of a type, by the type's name in a declaration."""
_PATHS = frozenset({"PathLike", "MarkersLike", "Cameras", "Changes", "SubjectLike", "ReferenceLike", "MotionLike"})


@dataclass(frozen=True)
class Option:
    """A declared option.

    type: of its values, as annotated. help: for people who use the command line or Python; python: what only Python
    takes. low, high, unit: range of a number. files: what the files are called that it names by camera, "" where it
    names none. kept: whether a run keeps what was given. called: its name on the command line where that is another.
    """

    name: str
    type: str
    default: Any
    help: str
    python: str = ""
    low: float | None = None
    high: float | None = None
    unit: str = ""
    files: str = ""
    kept: bool = True
    called: str = ""

    @property
    def is_needed(self) -> bool:
        """Whether it has no default."""
        return self.default is MISSING

    @property
    def flag(self) -> str:
        """Its name on the command line."""
        return (self.called or self.name).replace("_", "-")

    @property
    def parts(self) -> tuple[str, ...]:
        """The types that its values may have."""
        return tuple(part.strip() for part in self.type.split("|"))

    @property
    def choices(self) -> tuple[str, ...]:
        """The keywords that it accepts."""
        literals = [part for part in self.parts if part.startswith("Literal[")]
        return tuple(re.findall(r"'([^']*)'", "".join(literals)))  # quoted as annotations are stored

    @property
    def is_read(self) -> bool:
        """Whether a text is the path of a file to read, or a keyword."""
        return self.names_a_file and not {"SubjectLike", "MotionLike"} & {*self.parts}

    @property
    def names_a_file(self) -> bool:
        """Whether a text is the path of one file, or a keyword."""
        return not _PATHS.isdisjoint(self.parts)

    @property
    def taken(self) -> str:
        """The allowed values, for messages."""
        texts = [KINDS[part].taken for part in self.parts if part in KINDS]
        if self.choices and not texts:
            return f"one of {', '.join(self.choices)}"
        *others, last = [*texts, *self.choices]
        return f"{', '.join(others)} or {last}" if others else last

    @property
    def range(self) -> str:
        """The range of its numbers, empty where there is none."""
        if self.low is None:
            return ""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.low:g} or more{unit}" if self.high is None else f"{self.low:g} to {self.high:g}{unit}"

    def check(self, value: Any) -> None:
        """Raise InputError for a value of the wrong kind or out of range."""
        if value is None and "None" in self.parts:
            return
        if isinstance(value, str) and self.choices and value not in self.choices and "str" not in self.parts:
            raise InputError(self.name, f"{shown(value)} is unknown", remedy=self.taken)
        if not (isinstance(value, str) and value in self.choices):
            if not any(KINDS[part].fits(value) for part in self.parts if part in KINDS):
                raise misplaced(self.name, value, self.taken)
            if {"int", "float"} & {*self.parts}:
                self.in_range(value)

    def in_range(self, value: Any) -> Any:
        """A number, unchanged; raises InputError where it is out of range."""
        low = -MOST if self.low is None else self.low
        high = MOST if self.high is None else self.high
        if not low <= value <= high:
            allowed = self.range or f"at most {MOST}"
            raise InputError(self.name, f"must be {allowed}, got {shown(value)}")
        return value

    def words(self, value: Any) -> tuple[str, ...]:
        """A value as arguments of the command line; the option's name in capitals where it has no such form."""
        if isinstance(value, bool):
            return ()
        if self.files:
            return tuple(self._file_words(value))
        if isinstance(file := getattr(value, "file", getattr(value, "source", value)), (str, os.PathLike)):
            value = file  # of a run, a subject or a motion
        if {"CueNames", "Names"} & {*self.parts} and not isinstance(value, str):
            return (",".join(value),)
        if self.names_a_file or self.name == "layout":
            return (_absolute(value),) if isinstance(value, (str, os.PathLike)) else (self.placeholder,)
        return words_of(value)

    @property
    def placeholder(self) -> str:
        """The placeholder in a command for a value that only a program has."""
        return self.name.upper()

    def _file_words(self, value: Any) -> Iterator[str]:
        several = isinstance(value, (list, tuple, set, frozenset, Mapping))
        values = (
            named_pairs(value) if isinstance(value, Mapping) else [(None, v) for v in (value if several else [value])]
        )
        for name, given in values:
            if not isinstance(given, (str, os.PathLike)):
                path = self.placeholder
            else:
                own, separator, path = str(given).partition("=")
                if not separator or Path(given).exists():
                    path = str(given)
                else:
                    name = own
            where = _absolute(path)
            yield where if name is None else f"{name}={where}"


def _absolute(given: str | os.PathLike[str]) -> str:
    """A file's path; other names are unchanged."""
    return os.path.abspath(given) if Path(given).exists() else os.fspath(given)


def about(help: str, **more: Any) -> Mapping[str, Any]:
    """Metadata of a field that is an option without a default; more: attributes of `Option`."""
    return {_KEY: {"help": help, **more}}


def option(default: Any, help: str, **more: Any) -> Any:
    """A field of a request that is an option; more: attributes of `Option`."""
    return field(default=default, metadata=about(help, **more))


def again(request: type, name: str, **default: Any) -> Any:
    """The option of a request as a field of another; default: where it is another."""
    declared = next(f for f in fields(request) if f.name == name)
    return field(default=default.get("default", declared.default), metadata=declared.metadata)


def options_of(request: type) -> Mapping[str, Option]:
    """The options of a request by name, in the order of its fields."""
    return _options_of(cast(Hashable, request))


@cache
def _options_of(request: Any) -> Mapping[str, Option]:
    return {
        f.name: Option(f.name, str(f.type), f.default, **f.metadata[_KEY])
        for f in fields(request)
        if _KEY in f.metadata
    }


def words_given(request: Any) -> dict[str, tuple[str, ...]]:
    """The non-default values of a request, as arguments of the command line by flag name."""
    given = {o: getattr(request, o.name) for o in options_of(type(request)).values() if o.kept}
    return {o.flag: o.words(value) for o, value in given.items() if o.is_needed or not _same(value, o.default)}


def words_kept(request: Any) -> dict[str, tuple[str, ...]]:
    """The part of a request that a run stores: `words_given`, and the name of the file that was to be written."""
    return words_given(request) | ({} if request.out is None else {"out": (Path(request.out).name,)})


def _same(value: Any, default: Any) -> bool:
    """Whether a value is the default, as changes that change nothing are."""
    equal = isinstance(value, (str, int, float)) and value == default
    return value is default or equal or (isinstance(value, Mapping) and not value)


def check_options(request: Any) -> None:
    """Raise InputError for an option of a request of the wrong kind or out of range."""
    for name, declared in options_of(type(request)).items():
        declared.check(getattr(request, name))


def shared(request: Any, kind: type[Request], **changes: Any) -> Request:
    """A request of another kind with the options that both have; changes: options that it has otherwise."""
    own = {name: getattr(request, name) for name in options_of(kind) if name in options_of(type(request))}
    return kind(**own | changes)


def takes(
    request: Callable[Given, Request],
) -> Callable[[Callable[[Request], Result]], Callable[Given, Result]]:
    """A function of a request as a function of its options, which are checked and documented; its docstring has the
    word OPTIONS where their description goes."""

    def decorated(function: Callable[[Request], Result]) -> Callable[Given, Result]:
        def called(*args: Given.args, **kwargs: Given.kwargs) -> Result:
            return function(_asked(request, function.__name__, args, kwargs))

        _document(called, function, inspect.signature(request))
        called.__doc__ = with_options(function.__doc__, request)
        return called

    return decorated


def constructed_by(
    request: Callable[Given, Request],
) -> Callable[[Callable[[Any, Request], None]], Callable[Concatenate[Any, Given], None]]:
    """As `takes`, for the constructor of a class, whose docstring `with_options` completes."""

    def decorated(function: Callable[[Any, Request], None]) -> Callable[Concatenate[Any, Given], None]:
        def called(self: Any, /, *args: Given.args, **kwargs: Given.kwargs) -> None:
            function(self, _asked(request, type(self).__name__, args, kwargs))

        own = inspect.signature(request)
        itself = inspect.Parameter("self", inspect.Parameter.POSITIONAL_ONLY)
        _document(called, function, own.replace(parameters=[itself, *own.parameters.values()]))
        return called

    return decorated


def _asked(request: Callable[..., Request], name: str, args: Any, kwargs: Any) -> Request:
    try:
        inspect.signature(request).bind(*args, **kwargs)
    except TypeError as error:
        raise TypeError(f"{name}() {error}") from None
    asked = request(*args, **kwargs)
    check_options(asked)
    return asked


def _document(called: Any, function: Any, signature: inspect.Signature) -> None:
    returned = inspect.signature(function).return_annotation
    called.__name__, called.__qualname__, called.__module__ = (
        function.__name__, function.__qualname__, function.__module__,
    )  # fmt: skip
    called.__signature__ = signature.replace(return_annotation=returned)
    called.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()} | {"return": returned}


def with_options(docstring: str | None, request: Any) -> str:
    """A docstring with the description of a request's options in place of the word OPTIONS."""
    return (docstring or "").replace("OPTIONS", described(request))


def described(request: Any) -> str:
    """The options of a request for a docstring, indented as its body."""
    lines = []
    for declared in options_of(request).values():
        text = f"{declared.name}: {in_python(declared.help)} {declared.python}".strip()
        text += f" Range: {declared.range}." if declared.range else ""
        lines += textwrap.wrap(
            text,
            _WIDTH,
            initial_indent="    ",
            subsequent_indent=" " * 8,
            break_on_hyphens=False,
            break_long_words=False,
        )
    return "\n".join(lines).strip()


def in_python(help: str) -> str:
    """A text with the names of Python's arguments in place of flags, but for those in commands."""
    parts = help.split("`")
    parts[::2] = [_FLAG_NAME.sub(lambda flag: f"`{flag[1].replace('-', '_')}`", part) for part in parts[::2]]
    return "`".join(parts)
