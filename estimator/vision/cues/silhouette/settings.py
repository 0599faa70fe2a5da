"""Settings of the silhouette."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.vision.cues.silhouette.subtraction import SilhouetteSettings
from humanoid.support.settings import setting


@dataclass(frozen=True)
class SilhouetteCueSettings(SilhouetteSettings):
    """How the person is told from the background, and how their outline enters the energy.

    evidence: independent measurements that the foreground's outline counts as, 0 for none: half from the model's
        contour to the outline (Leclerc: a limb missing from the foreground must pull nothing), half the other way
        (Lorentzian).
    noise: standard deviation, as a fraction of the subject's extent. nu: spread of both.
    """

    evidence: float = setting(60.0, at_least=0)
    noise: float = setting(0.02, above=0)
    nu: float = setting(8.0, above=0)
