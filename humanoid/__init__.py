"""The tracked subject, its body and its geometry. Independent of images."""

from __future__ import annotations

from typing import TYPE_CHECKING

from humanoid.support.extras import lazy_names

# Pinocchio and numba take half a second to import, which those who need `humanoid.support` alone need not wait for.
if TYPE_CHECKING:
    from humanoid.kinematics.body import Body as Body, PosedBody as PosedBody
    from humanoid.subject.subject import (
        Flesh as Flesh,
        Landmark as Landmark,
        Proportion as Proportion,
        Stabiliser as Stabiliser,
        Subject as Subject,
        load_subject as load_subject,
        subject_names as subject_names,
    )
    from humanoid.support.errors import InputError as InputError

__all__, __getattr__ = lazy_names(__name__)
