"""A batch's summary of its clips: facts of runs, which clips to review, and their table."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from humanoid import InputError, load_subject
from kinemode.batches.clip_job import run_facts
from kinemode.batches.shown import COLUMNS, batch_table, write_batch_table
from tests.made_runs import made_run
from viz.report.thumbnail import BatchEntry, look_ranks

ODD = "<script>alert(\"x\")</script> & 'q'"
ENTRIES = (
    BatchEntry("clip10", "done", frames=100, hard=5, unobserved=15, doubtful=0.2, error=0.0305, seconds=10.0),
    BatchEntry("clip9", "done", "Ann", frames=1000, hard=0, unobserved=0, doubtful=0.0, error=0.2, seconds=9.5),
    BatchEntry(f"none, {ODD}", "waiting", ODD, subject=ODD, tracker=ODD),
    BatchEntry("bad", "failed", "Bo", f'"a.mp4": {ODD}\nis no film', seconds=0.0),
    BatchEntry("found", "done", message=f"a finding {ODD}", frames=5, hard=0, unobserved=0, doubtful=0.0),
    BatchEntry(
        "clip2", "done", "ann", frames=200, hard=40, unobserved=0, doubtful=0.2, error=float("nan"), seconds=3723.4,
        processor_seconds=4e-3, thumbnail="a b#1.jpg", report="javascript:alert(1)", run="r/50%?.run",
    ),
)  # fmt: skip
FIRST = ("bad", "clip2", "clip10", "found")
"""The clips to review, in order."""


def test_clips_to_review_first() -> None:
    """Failed clips first, then by doubtful frames, by hard ones, then those with a finding; good clips are not
    listed."""
    worse = BatchEntry("worse", "done", frames=100, hard=0, unobserved=21, doubtful=0.21)
    entries = (*ENTRIES, worse)
    ranks = {rank: entry.name for entry, rank in zip(entries, look_ranks(entries), strict=True) if rank}
    assert sorted(ranks) == [1, 2, 3, 4, 5]
    assert [ranks[rank] for rank in sorted(ranks)] == [FIRST[0], "worse", *FIRST[1:]]


def test_another_status_is_refused() -> None:
    with pytest.raises(ValueError, match="status must be one of done, failed, waiting, got 'lost'"):
        BatchEntry("a", "lost")


def test_facts_of_a_run_match_the_run(tmp_path: Path) -> None:
    """Frames with findings are hard, whatever their status; without frames there is no number."""
    subject = load_subject("arm8")
    q = np.tile(pin.neutral(subject.model), (8, 1, 1))
    status = ["tracked", "hard", "unobserved", "unobserved", "tracked", "tracked", "tracked", "tracked"]
    run = made_run(tmp_path / "a.run", subject, q, status=status)
    assert run_facts(run) == (subject.name, "css", 8, 1, 2, 0.375, "")
    run = made_run(tmp_path / "b.run", subject, q, status=status)
    run.header = replace(run.header, findings=("first", "second"), contradicted=(2, 5))
    assert run_facts(run) == (subject.name, "css", 8, 2, 2, 0.5, "first")
    assert BatchEntry("a", "done", **run_facts(run)._asdict()).doubtful == 0.5
    assert run_facts(made_run(tmp_path / "c.run", subject, q[:0]))[2:] == (0, 0, 0, None, "")


def test_the_table_is_read_back_as_it_was(tmp_path: Path) -> None:
    assert batch_table([]) == ",".join(COLUMNS) + "\n"
    path = write_batch_table(tmp_path / "summary.csv", ENTRIES)
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert rows == list(csv.DictReader(io.StringIO(batch_table(ENTRIES), newline="")))
    for row, entry, rank in zip(rows, ENTRIES, look_ranks(ENTRIES), strict=True):
        assert row["look_first"] == ("" if rank is None else str(rank))
        for column, field in COLUMNS.items():
            value = getattr(entry, field) if field else rank
            if isinstance(value, str):
                assert row[column] == value
            elif value is None or np.isnan(value):
                assert row[column] == ""
            else:
                assert float(row[column]) == pytest.approx(value, rel=1e-5)
    with pytest.raises(InputError, match="cannot be written"):
        write_batch_table(tmp_path / "nowhere" / "summary.csv", ENTRIES)
