"""Asks a real Prometheus every question of the dashboard and of the alerts.

    cargo build
    python3 docker/prometheus/ask.py            # with `prometheus` on the PATH

Lets a server learn two regimes, predict and simulate while Prometheus reads its metrics every second; then puts every
expression of docker/grafana/headway.json to it, and prints how many series each answers with. The exit code is 0 only when
every panel's has some, no alert fires, and Prometheus found nothing wrong with any of them.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import time
import urllib.parse
import urllib.request

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "api/fuzz"))
from traffic import followed  # noqa: E402

WINDOW = {"follower_speed_mps": [14.0] * 10, "leader_speed_mps": [14.0] * 10, "spacing_m": [9000.0] * 10}
VARIABLES = {"$instance": ".*", "$model": ".*", "$__rate_interval": "15s"}


def call(url, body=None):
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data, {"content-type": "application/json"})
    with urllib.request.urlopen(request, timeout=90) as answer:
        return json.load(answer)


def traffic(model, seconds):
    """Learns twice, then predicts and simulates for so long."""
    for first, regime in ((0, "fast"), (100, "slow")):
        events = [{"event_id": f"e{n}", "split": ("train", "test")[n % 2]} | followed(n) for n in range(first, first + 24)]
        call(f"{model}/batches?regime={regime}", {"events": events})
        task = call(f"{model}/tasks", {"batches": "pending"})
        while task["state"] in ("queued", "running"):
            task = call(f"{model}/tasks/{task['task_id']}?wait_s=30")
        assert task["state"] == "succeeded", task
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        call(f"{model}/predict", {"windows": [WINDOW] * 3})
        call(f"{model}/simulate", {"initial": WINDOW, "leader_speed_mps": [14.0] * 20})
        time.sleep(0.02)


def asked(prometheus, expression):
    for name, value in VARIABLES.items():
        expression = expression.replace(name, value)
    return call(f"{prometheus}/api/v1/query?{urllib.parse.urlencode({'query': expression})}")["data"]["result"]


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--binary", default="target/debug/headway")
    cli.add_argument("--prometheus", default="prometheus")
    cli.add_argument("--port", default="19090", help="for Prometheus")
    args = cli.parse_args()
    settings = ["model.hidden=6", "model.epochs=1", "model.schedule=manual", "model.promotion=auto"]
    dashboard = json.loads((HERE.parent / "grafana/headway.json").read_text())
    with tempfile.TemporaryDirectory() as folder:
        command = [args.binary, "serve", "--listen", "127.0.0.1:0", "--database", f"{folder}/headway.db"]
        server = subprocess.Popen(command + [part for setting in settings for part in ("--set", setting)],
                                  stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        url = server.stdout.readline().split()[-1]
        written = (HERE / "prometheus.yml").read_text().replace("headway:8080", url.removeprefix("http://"))
        # This server has no keys.
        written = "".join(line for line in written.splitlines(True) if "authorization" not in line)
        config = pathlib.Path(folder, "prometheus.yml")
        config.write_text(written.replace("15s", "1s").replace("alerts.yml", str(HERE / "alerts.yml")))
        prometheus = f"http://127.0.0.1:{args.port}"
        reader = subprocess.Popen([args.prometheus, f"--config.file={config}", f"--storage.tsdb.path={folder}/data",
                                   f"--web.listen-address=127.0.0.1:{args.port}"], stderr=subprocess.DEVNULL)
        try:
            traffic(f"{url}/v1/models/default", 20)
            wrong = []
            for panel in dashboard["panels"]:
                for target in panel.get("targets", []):
                    series = len(asked(prometheus, target["expr"]))
                    print(f"{series:4} {panel['title']}")
                    if series == 0:
                        wrong.append(f"nothing: {target['expr']}")
            rules = [rule for group in call(f"{prometheus}/api/v1/rules")["data"]["groups"] for rule in group["rules"]]
            wrong += [f"{rule['name']}: {rule['health']}, {rule['state']}" for rule in rules
                      if rule["health"] != "ok" or rule["state"] == "firing"]
            print(f"{len(rules)} alerts evaluated")
        finally:
            server.terminate()
            reader.terminate()
            server.wait(30)
            reader.wait(30)
    print(*wrong, sep="\n", end="\n" if wrong else "nothing to explain\n")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
