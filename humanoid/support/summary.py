"""The representation of an object at a prompt, and as a small table in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

Facts = Sequence[tuple[str, object]]


class Summarised:
    """An object with a name and facts, which are at hand without work: `__repr__` and `_repr_html_`.

    A dataclass that is one is declared with `repr=False`.
    """

    def _called(self) -> str:
        """Name of this object; empty where it has none."""
        return ""

    def _facts(self) -> Facts:
        """Names and values."""
        raise NotImplementedError

    def __repr__(self) -> str:
        told = ", ".join(f"{name} {value}" for name, value in self._facts())
        return f"<{self._title()}: {told}>"

    def _repr_html_(self) -> str:
        return table_html(self._title(), (), self._facts())

    def _title(self) -> str:
        return f"{type(self).__name__} {self._called()}".strip()


def table_html(title: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A title over a table; all columns but the first are right-aligned where there is a head."""
    top = f"<thead>{_line('th', head)}</thead>" if head else ""
    body = "".join(_line("td", row, "right" if head else "left") for row in rows)
    return f"<b>{escape(title)}</b><table>{top}<tbody>{body}</tbody></table>"


def _line(tag: str, cells: Sequence[object], side: str = "right") -> str:
    sides = ["left", *[side] * (len(cells) - 1)]
    cell = '<{tag} style="text-align: {side}">{text}</{tag}>'
    line = (cell.format(tag=tag, side=s, text=escape(str(c))) for s, c in zip(sides, cells, strict=True))
    return f"<tr>{''.join(line)}</tr>"
