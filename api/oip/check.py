"""The stock client of the Open Inference Protocol, tritonclient from PyPI, against a server that has learned something.

    cargo build
    python3 -m venv target/lint && target/lint/bin/pip install -r .ci/requirements.txt
    target/lint/bin/python api/oip/check.py

Starts `--binary` on a fresh database, lets it learn two regimes, and calls everything of the client that this server has:
health, metadata, configuration, inference as JSON, as bytes and compressed, by version, asynchronous, sequences across a
promotion, statistics, the repository, and errors. Every number is compared, bit for bit, with what the native interface
predicts. Prints a line for each; the exit code is 0 only when all pass.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import urllib.request

import numpy as np
from tritonclient.http import InferenceServerClient, InferInput, InferRequestedOutput
from tritonclient.utils import InferenceServerException

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "fuzz"))
from traffic import followed  # noqa: E402

HORIZON, MODEL = 10, "default"
SETTINGS = ["model.hidden=16", "model.epochs=1", "model.schedule=manual", "model.promotion=auto"]


class Server:
    """The real binary, and the native interface to it."""

    def __init__(self, binary, folder):
        command = [binary, "serve", "--listen", "127.0.0.1:0", "--database", f"{folder}/headway.db"]
        self.process = subprocess.Popen(command + [part for setting in SETTINGS for part in ("--set", setting)],
                                        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.url = self.process.stdout.readline().split()[-1]

    def call(self, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(f"{self.url}/v1/models/{MODEL}{path}", data, {"content-type": "application/json"})
        with urllib.request.urlopen(request, timeout=90) as answer:
            return json.load(answer)

    def learn(self, first, regime):
        events = [{"event_id": f"e{n}"} | followed(n) for n in range(first, first + 24)]
        self.call(f"/batches?regime={regime}", {"events": events})
        task = self.call("/tasks", {"batches": "pending"})
        while task["state"] in ("queued", "running"):
            task = self.call(f"/tasks/{task['task_id']}?wait_s=30")
        assert task["state"] == "succeeded", task

    def predicted(self, windows, version=None):
        """Served and raw accelerations, as the native interface gives them."""
        names = ("follower_speed_mps", "leader_speed_mps", None, "spacing_m")
        bodies = [{name: window[:, at].tolist() for at, name in enumerate(names) if name} for window in windows]
        answers = self.call("/predict", {"windows": bodies, "version": version})["predictions"]
        return tuple(np.array([[answer[name]] for answer in answers], np.float32) for name in ("accel_mps2", "raw_accel_mps2"))


def some_windows(count):
    """Windows of every kind of traffic, with relative speed leader minus follower."""
    draw = np.random.default_rng(7)
    follower = draw.uniform(0, 30, (count, 1)) + draw.normal(0, 0.3, (count, HORIZON)).cumsum(1)
    leader = follower + draw.normal(0, 2, (count, HORIZON))
    spacing = draw.uniform(2, 80, (count, 1)) + draw.normal(0, 0.2, (count, HORIZON)).cumsum(1)
    return np.stack([follower, leader, leader - follower, spacing], axis=2).astype(np.float32)


def tensor(name, values, binary=True):
    return InferInput(name, list(values.shape), "FP32").set_data_from_numpy(values, binary_data=binary)


def same(result, expected, names=("accel_mps2", "raw_accel_mps2")):
    for name, values in zip(names, expected):
        got = result.as_numpy(name)
        assert got.dtype == np.float32 and got.shape == values.shape and np.array_equal(got, values), (name, got, values)


def refused(says, call):
    try:
        call()
    except InferenceServerException as error:
        assert says in error.message(), error
    else:
        raise AssertionError(f"not refused: {says}")


def health(client, server):
    assert client.is_server_live() and client.is_server_ready()
    assert client.is_model_ready(MODEL) and client.is_model_ready(MODEL, "1") and not client.is_model_ready("nobody")


def metadata(client, server):
    told = client.get_server_metadata()
    assert told["name"] == "headway" and {"binary_tensor_data", "sequence", "statistics", "model_repository"} <= set(told["extensions"])
    model = client.get_model_metadata(MODEL)
    assert model["versions"] == ["1", "2"] and model["inputs"][0] == {"name": "window", "datatype": "FP32", "shape": [-1, HORIZON, 4]}
    assert [output["name"] for output in model["outputs"]] == ["accel_mps2", "raw_accel_mps2"]
    assert client.get_model_metadata(MODEL, "1")["versions"] == ["1"]
    assert client.get_model_config(MODEL)["input"][0]["dims"] == [HORIZON, 4]


def as_json(client, server):
    windows = some_windows(5)
    outputs = [InferRequestedOutput(name, binary_data=False) for name in ("accel_mps2", "raw_accel_mps2")]
    result = client.infer(MODEL, [tensor("window", windows, binary=False)], outputs=outputs, request_id="one")
    assert result.get_response()["id"] == "one" and "data" in result.get_output("accel_mps2")
    same(result, server.predicted(windows))


def as_bytes(client, server):
    windows = some_windows(500)
    same(client.infer(MODEL, [tensor("window", windows)]), server.predicted(windows))
    one = client.infer(MODEL, [tensor("window", windows)], outputs=[InferRequestedOutput("raw_accel_mps2")])
    assert one.as_numpy("accel_mps2") is None
    same(one, server.predicted(windows)[1:], names=["raw_accel_mps2"])


def mixed(client, server):
    windows = some_windows(3)
    outputs = [InferRequestedOutput("accel_mps2", binary_data=False), InferRequestedOutput("raw_accel_mps2", binary_data=True)]
    same(client.infer(MODEL, [tensor("window", windows)], outputs=outputs), server.predicted(windows))
    same(client.infer(MODEL, [tensor("window", windows, binary=False)]), server.predicted(windows))


def compressed(client, server):
    windows = some_windows(200)
    for algorithm in ("gzip", "deflate"):
        result = client.infer(MODEL, [tensor("window", windows)], request_compression_algorithm=algorithm,
                              response_compression_algorithm=algorithm)
        same(result, server.predicted(windows))


def by_version(client, server):
    windows = some_windows(4)
    first, second = (client.infer(MODEL, [tensor("window", windows)], model_version=version) for version in ("1", "2"))
    same(first, server.predicted(windows, 1))
    same(second, server.predicted(windows, 2))
    assert first.get_response()["model_version"] == "1"
    assert not np.array_equal(first.as_numpy("raw_accel_mps2"), second.as_numpy("raw_accel_mps2"))


def asynchronous(client, server):
    windows = [some_windows(n) for n in range(1, 9)]
    asked = [client.async_infer(MODEL, [tensor("window", each)]) for each in windows]
    for each, pending in zip(windows, asked):
        same(pending.get_result(), server.predicted(each))


def sequences(client, server):
    """A vehicle stays with its version across a promotion; another asks for what serves."""
    steps = some_windows(3).reshape(-1, 4)
    server.call("/promote", {"version": 1, "reason": "before the manoeuvre"})
    for at in range(len(steps)):
        if at == 4:
            server.call("/promote", {"version": 2, "reason": "in the middle of it"})
        window = np.stack([steps[max(at - back, 0)] for back in reversed(range(HORIZON))])[None]
        for name, follows in ((77, False), ("bus 12", True)):
            more = {"sequence_follow_live": True} if follows else None
            result = client.infer(MODEL, [tensor("step", steps[at : at + 1])], sequence_id=name, sequence_start=at == 0,
                                  sequence_end=at == len(steps) - 1, parameters=more)
            version = 2 if follows and at >= 4 else 1
            assert result.get_response()["model_version"] == str(version)
            same(result, server.predicted(window, version))
            warming = result.get_response().get("parameters", {}).get("warming_up", False)
            assert warming == (at + 1 < HORIZON), at
    refused("not open", lambda: client.infer(MODEL, [tensor("step", steps[:1])], sequence_id=77))


def statistics(client, server):
    before = {stats["version"]: stats for stats in client.get_inference_statistics(MODEL)["model_stats"]}
    client.infer(MODEL, [tensor("window", some_windows(9))], model_version="2")
    after = client.get_inference_statistics(MODEL, "2")["model_stats"][0]
    assert after["inference_count"] == before["2"]["inference_count"] + 9
    assert after["execution_count"] == before["2"]["execution_count"] + 1
    assert after["inference_stats"]["success"]["ns"] > before["2"]["inference_stats"]["success"]["ns"]
    assert any(stats["name"] == MODEL for stats in client.get_inference_statistics()["model_stats"])


def repository(client, server):
    entry = {"name": MODEL, "version": "2", "state": "READY", "reason": ""}
    assert client.get_model_repository_index() == [entry]
    client.unload_model(MODEL)
    assert not client.is_model_ready(MODEL) and client.get_model_repository_index()[0]["state"] == "UNAVAILABLE"
    refused("unloaded", lambda: client.infer(MODEL, [tensor("window", some_windows(1))]))
    client.load_model(MODEL)
    assert client.is_model_ready(MODEL) and client.get_model_repository_index() == [entry]
    refused("no model is called", lambda: client.load_model("nobody"))


def errors(client, server):
    window = some_windows(1)
    refused("no model is called", lambda: client.infer("nobody", [tensor("window", window)]))
    refused("no version 9", lambda: client.infer(MODEL, [tensor("window", window)], model_version="9"))
    refused("exactly the last 10", lambda: client.infer(MODEL, [tensor("window", window[:, 1:])]))
    refused("window is taken", lambda: client.infer(MODEL, [tensor("speed", window)]))
    refused("not within", lambda: client.infer(MODEL, [tensor("window", np.full_like(window, np.nan))]))
    wanted = [InferRequestedOutput("speed")]
    refused("accel_mps2 and raw_accel_mps2", lambda: client.infer(MODEL, [tensor("window", window)], outputs=wanted))
    doubles = InferInput("window", [1, HORIZON, 4], "FP64").set_data_from_numpy(window.astype(np.float64))
    refused("FP32 is taken", lambda: client.infer(MODEL, [doubles]))
    shared = InferInput("window", [1, HORIZON, 4], "FP32").set_shared_memory("region", 160)
    refused("not shared", lambda: client.infer(MODEL, [shared]))
    refused("not a path", lambda: client.get_trace_settings())


CHECKS = [health, metadata, as_json, as_bytes, mixed, compressed, by_version, asynchronous, sequences, statistics, repository, errors]


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--binary", default="target/debug/headway", type=lambda path: pathlib.Path(path).resolve())
    args = cli.parse_args()
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        server = Server(args.binary, folder)
        try:
            server.learn(0, "fast")
            server.learn(100, "slow")
            client = InferenceServerClient(server.url.removeprefix("http://"), concurrency=4, network_timeout=90)
            for check in CHECKS:
                try:
                    check(client, server)
                    print(f"pass  {check.__name__}")
                except (AssertionError, InferenceServerException, KeyError) as error:
                    failed += 1
                    print(f"FAIL  {check.__name__}: {error!r}")
        finally:
            server.process.terminate()
            server.process.wait(30)
    print(f"{len(CHECKS) - failed} of {len(CHECKS)} pass")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
