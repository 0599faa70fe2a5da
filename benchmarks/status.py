"""The tables of docs/history/status.md: one a system, one line a measure, from the registry and figures.toml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.registry import Measure, by_name, find
from humanoid.support.errors import InputError
from humanoid.support.files import read_toml, replacing

FIGURES = Path(__file__).with_name("figures.toml")
STATUS = Path(__file__).resolve().parents[1] / "docs" / "history" / "status.md"
NOTES = "measures.md"
MARK = "<!-- What follows is written by `python -m benchmarks --write-status` from benchmarks/figures.toml. -->"
COLUMNS = ("what", "target", "figure", "command")
_KEYS = {"measure", "options", "command", *COLUMNS}


@dataclass(frozen=True)
class Line:
    """One line of a table; `command` is what measures it."""

    what: str
    target: str
    figure: str
    command: str

    def cells(self) -> tuple[str, ...]:
        """Cells by `COLUMNS`. Text that is not a command is plain."""
        runs = self.command.split()[0] in ("python", "pytest", "kinemode", "make")
        return self.what, self.target, self.figure, f"`{self.command}`" if runs else self.command


@dataclass(frozen=True)
class System:
    """A group of measures."""

    name: str
    lines: tuple[Line, ...]

    @property
    def anchor(self) -> str:
        """The anchor of its heading, as GitHub names it."""
        return self.name.lower().replace(" ", "-")


def load(path: Path = FIGURES) -> list[System]:
    """The systems of a file of figures.

    Raises
    ------
    InputError: the file is not such a TOML file, or a line has no figure or names no measure and no command.
    """
    content = read_toml(path, remedy="see benchmarks/figures.toml")
    return [
        System(system["name"], tuple(_line(path, entry) for entry in system.get("line", ())))
        for system in content.get("system", ())
    ]


def _line(path: Path, entry: Mapping[str, Any]) -> Line:
    place = f"{path.name}, {entry.get('what', 'a line')!r}"
    if unknown := set(entry) - _KEYS:
        raise InputError(place, f"has {', '.join(sorted(unknown))}", remedy=f"some of {', '.join(sorted(_KEYS))}")
    if not entry.get("what") or not entry.get("figure"):
        raise InputError(place, "has no what or no figure", remedy="both are needed")
    if ("measure" in entry) == ("command" in entry):
        raise InputError(place, "needs a measure or a command", remedy="exactly one of them")
    measure: Measure | None = find(entry["measure"]) if "measure" in entry else None
    target = entry.get("target", measure.target if measure else "")
    if measure is None:
        return Line(entry["what"], target, entry["figure"], entry["command"])
    command = f"python -m benchmarks {measure.name} {entry.get('options', '')}".rstrip()
    return Line(entry["what"], target, entry["figure"], command)


def table(system: System) -> list[str]:
    """The section of a system, in Markdown."""
    rows = [COLUMNS, tuple("---" for _ in COLUMNS), *(line.cells() for line in system.lines)]
    written = ["| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in rows]
    return [f"## {system.name}", "", f"[Reasons and details]({NOTES}#{system.anchor}).", "", *written, ""]


def with_tables(text: str, systems: Sequence[System]) -> str:
    """The page whose text is given, with these tables below its mark; what stands above it is kept.

    Raises
    ------
    InputError: the page has no mark.
    """
    above, mark, _ = text.partition(MARK)
    if not mark:
        problem = "has no mark below which tables are written"
        raise InputError("docs/history/status.md", problem, remedy=f"add the line {MARK}")
    sections = "\n".join(line for system in systems for line in table(system))
    return f"{above}{MARK}\n\n{sections}"


def measures_without_line(systems: Sequence[System]) -> list[str]:
    """The registered measures that have no line."""
    words = {line.command.split()[3] for system in systems for line in system.lines if "-m benchmarks" in line.command}
    return [name for name in by_name() if name not in words]


def write(path: Path = STATUS) -> list[str]:
    """Write the tables of the page; returns the names of the measures without a line."""
    systems = load()
    text = with_tables(path.read_text(encoding="utf-8"), systems)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return measures_without_line(systems)
