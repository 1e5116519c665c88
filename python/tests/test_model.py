"""A model from data frames to versions, and back."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from conftest import url_of
from traffic import events, frame, windows

from headway import AsyncClient, Client


def test_two_regimes_are_learned_and_told(client: Client) -> None:
    model = client.model()
    batch = model.upload(frame("fast", 16.0), regime="fast")
    assert (batch.accepted, batch.rejected_count) == (12, 0)
    assert model.train().version == 1
    model.upload(frame("slow", 6.0), regime="slow")
    made = model.train(settings={"epochs": 2})
    assert (made.version, made.regime, made.stage, made.promoted) == (2, "slow", 2, True)
    assert [version.version for version in model.versions()] == [1, 2]
    evaluation = model.evaluation(2)
    assert evaluation["regime"].tolist() == ["fast", "slow"] and (evaluation["spacing_mse"] > 0).all()
    forgetting = model.forgetting()
    assert forgetting.index.to_numpy().tolist() == ["fast", "slow"]
    assert forgetting.columns.to_numpy().tolist() == [1, 2]
    ratios = forgetting.to_numpy()
    assert ratios[0, 0] == ratios[1, 1] == 1 and ratios[0, 1] > 0 and np.isnan(ratios[1, 0])
    moved = model.rollback(reason="tried")
    assert (moved["live"], model.info().live) == (1, 1)
    assert model.promote(2, reason="better")["live"] == 2


def test_the_same_events_are_the_same_however_they_are_given(client: Client, tmp_path: Path) -> None:
    model, rows = client.model(), frame("e", 12.0)
    first = model.upload(rows)
    rows.to_csv(tmp_path / "events.csv", index=False)
    rows.to_csv(tmp_path / "events.csv.gz", index=False)
    lines = "".join(json.dumps(event) + "\n" for event in events("e", 12.0))
    (tmp_path / "events.ndjson").write_text(lines)
    table = pa.Table.from_pandas(rows)
    for given in [
        events("e", 12.0),
        [{name: np.asarray(v) if isinstance(v, list) else v for name, v in e.items()} for e in events("e", 12.0)],
        table,
        tmp_path / "events.csv",
        str(tmp_path / "events.csv.gz"),
        tmp_path / "events.ndjson",
    ]:
        again = model.upload(given)
        assert (again.accepted, again.duplicates) == (0, 12), given
    back = model.events(first.batch_id)
    for column in ["spacing_m", "follower_speed_mps", "leader_speed_mps"]:
        pd.testing.assert_series_equal(back[column], rows[column], check_dtype=False, rtol=1e-6)
    assert back["event_id"].unique().tolist() == rows["event_id"].unique().tolist()
    with pytest.raises(ValueError, match="ends in none of"):
        model.upload(tmp_path / "events.txt")


def test_predictions_are_those_of_the_interface_bit_for_bit(client: Client) -> None:
    model = client.model()
    model.upload(frame("fast", 16.0), regime="fast")
    model.train()
    asked = windows(33).astype(np.float32)
    asked[::3, :, 3] = 0.5
    predicted = model.predict(asked)
    names = ["follower_speed_mps", "leader_speed_mps", "_", "spacing_m"]
    plain = [{name: window[:, at].tolist() for at, name in enumerate(names) if name != "_"} for window in asked]
    said = httpx.post(f"{url_of(client)}/v1/models/default/predict", json={"windows": plain}).json()
    for name, values in [("accel_mps2", predicted.accel_mps2), ("raw_accel_mps2", predicted.raw_accel_mps2)]:
        assert values.tolist() == [float(np.float32(each[name])) for each in said["predictions"]]
    limited = ["envelope" in each["flags"] for each in said["predictions"]]
    assert predicted.limited.tolist() == limited and any(limited) and not all(limited)
    assert predicted.version == 1 and "envelope" in predicted.flags
    assert model.predict(plain, version=1).accel_mps2.tolist() == predicted.accel_mps2.tolist()
    drive = model.simulate(asked[0], np.full(20, 10.0))
    told = {name: asked[0, :, at] for at, name in enumerate(names) if name != "_"}
    assert model.simulate(told, [10.0] * 20).spacing_m.tolist() == drive.spacing_m.tolist()
    assert len(drive.spacing_m) == 20 and abs(drive.accel_mps2[0] - predicted.accel_mps2[0]) < 1e-6
    with pytest.raises(ValueError, match="horizon"):
        model.predict(asked[0])


def test_versions_are_compared_and_exported(client: Client, tmp_path: Path) -> None:
    model = client.create_model("other", method="mas", settings={"hidden": 4})
    model.upload(frame("fast", 16.0), regime="fast")
    model.train()
    compared = model.evaluate(frame("new", 14.0), references=["idm", "constant"], regime="fast")
    assert compared["driver"].tolist() == ["version 1", "idm", "constant"]
    assert compared["spacing_mse"].gt(0).all() and compared["forgetting_ratio"].isna().tolist() == [False, True, True]
    assert model.export(1, tmp_path / "v1.onnx", format="onnx").read_bytes()[:1] == b"\x08"
    fork = client.create_model("fork", method="mas", from_=("other", 1))
    assert fork.info().live == 1 and {info.model for info in client.models()} == {"default", "other", "fork"}


def test_a_frame_comes_back_as_it_went(client: Client) -> None:
    model, rows = client.model(), frame("e", 12.0)
    # Text may be categories, numbers of any width, and events numbered.
    rows["split"] = rows["split"].astype("category")
    rows["event_id"] = rows.groupby("event_id", sort=False).ngroup()
    rows["leader_speed_mps"] = rows["leader_speed_mps"].astype(np.float32)
    assert model.upload(rows, source="somewhere").accepted == 12
    back = model.events("b1")
    assert back["event_id"].tolist() == rows["event_id"].astype(str).tolist()
    assert back["split"].tolist() == rows["split"].tolist() and set(back["source"]) == {"somewhere"}
    for column in ["spacing_m", "follower_speed_mps", "leader_speed_mps"]:
        np.testing.assert_array_equal(back[column], rows[column].astype(np.float32))
    other = client.create_model("other")
    copied = other.upload(back)
    assert copied.accepted == 12
    pd.testing.assert_frame_equal(other.events(copied.batch_id), back)
    # No event says its run: that column is empty, which pandas 2 holds as objects and Arrow as nulls.
    for same in [back, back.astype({"run": object}), pa.Table.from_pandas(back.assign(run=None))]:
        again = model.upload(same)
        assert (again.accepted, again.duplicates) == (0, 12)


def test_lists_are_read_to_their_end(client: Client) -> None:
    model = client.model()
    for number in range(5):
        bad = {**events("bad", 9.0, 1)[0], "spacing_m": [-1.0] * 40}
        model.upload([*events(f"e{number}", 10.0 + number), bad, bad, bad], regime="fast")
        model.train()
    assert [each["batch_id"] for each in model.batches(page_size=2)] == ["b1", "b2", "b3", "b4", "b5"]
    assert [each["task_id"] for each in model.tasks(page_size=2)] == ["t1", "t2", "t3", "t4", "t5"]
    assert len(list(model.rejections("b1", page_size=2))) == 3 and len(list(model.history(page_size=2))) == 5
    assert len(model.versions()) == 5

    async def awaited() -> list[Any]:
        async with AsyncClient(url_of(client)) as there:
            other = there.model()
            lists = [other.batches(page_size=2), other.tasks(page_size=2), other.history(page_size=2)]
            read = []
            for entries in [*lists, other.rejections("b1", page_size=2)]:
                read.append([each async for each in entries])
            return read

    lists = [model.batches(), model.tasks(), model.history(), model.rejections("b1")]
    assert asyncio.run(awaited()) == [list(entries) for entries in lists]
