"""Packages are layers: imports go down, there are no cycles, and no file names the machine it was written on."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TOP = ("humanoid", "estimator", "viz", "kinemode")
ESTIMATOR = (
    "numerics", "data", "energy", "vision", "inference", "dynamics", "search", "trackers", "tracking", "fitting",
    "runs", "synthesis", "retargeting",
)  # fmt: skip
"""The packages of `estimator`, the lowest first."""
FEWEST = 3  # modules in a folder, without `__init__`


def modules(root: Path) -> dict[str, Path]:
    """Every module of the four packages by its dotted name."""
    named = {}
    for top in TOP:
        for path in sorted((root / top).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            named[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return named


def imports(path: Path, name: str, known: Iterable[str], *, lazy: bool) -> Iterator[str]:
    """Modules of the four packages that a file imports; lazy: also those inside functions, which cannot form import
    cycles."""
    known = set(known)
    is_package = path.name == "__init__.py"
    for node, later in _imports_in(path.read_text(encoding="utf-8")):
        if later and not lazy:
            continue
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        else:
            base = node.module or ""
            if node.level:
                package = name.split(".") if is_package else name.split(".")[:-1]
                base = ".".join([*package[: len(package) - node.level + 1], *([base] if base else [])])
            # `from package import module` depends on the module, `from module import name` on the module named
            targets = [f"{base}.{a.name}" if f"{base}.{a.name}" in known else base for a in node.names]
        yield from (t for t in targets if t.split(".")[0] in TOP)


@cache
def _imports_in(source: str) -> list[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Every import, and whether it runs after the module is loaded."""
    return list(_imports(ast.parse(source), later=False))


def _imports(node: ast.AST, later: bool) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.Import, ast.ImportFrom)):
            yield child, later
        elif not isinstance(child, ast.expr):
            yield from _imports(child, later or _runs_later(child))


def _runs_later(node: ast.AST) -> bool:
    """Functions, and blocks for type checkers alone."""
    if isinstance(node, ast.If):
        return "TYPE_CHECKING" in ast.unparse(node.test)
    return isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))


def upward_imports(root: Path) -> list[str]:
    """Violations: a layer that imports one above it, even inside a function or for types alone."""
    known = modules(root)
    return [
        f"{name} imports {target}"
        for name, path in known.items()
        for target in imports(path, name, known, lazy=True)
        if layer(target) > layer(name)
    ]


def layer(name: str) -> tuple[int, int]:
    """The layer of a module: its package's position in `TOP` and, in `estimator`, in `ESTIMATOR`."""
    top, _, rest = name.partition(".")
    package = rest.split(".")[0]
    return TOP.index(top), ESTIMATOR.index(package) if top == "estimator" and package else -1


def rings(root: Path) -> list[str]:
    """Folders that import each other, directly or through others: each has to be a layer."""
    known = modules(root)
    graph: dict[str, dict[str, str]] = {}
    for name, path in known.items():
        if path.name == "__init__.py" and path.parent.parent == root:
            continue  # the package's `__init__` gathers names
        for target in imports(path, name, known, lazy=True):
            here, there = folder_of(path, root), folder_of(known[target], root) if target in known else ""
            if there not in ("", *TOP) and here != there:
                graph.setdefault(here, {}).setdefault(there, f"{name} imports {target}")
    simple = {folder: sorted(others) for folder, others in graph.items()}
    return ["; ".join(graph[a][b] for a, b in pairwise(ring)) for ring in _cycles(simple)]


def folder_of(path: Path, root: Path) -> str:
    """The dotted name of a file's folder; a file at the top of viz or kinemode counts as a folder of its own."""
    folder = path.parent.relative_to(root).parts
    outside = folder in (("viz",), ("kinemode",)) and path.name != "__init__.py"
    return ".".join((*folder, path.stem) if outside else folder)


def cycles(root: Path) -> list[str]:
    """Import cycles between modules, even inside a function or for types alone; a package's __init__, which gathers
    names, may be passed through."""
    known = modules(root)
    graph = {
        name: sorted({t for t in imports(path, name, known, lazy=True) if t in known and t != name})
        for name, path in known.items()
        if path.name != "__init__.py"
    }
    return [" -> ".join(cycle) for cycle in _cycles(graph)]


def _cycles(graph: Mapping[str, list[str]]) -> Iterator[list[str]]:
    done: set[str] = set()

    def visit(name: str, path: list[str]) -> Iterator[list[str]]:
        if name in path:
            yield [*path[path.index(name) :], name]
        elif name not in done:
            for target in graph.get(name, []):
                yield from visit(target, [*path, name])
            done.add(name)

    for name in graph:
        yield from visit(name, [])


FEW_LINES = 60
OF_ONE_USER = {
    "estimator.data.formats.cameras_easymocap",  # formats: the reference has a section for each
    "estimator.data.formats.cameras_kalibr",
    "estimator.data.formats.cameras_panoptic",
    "estimator.trackers.css.css_dual",  # a tracker
    "estimator.trackers.dual_chain.settings",  # the settings stored in run files, apart from their users
    "estimator.trackers.elmo.reweighting",  # ELMO's section 3.2, apart from the tracker
    "estimator.trackers.elmo.settings",
    "estimator.trackers.loose_limbed.settings",
    "kinemode.calibrating",  # work, loaded by its public function when called
}
"""Short modules that one other module imports: family members listed by a registry, and settings."""


def short_modules_of_one_user(root: Path) -> set[str]:
    """Modules with fewer than `FEW_LINES` lines that are not blank, which one other module imports."""
    known = modules(root)
    users: dict[str, set[str]] = {name: set() for name in known}
    for name, path in known.items():
        for target in imports(path, name, known, lazy=True):
            if target in known and target != name:
                users[target].add(name)
    short = {name for name, path in known.items() if _lines(path) < FEW_LINES}
    return {n for n in short if len(users[n]) == 1 and known[n].name != "__init__.py"}


def _lines(path: Path) -> int:
    return sum(1 for line in path.read_text(encoding="utf-8").splitlines() if line.strip())


def test_short_modules_of_one_user_are_part_of_it() -> None:
    assert len(OF_ONE_USER) <= 15
    assert short_modules_of_one_user(ROOT) - OF_ONE_USER == set()


def test_a_short_module_of_one_user_is_found(tmp_path: Path) -> None:
    for folder in ("humanoid", "estimator", "viz", "kinemode"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "__init__.py").write_text("")
    (tmp_path / "viz" / "a.py").write_text("X = 1\n")
    (tmp_path / "viz" / "b.py").write_text("from viz.a import X\n")
    assert short_modules_of_one_user(tmp_path) == {"viz.a"}
    (tmp_path / "viz" / "c.py").write_text("from viz.a import X\n")
    assert short_modules_of_one_user(tmp_path) == set()


def test_imports_go_down() -> None:
    assert upward_imports(ROOT) == []


def test_imports_do_not_go_round() -> None:
    assert cycles(ROOT) == []


def test_every_folder_is_a_layer() -> None:
    assert rings(ROOT) == []


def test_estimator_shows_its_packages() -> None:
    """`humanoid` and `estimator` contain no file but `__init__`, which describes them."""
    assert [path.name for top in TOP[:2] for path in (ROOT / top).glob("*.py")] == ["__init__.py"] * 2
    assert {path.parent.name for path in (ROOT / "estimator").glob("*/__init__.py")} == set(ESTIMATOR)


def test_no_folder_is_nearly_empty() -> None:
    assert small_folders(ROOT) == []


def small_folders(root: Path) -> list[str]:
    """Folders of fewer than `FEWEST` modules, the four at the top apart."""
    folders = {path.parent for top in TOP for path in (root / top).rglob("*.py")} - {root / top for top in TOP}
    few = [folder for folder in folders if len([p for p in folder.glob("*.py") if p.stem != "__init__"]) < FEWEST]
    return sorted(folder.relative_to(root).as_posix() for folder in few)


def test_a_planted_small_folder_is_found(tmp_path: Path) -> None:
    plant(tmp_path, {f"humanoid/{name}.py": "" for name in ("a/x", "a/y", "a/z", "b/x", "b/y", "b/__init__")})
    assert small_folders(tmp_path) == ["humanoid/b"]


@pytest.mark.parametrize(
    ("file", "text", "violation"),
    [
        ("humanoid/kinematics/body.py", "import estimator.energy", "humanoid.kinematics.body imports estimator.energy"),
        (
            "humanoid/kinematics/body.py",
            "def f():\n    from viz import sheet",
            "humanoid.kinematics.body imports viz.sheet",
        ),
        ("estimator/energy/term.py", "from kinemode import jobs", "estimator.energy.term imports kinemode.jobs"),
        ("viz/sheet.py", "if True:\n    import kinemode", "viz.sheet imports kinemode"),
        (
            "estimator/energy/cost.py",
            "if TYPE_CHECKING:\n    from estimator.vision.cues import base",
            "estimator.energy.cost imports estimator.vision.cues",
        ),
    ],
)
def test_a_planted_upward_import_is_found(tmp_path: Path, file: str, text: str, violation: str) -> None:
    plant(tmp_path, {file: text})
    assert upward_imports(tmp_path) == [violation]


def test_a_planted_cycle_is_found(tmp_path: Path) -> None:
    plant(tmp_path, {"humanoid/a.py": "from . import b", "humanoid/b.py": "from humanoid.c import x"})
    assert cycles(tmp_path) == []
    plant(tmp_path, {"humanoid/c.py": "import humanoid.a\nx = 1"})
    assert cycles(tmp_path) == ["humanoid.a -> humanoid.b -> humanoid.c -> humanoid.a"]


def test_a_planted_ring_of_folders_is_found(tmp_path: Path) -> None:
    """Also without a cycle between two files, and for types or inside a function."""
    plant(tmp_path, {"estimator/a/x.py": "from estimator.b import y", "estimator/b/y.py": "", "estimator/b/z.py": ""})
    assert rings(tmp_path) == []
    plant(tmp_path, {"estimator/b/z.py": "def f():\n    from estimator.a.x import g"})
    ring = "estimator.a.x imports estimator.b.y; estimator.b.z imports estimator.a.x"
    assert rings(tmp_path) == [ring]
    plant(tmp_path, {"kinemode/a/x.py": "from kinemode import cli", "kinemode/cli.py": "import kinemode.a.x"})
    assert rings(tmp_path) == [ring, "kinemode.a.x imports kinemode.cli; kinemode.cli imports kinemode.a.x"]


def plant(root: Path, files: Mapping[str, str]) -> None:
    for name in ("humanoid/__init__.py", "viz/__init__.py", "viz/sheet.py", "kinemode/jobs.py", *files):
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(files.get(name, ""), encoding="utf-8")


# Folders of one machine, and addresses of package indexes; split so that this file does not match itself.
MACHINE = re.compile("/" + r"(home|Users|root|work|opt|tmp|mnt)/[\w.-]" + "|" + "[A-Z]:" + r"\\Users")
INDEX = re.compile("(--(extra-)?index" + "-url|--find" + "-links|https?://[^ ]*/simple" + r"\b|pypi" + r"\.org)")
# options that switch such addresses off
ALLOWED = re.compile("--no-emit-" + "[a-z-]+")


def foreign_text(text: str) -> list[str]:
    """Machine paths and index addresses in a text."""
    text = ALLOWED.sub("", text)
    return [m.group(0) for pattern in (MACHINE, INDEX) for m in pattern.finditer(text)]


def repository_files() -> list[Path]:
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    return [path for line in listed.stdout.splitlines() if (path := ROOT / line).is_file()]


def test_no_file_names_this_machine() -> None:
    hits = []
    for path in repository_files():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        hits += [f"{path.relative_to(ROOT)}: {hit}" for hit in foreign_text(text)]
    assert hits == []


def test_a_planted_address_is_found() -> None:
    planted = [
        "see /" + "home/someone/x",
        "--extra-index" + "-url x",
        "https://host/" + "simple",
        "files.pypi" + ".org",
    ]
    assert [bool(foreign_text(text)) for text in planted] == [True] * 4
    assert foreign_text("package://example-robot-data/robots ../shared/data a/tmp_path/b") == []
