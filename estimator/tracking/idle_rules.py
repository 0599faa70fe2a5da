"""Which settings have no effect under which others."""

from __future__ import annotations

from typing import Any, NamedTuple


class Rule(NamedTuple):
    """Settings that have no effect, or groups that stand for all in them, by their names with their groups in front;
    where all of `where` have these values, for trackers that go by `group` (all, where it is empty). because: why,
    where the values do not say it."""

    names: tuple[str, ...]
    where: tuple[tuple[str, Any], ...] = ()
    group: str = ""
    because: str = ""

    @property
    def reason(self) -> str:
        """Why they have none."""
        words = {True: "on", False: "off"}
        said = [f"{name} is {words[v] if isinstance(v, bool) else f'{v:g}' if v == 0 else v}" for name, v in self.where]
        return " and ".join([*said, self.because] if self.because else said)


def _rule(names: str, group: str = "", because: str = "", **where: Any) -> Rule:
    """names: separated by blanks. where: names with two underscores for their dots."""
    conditions = tuple((name.replace("__", "."), value) for name, value in where.items())
    return Rule(tuple(names.split()), conditions, group, because)


_TRANSITION = "cost.transition_potential cost.transition_nu"
_EDGES = "cost.image.edge_noise cost.image.edge_window cost.image.edge_candidates cost.image.edge_nu"
_FLOW = "cost.image.flow_noise cost.image.flow_share cost.image.flow_nu"
_BEGUN_ELSEWHERE = "no search begins where its parent was"

RULES = (
    _rule("cost.nu", cost__potential="gaussian"),
    _rule("cost.transition_nu", cost__transition_potential="gaussian"),
    _rule("cost.upright_weight cost.pose_prior_weight cost.pose_prior_file", cost__stabiliser_weight=0.0),
    _rule("cost.pose_prior_file", cost__pose_prior_weight=0.0),
    _rule("cost.clearance_scale search.contact", cost__interpenetration_weight=0.0),
    _rule("cost.exchange_penalty css.other_readings", search__exchange=False),
    _rule("search.settled", cost__image__rounds=1),
    _rule("search.weigh_samples", search__weigh="height"),
    _rule("search.weigh_samples", search__weigh="volume"),
    _rule("search.weigh search.weigh_samples", "single_mode", "a single mode has all the weight"),
    _rule("search.follow", "single_mode", single_mode__transition=False),
    _rule("search.follow", "condensation", _BEGUN_ELSEWHERE),
    _rule("search.follow", "annealed", _BEGUN_ELSEWHERE),
    _rule("search.follow", "multiple_hypothesis", _BEGUN_ELSEWHERE),
    _rule(
        "search.follow", "css", css__keep=False, css__other_readings=0, css__flips=0, css__limb_searches=0,
        css__exchanges=0,
    ),
    _rule(_TRANSITION, "condensation", "particles move by their dynamics alone"),
    _rule(_TRANSITION, "annealed", "particles move by their dynamics alone"),
    _rule(_TRANSITION, "single_mode", single_mode__transition=False),
    _rule(_TRANSITION, "css", css__transition=False),
    _rule("css.flip_penalty css.limb_penalty css.momentum", css__transition=False),
    _rule("css.flip_penalty", css__flips=0),
    _rule("css.limb_samples", css__limb_searches=0),
    _rule("css.limb_searches", css__limb_samples=0),
    _rule("css.limb_penalty", css__limb_searches=0, css__exchanges=0),
    _rule("css.limb_penalty", css__limb_samples=0, css__exchanges=0),
    _rule("css.shape css.scale css.tail", css__samples=0),
    _rule("css.tail", because="which is regular", css__shape="weakest"),
    _rule("css.budget.alarm", css__budget__calm=1.0),
    _rule("css.budget.alarm", css__keep=False),
    _rule("annealed.diffusion", annealed__layers=1),
    _rule("annealed.cluster", annealed__modes=1),
    _rule("condensation.cluster", condensation__modes=1),
    _rule(
        f"cues.edges cost.image.edge_evidence cost.image.motion_boundary {_EDGES}", cues__use_edges=False,
    ),
    _rule(f"cost.image.motion_boundary {_EDGES}", cost__image__edge_evidence=0.0),
    _rule("cues.edges", cost__image__edge_evidence=0.0, cues__use_silhouette=False),
    _rule(f"cues.flow cost.image.flow_evidence cost.image.motion_boundary {_FLOW}", cues__use_flow=False),
    _rule(_FLOW, cost__image__flow_evidence=0.0),
    _rule("cues.flow", cost__image__flow_evidence=0.0, cost__image__motion_boundary=0.0),
    _rule("cues.flow", cost__image__flow_evidence=0.0, cost__image__edge_evidence=0.0),
    _rule("cues.flow", cost__image__flow_evidence=0.0, cues__use_edges=False),
    _rule(
        "cues.silhouette cost.image.outline_evidence cost.image.outline_noise cost.image.outline_nu",
        cues__use_silhouette=False,
    ),
    _rule("cost.image.outline_nu", cost__image__outline_evidence=0.0),
    _rule(
        "cost.image.back_facing cost.image.occluded", cost__image__visibility_evidence=0.0,
        cost__image__edge_evidence=0.0,
    ),
    _rule(
        "cost.image.back_facing cost.image.occluded", cost__image__visibility_evidence=0.0, cues__use_edges=False,
    ),
    _rule("smooth.lag smooth.lag_iterations", because="they are for live use; a clip is smoothed as a whole"),
    _rule(
        "smooth.turn_acceleration smooth.root_turn_acceleration smooth.root_slide_acceleration smooth.iterations"
        " smooth.tolerance smooth.window",
        smooth__enabled=False,
    ),
)  # fmt: skip

OF_PICTURES = (
    "cost.image", "cues", "search.follow", "search.settled", "css.momentum", "css.limb_searches", "css.limb_samples",
    "css.limb_penalty", "css.exchanges",
)  # fmt: skip
"""What has an effect where pictures are looked at."""
OF_ONE_CAMERA = ("css.flips", "css.flip_penalty", "css.exchanges")
"""What has an effect where there is one camera."""
