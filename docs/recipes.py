"""The recipes in CONTRIBUTING.md: programs that the tests run, one for each family that others can add to.

`python docs/recipes.py` writes them there from the files in `tests`.
"""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "CONTRIBUTING.md"
_RECIPE = re.compile(r"(<!-- recipe: (tests/toy_\w+\.py) -->\n\n```python\n).*?(```)", re.DOTALL)


def with_recipes(text: str) -> str:
    """A page with each program below its mark as it is in its file, without the file's docstring."""
    return _RECIPE.sub(lambda match: match[1] + program(ROOT / match[2]) + match[3], text)


def program(path: Path) -> str:
    """A file without its docstring and the import that every file begins with."""
    _, _, text = path.read_text(encoding="utf-8").partition("from __future__ import annotations\n\n")
    return text


def recipes(text: str) -> list[str]:
    """The files whose programs a page has."""
    return [match[2] for match in _RECIPE.finditer(text)]


if __name__ == "__main__":
    PAGE.write_text(with_recipes(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
