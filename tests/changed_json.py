"""One value of a JSON text replaced."""

from __future__ import annotations

import json
from typing import Any


def changed(value: Any, place: str, new: Any) -> bytes:
    """JSON of nested values with one of them replaced; `place` has dots between keys and indices."""
    value = json.loads(json.dumps(value))
    *path, last = [int(key) if key.isdecimal() else key for key in place.split(".")]
    inner = value
    for key in path:
        inner = inner[key]
    inner[last] = new
    return json.dumps(value).encode()
