"""Means with their spread."""

from __future__ import annotations

from tables import table, told


def test_a_spread_is_told_where_there_is_one() -> None:
    assert told([1.0, 2.0, 3.0]) == "2.00 ± 1.00"
    assert told([1000.0, 1010.0]) == "1005 ± 7"
    assert told([0, 0, 0]) == "0" and told([12.34]) == "12.3" and told([]) == "–"


def test_who_has_no_such_figure_has_none() -> None:
    lines = table({"idm": [{"flow": 100.0}], "headway": [{"flow": 90.0, "driven": 50.0}]}).splitlines()
    assert lines[1:] == ["| | idm | headway |", "| --- | --- | --- |", "| flow | 100 | 90 |", "| driven | – | 50 |"]
