"""What the README shows works as written, in as few lines as it says."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import Server
from traffic import frame

from headway import Client

README = (Path(__file__).parents[1] / "README.md").read_text()
EXAMPLES = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def lines(code: str) -> int:
    return sum(bool(line.strip()) for line in code.splitlines())


def run(code: str, url: str) -> None:
    exec(compile(code.replace("http://127.0.0.1:8080", url), "README.md", "exec"), {})


def test_the_examples_are_short() -> None:
    first, whole = EXAMPLES
    assert lines(first) <= 10 and lines(whole) <= 25


def test_a_first_prediction(server: Server, capsys: pytest.CaptureFixture[str]) -> None:
    model = Client(server.url).create_model("ewc", settings={"horizon": 10})
    model.upload(frame("fast", 16.0), regime="fast")
    model.train()
    run(EXAMPLES[0], server.url)
    assert re.fullmatch(r"-?\d+\.\d\d m/s² by version 1\n", capsys.readouterr().out)


def test_from_a_data_frame_to_a_plot(
    server: Server, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    run(EXAMPLES[1], server.url)
    assert capsys.readouterr().out == "24 events\n1 is trained\n24 events\n2 is trained\n"
    assert (tmp_path / "forgetting.png").read_bytes().startswith(b"\x89PNG")


def test_the_notebook_runs_from_a_frame_to_its_figures(server: Server, tmp_path: Path) -> None:
    example = Path(__file__).parents[1] / "examples" / "dataframe_to_version.py"
    environment = {**os.environ, "HEADWAY_URL": server.url, "HEADWAY_FIGURES": str(tmp_path), "MPLBACKEND": "agg"}
    ran = subprocess.run([sys.executable, str(example)], env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert "slow: 60 events, 0 refused; version 2" in ran.stdout, ran.stdout
    for name in ["forgetting.png", "trajectories.png"]:
        assert (tmp_path / name).stat().st_size > 10_000
