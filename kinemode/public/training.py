"""What a body looks like, painted into files: `train_index` for trackers that look poses up, `train_templates` for part
detectors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from humanoid.support.errors import InputError
from kinemode.named import PathLike
from kinemode.progress import Reporter, unreported
from kinemode.public.arguments import check_arguments, check_as, whole
from kinemode.public.tracking import loaded_subject
from kinemode.target import check_absent, check_folder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from estimator.data.cameras.camera import Camera
    from estimator.search.examples.index import IndexRecipe
    from kinemode.public.tracking import SubjectLike


def train_index(
    subject: SubjectLike,
    out: PathLike,
    *,
    examples: int = 60_000,
    headings: float = 360.0,
    legs: bool = False,
    elevation: float = 8.0,
    seed: int = 0,
    workers: int = 1,
    overwrite: bool = False,
    progress: Reporter | None = None,
) -> Path:
    """Paint examples of a subject's poses, and write them as an index for `track(..., tracker="elmo", index=...)`.

    The same call goes on where one was interrupted; the index is the same with any number of workers.

    Parameters
    ----------
    subject: with flesh: a loaded subject, a built-in name, or the path of a URDF.
    out: the file.
    examples: how many. headings: range of the body's heading about facing the camera [degrees]. legs: whether they move
        as arms do not: as far as their rest positions let them. elevation: by how much the camera looks down [degrees].
    seed: of poses, clothes and light. workers: how many processes share the work. overwrite: replace `out`.
    progress: opens a progress report, such as `kinemode.reported`; none by default.

    Returns the file.

    Raises
    ------
    InputError: a subject without flesh, invalid numbers, a file that is there or cannot be written.
    """
    check_arguments(subject=subject, examples=examples, seed=seed, workers=workers, progress=progress)
    check_as("file", out=out)
    check_as("fps", headings=headings, elevation=elevation)
    check_as("overwrite", legs=legs, overwrite=overwrite)
    for name, value, low, high in (("headings", headings, 0.0, 360.0), ("elevation", elevation, -10.0, 60.0)):
        if not low <= value <= high:
            raise InputError(name, f"is {value:g}", remedy=f"{low:g} to {high:g} degrees")
    count = whole("examples", examples, 1)
    check_folder(Path(out))
    check_absent([Path(out)], False, overwrite, "--overwrite replaces it")
    loaded = loaded_subject(subject)
    from estimator.numerics.processes import checked_count
    from estimator.search.examples.index import IndexRecipe
    from kinemode.indexing import write_index

    recipe: IndexRecipe = IndexRecipe(
        examples=count, headings=float(headings), legs=legs, elevation=float(elevation), seed=whole("seed", seed, 0)
    )
    processes = checked_count(workers)
    return write_index(
        loaded, recipe, Path(out), workers=processes, overwrite=overwrite, progress=progress or unreported
    )


LABEL = "training"


def train_templates(
    cameras: PathLike | Mapping[str, Camera],
    out: PathLike,
    *,
    subject: SubjectLike = "human34",
    limbs: str | Sequence[str] = (),
    poses: int = 1500,
    seed: int = 0,
    overwrite: bool = False,
    progress: Reporter | None = None,
) -> Path:
    """Paint a subject as the cameras of a rig see it, and write what its limbs look like to all of them together.

    It is drawn in random poses, sizes, clothes and light anywhere in the cameras' common volume, upright along the
    world's z. The templates are those of Sigal et al. (CVPR 2004, section 5), and suit this rig only.

    Parameters
    ----------
    cameras: the calibration: the path of a camera file, or cameras by name, in the order of the clips.
    out: the file.
    subject: with flesh: a loaded subject, a built-in name, or the path of a URDF.
    limbs: names of limbs (a text with commas, or a list); the other side's come with them. All unless given.
    poses: how many are painted. seed: of all that is random. overwrite: replace `out`.
    progress: opens a progress report, such as `kinemode.reported`; none by default.

    Returns the file.

    Raises
    ------
    InputError: cameras that see no place in common, a limb that is none, a subject that cannot be painted, too few
    poses, a file that is there or cannot be written.
    """
    check_arguments(cameras=cameras, subject=subject, limbs=limbs, poses=poses, seed=seed, progress=progress)
    check_as("file", out=out)
    check_as("overwrite", overwrite=overwrite)
    check_folder(Path(out))
    check_absent([Path(out)], False, overwrite, "--overwrite replaces it")
    loaded = loaded_subject(subject)
    from threadpoolctl import threadpool_limits

    from estimator.data.formats.cameras import load_cameras
    from estimator.synthesis import limb_templates
    from estimator.trackers.loose_limbed.part_detectors.templates import save_templates

    known = cameras if isinstance(cameras, Mapping) else load_cameras(cameras)
    named = [name for name in limbs.split(",") if name] if isinstance(limbs, str) else list(limbs)
    with threadpool_limits(limits=1), (progress or unreported)(LABEL) as report:
        made = limb_templates.train_templates(
            loaded, list(known.values()), poses=whole("poses", poses, 1), limbs=named, seed=whole("seed", seed, 0),
            progress=report,
        )  # fmt: skip
    save_templates(made, out)
    return Path(out)
