"""A diagram is drawn of what was seen."""

from __future__ import annotations

from pathlib import Path

import network
import pytest
import simulate
from diagrams import draw
from disturbances import one_brakes


def test_a_diagram_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    road = network.ring(tmp_path, "idm", end_s=20.0)
    measures, _ = simulate.run(road, None, [one_brakes(1)])
    assert len({seen.vehicle for seen in measures.seen}) == 22
    assert all(0 <= seen.place_m <= road.length_m for seen in measures.seen)
    draw({"ring": {"idm": measures, "krauss": measures}}, tmp_path / "sumo.png")
    assert (tmp_path / "sumo.png").stat().st_size > 10_000
