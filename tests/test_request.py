"""An option is declared once: all that a user sees of it follows from that declaration."""

from __future__ import annotations

import inspect
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

import kinemode as km
from humanoid.support.errors import InputError
from kinemode import cli, request as declared
from kinemode.flags import TYPES, flag_types
from kinemode.option import KINDS, check_options, options_of, words_given
from kinemode.request import FileOptions, TrackRequest
from tests.waiting import DEADLINE

ROOT = Path(__file__).resolve().parent.parent
REQUESTS = [kind for kind in vars(declared).values() if isinstance(kind, type) and kind.__name__.endswith("Request")]

WITH_A_TOY = """
import importlib.util, sys
from pathlib import Path
spec = importlib.util.find_spec("kinemode.request")
line = '    tracker: str | None = option('
toy = '    toy_count: int = option(3, "How many toys there are.", low=1, unit="toys")\\n'
source = Path(spec.origin).read_text()
assert source.count(line) == 1
sys.modules["kinemode.request"] = module = importlib.util.module_from_spec(spec)
exec(compile(source.replace(line, toy + line), spec.origin, "exec"), module.__dict__)
"""
SHOWN = {
    "Python": "import inspect, kinemode as km; print(inspect.signature(km.track), km.track.__doc__)",
    "command line": "from kinemode.__main__ import main; main(['track', '--help'])",
    "refused": "import kinemode as km\ntry: km.track('human34', toy_count=0)\nexcept km.InputError as e: print(e)",
    "manifest": "from kinemode.batches.manifest import rows_of; "
    "print(rows_of([{'keypoints': sys.argv[1], 'toy-count': '5'}])[0].options)",
    "run": "from kinemode.option import words_given; print(words_given(module.TrackRequest('human34', toy_count=7)))",
    "report": "from types import SimpleNamespace as S; from kinemode.reporting import command_of; "
    "print(command_of(S(file=Path('a.run'), header=S(request={'toy-count': ('7',)}, retargeted=False))))",
    "pages": "sys.path.insert(0, sys.argv[2]); import generate; print(generate.commands(), generate.interface())",
}
TOLD = {
    "Python": ["toy_count: 'int' = 3", "toy_count: How many toys there are. Range: 1 or more toys."],
    "command line": ["--toy-count", "How many toys there are."],
    "refused": ["toy_count: must be 1 or more toys, got 0"],
    "manifest": ["'toy_count': 5"],
    "run": ["'toy-count': ('7',)"],
    "report": ["--toy-count 7"],
    "pages": ["--toy-count", "`toy_count`: How many toys there are."],
}


@pytest.fixture(scope="module")
def shown() -> dict[str, str]:
    """What each place prints, by its name: all of them in one process, in which the option is declared."""
    parts = [f"print({_NEXT + name!r})\n{program}" for name, program in SHOWN.items()]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join([WITH_A_TOY.replace("\\\\n", "\\n"), *parts]), __file__, str(ROOT / "docs")],
        capture_output=True, text=True, cwd=ROOT, timeout=DEADLINE, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return {name: text for name, _, text in (part.partition("\n") for part in done.stdout.split(_NEXT)[1:])}


_NEXT = "--- next: "


@pytest.mark.parametrize("where", SHOWN)
def test_a_new_option_is_a_line_of_one_file(where: str, shown: dict[str, str]) -> None:
    for text in TOLD[where]:
        assert text in " ".join(shown[where].split())


@pytest.mark.parametrize("request_kind", REQUESTS, ids=lambda kind: kind.__name__)
def test_every_field_is_an_option_of_a_kind_that_is_known(request_kind: type) -> None:
    options = options_of(request_kind)
    assert [field.name for field in fields(request_kind)] == list(options)
    for option in options.values():
        assert option.help
        for part in option.parts:
            assert part in KINDS or part == "None" or part.startswith("Literal["), (option.name, part)
        if not option.is_needed:
            option.check(option.default)
    assert set(flag_types(request_kind)) >= {name for name, o in options.items() if set(o.parts) <= set(TYPES)}


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"floor": "ground"}, "floor: 'ground' is unknown (a number, auto or off)"),
        ({"floor": 2e3}, "floor: must be -1000 to 1000 m, got 2000.0"),
        ({"height": float("nan")}, "height: must be 0.5 to 2.5 m, got nan"),
        ({"sync": "on"}, "sync: 'on' is unknown (one of off, auto)"),
        ({"seed": -1}, "seed: must be 0 or more, got -1"),
        ({"seed": 2**70}, "seed: must be 0 or more, got "),
        ({"seed": True}, "seed: cannot be of type bool (True) (give a whole number)"),
        ({"detect": "yes"}, "detect: cannot be of type str ('yes') (give True or False)"),
        ({"cameras": 3}, "cameras: cannot be of type int (3) (give the path of a camera file"),
    ],
)
def test_a_value_of_another_kind_or_out_of_range_is_refused(given: dict[str, Any], problem: str) -> None:
    with pytest.raises(InputError) as error:
        check_options(TrackRequest("human34", **given))
    assert str(error.value).startswith(problem)


def test_only_what_is_given_is_kept() -> None:
    assert words_given(FileOptions()) == {}
    asked = words_given(TrackRequest("human34", "a.mp4", out="a.run", resume=True, sync="auto", detect=True))
    assert asked == {"subject": ("human34",), "clips": ("a.mp4",), "sync": ("auto",), "detect": ()}


def test_functions_take_the_options_of_their_request() -> None:
    assert list(inspect.signature(km.track).parameters) == list(options_of(TrackRequest))
    with pytest.raises(TypeError, match=r"track\(\) got an unexpected keyword argument 'flor'"):
        km.track("human34", flor=0.0)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"Tracker\(\) missing a required argument: 'subject'"):
        km.Tracker()  # type: ignore[call-arg]


def test_trackers_are_named_by_commas_or_one_by_one() -> None:
    line = ["compare", "a.mp4", "--out", "a", "--trackers", "css", "single-mode,annealed", "--cues", "edges,flow"]
    _, bound, _ = cli.app.parse_args(line, exit_on_error=False, print_error=False)
    assert bound.arguments["trackers"] == ["css", "single-mode,annealed"]
    assert bound.arguments["clips"] == ("a.mp4",)
    assert bound.arguments["cues"] == "edges,flow"
