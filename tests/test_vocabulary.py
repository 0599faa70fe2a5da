"""Names and messages in the field's terms: replaced words do not return to names, and messages give what is allowed and
what was found. Class names are unique."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.test_layers import ROOT, TOP

NAMES = re.compile(
    r"_*(shouters?|shouts?|shouted|heard|overheard|said_by|said_against|searches_told|look_at_keypoints|q_paid|moves_along"
    r"|led_steps|led_kernels|strayed|looked_anew|other_readings|sightings?|sighted"
    r"|told_(of|each|if_hidden|apart)|as_told|judged(_rows|_message|_output)?|led|paid|goes_by|looked(_up|_into)?"
    r"|look_at_each|look_past|can_be_looked_up|idle(_where|_without|_with_input|_settings|_rules)?"
    r"|drawn_(garment|keys|poses|configurations)|limbs_kept|kept_(back|clip)|everybody_settled)_*"
)
"""Names of functions, arguments and fields that must not return."""
PARTICIPLES = re.compile(r"_*(told|carried|drawn|kept|begun|settled)_*")
"""Those that are gone from `estimator` and `benchmarks`."""
OPTIONS = {"limb_learning.py: drawn"}
"""Options of commands, whose names stay."""
CLASSES = re.compile(
    "_*(Shout.*|KeypointShoutSettings|FrameCase|Crowd|Drawn|Begins|HasEnergy|SharesWork|GoesByCue|ShowsMore|LooksAhead"
    "|LooksBack|Newest|Resting|Swinging|Speckled|Sighting|Sight|Looked|Judged|Idle|IdleRule|EachTold|Kept|Begun)"
)
"""Those of classes."""
MESSAGES = re.compile(
    r"\bshout(?:s|ed|ers?|ing)\b|\bgoes by\b|\bgoes on with\b|\bheard nothing\b|beyond all measure"
    r"|frames per second cannot be|: [^ ]+ cannot be$"
)
"""Phrases that messages and docstrings avoid."""
SPOKEN = re.compile(
    r"\b(?:told|tells?|heard|hears?|looks at|looked (?:at|for|into)|there twice|whoever|taken for|put right|let be"
    r"|go(?:es)? on|all the same|asked for|front door)\b|\bholds no\b|\bcannot be(?=$|[.;,)])"
    r"|\bsays? (?:nothing|so|what|where|which|whether|how|of)\b"
)
"""Phrases of speech for files, numbers and models: they declare, contain, give and use."""
PLAIN = (*TOP, "benchmarks", "tests", "examples")
"""Folders without any of them."""
TRANSLATED = re.compile(
    r"\b(?:unless all but one are said|takes them as they are told|looked at for|tells nothing of"
    r"|is no name of a page|is out of reach|is the ending of no|names no clip|stands twice"
    r"|quotation mark has no second|the command says it for|is to be said of|a user should hear|told to who"
    r"|later than told|asked again more sharply|characters that are none|holds no pose|do not tell is a"
    r"|it takes a network"
    r"|pulls at nothing|Tell when the feet|_lead\(|_given_out\b|begun_match\b|class Said\b|_strange\("
    r"|goes by\b|heard nothing|hears? itself|beyond all measure|what is told\b|(?:is|are) told nothing\b"
    r"|measures? right\b|is of no\b|stands? in comments|go(?:es|ne)? on with\b|takes? z for up|front door"
    r"|it says\b|is looked at\b|that are none\b|nothing to go by\b|how to go on\b|without a word of it"
    r"|(?<!there )is no (?:name|file|folder|text|number|axis|landmark|picture|person|index|Python|measure|sentence"
    r"|pair|line|edge|floor|leap|gap|camera|clip|mesh)\b)"
)
"""Sentences and names that read as translated; the repository contains none."""


def named(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Names of classes, functions, arguments and fields, and their lines."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            yield node.name, node.lineno
        elif isinstance(node, ast.arg):
            yield node.arg, node.lineno
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            yield node.target.id, node.lineno


def is_gone(name: str) -> bool:
    return (CLASSES if name.lstrip("_")[:1].isupper() else NAMES).fullmatch(name) is not None


def spoken(path: Path, phrases: re.Pattern[str]) -> list[str]:
    """Where a file's texts have such a phrase."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    texts = (n for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str))
    return [f"{path.name}:{n.lineno}: {hit.group(0)}" for n in texts if (hit := phrases.search(n.value))]


def forbidden(path: Path) -> list[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [f"{path.name}:{line}: {name}" for name, line in named(tree) if is_gone(name)] + spoken(path, MESSAGES)


@pytest.mark.parametrize("top", ["estimator", "benchmarks"])
def test_nothing_is_named_by_a_bare_participle(top: str) -> None:
    hits = set()
    for path in (ROOT / top).rglob("*.py"):
        names = {name for name, _ in named(ast.parse(path.read_text(encoding="utf-8")))}
        hits |= {f"{path.name}: {name}" for name in names if is_gone(name) or PARTICIPLES.fullmatch(name)}
    assert hits - OPTIONS == set()


@pytest.mark.parametrize("top", TOP)
def test_words_are_the_fields(top: str) -> None:
    assert [hit for path in sorted((ROOT / top).rglob("*.py")) for hit in forbidden(path)] == []


@pytest.mark.parametrize("folder", PLAIN)
def test_nothing_speaks(folder: str) -> None:
    files = [path for path in sorted((ROOT / folder).rglob("*.py")) if path != Path(__file__).resolve()]
    assert files
    assert [hit for path in files for hit in spoken(path, SPOKEN)] == []


def test_no_sentence_reads_as_translated() -> None:
    own = Path(__file__).resolve()
    tops = (*TOP, "benchmarks", "tests", "docs", "examples")
    paths = [p for top in tops for p in (ROOT / top).rglob("*") if p.suffix in (".py", ".md", ".toml") and p != own]
    paths += list(ROOT.glob("*.md"))
    assert len(paths) > 1000
    hits = [(p, TRANSLATED.search(p.read_text(encoding="utf-8"))) for p in paths]
    assert [f"{p.relative_to(ROOT)}: {hit[0]}" for p, hit in hits if hit is not None] == []
    assert TRANSLATED.search("the row names no clip")


@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "guide").glob("*.md")), ids=lambda page: page.stem)
def test_guides_do_not_speak(page: Path) -> None:
    assert (
        re.findall(r"\b(?:told|heard|looks at|looked at)\b|\b(?:says?|tells?) (?:nothing|so|what)\b", page.read_text())
        == []
    )


def test_planted_speech_is_found(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    path.write_text(
        '"""The file says so."""\nx = "a value that cannot be"\ny = "cannot be read"\nz = f"{x} looks at {y}"\n'
    )
    assert spoken(path, SPOKEN) == ["a.py:1: says so", "a.py:2: cannot be", "a.py:4: looks at"]


def test_planted_words_are_found(tmp_path: Path) -> None:
    path = tmp_path / "a.py"
    path.write_text(
        "class LooksAhead:\n    heard: int = 0\n\n    def f(self, q_paid): ...\n\n\nx = 'css goes by edges'\n"
    )
    assert sorted(forbidden(path)) == ["a.py:1: LooksAhead", "a.py:2: heard", "a.py:4: q_paid", "a.py:7: goes by"]


def repeated_classes(root: Path) -> list[str]:
    """Public classes of one name in two files."""
    files: dict[str, set[str]] = defaultdict(set)
    for top in TOP:
        for path in (root / top).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    files[node.name].add(path.relative_to(root).as_posix())
    return [f"{name}: {', '.join(sorted(where))}" for name, where in sorted(files.items()) if len(where) > 1]


def test_class_names_are_unique() -> None:
    assert repeated_classes(ROOT) == []


def test_a_planted_class_of_the_same_name_is_found(tmp_path: Path) -> None:
    for name in ("humanoid/a.py", "viz/b.py"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text("class Mixture: ...\n")
    assert repeated_classes(tmp_path) == ["Mixture: humanoid/a.py, viz/b.py"]
