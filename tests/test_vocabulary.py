"""Names and messages in the field's terms: replaced words do not return to names, and messages give what is allowed and
what was found. Class names are unique."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.sources import Facts, below, facts_of
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


def is_gone(name: str) -> bool:
    return (CLASSES if name.lstrip("_")[:1].isupper() else NAMES).fullmatch(name) is not None


def spoken(path: Path, facts: Facts, phrases: re.Pattern[str]) -> list[str]:
    """Where a file's texts have such a phrase."""
    return [f"{path.name}:{line}: {hit[0]}" for text, line in facts.texts if (hit := phrases.search(text))]


def forbidden(path: Path, facts: Facts) -> list[str]:
    gone = [f"{path.name}:{line}: {name}" for name, line in facts.named if is_gone(name)]
    return gone + spoken(path, facts, MESSAGES)


@pytest.mark.parametrize("top", ["estimator", "benchmarks"])
def test_nothing_is_named_by_a_bare_participle(top: str, facts: Mapping[Path, Facts]) -> None:
    hits = set()
    for path, told in below(facts, top).items():
        names = {name for name, _ in told.named}
        hits |= {f"{path.name}: {name}" for name in names if is_gone(name) or PARTICIPLES.fullmatch(name)}
    assert hits - OPTIONS == set()


@pytest.mark.parametrize("top", TOP)
def test_words_are_the_fields(top: str, facts: Mapping[Path, Facts]) -> None:
    assert [hit for path, told in below(facts, top).items() for hit in forbidden(path, told)] == []


@pytest.mark.parametrize("folder", PLAIN)
def test_nothing_speaks(folder: str, facts: Mapping[Path, Facts]) -> None:
    files = {path: source for path, source in below(facts, folder).items() if path != Path(__file__).resolve()}
    assert files
    assert [hit for path, source in files.items() for hit in spoken(path, source, SPOKEN)] == []


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


def test_planted_speech_is_found() -> None:
    text = '"""The file says so."""\nx = "a value that cannot be"\ny = "cannot be read"\nz = f"{x} looks at {y}"\n'
    assert sorted(spoken(Path("a.py"), facts_of("a", text), SPOKEN)) == [
        "a.py:1: says so",
        "a.py:2: cannot be",
        "a.py:4: looks at",
    ]


def test_planted_words_are_found() -> None:
    text = "class LooksAhead:\n    heard: int = 0\n\n    def f(self, q_paid): ...\n\n\nx = 'css goes by edges'\n"
    assert sorted(forbidden(Path("a.py"), facts_of("a", text))) == [
        "a.py:1: LooksAhead",
        "a.py:2: heard",
        "a.py:4: q_paid",
        "a.py:7: goes by",
    ]


def repeated_classes(facts: Mapping[Path, Facts]) -> list[str]:
    """Public classes of one name in two files."""
    files: dict[str, set[str]] = defaultdict(set)
    for path, told in facts.items():
        for name in {each.name for each in told.classes if not each.name.startswith("_")}:
            files[name].add(path.relative_to(ROOT).as_posix())
    return [f"{name}: {', '.join(sorted(where))}" for name, where in sorted(files.items()) if len(where) > 1]


def test_class_names_are_unique(facts: Mapping[Path, Facts]) -> None:
    assert repeated_classes(below(facts, *TOP)) == []


def test_a_planted_class_of_the_same_name_is_found() -> None:
    planted = {ROOT / name: facts_of("a", "class Mixture: ...\n") for name in ("humanoid/a.py", "viz/b.py")}
    assert repeated_classes(planted) == ["Mixture: humanoid/a.py, viz/b.py"]
