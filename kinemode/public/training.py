"""Appearances of a body, painted into files: `train_index` for trackers that look poses up, `train_templates` for part
detectors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from kinemode.making_requests import IndexRequest, TemplatesRequest
from kinemode.option import takes
from kinemode.public.tracking import loaded_subject
from kinemode.target import check_absent, check_folder

LABEL = "training"


@takes(IndexRequest)
def train_index(request: IndexRequest) -> Path:
    """Paint examples of a subject's poses, and write them as an index for `track(..., tracker="elmo", index=...)`.

    The same call resumes an interrupted one; the index is the same with any number of workers.

    Parameters
    ----------
    OPTIONS

    Returns the file.

    Raises
    ------
    InputError: a subject without flesh, invalid numbers, a file that is there or cannot be written.
    """
    file = _new_file(request)
    loaded = loaded_subject(request.subject)
    from estimator.numerics.processes import checked_count
    from estimator.search.examples.index import IndexRecipe
    from kinemode.indexing import write_index

    recipe = IndexRecipe(
        examples=int(request.examples), headings=float(request.headings), legs=request.legs,
        elevation=float(request.elevation), seed=int(request.seed),
    )  # fmt: skip
    processes = checked_count(request.workers)
    return write_index(loaded, recipe, file, workers=processes, overwrite=request.overwrite, progress=request.reporter)


@takes(TemplatesRequest)
def train_templates(request: TemplatesRequest) -> Path:
    """Paint a subject as the cameras of a rig see it, and write what its limbs look like to all of them together.

    It is drawn in random poses, sizes, clothes and light anywhere in the cameras' common volume, upright along the
    world's z. The templates are those of Sigal et al. (CVPR 2004, section 5), and suit this rig only.

    Parameters
    ----------
    OPTIONS

    Returns the file.

    Raises
    ------
    InputError: cameras that see no place in common, an unknown limb, a subject that cannot be painted, too few
    poses, a file that is there or cannot be written.
    """
    file, limbs = _new_file(request), request.limbs
    loaded = loaded_subject(request.subject)
    from threadpoolctl import threadpool_limits

    from estimator.data.formats.cameras import load_cameras
    from estimator.synthesis import limb_templates
    from estimator.trackers.loose_limbed.part_detectors.templates import save_templates

    cameras = request.cameras if isinstance(request.cameras, Mapping) else load_cameras(request.cameras)
    named = [name for name in limbs.split(",") if name] if isinstance(limbs, str) else list(limbs)
    with threadpool_limits(limits=1), request.reporter(LABEL) as report:
        made = limb_templates.train_templates(
            loaded, list(cameras.values()), poses=int(request.poses), limbs=named, seed=int(request.seed),
            progress=report,
        )  # fmt: skip
    save_templates(made, file)
    return file


def _new_file(request: IndexRequest | TemplatesRequest) -> Path:
    """The file to write, which can be written and is not there, or may be replaced."""
    file = Path(request.out)
    check_folder(file)
    check_absent([file], False, request.overwrite, "--overwrite replaces it")
    return file
