"""Settings of flow."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.vision.cues.flow.flow_field import FlowSettings
from humanoid.support.settings import setting


@dataclass(frozen=True)
class FlowCueSettings(FlowSettings):
    """How flow is found and checked, and how it enters the energy.

    evidence: independent measurements that all inside nodes together count as (CSS eq. 9), 0 for none. leading: as many
        as it counts while it leads a hypothesis to where the other cues are matched, at least `evidence`. There it has
        to win over the transition; as evidence it counts less, since it is relative to a pose that is itself uncertain.
    noise [px], share: standard deviation of the flow, and its part that grows with the flow's length. nu: Lorentzian.
    """

    evidence: float = setting(10.0, at_least=0)
    leading: float = setting(60.0, at_least=0)
    noise: float = setting(0.5, above=0)
    share: float = setting(0.1, at_least=0)
    nu: float = setting(4.0, above=0)
