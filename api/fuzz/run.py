"""The real server under schemathesis: every operation of api/openapi.yaml, every check, every phase.

    cargo build
    python3 -m venv target/lint && target/lint/bin/pip install -r .ci/requirements.txt
    target/lint/bin/python api/fuzz/run.py --examples 300

Starts `--binary` on a fresh database, lets models learn, and sends it what schemathesis makes up of the contract under
`--seed`, valid and not, alone and in sequences along links: with an admin's key, with none, and with keys of one scope and
of one model, each of which must get no further than it may (hooks.py, which also has every excuse, with its reason). At the
end the server must be ready, its keys untouched, its log without an error or a panic; it must stop when it is told to, and
`headway verify` must find its database whole. Prints cases, failures and answers 5xx; the exit code is 0 only when nothing
is left to explain.
"""

import argparse
import collections
import http.client
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

from traffic import followed

HERE = pathlib.Path(__file__).resolve().parent
CONTRACT = HERE.parent / "openapi.yaml"
# Small networks, nothing that happens by itself, and no limit met before what is looked for.
SETTINGS = ["model.hidden=6", "model.minibatch=8", "model.promotion=auto", "model.test_reservoir=20", "model.schedule=manual",
            "training.training_threads=1", "server.wait_max_s=1", "server.progress_interval_s=0.1", "access.rate_requests=0",
            "access.rate_predictions=0"]
# Whose requests: their share of the cases, and what the key may do.
CALLERS = {
    "admin": (1.0, ["--scope", "admin"]),
    "nobody": (0.1, None),
    "predict": (0.1, ["--scope", "predict"]),
    "ingest": (0.1, ["--scope", "ingest"]),
    "train": (0.1, ["--scope", "train"]),
    "elsewhere": (0.1, ["--scope", "predict", "--scope", "ingest", "--scope", "train", "--model", "elsewhere"]),
}


class Server:
    """The real binary as a child process, its database and its log."""

    def __init__(self, binary, folder):
        self.binary, self.database, self.log = binary, folder / "headway.db", folder / "log"
        self.keys = {name: self.headway("keys", "create", *options) for name, (_, options) in CALLERS.items() if options}
        settings = [*SETTINGS, f"backup.folder={folder / 'backups'}"]
        command = [binary, "serve", "--listen", "127.0.0.1:0", "--database", self.database]
        self.process = subprocess.Popen(
            command + [part for setting in settings for part in ("--set", setting)],
            stdout=subprocess.PIPE, stderr=self.log.open("wb"), text=True, env=os.environ | {"TMPDIR": str(folder)})
        self.url = self.process.stdout.readline().split()[-1]

    def headway(self, *arguments):
        """What a command of the binary prints about the database."""
        command = [self.binary, *arguments, "--database", self.database]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    def key_ids(self):
        return [key.split("_")[1] for key in self.keys.values()]

    def call(self, method, path, body=None):
        connection = http.client.HTTPConnection(self.url.removeprefix("http://"), timeout=90)
        headers = {"authorization": f"Bearer {self.keys['admin']}", "content-type": "application/json"}
        connection.request(method, path, json.dumps(body) if body is not None else None, headers)
        answer = connection.getresponse()
        content = answer.read()
        if answer.status >= 300:
            raise SystemExit(f"{method} {path}: {answer.status} {content[:500]}")
        return json.loads(content)

    def learn(self, model, first):
        """Uploads some events and learns them."""
        events = [{"event_id": f"e{number}"} | followed(number) for number in range(first, first + 24)]
        batch = self.call("POST", f"/v1/models/{model}/batches?source=seed", {"events": events})["batch_id"]
        task = self.call("POST", f"/v1/models/{model}/tasks", {"batches": [batch]})
        while task["state"] in ("queued", "running"):
            task = self.call("GET", f"/v1/models/{model}/tasks/{task['task_id']}?wait_s=1")
        if task["state"] != "succeeded":
            raise SystemExit(task)

    def end(self):
        """Stops it; what is wrong with it and with what it leaves."""
        wrong = []
        try:
            self.call("GET", "/readyz")
            ended = [key for key in self.key_ids() if self.call("GET", f"/v1/keys/{key}")["state"] != "active"]
            wrong += [f"a key of the run was ended: {key}" for key in ended]
        except (OSError, SystemExit) as error:
            wrong.append(f"does not answer as it should: {error}")
        self.process.send_signal(signal.SIGTERM)
        try:
            if self.process.wait(60) != 0:
                wrong.append(f"ended with {self.process.returncode}")
        except subprocess.TimeoutExpired:
            wrong.append("did not stop")
            self.process.kill()
        lines = self.log.read_text(errors="replace").splitlines()
        wrong += [f"logged: {line}" for line in lines if "panicked" in line or " ERROR " in line]
        verified = subprocess.run([self.binary, "verify", "--database", self.database], capture_output=True, text=True)
        if verified.returncode != 0:
            wrong.append(f"verify: {verified.stdout}{verified.stderr}")
        return wrong


def fuzz(server, caller, args, folder):
    """One run of schemathesis: its report, and what hooks.py counted."""
    report, counted = folder / f"{caller}.json", folder / f"{caller}.counted.json"
    examples = max(1, round(args.examples * CALLERS[caller][0]))
    command = [args.schemathesis, "--config-file", "schemathesis.toml", "run", CONTRACT, "--url", server.url, "--checks", "all",
               "--seed", args.seed, "--max-examples", examples, "--generation-database", "none", "--no-color",
               "--report", "json", "--report-json-path", report, *args.more]
    if caller in server.keys:
        command += ["--header", f"Authorization: Bearer {server.keys[caller]}"]
    environment = os.environ | {"HEADWAY_CALLER": caller, "HEADWAY_KEY": server.keys.get(caller, ""),
                                "HEADWAY_SPARED": " ".join(server.key_ids()), "HEADWAY_COUNTED": str(counted),
                                "PYTHONPATH": str(HERE), "PYTHONDONTWRITEBYTECODE": "1"}
    with (folder / f"{caller}.txt").open("w") as told:
        subprocess.run(map(str, command), env=environment, cwd=HERE, stdout=told, stderr=subprocess.STDOUT)
    return json.loads(report.read_text()), json.loads(counted.read_text())


def summary(caller, report, took_s):
    cases, phases = report["test_cases"], report["phases"] or {}
    unfinished = [name for name, phase in phases.items() if phase["status"] not in ("success", "failure", "skip")]
    print(f"{caller:>10}: {cases['generated']:6} cases, {cases['unique_failures']} failures, {report['operations']['tested']} of "
          f"{report['operations']['total']} operations, {took_s:.0f} s", flush=True)
    return [f"{caller}: {failure['title']} ({', '.join(failure['operations'])})" for failure in report["failures"]] \
        + [f"{caller}: {error['title']}" for error in report["errors"]] \
        + [f"{caller}: {name} did not end" for name in unfinished] \
        + ([] if report["complete"] and report["exit_code"] == 0 else [f"{caller}: ended with {report['exit_code']}"])


def main():
    beside = pathlib.Path(sys.executable).with_name("schemathesis")
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--binary", default="target/debug/headway", type=lambda path: pathlib.Path(path).resolve())
    cli.add_argument("--schemathesis", default=beside if beside.exists() else shutil.which("schemathesis"))
    cli.add_argument("--seed", type=int, default=5)
    cli.add_argument("--examples", type=int, default=100, help="cases an operation and phase at most, for the admin's key")
    cli.add_argument("--callers", nargs="*", choices=CALLERS, default=list(CALLERS))
    cli.add_argument("--keep", type=pathlib.Path, help="a new folder for database, log and reports, else thrown away")
    cli.add_argument("more", nargs="*", help="for schemathesis, after --")
    args = cli.parse_args()
    if args.schemathesis is None:
        cli.error("schemathesis is not here: pip install -r .ci/requirements.txt")
    with tempfile.TemporaryDirectory() as scratch:
        folder = (args.keep or pathlib.Path(scratch)).resolve()
        folder.mkdir(exist_ok=True)
        server = Server(args.binary, folder)
        wrong, cases, answers, excused = [], 0, collections.Counter(), collections.Counter()
        try:
            for model in ("kept", "elsewhere"):
                server.call("POST", "/v1/models", {"model": model, "method": "ewc"})
            for model, first in (("kept", 0), ("default", 100), ("default", 200), ("default", 300)):
                server.learn(model, first)
            print(f"seed {args.seed}, {args.examples} examples", flush=True)
            for caller in args.callers:
                began = time.monotonic()
                report, counted = fuzz(server, caller, args, folder)
                found = summary(caller, report, time.monotonic() - began)
                if found:
                    print((folder / f"{caller}.txt").read_text())
                wrong, cases = wrong + found, cases + report["test_cases"]["generated"]
                answers.update(counted["answers"])
                excused.update(counted["excused"])
        finally:
            wrong += server.end()
    print(f"{cases} cases, {answers.total()} requests")
    for why, times in excused.most_common():
        print(f"excused {times} times: {why}")
    for answer in sorted(answer for answer in answers if answer.split()[1] >= "500"):
        print(f"answered {answer}: {answers[answer]} times")
    print(*wrong, sep="\n", end="\n" if wrong else "nothing to explain\n")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
