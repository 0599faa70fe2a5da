"""A batch as one page: it works from a file, without a server or a network; thumbnails and reports lie beside it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import NamedTuple
from urllib.parse import quote

from estimator.trackers.frame_result import HARD, STATUS_MEANINGS
from humanoid.support.files import replacing
from viz.page_style import page_style, text
from viz.report.thumbnail import HEIGHT, STATUSES, WAITING, WIDTH, BatchEntry, known, look_ranks

_TEMPLATE = Path(__file__).with_name("batch.html")
_COUNTS = "frames", "hard", "unobserved"
_SHOWN = 0.75  # of a thumbnail's size: sharp on finer screens, too
_MEANINGS = {
    "look": "which clips to review first: failed ones, then those with the largest share of frames not to be trusted,"
    " then of hard ones. A clip without a number is tracked in all frames, and nothing speaks against it, or waits",
    "hard": STATUS_MEANINGS[HARD],
    "unobserved": STATUS_MEANINGS["unobserved"],
    "not trusted": "the share of frames that are not tracked: their 90 % bands are not to be trusted",
    "error": "mean distance of landmarks from the reference that the clip's row names",
    "time": "of the clock; processor: of all threads together",
}


class _Head(NamedTuple):
    """A column. numbers: whether it has numbers. falls: whether the first sorting puts the largest first."""

    name: str
    kind: str
    numbers: bool = True
    falls: bool = True


_HEADS = (
    _Head("look", "look", falls=False),
    _Head("clip", "clip", numbers=False, falls=False),
    _Head("status", "status", numbers=False, falls=False),
    _Head("person", "person", numbers=False, falls=False),
    _Head("frames", "frames"),
    _Head("hard", "hard"),
    _Head("unobserved", "unobserved"),
    _Head("not trusted [%]", "doubtful"),
    _Head("error [mm]", "error"),
    _Head("time", "time"),
    _Head("processor", "processor"),
)


def write_batch_page(path: str | Path, entries: Sequence[BatchEntry], title: str) -> Path:
    """Write the page and return its path. The file is written whole or not at all.

    Raises InputError where it cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(batch_page(entries, title).encode("utf-8", "replace"))
    return Path(path)


def batch_page(entries: Sequence[BatchEntry], title: str) -> str:
    """The text of the page, see `write_batch_page`. Clips to be reviewed come first, see `look_ranks`, then finished
    ones, then waiting ones."""
    ranks = look_ranks(entries)
    ranked = sorted(
        zip(entries, ranks, strict=True), key=lambda pair: (pair[1] or len(entries) + 1, pair[0].status == WAITING)
    )
    return Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=escape(f"{title} - kinemode batch"),
        style=page_style(),
        heading=escape(title),
        summary=escape(_summary(entries)),
        filters=_filters(entries, ranks),
        heads="".join(_head(head) for head in _HEADS),
        rows="\n".join(_row(entry, rank) for entry, rank in ranked),
        meanings="".join(f"<dt>{escape(name)}</dt><dd>{text(said)}.</dd>" for name, said in _MEANINGS.items()),
        width=round(_SHOWN * WIDTH),
        height=round(_SHOWN * HEIGHT),
    )


def _count(entries: Sequence[BatchEntry], status: str) -> int:
    return sum(entry.status == status for entry in entries)


def _summary(entries: Sequence[BatchEntry]) -> str:
    clips = f"{len(entries):,} clip{'' if len(entries) == 1 else 's'}"
    statuses = ", ".join(f"{count:,} {status}" for status in STATUSES if (count := _count(entries, status)))
    frames, hard, unobserved = (
        sum(getattr(e, name) or 0 for e in entries) for name in ("frames", "hard", "unobserved")
    )
    seconds, processor = (
        sum(value for e in entries if known(value := getattr(e, name))) for name in ("seconds", "processor_seconds")
    )
    return (
        f"{clips}: {statuses or 'none'}; {frames:,} frames, {hard:,} hard, {unobserved:,} unobserved; all together took"
        f" {duration(seconds)}, {duration(processor)} of processor time"
    )


def duration(seconds: float) -> str:
    """A time as "8.3 s", "12:34 min" or "1:02:03 h"."""
    if seconds < 59.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d} h" if hours else f"{minutes}:{rest:02d} min"


def _filters(entries: Sequence[BatchEntry], ranks: Sequence[int | None]) -> str:
    counts = {"all": len(entries), "to review": sum(rank is not None for rank in ranks)}
    counts |= {status: _count(entries, status) for status in STATUSES}
    return "".join(
        f'<button type="button" data-only="{name}" aria-pressed="{str(name == "all").lower()}">{name}'
        f" <span>{count:,}</span></button>"
        for name, count in counts.items()
    )


def _head(head: _Head) -> str:
    sorted_by = ' aria-sort="ascending"' if head.name == "look" else ""
    numbers, falls = (" n" if head.numbers else ""), (" data-falls" if head.falls else "")
    button = f'<button type="button">{head.name}</button>'
    cell = f'<th scope="col" class="{head.kind}{numbers}"{falls}{sorted_by}>{button}</th>'
    return cell + '<th class="picture"><span>picture</span></th>' if head.name == "look" else cell


def _row(entry: BatchEntry, rank: int | None) -> str:
    cells = [
        _number("look", rank, "" if rank is None else str(rank)),
        f'<td class="picture">{_thumbnail(entry)}</td>',
        f'<td class="clip">{_clip(entry)}</td>',
        f'<td class="status">{entry.status}</td>',
        f'<td class="person">{escape(entry.person)}</td>',
        *(_number(name, value := getattr(entry, name), f"{value or 0:d}") for name in _COUNTS),
        _number("doubtful", entry.doubtful, f"{100.0 * (entry.doubtful or 0.0):.1f}"),
        _number("error", entry.error, f"{1000.0 * (entry.error or 0.0):.1f}"),
        _number("time", entry.seconds, duration(entry.seconds or 0.0)),
        _number("processor", entry.processor_seconds, duration(entry.processor_seconds or 0.0)),
    ]
    of_kind = entry.status if rank is None else f"{entry.status} doubted"
    return f'<tr class="{of_kind}">{"".join(cells)}</tr>'


def _number(kind: str, value: float | None, shown: str) -> str:
    if value is None or not known(value):
        return f'<td class="{kind} n"></td>'
    return f'<td class="{kind} n" data-v="{value:.9g}">{shown}</td>'


def _thumbnail(entry: BatchEntry) -> str:
    if not entry.thumbnail:
        return ""
    size = f'width="{round(_SHOWN * WIDTH)}" height="{round(_SHOWN * HEIGHT)}"'
    return f'<img src="{address(entry.thumbnail)}" {size} loading=lazy decoding="async" alt="">'


def _clip(entry: BatchEntry) -> str:
    parts = [f"<b>{escape(entry.name)}</b>"]
    if entry.subject or entry.tracker:
        parts.append(f"<small>{escape(', '.join(filter(None, (entry.subject, entry.tracker))))}</small>")
    if entry.message:
        parts.append(f'<small class="said">{escape(entry.message)}</small>')
    links = [(entry.report, "report"), (entry.run, "run file")]
    shown = [f'<a href="{address(path)}">{name}</a>' for path, name in links if path]
    if shown:
        parts.append(f'<small class="links">{" ".join(shown)}</small>')
    return "".join(parts)


def address(path: str) -> str:
    """A path as a link, with any characters in it; nothing in it is read as a scheme, query or place."""
    return escape(quote(os.fsencode(Path(path).as_posix())))
