"""`train_templates`: what limbs look like to all cameras of a rig, painted into a file that part detectors go by."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from kinemode.inputs.named import PathLike
from kinemode.public.arguments import check_arguments, check_as, whole
from kinemode.public.tracking import loaded_subject
from kinemode.target import check_absent, check_folder
from kinemode.terminal.progress import Reporter, unreported

if TYPE_CHECKING:
    from collections.abc import Sequence

    from estimator.data.cameras.camera import Camera
    from kinemode.public.tracking import SubjectLike

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
    from estimator.synthesis.examples import limb_templates
    from estimator.trackers.loose_limbed.part_detectors.template_file import save_templates

    known = cameras if isinstance(cameras, Mapping) else load_cameras(cameras)
    named = [name for name in limbs.split(",") if name] if isinstance(limbs, str) else list(limbs)
    with threadpool_limits(limits=1), (progress or unreported)(LABEL) as report:
        made = limb_templates.train_templates(
            loaded, list(known.values()), poses=whole("poses", poses, 1), limbs=named, seed=whole("seed", seed, 0),
            progress=report,
        )  # fmt: skip
    save_templates(made, out)
    return Path(out)
