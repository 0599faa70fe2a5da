"""Values computed once for an object, and kept as long as it lives."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

Thing = TypeVar("Thing")
More = ParamSpec("More")
Answer = TypeVar("Answer")


def per_object(function: Callable[Concatenate[Thing, More], Answer]) -> Callable[Concatenate[Thing, More], Answer]:
    """A function of one object that never changes, and of hashable arguments, which is called once for each of them.

    Its results are shared and must not be changed; a result that refers to the object keeps it alive.
    """
    kept: WeakKeyDictionary[Any, dict[Any, Answer]] = WeakKeyDictionary()

    @wraps(function)
    def once(thing: Thing, *args: More.args, **kwargs: More.kwargs) -> Answer:
        answers = kept.setdefault(thing, {})
        key = (args, tuple(sorted(kwargs.items())))
        if key not in answers:
            answers[key] = function(thing, *args, **kwargs)
        return answers[key]

    return once
