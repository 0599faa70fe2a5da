"""Indices of examples: trained into a file, or into the user's cache when one is needed."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from estimator.search.examples.index import FORMAT, IndexRecipe, check_index
from estimator.search.settings import BY_INDEX
from estimator.synthesis.training import check_flesh, train_index
from estimator.tracking.registry import TRACKERS
from humanoid.kinematics.body import Body
from humanoid.subject.subject import BUILT_IN, Subject, load_subject
from humanoid.support.compiled_cache import cache_roots
from humanoid.support.errors import InputError
from kinemode import __version__
from kinemode.notices import warn
from kinemode.progress import Reporter
from kinemode.settings import Chosen
from kinemode.target import cache_folder, check_absent, check_folder, made_folder
from kinemode.terminal.interruption import kept_if_interrupted

LABEL = "training"
_SECONDS_EACH = 0.008  # of one core, for an example


def write_index(
    subject: Subject, recipe: IndexRecipe, out: Path, *, workers: int, overwrite: bool, progress: Reporter
) -> Path:
    """Train an index into a file; finished parts are kept in a folder next to it until it is complete, so that the same
    call resumes after an interruption. Raises InputError where the file exists, or cannot be written."""
    check_folder(out)
    check_absent([out], False, overwrite, "--overwrite replaces it")
    parts = out.with_name(f"{out.name}.parts")
    made_folder(parts)
    with kept_if_interrupted(lambda: None), threadpool_limits(limits=1), progress(LABEL) as report:
        index = train_index(subject, recipe, parts=parts, processes=workers, progress=report)
    index.save(out)
    shutil.rmtree(parts, ignore_errors=True)
    return out


def painting_seconds(recipe: IndexRecipe) -> float:
    """About how long an index takes one core [s]."""
    return (recipe.examples + 2 * recipe.pairs) * _SECONDS_EACH


def beginning(chosen: Chosen, start: str | None) -> Chosen:
    """A tracker's settings with what its first pose comes from, where that is given."""
    if start is None:
        return chosen
    search = replace(chosen.settings.search, start=start)
    return replace(chosen, settings=replace(chosen.settings, search=search))


def uses_index(chosen: Chosen) -> bool:
    """Whether a tracker makes use of an index that is given."""
    return _needs_index(chosen) or TRACKERS[chosen.tracker].may_look_up(chosen.settings.own)


def index_unused(chosen: Chosen) -> InputError:
    """The error of an index that is given to a tracker that makes no use of it."""
    remedy = "leave it out, start with it (--start index), or --tracker elmo"
    return InputError("index", f"{chosen.tracker} looks nothing up in it", remedy=remedy)


def _needs_index(chosen: Chosen) -> bool:
    own, search = chosen.settings.own, chosen.settings.search
    return search.start == BY_INDEX or TRACKERS[chosen.tracker].looks_up(own)


def with_index(chosen: Chosen, subject: Subject, given: str | Path | None, progress: Reporter) -> Chosen:
    """A tracker's settings with the index that it looks poses up in: the file given, the one its settings name, or the
    one of the subject in the cache, which is trained where it is not there. A tracker that can do without, and for
    which none is named, gets none.

    Raises
    ------
    InputError: an index for a tracker that looks nothing up; one that does not suit the subject.
    """
    search = chosen.settings.search
    if given is not None and not uses_index(chosen):
        raise index_unused(chosen)
    named = (given or search.index) if uses_index(chosen) else None
    if not named and not _needs_index(chosen):
        return chosen
    path = Path(named or _cached(subject, progress)).absolute()
    check_index(path, Body(subject))
    return replace(chosen, settings=replace(chosen.settings, search=replace(search, index=str(path))))


def _cached(subject: Subject, progress: Reporter) -> Path:
    """The index of a subject by the default recipe; one with the coordinates of a built-in one, fitted to whomever, has
    that of the built-in one, whose pictures are of people of all sizes."""
    check_flesh(subject)  # before minutes are spent on the built-in one's
    names = Body(subject).q_names
    alike = (built_in for built_in in map(load_subject, BUILT_IN) if Body(built_in).q_names == names)
    known = next(alike, subject)
    recipe = IndexRecipe()
    text = f"{known.urdf}{recipe!r}{FORMAT}{__version__}"
    name = f"examples-{hashlib.sha256(text.encode()).hexdigest()[:16]}.npz"
    for root in cache_roots():
        if (path := root / name).is_file():
            return path
    minutes = painting_seconds(recipe) / 60.0
    note = f"there is no index of {known.source} yet: {recipe.examples} examples are painted, once"
    warn(f"{note}, in about {minutes:.0f} minutes (kinemode train-index)")
    return write_index(known, recipe, cache_folder() / name, workers=1, overwrite=True, progress=progress)
