"""Everything that can be asked of a server, each once, whoever sends it."""

from __future__ import annotations

import io
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd

from .answers import Batch, ModelInfo, Simulation, Version, measures_of
from .calls import Answer, Call, Operation, json_of
from .events import Events, body_of
from .problem import TaskFailed
from .progress import Listener, Progress
from .windows import Predictions, Windows, array_of, predictions_of, request_of

POLL_S = 10.0
"""How long a server is asked to wait for a task that nobody watches."""


def model_path(model: str, rest: str = "") -> str:
    """A path under a model's."""
    return f"/v1/models/{quote(model, safe='')}{rest}"


def get(path: str, **query: Any) -> Operation[Any]:
    """JSON that is there."""
    answer: Answer = yield Call("GET", path, query)
    return answer.json()


def post(path: str, body: Mapping[str, Any]) -> Operation[Any]:
    """Has something made or moved. It carries a key: a server does it once, however often it is sent."""
    headers = {"content-type": "application/json", "idempotency-key": str(uuid.uuid4())}
    answer: Answer = yield Call("POST", path, body=json_of(body), headers=headers)
    return answer.json()


@dataclass(frozen=True)
class Listing:
    """A list that comes page by page."""

    path: str
    member: str
    page_size: int = 1000

    def page(self, token: str | None) -> Operation[tuple[list[dict[str, Any]], str | None]]:
        """The page that this token leads to, and the token of the next."""
        said = yield from get(self.path, page_size=self.page_size, page_token=token)
        return said[self.member], said["next_page_token"]


def listing(model: str, of: str, member: str, page_size: int) -> Listing:
    """A list of a model's."""
    return Listing(model_path(model, of), member, page_size)


def rejections(model: str, batch_id: str, page_size: int) -> Listing:
    """What an upload was refused."""
    return listing(model, f"/batches/{quote(batch_id, safe='')}/rejections", "rejections", page_size)


def pages(path: str, member: str) -> Operation[list[dict[str, Any]]]:
    """Every entry of a list that is short."""
    entries, token = yield from Listing(path, member).page(None)
    while token is not None:
        more, token = yield from Listing(path, member).page(token)
        entries = entries + more
    return entries


def models() -> Operation[list[ModelInfo]]:
    """Every model."""
    return [ModelInfo.read(said) for said in (yield from pages("/v1/models", "models"))]


def info(model: str) -> Operation[ModelInfo]:
    """A model."""
    return ModelInfo.read((yield from get(model_path(model))))


def create_model(
    name: str, method: str, settings: Mapping[str, Any], from_: tuple[str, int] | None
) -> Operation[ModelInfo]:
    """A new model."""
    body: dict[str, Any] = {"model": name, "method": method, "settings": dict(settings)}
    if from_ is not None:
        body["from"] = {"model": from_[0], "version": from_[1]}
    return ModelInfo.read((yield from post("/v1/models", body)))


def upload(
    model: str, events: Events, options: Mapping[str, Any], sent: Callable[[int, int], None] | None = None
) -> Operation[Batch]:
    """Uploads events."""
    body = body_of(events)
    headers = {**body.headers, "idempotency-key": str(uuid.uuid4())}
    answer: Answer = yield Call("POST", model_path(model, "/batches"), options, body.content, headers, sent=sent)
    return Batch.read(answer.json())


def train(
    model: str,
    batches: list[str] | None,
    regime: str | None,
    settings: Mapping[str, Any],
    told: Callable[[Progress], None] | None,
) -> Operation[list[Version]]:
    """Learns, waits, and gives the versions that came of it."""
    wish: dict[str, Any] = {"batches": batches if batches is not None else "pending"}
    if regime is not None:
        wish["regime"] = regime
    if settings:
        wish["settings"] = dict(settings)
    queued = yield from post(model_path(model, "/tasks"), wish)
    made = []
    for task_id in queued["task_ids"]:
        task = yield from ended(model, task_id, told)
        made.append((yield from version(model, task["version"])))
    return made


def ended(model: str, task_id: str, told: Callable[[Progress], None] | None) -> Operation[dict[str, Any]]:
    """A task once it has a version. Where somebody is told, the server's stream of events tells them."""
    path = model_path(model, f"/tasks/{quote(task_id, safe='')}")
    task: dict[str, Any] = yield from get(path)
    listener = Listener(told, task) if told else None
    while task["state"] in ("queued", "running"):
        if listener:
            yield Call("GET", path + "/progress", heard=listener.line)
        # A stream may break off, and a server has only so many: a second's wait keeps from opening one after another.
        wait_s = 1.0 if listener else POLL_S
        answer: Answer = yield Call("GET", path, {"wait_s": wait_s}, wait_s=wait_s)
        task = answer.json()
        if listener:
            listener.task(task)
    if task["state"] != "succeeded":
        raise TaskFailed(task)
    return task


def version(model: str, number: int) -> Operation[Version]:
    """One version."""
    return Version.read((yield from get(model_path(model, f"/versions/{number}"))))


def versions(model: str) -> Operation[list[Version]]:
    """Every version of a model, the oldest first."""
    return [Version.read(said) for said in (yield from pages(model_path(model, "/versions"), "versions"))]


def evaluation(model: str, number: int) -> Operation[pd.DataFrame]:
    """How a version drives on the test events of every regime that it has learned."""
    said = yield from get(model_path(model, f"/versions/{number}/evaluation"))
    return measures_of("version", {number: said["tasks"]})


def forgetting(model: str) -> Operation[pd.DataFrame]:
    """Regimes × versions of the line that is learned on: spacing error over what it was when just learned."""
    number = (yield from info(model)).head
    line = {made.version: made for made in (yield from versions(model))}
    ratios: dict[int, pd.Series[float]] = {}
    while number is not None:
        frame = yield from evaluation(model, number)
        ratios[number] = frame.set_index("regime")["forgetting_ratio"]
        number = line[number].raw["parent"]
    table = pd.DataFrame({number: ratios[number] for number in sorted(ratios)})
    table.columns.name = "version"
    learned = [line[number].regime for number in sorted(ratios)]
    return table.reindex(list(dict.fromkeys(learned)))


def move(model: str, way: str, number: int | None, reason: str, force: bool) -> Operation[dict[str, Any]]:
    """Promotes, or rolls back."""
    said: dict[str, Any] = yield from post(
        model_path(model, way), {"version": number, "reason": reason, "force": force}
    )
    return said


def predict(model: str, windows: Windows, number: int | None) -> Operation[Predictions]:
    """The next acceleration of each window."""
    array = array_of(windows)
    content, headers = request_of(array)
    of = "" if number is None else f"/versions/{number}"
    path = f"/v2/models/{quote(model, safe='')}{of}/infer"
    # It changes nothing, so that it may be sent again.
    return predictions_of((yield Call("POST", path, body=content, headers=headers)))


def simulate(
    model: str, initial: Mapping[str, Any] | np.ndarray[Any, Any], leader_speed_mps: Any, number: int | None
) -> Operation[Simulation]:
    """Drives a follower behind a leader."""
    if isinstance(initial, np.ndarray):
        initial = dict(
            zip(["follower_speed_mps", "leader_speed_mps", "_", "spacing_m"], initial.T.tolist(), strict=True)
        )
        del initial["_"]
    leader = np.asarray(leader_speed_mps, dtype=float).tolist()
    body: dict[str, Any] = {"initial": initial, "leader_speed_mps": leader}
    if number is not None:
        body["version"] = number
    # As a prediction, it changes nothing, and may be sent again.
    headers = {"content-type": "application/json"}
    answer: Answer = yield Call("POST", model_path(model, "/simulate"), body=json_of(body), headers=headers)
    return Simulation.read(answer.json())


def evaluate(
    model: str, events: Events, numbers: list[int] | None, references: list[str], options: Mapping[str, Any]
) -> Operation[pd.DataFrame]:
    """How versions and drivers out of the literature do on events that are not kept."""
    body = body_of(events)
    query = dict(options)
    if numbers:
        query["versions"] = ",".join(str(number) for number in numbers)
    if references:
        query["references"] = ",".join(references)
    answer: Answer = yield Call("POST", model_path(model, "/evaluate"), query, body.content, body.headers)
    said = answer.json()
    drivers = {f"version {tried['version']}": tried["tasks"] for tried in said["versions"]}
    drivers |= {tried["reference"]: tried["tasks"] for tried in said["references"]}
    return measures_of("driver", drivers)


def events(model: str, batch_id: str) -> Operation[pd.DataFrame]:
    """What a batch holds, a row for each step."""
    path = model_path(model, f"/batches/{quote(batch_id, safe='')}/events")
    answer: Answer = yield Call("GET", path, {"format": "parquet"})
    return pd.read_parquet(io.BytesIO(answer.body))


def artifact(model: str, number: int, format_: str, to: Path) -> Operation[Path]:
    """A version as a file."""
    answer: Answer = yield Call("GET", model_path(model, f"/versions/{number}/artifact"), {"format": format_})
    to.write_bytes(answer.body)
    return to
