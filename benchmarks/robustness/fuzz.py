"""Damaged files through every reader, and through the commands: a result or one short line, for any content."""

from __future__ import annotations

import shutil
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from benchmarks.robustness import fuzz_commands
from benchmarks.robustness.fuzz_cases import GOOD, MOST_SECONDS, Case, Verdict
from benchmarks.robustness.fuzz_corpus import Files, corpus
from benchmarks.robustness.fuzz_judge import judge, prepare, write
from benchmarks.robustness.fuzz_readers import READERS
from benchmarks.robustness.fuzz_workers import limit_memory, verdicts
from benchmarks.support.common import Json, Several, save, tell
from humanoid.support.errors import InputError
from kinemode.progress import reported
from kinemode.terminal import report

_SHOWN = 40  # kinds of faults that are listed


def cases(inputs: int, seed: int, readers: Sequence[str] = ()) -> list[Case]:
    """So many inputs shared among readers, mixed so that a part of them has every reader."""
    unknown = [name for name in readers if name not in READERS]
    if unknown:
        raise InputError("--readers", f"no reader {unknown[0]!r}", remedy="one of " + ", ".join(READERS))
    chosen = {name: READERS[name].share for name in readers or READERS}
    whole = sum(chosen.values())
    placed = [(n / (share / whole), Case(name, seed, n)) for name, share in chosen.items()
             for n in range(max(1, round(inputs * share / whole)))]  # fmt: skip
    return [case for _, case in sorted(placed)]


def judge_case(
    case: Case, files: Mapping[str, list[Files]], folder: Path, most_seconds: float = MOST_SECONDS
) -> Verdict:
    """Make the damaged files of a case, and read them, in so much time."""
    return judge(case.reader, prepare(case, files, folder), most_seconds)


class Tally:
    """The results of all cases: outcomes by reader, the faults, the worst of time and memory."""

    def __init__(self) -> None:
        self.outcomes: Counter[tuple[str, str]] = Counter()
        self.faults: list[tuple[Case, Verdict]] = []
        self.worst: dict[str, Verdict] = {}
        self.memory = 0
        self.seconds: defaultdict[str, float] = defaultdict(float)

    def add(self, case: Case, verdict: Verdict) -> None:
        self.outcomes[case.reader, verdict.outcome] += 1
        self.seconds[case.reader] += verdict.seconds
        self.memory = max(self.memory, verdict.memory)
        if case.reader not in self.worst or verdict.seconds > self.worst[case.reader].seconds:
            self.worst[case.reader] = verdict
        if not verdict.good:
            self.faults.append((case, verdict))

    def figures(self) -> dict[str, Any]:
        """The figures to be saved as JSON."""
        return {
            "measure": "fuzz",
            "inputs": sum(self.outcomes.values()),
            "outcomes": [{"reader": r, "outcome": o, "count": n} for (r, o), n in sorted(self.outcomes.items())],
            "memory": self.memory,
            "faults": [{"case": str(case), "outcome": v.outcome, "message": v.message} for case, v in self.faults],
        }


def main(
    *,
    inputs: int = 100_000,
    commands: int = 1_000,
    seed: int = 0,
    jobs: int = 2,
    readers: Annotated[tuple[str, ...], Several] = (),
    keep: Path | None = None,
    replay: Annotated[tuple[Path, ...], Several] = (),
    json: Json = None,
) -> None:
    """Damage valid files in many ways and give them to their readers and to `track`, `export`, `view` and `explain`.

    A reader has to give a result or an InputError of at most 500 characters, print nothing, and stay below 20 s and
    1 GB; a command has to end with code 0, or with 2 and one line. Ctrl-C ends it with what is known so far.

    Parameters
    ----------
    inputs
        How many damaged files for all readers together.
    commands
        How many command lines with damaged files.
    seed
        Of all damage.
    jobs
        How many processes.
    readers
        Only these.
    keep
        Folder for the inputs that fail, one folder each.
    replay
        Read kept folders again instead.
    """
    if replay:
        for folder in replay:
            show_replayed(folder)
        return
    tally, began = Tally(), time.monotonic()
    files = corpus()
    try:
        wanted = cases(inputs, seed, readers)
        work(verdicts(judge_case, files, wanted, jobs), len(wanted), files, tally, keep)
        wanted = [] if readers else fuzz_commands.cases(commands, seed)
        work(verdicts(fuzz_commands.judge_case, files, wanted, jobs, batch=5), len(wanted), files, tally, keep)
    except KeyboardInterrupt:
        tell("interrupted: what follows is of the inputs so far")
    show(tally, time.monotonic() - began)
    save(json, tally.figures())


def work(
    outcomes: Iterator[tuple[Case, Verdict]],
    count: int,
    files: Mapping[str, list[Files]],
    tally: Tally,
    keep: Path | None,
) -> None:
    """Count the verdicts on so many cases as they come, and keep the inputs that fail."""
    with reported("damaged inputs") as progress:
        for done, (case, verdict) in enumerate(outcomes, 1):
            tally.add(case, verdict)
            if not verdict.good and keep is not None:
                keep_input(case, verdict, files, keep)
            progress(done, count)


def keep_input(case: Case, verdict: Verdict, files: Mapping[str, list[Files]], folder: Path) -> None:
    """Keep a failing input with what it did."""
    place = folder / str(case)
    place.parent.mkdir(parents=True, exist_ok=True)
    if case.reader in READERS:
        main = prepare(case, files, place)
    else:
        write(fuzz_commands.damaged_files(case, files), place)
        main = place
    (folder / f"{case}.txt").write_text(f"{main.name}\n{verdict.outcome}: {verdict.message}\n", encoding="utf-8")


def show_replayed(folder: Path) -> None:
    """Read a kept input again, here, with the workers' limit of memory: a debugger can look on."""
    limit_memory()
    reader, seed, number = folder.name.rsplit("-", 2)
    case = Case(reader.replace("_", " "), int(seed), int(number))
    if case.reader not in READERS:
        tell(f"{folder}: {fuzz_commands.judge_case(case, corpus(), folder.with_suffix('.again'))}")
        shutil.rmtree(folder.with_suffix(".again"), ignore_errors=True)
        return
    notes = folder.parent / f"{folder.name}.txt"
    if not notes.is_file():
        raise InputError(folder, "is not a kept input", remedy="--keep FOLDER keeps those that fail")
    tell(f"{folder}: {judge(case.reader, folder / notes.read_text(encoding='utf-8').splitlines()[0])}")


def show(tally: Tally, seconds: float) -> None:
    """Outcomes by reader, and the kinds of faults."""
    table = report.table("damaged inputs", "reader", *GOOD, "faults", "mean [ms]", "longest [s]")
    for reader in dict.fromkeys(r for r, _ in tally.outcomes):
        counts = [tally.outcomes[reader, outcome] for outcome in GOOD]
        total = sum(n for (r, _), n in tally.outcomes.items() if r == reader)
        mean, longest = 1e3 * tally.seconds[reader] / total, tally.worst[reader].seconds
        table.add_row(reader, *map(str, counts), str(total - sum(counts)), f"{mean:.1f}", f"{longest:.2f}")
    out = report.console()
    out.print(table)
    kinds = Counter((c.reader, v.outcome, v.message[:90]) for c, v in tally.faults)
    example = {(c.reader, v.outcome, v.message[:90]): c for c, v in tally.faults}
    for kind, count in kinds.most_common(_SHOWN):
        print(f"{count:6d} x {' | '.join(kind)!r} as {example[kind]}")
    total = sum(tally.outcomes.values())
    print(f"{total} inputs in {seconds:.0f} s, {len(tally.faults)} faults, largest process {tally.memory / 1e6:.0f} MB")
