"""Settings of the silhouette in the image likelihood."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.vision.cues.settings import SurfaceSettings
from humanoid.support.idle import idle_where
from humanoid.support.settings import setting


@dataclass(frozen=True)
class OutlineLikelihoodSettings(SurfaceSettings):
    """How silhouettes enter the energy.

    outline_evidence, outline_noise, outline_nu: of the foreground's outline, half from the model's contour to the
        outline (Leclerc: a limb missing from the foreground must pull nothing), half the other way (Lorentzian).
    """

    outline_evidence: float = setting(60.0, at_least=0)
    outline_noise: float = setting(0.02, above=0)
    outline_nu: float = setting(8.0, above=0)


_OUTLINE = "cost.image.outline_evidence cost.image.outline_noise cost.image.outline_nu"
IDLE = (
    idle_where(_OUTLINE, cues__use_silhouette=False),
    idle_where("cost.image.outline_nu", cost__image__outline_evidence=0.0),
)
