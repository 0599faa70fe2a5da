"""Which of the common settings have no effect under which others; a tracker's own rules stand in its `Spec`."""

from __future__ import annotations

from humanoid.support.idle import PICTURES, idle_where, idle_without

_EDGES = "cost.image.edge_noise cost.image.edge_window cost.image.edge_candidates cost.image.edge_nu"
_FLOW = "cost.image.flow_noise cost.image.flow_share cost.image.flow_nu"
_SEEN = "cost.image.back_facing cost.image.occluded"

RULES = (
    idle_where("cost.nu", cost__potential="gaussian"),
    idle_where("cost.transition_nu", cost__transition_potential="gaussian"),
    idle_where("cost.upright_weight cost.pose_prior_weight cost.pose_prior_file", cost__stabiliser_weight=0.0),
    idle_where("cost.pose_prior_file", cost__pose_prior_weight=0.0),
    idle_where("cost.clearance_scale search.contact", cost__interpenetration_weight=0.0),
    idle_where("cost.exchange_penalty", search__exchange=False),
    idle_where("search.settled", cost__image__rounds=1),
    idle_where("search.weigh_samples", search__weigh="height"),
    idle_where("search.weigh_samples", search__weigh="volume"),
    idle_where(
        f"cues.edges cost.image.edge_evidence cost.image.motion_boundary {_EDGES}", cues__use_edges=False,
    ),
    idle_where(f"cost.image.motion_boundary {_EDGES}", cost__image__edge_evidence=0.0),
    idle_where("cues.edges", cost__image__edge_evidence=0.0, cues__use_silhouette=False),
    idle_where(f"cues.flow cost.image.flow_evidence cost.image.motion_boundary {_FLOW}", cues__use_flow=False),
    idle_where(_FLOW, cost__image__flow_evidence=0.0),
    idle_where("cues.flow", cost__image__flow_evidence=0.0, cost__image__motion_boundary=0.0),
    idle_where("cues.flow", cost__image__flow_evidence=0.0, cost__image__edge_evidence=0.0),
    idle_where("cues.flow", cost__image__flow_evidence=0.0, cues__use_edges=False),
    idle_where(
        "cues.silhouette cost.image.outline_evidence cost.image.outline_noise cost.image.outline_nu",
        cues__use_silhouette=False,
    ),
    idle_where("cost.image.outline_nu", cost__image__outline_evidence=0.0),
    idle_where(_SEEN, cost__image__visibility_evidence=0.0, cost__image__edge_evidence=0.0),
    idle_where(_SEEN, cost__image__visibility_evidence=0.0, cues__use_edges=False),
    idle_where("smooth.lag smooth.lag_iterations", "they are for live use; a clip is smoothed as a whole"),
    idle_where(
        "smooth.turn_acceleration smooth.root_turn_acceleration smooth.root_slide_acceleration smooth.iterations"
        " smooth.tolerance smooth.window",
        smooth__enabled=False,
    ),
    idle_without(PICTURES, "cost.image cues search.follow search.settled"),
)  # fmt: skip
