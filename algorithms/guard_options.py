"""Readings of Alg. 2 that can be switched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class GuardOptions:
    """Readings of Alg. 2 that can be switched; the defaults are those of docs/fidelity.md.

    Attributes:
        literal_all_lanes: Every object counts, whatever its lane.
        literal_followers: Followers in the ego's own lane count, too.
        literal_selection: The printed max over preceding objects, which picks the least binding one; an object
            alongside, a_safe = -inf, is never the greatest, and one that is alone there binds as little as none.
        literal_longitudinal: The printed a_x = a_pre also where a_x was too low.
        reserve: Correction: limits also keep a braking reserve (`stopping_bound`, `follower_can_brake`).
        hold: Correction: where the way to the lane's centre is blocked, too, the last executed target stays.
        give_way: Correction: ... but not where it leads to a follower that cannot brake; then the lane's centre.
        turned_body: Correction: the corridor holds the turned body, whose corners stand out.
        excursion: Correction: the corridor holds the way that the present lateral motion leads before it ends.
    """

    literal_all_lanes: bool = False
    literal_followers: bool = False
    literal_selection: bool = False
    literal_longitudinal: bool = False
    reserve: bool = True
    hold: bool = True
    give_way: bool = True
    turned_body: bool = True
    excursion: bool = True


class Switches(NamedTuple):
    """`GuardOptions` as compiled code takes them, in the same order."""

    all_lanes: bool
    followers: bool
    least_binding: bool
    printed_longitudinal: bool
    reserve: bool
    hold: bool
    give_way: bool
    turned_body: bool
    excursion: bool
