"""A tracker of another package: registered by being imported, named nowhere else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from estimator.trackers.spec import Spec
from estimator.tracking.registry import register
from humanoid.support.settings import setting, unused_where


@dataclass(frozen=True)
class LazySettings:
    """How lazy it is.

    naps: how many a frame. depth: of a nap. bed: where.
    """

    naps: int = setting(2, at_least=0, at_most=5)
    depth: float = setting(0.5, above=0)
    bed: str = setting("sofa", one_of=("sofa", "floor"))


class Lazy:
    """Needs no search for modes."""

    def __init__(self, body: Any, settings: LazySettings) -> None:
        self.body, self.settings = body, settings


register(
    Spec(
        name="lazy",
        sentence="stays where it is",
        make=lambda body, settings: Lazy(body, settings.own),  # type: ignore[arg-type, return-value]
        group="lazy",
        settings=LazySettings(),
        defaults={"smooth": {"enabled": False}},
        unused=(unused_where("lazy.depth", lazy__naps=0),),
    )
)
