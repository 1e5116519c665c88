"""Headway beside the same protocol in PyTorch: the same events, splits, seeds, hidden units and epochs.

    python3 -m venv .venv && .venv/bin/pip install torch numpy pandas pyarrow
    cargo build --release
    .venv/bin/python bench/against_torch.py --splits protocol_random.csv --events waymo.parquet ngsim_i80.parquet ...

Runs `bench/torch_protocol.py` for joint and naive and `headway reproduce`, once for every seed, and prints a Markdown table.
Every ratio is of two models with the same seed on the same test events; a cell shows the mean of the seeds' ratios and, in
parentheses, each of them. R[i,j] is the spacing MSE in m^2 on the test events of task j after stage i of T, of the network
alone. Training events/s count new training events x epochs over the time inside updates; joint is compared with torch's
joint there, every other method with torch's naive.
Both programs keep what they finished in `--folder`, and the same command goes on from there; `--torch-results` and
`--report` take results from elsewhere instead. Where the two sides were not made alike, that is said above the table.
`--out` (default FOLDER/against_torch.json) gets every figure and the conditions. Options not listed here go to
`headway reproduce`, for example `--strength ewc=1 --preset paper`.
"""

import argparse
import json
import os
import pathlib
import platform
import subprocess
import sys

YARDSTICKS = ("joint", "naive")
PROTOCOL = pathlib.Path(__file__).with_name("torch_protocol.py")


def torch_result(args, method, seed):
    """One run of the protocol in PyTorch: of this folder when it is there, else made."""
    path = args.folder / "torch" / f"{method}_{seed}.json"
    command = [args.python, str(PROTOCOL), "--events", *args.events, "--splits", args.splits, "--method", method,
               "--seed", str(seed), "--hidden", str(args.hidden), "--epochs", str(args.epochs), "--steps", str(args.steps)]
    if path.exists():
        result = json.loads(path.read_text())
        if result["command"] == command[1:]:
            return result
    print(f"torch: {method}, seed {seed}", file=sys.stderr, flush=True)
    environment = os.environ | ({"OMP_NUM_THREADS": str(args.threads)} if args.threads else {})
    answer = subprocess.run(command, stdout=subprocess.PIPE, env=environment, check=True).stdout
    result = json.loads(answer) | {"command": command[1:]}
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_suffix(".new")
    beside.write_text(json.dumps(result, indent=1))
    beside.replace(path)
    return result


def torch_results(args, seeds):
    """{(method, seed): result}: those of --torch-results, and the rest made here."""
    given = [json.loads(path.read_text()) for path in args.torch_results]
    results = {(result["args"]["method"], result["args"]["seed"]): result for result in given}
    for seed in seeds:
        for method in YARDSTICKS:
            if (method, seed) not in results:
                if not args.events or not args.splits:
                    raise SystemExit(f"no --torch-results of {method} with seed {seed}: --events and --splits are needed")
                results[method, seed] = torch_result(args, method, seed)
    return results


def headway_report(args, more):
    """`report.json` of --report, or of a `headway reproduce` made here."""
    folder = args.report
    if not folder:
        if not args.events or not args.splits:
            raise SystemExit("--report, or --events and --splits, are needed")
        folder = args.folder / "reproduce"
        threads = ["--threads", str(args.threads)] if args.threads else []
        subprocess.run([args.binary, "reproduce", "--events", *args.events, "--splits", args.splits, "--methods", args.methods,
                        "--seeds", args.seeds, "--hidden", str(args.hidden), "--epochs", str(args.epochs),
                        "--steps", str(args.steps), "--out", str(folder), *threads, *more], check=True)
    return json.loads((folder / "report.json").read_text())


class Model:
    """What one model reached with one seed: stages x tasks of spacing MSE and of collision rates, and its speed."""

    def __init__(self, spacing_mse, collisions_percent, events_per_s):
        self.spacing_mse, self.collisions_percent, self.events_per_s = spacing_mse, collisions_percent, events_per_s

    @classmethod
    def of_torch(cls, result):
        table = lambda name: [[task[name] for task in stage] for stage in result["stages"]]
        return cls(table("spacing_mse"), table("collision_rate"), result["train_events_per_s"])

    @classmethod
    def of_headway(cls, seed):
        return cls(seed["spacing_mse"], seed["collision_rate_percent"], seed["train_events_per_s"])

    def last(self):
        return self.spacing_mse[-1]

    def mean(self):
        return sum(self.last()) / len(self.last())

    def forgetting(self):
        """R[T,1] / R[1,1]; none for a model that learned everything at once."""
        return self.last()[0] / self.spacing_mse[0][0] if len(self.spacing_mse) > 1 else None

    def worst_collisions_percent(self):
        """Over stages, on the tasks that had been seen by then."""
        skipped = len(self.last()) - len(self.spacing_mse)
        return max(rate for stage, row in enumerate(self.collisions_percent) for rate in row[: skipped + stage + 1])


def figures(model, own_naive, torch_joint, torch_naive, method):
    """Everything told of one model with one seed."""
    turns = len(model.spacing_mse) > 1
    beside = torch_joint if method == "joint" else torch_naive
    return {
        "final_spacing_mse": model.last(),
        "mean_spacing_mse": model.mean(),
        "mean_over_torch_joint": model.mean() / torch_joint.mean(),
        "forgetting_ratio": model.forgetting(),
        "last_task_over_torch_naive": model.last()[-1] / torch_naive.last()[-1] if turns else None,
        "last_task_over_own_naive": model.last()[-1] / own_naive.last()[-1] if turns and own_naive else None,
        "worst_collisions_percent": model.worst_collisions_percent(),
        "train_events_per_s": model.events_per_s,
        "train_events_per_s_over_torch": model.events_per_s / beside.events_per_s,
    }


def compared(torch, report, seeds):
    """{model: {seed: figures}}, torch's first."""
    models = {}
    of_torch = {key: Model.of_torch(result) for key, result in torch.items()}
    of_headway = {(method, seed["seed"]): Model.of_headway(seed)
                  for method, told in report["methods"].items() for seed in told["per_seed"]}
    for side, all_models in (("torch", of_torch), ("headway", of_headway)):
        for method in sorted({method for method, _ in all_models}, key=lambda name: (name not in YARDSTICKS, name)):
            models[f"{side} {method}"] = {
                seed: figures(all_models[method, seed], all_models.get(("naive", seed)), of_torch["joint", seed],
                              of_torch["naive", seed], method)
                for seed in seeds if (method, seed) in all_models
            }
    return models


def differences(torch, report, seeds):
    """Where the two sides were not made alike, in sentences."""
    told, settings = [], report["settings"]
    of_headway = {"hidden": settings["hidden"], "epochs": settings["epochs"], "steps": report["protocol"]["steps"]}
    for name, value in of_headway.items():
        others = {result["args"][name] for result in torch.values()} - {value}
        told += [f"{name}: {value} for Headway, {', '.join(map(str, sorted(others)))} for torch"] if others else []
    usable = sum(file["kept"] for file in report["protocol"]["files"])
    others = {result["events"] for result in torch.values()} - {usable}
    told += [f"events that can be used: {usable} for Headway, {', '.join(map(str, others))} for torch"] if others else []
    for result in torch.values():
        if not result["args"]["splits"]:
            told.append(f"torch {result['args']['method']} with seed {result['args']['seed']} used no splits file")
        if len(result["stages"][-1]) != len(report["tasks"]):
            raise SystemExit(f"torch learned {len(result['stages'][-1])} tasks, Headway {len(report['tasks'])}")
    unpaired = set(report["seeds"]) - set(seeds)
    told += [f"seeds {sorted(unpaired)} of Headway are not compared"] if unpaired else []
    return told


def cell(values, digits=2):
    """Mean and, where there are several, each seed's."""
    values = [value for value in values if value is not None]
    if not values:
        return "–"
    mean = f"{sum(values) / len(values):.{digits}f}"
    return mean if len(values) == 1 else f"{mean} ({', '.join(f'{value:.{digits}f}' for value in values)})"


def print_table(models, tasks):
    last = len(tasks)
    heads = ["model", *(f"R[{last},{task + 1}] {name}" for task, name in enumerate(tasks)), "mean", "mean / torch's joint",
             f"R[{last},1]/R[1,1]", f"R[{last},{last}] / torch naive's", f"R[{last},{last}] / own naive's",
             "collisions on tasks seen, worst, %", "training events/s", "over torch's"]
    print("| " + " | ".join(heads) + " |\n" + "| --- " * len(heads) + "|")
    for model, by_seed in models.items():
        each = lambda name: [told[name] for told in by_seed.values()]
        mean = lambda values: f"{sum(values) / len(values):.2f}"
        cells = [model, *(mean(errors) for errors in zip(*each("final_spacing_mse"))), mean(each("mean_spacing_mse")),
                 cell(each("mean_over_torch_joint")), cell(each("forgetting_ratio")),
                 cell(each("last_task_over_torch_naive")), cell(each("last_task_over_own_naive")),
                 f"{max(each('worst_collisions_percent')):.1f}", cell(each("train_events_per_s"), 0),
                 cell(each("train_events_per_s_over_torch"), 1)]
        print("| " + " | ".join(cells) + " |")


def conditions(torch, report):
    several = lambda name: sorted({result[name] for result in torch.values() if name in result})
    return {
        "cpus": os.cpu_count(), "machine": platform.machine(), "python": platform.python_version(),
        "torch": {"versions": several("torch"), "threads": several("threads"),
                  "args": [result["args"] for result in torch.values()]},
        "headway": {name: report.get(name) for name in ("version", "kernel", "threads", "preset", "settings", "protocol")}
        | {"strengths": {method: told["strength"] for method, told in report["methods"].items()}},
    }


def main():
    cli = argparse.ArgumentParser(description=__doc__, allow_abbrev=False,
                                  formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--events", nargs="+")
    cli.add_argument("--splits", help="CSV with columns event_id, task, split; task 1 is learned first")
    cli.add_argument("--methods", default="joint,naive,ewc,mas", help="Headway's")
    cli.add_argument("--seeds", default="42,43,44")
    cli.add_argument("--hidden", type=int, default=128)
    cli.add_argument("--epochs", type=int, default=5)
    cli.add_argument("--steps", type=int, default=150)
    cli.add_argument("--threads", type=int, help="for both; else as many as each takes by itself")
    cli.add_argument("--binary", default="target/release/headway")
    cli.add_argument("--python", default=sys.executable, help="a Python that has torch")
    cli.add_argument("--torch-results", nargs="+", type=pathlib.Path, default=[], metavar="FILE")
    cli.add_argument("--report", type=pathlib.Path, metavar="DIR", help="--out of an earlier headway reproduce")
    cli.add_argument("--folder", type=pathlib.Path, default=pathlib.Path("against_torch"))
    cli.add_argument("--out", type=pathlib.Path, metavar="FILE")
    args, more = cli.parse_known_args()
    if args.report and more:
        cli.error(f"{' '.join(more)}: --report is of a reproduce that is over")
    report = headway_report(args, more)
    seeds = [int(seed) for seed in args.seeds.split(",")]
    absent = set(seeds) - set(report["seeds"])
    if absent:
        raise SystemExit(f"Headway has not learned with seed {', '.join(map(str, sorted(absent)))}; choose --seeds")
    torch = {key: result for key, result in torch_results(args, seeds).items() if key[1] in seeds}
    told = differences(torch, report, seeds)
    models = compared(torch, report, seeds)
    for difference in told:
        print(f"Not alike: {difference}.")
    print_table(models, report["tasks"])
    out = args.out or args.folder / "against_torch.json"
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps({"seeds": seeds, "tasks": report["tasks"], "models": models, "not_alike": told,
                               "conditions": conditions(torch, report)}, indent=1) + "\n")


if __name__ == "__main__":
    main()
