"""Which of the common settings have no effect under which others; the rules of a tracker stand in its `Spec`.

There is a rule where somebody may well be mistaken: what makes the settings unused is a default, or the input. Who
turns a part off and sets its details, too, knows what he does.
"""

from __future__ import annotations

from humanoid.support.unused import ONE_CAMERA, PICTURES, unused_where, unused_without

RULES = (
    unused_where("cost.nu", cost__potential="gaussian"),
    unused_where("cost.transition_nu", cost__transition_potential="gaussian"),
    unused_where("cost.pose_prior_file", cost__pose_prior_weight=0.0),
    unused_where("cost.clearance_scale search.contact", cost__interpenetration_weight=0.0),
    unused_where("cost.exchange_penalty", search__exchange=False),
    unused_where("search.readings_rest smooth.reading", search__readings=False),
    unused_where("search.start_samples", search__start="index"),
    unused_where("search.weigh_samples", search__weigh="height"),
    unused_where("search.weigh_samples", search__weigh="volume"),
    unused_where("smooth.lag smooth.lag_iterations", "they are for live use; a clip is smoothed as a whole"),
    unused_where(
        "smooth.turn_acceleration smooth.root_turn_acceleration smooth.root_slide_acceleration smooth.iterations"
        " smooth.tolerance smooth.window smooth.rounds smooth.round_gain smooth.renewed smooth.memory"
        " smooth.pace_rounds smooth.pace_span smooth.pace_count smooth.lasting smooth.reading",
        smooth__enabled=False,
    ),
    unused_without(ONE_CAMERA, "search.readings search.readings_rest smooth.reading"),
    unused_without(
        PICTURES,
        "cues search.follow search.reassign_tolerance search.flow_in_covariance smooth.rounds smooth.round_gain"
        " smooth.renewed",
    ),
)  # fmt: skip
