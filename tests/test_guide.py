"""The commands and programs of README and guide, run as written; the pages as a site without a warning; the reference
pages, which have every command, setting, tracker, format and public name."""

from __future__ import annotations

import csv
import inspect
import io
import re
import shlex
import shutil
import sys
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import cyclopts
import pytest

import kinemode as km
from benchmarks.support.common import ROOT
from estimator.tracking import registry
from estimator.tracking.setting_changes import changed
from kinemode import __main__ as front, cli, jobs
from kinemode.batches import engines
from kinemode.batches.manifest import read_manifest
from kinemode.batches.shown import COLUMNS
from kinemode.detection import clip as detection
from tests.inline_engine import Inline
from tests.made_once import made_once
from tests.tiers import later
from tests.tiny_clip import QUICK_BY_KEYPOINTS

DOCS = ROOT / "docs"
GUIDE = sorted((DOCS / "guide").glob("*.md"))
FIRST = "first-clip"
RUNNABLE = ("concepts", "commands", "uncertainty", "opensim", "own-robot", "cues", "points", "retargeting")
QUICKLY = ("README", "your-video", "several-cameras", "input", "python", "trackers")
"""Pages whose tracks use few searches and the unfitted subject: other pages fit it."""
BATCH = "batch"
PAGES = (FIRST, *RUNNABLE, *QUICKLY, BATCH, "conventions", "forces", "install", "troubleshooting", "two-phones")
MANIFESTS = {"text": "clips.csv", "toml": "clips.toml"}
"""Files shown on the batch page, by block type."""
COMMANDS = {name for name in cli.app if not name.startswith("-")}
ALWAYS = {"--help", "--debug"}
QUIET = "ignore:.*Check CHANGES for Sphinx API modifications"
SECONDS = re.compile(r"--seconds [0-9.]+")
BLOCK = re.compile(r"^ *```(sh|python|console|text|toml)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
MENTIONED = re.compile(r"`(?:\.venv/bin/)?kinemode ([a-z][a-z-]*)((?:[^`]|\n)*)`")


def page_of(name: str) -> Path:
    return ROOT / "README.md" if name == "README" else DOCS / "guide" / f"{name}.md"


def blocks(name: str) -> list[tuple[str, str]]:
    return BLOCK.findall(page_of(name).read_text(encoding="utf-8"))


@pytest.fixture
def folder(tmp_path_factory: pytest.TempPathFactory, tmp_path: Path) -> Path:
    """A copy of the first page's output, which the other pages use, with a clip, its keypoints, calibration and truth
    under the names of a reader's own files."""

    def first_page(empty: Path) -> Path:
        follow(FIRST, empty)
        made = empty / "reach"
        shutil.copy(made / "cam01.mp4", empty / "walk.mp4")
        shutil.copy(made / "keypoints" / "cam01.json", empty / "walk.json")
        shutil.copy(made / "cameras.json", empty / "calibration.json")
        shutil.copy(made / "truth.npz", empty)
        return empty

    return Path(shutil.copytree(made_once(tmp_path_factory, "guide", first_page), tmp_path / "guide"))


@pytest.fixture
def detector(monkeypatch: pytest.MonkeyPatch) -> None:
    """A detector that returns walk.json for every clip."""
    monkeypatch.setattr(detection, "detect_clip", lambda clip, file, *_: shutil.copy("walk.json", file))


@pytest.fixture
def few_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trackers with fast frames at their defaults, and no fit before."""
    usual = registry._defaults

    def few(spec: Any) -> Any:
        groups = {group: values for group, values in QUICK_BY_KEYPOINTS.items() if group in ("search", spec.group)}
        return changed(usual(spec), groups)

    monkeypatch.setattr(registry, "_defaults", few)
    monkeypatch.setattr(jobs, "_fitted", lambda job, subject, *_: jobs._Fitted(subject, job.known.estimates))


def follow(name: str, folder: Path) -> None:
    """Run the examples of a page in this process, on shorter clips: long ones only repeat similar frames. Blocks called
    "console" need files or devices that a test does not have; manifests of batches are written."""
    steps = [block for block in blocks(name) if block[0] in ("sh", "python", *(MANIFESTS if name == BATCH else ()))]
    assert steps
    names: dict[str, Any] = {"__name__": "__main__"}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for kind, text in steps:
            if kind == "python":
                exec(compile(text, f"{name}.md", "exec"), names)
                continue
            if kind in MANIFESTS:
                Path(MANIFESTS[kind]).write_text(text, encoding="utf-8")
                read_manifest(MANIFESTS[kind])
                continue
            for line in text.splitlines():
                program, *words = shlex.split(SECONDS.sub("--seconds 0.1", line))
                assert program == "kinemode"
                assert front.main(words) == 0, line


@pytest.mark.usefixtures("detector", "few_figures")
@pytest.mark.parametrize("name", later((FIRST, *RUNNABLE), "own-robot", thorough=["retargeting"]))
def test_the_examples_of_a_page_work(name: str, folder: Path) -> None:
    if name != FIRST:  # already done
        follow(name, folder)
    assert (folder / "reach.run").exists()


@pytest.mark.usefixtures("detector", "few_searches", "few_figures")
@pytest.mark.filterwarnings("ignore::kinemode.InputWarning")
@pytest.mark.parametrize("name", QUICKLY)
def test_the_examples_of_a_page_work_with_few_searches(name: str, folder: Path) -> None:
    follow(name, folder)


class StandIn:
    """In place of a cluster of other machines: a scheduler and one worker in this process, started with the cluster's
    arguments. names: of these arguments."""

    def __init__(self, *names: str) -> None:
        self._names = {*names}
        self.started = 0

    def __call__(self, *hosts: list[str], **options: Any) -> Any:
        from distributed import LocalCluster

        assert options.keys() | ({"hosts"} if hosts else set()) <= self._names
        self.started += 1
        cluster = LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0")
        usual = cluster.scale  # which closing needs
        cluster.scale = lambda n=0, jobs=0: None if jobs else usual(n)
        cluster.wait_for_workers = lambda count: None
        return cluster


@pytest.fixture
def far_clusters(monkeypatch: pytest.MonkeyPatch) -> list[StandIn]:
    """Dask's clusters of other machines, with their work done here."""
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    ssh = StandIn(*inspect.signature(distributed.SSHCluster).parameters)
    slurm = StandIn("queue", "cores", "processes", "memory", "walltime")  # of dask-jobqueue 0.9
    here = partial(distributed.LocalCluster, processes=False, dashboard_address=":0")
    monkeypatch.setattr(distributed, "LocalCluster", here)  # real processes are those of test_batch
    monkeypatch.setattr(distributed, "SSHCluster", ssh)
    monkeypatch.setitem(sys.modules, "dask_jobqueue", SimpleNamespace(SLURMCluster=slurm))
    return [ssh, slurm]


@pytest.mark.usefixtures("few_searches", "few_figures")
def test_the_examples_of_the_batch_page_work(
    folder: Path, far_clusters: list[StandIn], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engines, "ProcessEngine", lambda count: Inline())
    follow(BATCH, folder)
    with (folder / "tracked" / "summary.csv").open(newline="", encoding="utf-8") as table:
        rows = list(csv.DictReader(table))
    assert [(row["name"], row["status"], row["person"]) for row in rows] == [
        (n, "done", "anna") for n in ("reach", "turn")
    ]
    text = page_of(BATCH).read_text(encoding="utf-8")
    assert set(re.findall(r"`([a-z_]+)`", text.partition("The columns of `summary.csv`")[2])) >= set(COLUMNS)
    assert [cluster.started for cluster in far_clusters] == [1, 1]


def understood_by_dask(line: str) -> bool:
    """Whether Dask's own command takes a command line."""
    import click
    from distributed.cli import dask_scheduler, dask_worker

    _, name, *words = shlex.split(line)
    try:
        {"scheduler": dask_scheduler, "worker": dask_worker}[name].main.make_context(name, words)
    except click.ClickException:
        return False
    return True


def test_commands_of_dask_are_understood() -> None:
    pytest.importorskip("distributed", reason="Dask is not installed")
    lines = [line for kind, text in blocks(BATCH) if kind == "console" for line in text.splitlines()]
    of_dask = [line for line in lines if line.startswith("dask ")]
    assert len(of_dask) == 2
    assert all(map(understood_by_dask, of_dask))
    assert not understood_by_dask("dask worker tcp://192.168.0.5:8786 --nthread 1")


def understood(line: str) -> bool:
    """Whether a command line has all that its command needs and no option that the command lacks."""
    program, *words = shlex.split(line, comments=True)
    try:
        cli.app.parse_args(words, exit_on_error=False, print_error=False)
    except cyclopts.CycloptsError:
        return False
    return program == "kinemode"


def unknown_words(text: str) -> list[str]:
    """Commands and options between backticks that do not exist."""
    unknown = []
    for command, rest in MENTIONED.findall(text):
        if command not in COMMANDS:
            unknown.append(command)
            continue
        unknown += [f"{command} {o}" for o in re.findall(r"--[a-z][a-z-]*", rest) if o not in options(command)]
    return unknown


@cache
def options(command: str) -> set[str]:
    names = {name for argument in cli.app[command].assemble_argument_collection() for name in argument.names}
    return {name for name in names if name.startswith("-")} | ALWAYS


def test_every_command_with_files_of_a_reader_is_understood() -> None:
    lines = [line for name in PAGES for kind, text in blocks(name) if kind == "console" for line in text.splitlines()]
    ours = [line for line in map(str.strip, lines) if not line.startswith(("make ", "pip ", "dask "))]
    gait_models = re.findall(r"^    (kinemode .*)$", (DOCS / "opensim.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert len(ours) > 10
    assert len(gait_models) > 5
    assert [line for line in (*ours, *gait_models) if not understood(line)] == []


@pytest.mark.parametrize("name", PAGES)
def test_every_command_and_option_in_a_sentence_exists(name: str) -> None:
    assert unknown_words(page_of(name).read_text(encoding="utf-8")) == []


def test_faults_in_a_command_line_would_be_seen() -> None:
    assert understood("kinemode gait walk.run --out strides.csv")
    for line in ("kinemode gait", "kinemode gate walk.run", "kinemode gait walk.run --outt a.csv"):
        assert not understood(line)
    assert not understood("kinemode explain walk.run --frame first")
    assert unknown_words("`kinemode gate`, `kinemode gait RUN --outt FILE`, `kinemode track\n--fit off`") == [
        "gate",
        "gait --outt",
    ]


def test_every_page_is_tested_and_no_block_is_without_a_kind() -> None:
    assert set(PAGES) == {"README", *(path.stem for path in GUIDE)}
    for name in PAGES:
        fences = re.findall(r"^ *```(\w*)$", page_of(name).read_text(encoding="utf-8"), re.MULTILINE)
        assert set(fences[::2]) <= {"sh", "python", "console", "text", "toml"}, name
        assert set(fences[1::2]) <= {""}, name


def test_readme_and_table_have_every_command_and_target() -> None:
    table = page_of("commands").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `kinemode ([a-z-]+)", table, re.MULTILINE)) == COMMANDS
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    readme = page_of("README").read_text(encoding="utf-8")
    assert len(readme.splitlines()) <= 90
    for name in ("README", "install"):
        targets = set(re.findall(r"\bmake (?=[a-z])([a-z-]+)", page_of(name).read_text(encoding="utf-8")))
        assert {"demo", "test"} <= targets
        assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in targets - {"a"}), targets


def site(builder: str, out: Path) -> ModuleType:
    """Build the documentation in this process, where the sources of the reference are already imported; returns the
    module that wrote it."""
    application = pytest.importorskip("sphinx.application", reason="Sphinx is not installed")
    docutils = pytest.importorskip("sphinx.util.docutils")
    warnings = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, docutils.patch_docutils(DOCS), docutils.docutils_namespace():
        patch.setattr(sys, "path", list(sys.path))  # docs/conf.py adds its folder
        made = application.Sphinx(DOCS, DOCS, out, out / ".doctrees", builder, status=None, warning=warnings)
        made.build()
    assert warnings.getvalue() == ""
    return sys.modules["generate"]


@pytest.mark.filterwarnings(QUIET)
def test_the_site_has_every_page_and_a_complete_reference(
    tmp_path: Path,
) -> None:
    generate = site("dummy", tmp_path)  # everything but writing the pages
    built = {path.relative_to(tmp_path / ".doctrees").with_suffix("") for path in tmp_path.rglob("*.doctree")}
    assert built == {path.relative_to(DOCS).with_suffix("") for path in DOCS.rglob("*.md")}
    assert set(generate.PAGES) == {path.stem for path in (DOCS / "reference").glob("*.md")}
    commands, settings, trackers, formats, interface = (
        generate.PAGES[name]() for name in ("commands", "settings", "trackers", "formats", "interface")
    )
    for command in COMMANDS:
        assert re.search(rf"^## kinemode {command}\n\n```text\nkinemode {command}(?! -m)", commands, re.MULTILINE)
        missing = {option for option in options(command) - ALWAYS if not re.search(rf"{option}\b", commands)}
        assert missing == set()
    examples = re.findall(r"^    (kinemode .*)$", commands, re.MULTILINE)
    assert {line.split()[1] for line in examples} >= {*COMMANDS} - {"trackers", "cues", "version"}
    assert [line for line in examples if not understood(line)] == []
    for name in registry.TRACKERS:
        assert f"\n## {name}\n" in settings
        assert f"| `{name}`" in trackers
        for setting in own_settings(name):
            assert re.search(rf"^{setting} = ", settings, re.MULTILINE), setting
    assert all(f"`{name}`" in formats for name in ("npz", "c3d", "osim", "glb", "rrd", "mediapipe33"))
    assert all(f"\n### `{name}`\n" in interface for name in km.__all__ if not name.startswith("_"))
    assert generate.markdown(DOCSTRING).split("\n\n") == [
        "What it is: a \\* b.",
        "- `size, other [m]`: of a thing,\n  and more.",
        "**Raises**",
        "- `InputError`: never.",
        '```text\n{"a": 1}\n```',
    ]


DOCSTRING = """What it is: a * b.

    size, other [m]: of a thing,
        and more.

    Raises
    ------
    InputError: never.

        {"a": 1}
    """


def own_settings(name: str) -> set[str]:
    """The last part of a tracker's settings keys, over all groups."""

    def last(values: dict[str, Any]) -> Iterator[str]:
        for key, value in values.items():
            yield from last(value) if isinstance(value, dict) else (key,)

    return set(last(registry.settings_for(name).to_dict()))


@pytest.mark.filterwarnings(QUIET)
@pytest.mark.paper  # a long example: the quicker test above covers all but writing the pages
def test_the_pages_are_written_without_a_warning(tmp_path: Path) -> None:
    site("html", tmp_path)
    commands = (tmp_path / "reference" / "commands.html").read_text(encoding="utf-8")
    assert "With --occlusion:" in commands  # no dash in place of the two
    assert (tmp_path / "guide" / "concepts.html").exists()
