"""A manifest made from what lies in a folder."""

from __future__ import annotations

import csv
import io
import os
import re
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from kinemode.batches.layouts import recordings_in
from kinemode.batches.manifest import LONGEST_NAME, fitting_name
from kinemode.batches.recordings import VIDEOS, ClipFiles, Listing
from kinemode.target import check_absent, check_folder

_ORDER = ("name", "clips", "cameras", "keypoints", "detect", "person", "height", "phone", "sync")
_TO_QUOTE = re.compile(r"[\s'\"]")


@dataclass(frozen=True)
class MadeManifest:
    """The recordings found in a folder.

    recordings: by the names of their rows. left_out: sentences on what could not be placed, and on what was guessed.
    """

    recordings: Mapping[str, ClipFiles]
    left_out: tuple[str, ...]

    def rows(self, folder: str | Path) -> list[dict[str, str]]:
        """Cells by column, a row for each recording; paths are relative to the folder that the manifest will be in."""
        return [_cells(name, recording, Path(folder)) for name, recording in self.recordings.items()]


def manifest_of(folder: str | Path) -> MadeManifest:
    """The clips in a folder and below it, whose keypoints are to be detected where none are there.

    Read are: videos beside each other, with keypoints of the same name (WALK.json, WALK.keypoints, WALK_json) in the
    folder or in keypoints/ or pose/; folders of one video, or of several cameras with a camera file in them or above;
    Pose2Sim's sessions (calibration/, videos/, pose/, of one trial or several); OpenCap's (Videos/Cam0/InputMedia/...).

    Raises
    ------
    InputError: it is not a folder, or contains no clips.
    """
    top = Path(folder).absolute()
    if not top.is_dir():
        raise InputError(folder, "is not a folder" if top.exists() else "there is no such folder")
    listing = Listing(top)
    recordings = _with_known_persons(listing, recordings_in(listing, top))
    if not recordings:
        remedy = f"videos end in {', '.join(VIDEOS)}" if not listing.notes else "; ".join(listing.notes)
        raise InputError(folder, "no clip is in it", remedy=remedy)
    return MadeManifest(dict(zip(_names(recordings), recordings, strict=True)), tuple(listing.notes))


def write_manifest(made: MadeManifest, out: str | Path, *, overwrite: bool = False) -> Path:
    """Write a manifest as CSV that `read_manifest` reads; the file.

    Raises
    ------
    InputError: it is there without `overwrite`, does not end in .csv, or cannot be written.
    """
    out = Path(out)
    if out.suffix.lower() != ".csv":
        raise InputError(out, "is not a .csv file", remedy="one that ends in .csv")
    check_folder(out)
    check_absent([out], False, overwrite, "--overwrite replaces it; it may have been edited")
    rows = made.rows(out.absolute().parent)
    text = io.StringIO()
    columns = [column for column in _ORDER if any(row.get(column) for row in rows)]
    table = csv.DictWriter(text, columns, lineterminator="\n", extrasaction="ignore")
    table.writeheader()
    table.writerows(rows)
    content = text.getvalue()
    with replacing(out) as temporary:  # Excel takes other letters than ASCII for its own unless a mark is before them
        temporary.write_text(content, encoding="utf-8" if content.isascii() else "utf-8-sig", newline="")
    return out


def _with_known_persons(listing: Listing, recordings: Sequence[ClipFiles]) -> list[ClipFiles]:
    """The same without persons with two heights: those are several people of one name."""
    heights: dict[str, set[str]] = {}
    for recording in recordings:
        heights.setdefault(recording.others.get("person", ""), set()).add(recording.others.get("height", ""))
    several = {person for person, theirs in heights.items() if person and len(theirs) > 1}
    for person in sorted(several):
        listing.note(listing.top, f"the person {person} has several heights, so the column person is left empty")
    without = [{k: v for k, v in r.others.items() if k != "person"} for r in recordings]
    return [
        replace(recording, others=others) if recording.others.get("person") in several else recording
        for recording, others in zip(recordings, without, strict=True)
    ]


def _names(recordings: Sequence[ClipFiles]) -> list[str]:
    """A name for each: the last of its parts, and as many before it as distinguish it from the others."""
    names = [""] * len(recordings)
    open_rows = list(range(len(recordings)))
    for count in range(1, 1 + max(len(r.parts) for r in recordings)):
        for i in open_rows:
            names[i] = fitting_name("_".join(recordings[i].parts[-count:])) or "clip"
        times = Counter(name.casefold() for name in names)
        open_rows = [i for i in open_rows if times[names[i].casefold()] > 1]
    taken = {name.casefold() for i, name in enumerate(names) if i not in open_rows}
    for i in open_rows:  # what only differs in signs that a name cannot have
        number = 1
        while (name := f"{names[i][: LONGEST_NAME - 6]}{f'_{number}' if number > 1 else ''}").casefold() in taken:
            number += 1
        names[i] = name
        taken.add(name.casefold())
    return names


def _cells(name: str, recording: ClipFiles, folder: Path) -> dict[str, str]:
    alone = len({*recording.videos, *recording.keypoints}) == 1
    cells = {"name": name, **recording.others}
    cells["clips"] = _words(recording.videos, folder, alone)
    cells["keypoints"] = _words(recording.keypoints, folder, alone)
    cells["cameras"] = "" if recording.cameras is None else _relative(recording.cameras, folder)
    cells["detect"] = "yes" if recording.videos.keys() - recording.keypoints.keys() else ""
    return {column: text for column, text in cells.items() if text}


def _words(paths: Mapping[str, Path], folder: Path, alone: bool) -> str:
    """Files as a cell has them, each with the name of its camera where it is not the file's own."""
    words = []
    for name, path in paths.items():
        own = alone or name == (path.name if path.is_dir() else path.stem)
        text = _relative(path, folder)
        words.append(text if own else f"{name}={text}")
    return " ".join(shlex.quote(word) if _TO_QUOTE.search(word) else word for word in words)


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return path.as_posix()
