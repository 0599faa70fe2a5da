"""Which bodies make a limb: a rule from their lengths and places in the tree, never from names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from humanoid.limbs.bodies import Bodies

Detail = Literal["paper", "fine"]
_HUB = 3  # neighbours from which a limb is one that others branch from
_BALL = 3  # degrees of freedom of a joint that begins a limb, however short
_FEWEST = 2  # limbs, below which nothing is merged


@dataclass(frozen=True)
class Rule:
    """Below which lengths limbs are merged, in lengths of the longest body.

    root: the root. end: the end of a chain, as a foot or a hand. twig: an end that hangs on a hub, as a finger or head.
    link: between a hub and another limb, on a joint of at most two degrees of freedom, as a clavicle.
    """

    root: float
    end: float
    twig: float
    link: float


RULES: dict[str, Rule] = {"paper": Rule(0.5, 0.5, 0.2, 0.5), "fine": Rule(0.1, 0.1, 0.1, 0.45)}


@dataclass(frozen=True)
class Group:
    """Bodies that make a limb, the topmost first, and the one of them that carries it.

    fixed: whether it was requested, so that nothing with a surface is merged with it. name: its given name.
    """

    members: tuple[int, ...]
    carrier: int
    fixed: bool = False
    name: str = ""


def topmost_first(bodies: Bodies, members: Iterable[int]) -> list[int]:
    """Connected bodies, beginning with the one that hangs on none of them."""
    own = set(members)
    return sorted(own, key=lambda j: (int(bodies.parent[j]) in own, j))


class Groups:
    """The partition of a body into limbs while it is made."""

    def __init__(self, bodies: Bodies, fixed: Sequence[Group]) -> None:
        self.bodies = bodies
        self.all = {group.members[0]: group for group in fixed}
        taken = {j for group in fixed for j in group.members}
        units: dict[int, list[int]] = {}
        for j in range(len(bodies.parent)):
            if bodies.parent[j] >= -1 and j not in taken:
                units.setdefault(int(bodies.unit[j]), []).append(j)
        for unit, members in units.items():
            members = topmost_first(bodies, members)
            self.all[members[0]] = Group(tuple(members), unit)
        self.length = {top: bodies.length(list(group.members)) for top, group in self.all.items()}

    def above(self, top: int) -> int | None:
        """The group, by its topmost body, that a group hangs on."""
        parent = int(self.bodies.parent[top])
        return next((t for t, group in self.all.items() if parent in group.members), None)

    def neighbours(self) -> dict[int, list[int]]:
        """Neighbours of every group, with the one that it hangs on first."""
        above = {top: self.above(top) for top in self.all}
        around: dict[int, list[int]] = {top: [] if up is None else [up] for top, up in above.items()}
        for top, up in above.items():
            if up is not None:
                around[up].append(top)
        return around

    def joined(self, a: int, b: int) -> bool:
        """Whether a joint joins two neighbours; see `Bodies.hung`."""
        lower = a if self.bodies.parent[a] in self.all[b].members else b
        return not self.bodies.hung[lower]

    def merge(self, top: int, into: int, carried: bool) -> None:
        """Two groups become one; `carried`: by what carried the second, else by the longer's."""
        first, second = self.all.pop(top), self.all.pop(into)
        longer = second if carried or self.length[into] >= self.length[top] else first
        members = tuple(topmost_first(self.bodies, first.members + second.members))
        self.all[members[0]] = Group(members, longer.carrier, second.fixed, second.name)
        self.length[members[0]] = self.bodies.length(list(members))


def merged(bodies: Bodies, rule: Rule, fixed: Sequence[Group] = ()) -> list[Group]:
    """The limbs of a body, inner ones first; `fixed` ones are unchanged, except for bodies without surface.

    Bodies without surface go first, then what is shorter than the rule's limit, the shortest first and the root last,
    into the neighbour with the most neighbours (of equals, the one that it hangs on). Lengths are measured again each
    time.
    """
    groups = Groups(bodies, fixed)
    while (bare := _bare(groups)) is not None:
        groups.merge(*bare, carried=True)
    while len(groups.all) > _FEWEST and (short := _shortest(groups, rule)) is not None:
        groups.merge(*short, carried=False)
    return [groups.all[top] for top in sorted(groups.all, key=lambda top: _depths(groups, top))]


def _bare(groups: Groups) -> tuple[int, int] | None:
    around = groups.neighbours()
    for top in sorted(groups.all):
        if groups.bodies.size(list(groups.all[top].members)) == 0 and around[top]:
            return top, _most_neighbours(around, [t for t in around[top] if groups.joined(top, t)] or around[top])
    return None


def _shortest(groups: Groups, rule: Rule) -> tuple[int, int] | None:
    around, options = groups.neighbours(), []
    for top, group in groups.all.items():
        open_ones = [t for t in around[top] if not groups.all[t].fixed and groups.joined(top, t)]
        if (
            not group.fixed
            and open_ones
            and groups.length[top] < groups.bodies.longest * _limit(groups, around, top, rule)
        ):
            is_root = bool(groups.bodies.parent[top] == -1)
            options.append((is_root, groups.length[top], top, _most_neighbours(around, open_ones)))
    return min(options)[2:] if options else None


def _limit(groups: Groups, around: dict[int, list[int]], top: int, rule: Rule) -> float:
    """The length below which a group is merged, by its place in the tree; 0 where it never is."""
    hub = any(len(around[t]) >= _HUB for t in around[top])
    if groups.bodies.parent[top] == -1:
        return rule.root
    if len(around[top]) == 1:
        return rule.twig if hub else rule.end
    linking = len(around[top]) == 2 and hub and groups.bodies.freedom[top] < _BALL
    return rule.link if linking else 0.0


def _most_neighbours(around: dict[int, list[int]], among: list[int]) -> int:
    return max(among, key=lambda t: len(around[t]))  # the first of equals


def _depths(groups: Groups, top: int) -> tuple[int, int]:
    """Sort key: number of groups above, then the order of the joints."""
    depth, up = 0, groups.above(top)
    while up is not None:
        depth, up = depth + 1, groups.above(up)
    return depth, top
