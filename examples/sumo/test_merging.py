"""Who makes room for whom."""

from __future__ import annotations

from merging import ZONE_M, those_who_join
from network import Merge

MERGE = Merge({"before": -1000.0, "beside": 0.0}, {"ramp": -400.0, "joining": 0.0})


def test_the_first_behind_makes_room() -> None:
    places = {"a": ("before", 990.0), "b": ("before", 970.0), "c": ("before", 950.0), "joins": ("ramp", 390.0)}
    # Five metres of its length before its front at -10 m: "a", beside it, and "b" are at -10 and -30 m.
    assert those_who_join(MERGE, places) == {"b": ("joins", 15.0)}


def test_of_several_who_join_the_nearest_counts() -> None:
    places = {"a": ("before", 950.0), "far": ("joining", 40.0), "near": ("ramp", 390.0)}
    assert those_who_join(MERGE, places) == {"a": ("near", 35.0)}
    places["b"] = ("beside", 10.0)
    assert those_who_join(MERGE, places) == {"a": ("near", 35.0), "b": ("far", 25.0)}


def test_nobody_makes_room_far_from_where_they_meet_or_behind() -> None:
    assert those_who_join(MERGE, {"a": ("before", 700.0), "joins": ("ramp", 399.0 - ZONE_M)}) == {}
    assert those_who_join(MERGE, {"a": ("beside", 100.0), "joins": ("joining", 50.0)}) == {}
    assert those_who_join(MERGE, {"a": ("elsewhere", 100.0), "joins": ("joining", 50.0)}) == {}
