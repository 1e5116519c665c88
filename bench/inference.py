"""Headway's predictions beside ONNX Runtime's, in process: one window, 4,096 windows, a step of a vehicle's sequence.

    python3 -m venv .venv && .venv/bin/pip install onnxruntime onnx numpy
    cargo build --release
    .venv/bin/python bench/inference.py

Both compute the same: windows of `horizon` steps of four inputs in, standardised, one LSTM layer from a zero state, a linear
head, tanh, the acceleration limit; random weights. The graph is checked against the formulas before it is timed.
ONNX Runtime is taken at its best: of the LSTM operator and of the same network written step by step, with one and two threads,
with and without bound buffers, with all windows in one call, in smaller ones, and in two sessions of one thread each, whatever
was fastest in a first run. Then it and `headway bench inference` take turns, `--rounds` times, and the medians of the rounds
are printed as a Markdown table with the conditions. `--out` gets every figure.
"""

import argparse
import concurrent.futures
import itertools
import json
import os
import pathlib
import platform
import statistics
import subprocess
import sys
import time

import numpy as np
import onnxruntime as ort

from onnx_model import HORIZON, INPUTS, MEAN, SPREAD, Network


def session(model, threads):
    options = ort.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.graph_optimization_level = ort.GraphOptimizationLevel.ORT_ENABLE_ALL
    return ort.InferenceSession(model, options, providers=["CPUExecutionProvider"])


class Plain:
    """Arrays in, arrays out."""

    def __init__(self, session, windows):
        self.run = lambda: session.run(None, {"window": windows})[0]


class Bound:
    """Buffers bound once: nothing is copied or allocated by the caller."""

    def __init__(self, session, windows):
        binding, self.answers = session.io_binding(), np.empty((len(windows), 1), np.float32)
        binding.bind_ortvalue_input("window", ort.OrtValue.ortvalue_from_numpy(windows))
        binding.bind_output("accel_mps2", "cpu", 0, np.float32, self.answers.shape, self.answers.ctypes.data)
        self.run = lambda: (session.run_with_iobinding(binding), self.answers)[1]


class Pieces:
    """Several calls, one after another or shared between `workers` threads with a session each."""

    def __init__(self, sessions, windows, each):
        pieces = [windows[at : at + each] for at in range(0, len(windows), each)]
        shares = [[Bound(session, piece) for piece in pieces[n :: len(sessions)]] for n, session in enumerate(sessions)]
        pool = concurrent.futures.ThreadPoolExecutor(len(sessions))
        work = lambda share: [piece.run() for piece in share]

        def run():
            done = list(pool.map(work, shares)) if len(shares) > 1 else [work(shares[0])]
            answers = [None] * len(pieces)
            for n, of_share in enumerate(done):
                answers[n :: len(sessions)] = of_share
            return np.concatenate(answers)

        self.run = run


def times_us(run, seconds):
    """Times of calls of `run` for so long, each in microseconds."""
    times, end = [], time.perf_counter() + seconds
    while time.perf_counter() < end or len(times) < 3:
        start = time.perf_counter()
        run()
        times.append(1e6 * (time.perf_counter() - start))
    return times


def candidates(network, windows, threads):
    """{name: how to answer the windows}."""
    models = {kind: network.graph(kind) for kind in ("operator", "steps")}
    for (kind, model), count in itertools.product(models.items(), range(1, threads + 1)):
        name = f"{kind}, {count} thread{'s' if count > 1 else ''}"
        yield name, Plain(session(model, count), windows)
        yield f"{name}, bound", Bound(session(model, count), windows)
        for each in (256, 64) if len(windows) > 256 else ():
            yield f"{name}, calls of {each}", Pieces([session(model, count)], windows, each)
    if len(windows) > 256 and threads > 1:
        for (kind, model), each in itertools.product(models.items(), (len(windows) // threads, 256, 64)):
            sessions = [session(model, 1) for _ in range(threads)]
            yield f"{kind}, {threads} sessions of one thread, calls of {each}", Pieces(sessions, windows, each)


def best(network, windows, threads, seconds):
    """The fastest way, its name, and what every way took in the median, in microseconds a call."""
    expected, tried, ways = network.accelerations(windows), {}, {}
    for name, way in candidates(network, windows, threads):
        error = np.abs(way.run() - expected).max()
        if error > 1e-4:
            raise SystemExit(f"{name} is not the same computation: off by {error} m/s^2")
        ways[name], tried[name] = way, statistics.median(times_us(way.run, seconds))
    name = min(tried, key=tried.get)
    return ways[name], name, tried


def headway(args):
    command = [args.binary, "bench", "inference", "--hidden", str(args.hidden), "--windows", str(args.windows),
               "--threads", ",".join(str(count) for count in sorted({1, args.threads})), "--repeats", "3", "--json"]
    return json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)


def figure(report, name):
    return next(told["median"] for told in report["figures"] if told["name"] == name)


def cpu():
    info = pathlib.Path("/proc/cpuinfo")
    found = dict(line.split(":", 1) for line in info.read_text().splitlines() if ":" in line) if info.exists() else {}
    found = {name.strip(): value.strip() for name, value in found.items()}
    features = [name for name in ("avx2", "fma", "avx512f", "avx512_vnni", "amx_tile") if name in found.get("flags", "").split()]
    return {"model": found.get("model name", platform.processor()), "features": features, "cpus": os.cpu_count()}


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--hidden", type=int, default=128)
    cli.add_argument("--windows", type=int, default=4096)
    cli.add_argument("--threads", type=int, default=min(2, os.cpu_count()))
    cli.add_argument("--rounds", type=int, default=5)
    cli.add_argument("--seconds", type=float, default=1.0, help="ONNX Runtime is timed so long, in each round")
    cli.add_argument("--binary", default="target/release/headway")
    cli.add_argument("--out", type=pathlib.Path, metavar="FILE")
    args = cli.parse_args()

    network = Network(args.hidden)
    random = np.random.default_rng(2)
    windows = (MEAN + SPREAD * random.normal(size=(args.windows, HORIZON, INPUTS))).astype(np.float32)
    one, one_name, one_tried = best(network, windows[:1].copy(), args.threads, 0.2)
    many, many_name, many_tried = best(network, windows, args.threads, 0.4)
    print(f"ONNX Runtime at its best: {one_name}; {many_name}", file=sys.stderr, flush=True)
    rounds = []
    for _ in range(args.rounds):
        single = sorted(times_us(one.run, args.seconds))
        rounds.append({
            "onnxruntime": {
                "single_us": statistics.median(single), "single_p99_us": single[int(0.99 * len(single))],
                "many_us_per_window": statistics.median(times_us(many.run, args.seconds)) / args.windows,
            },
            "headway": headway(args),
        })

    told = {"conditions": {"cpu": cpu(), "python": platform.python_version(), "onnxruntime": ort.__version__,
                           "args": {name: str(value) for name, value in vars(args).items()}},
            "best": {"single": one_name, "many": many_name}, "tried_us": {"single": one_tried, "many": many_tried},
            "rounds": rounds}
    print_table(args, told)
    if args.out:
        args.out.parent.mkdir(parents=True, exist_ok=True)
        args.out.write_text(json.dumps(told, indent=1) + "\n")


def print_table(args, told):
    rounds = told["rounds"]
    median = lambda read: statistics.median(read(turn) for turn in rounds)
    theirs = lambda name: median(lambda turn: turn["onnxruntime"][name])
    ours = lambda name: median(lambda turn: figure(turn["headway"], name))
    rows = [
        ("one window, median, µs", theirs("single_us"), ours("single_window")),
        ("one window, 99th percentile, µs", theirs("single_p99_us"), ours("single_window_p99")),
        (f"{args.windows} windows, {args.threads} threads, µs a window", theirs("many_us_per_window"),
         ours(f"windows_{args.threads}_threads")),
        (f"{args.windows} windows, one thread, µs a window", None, ours("windows_1_threads")),
        ("the newest step of a vehicle's sequence, median, µs", theirs("single_us"), ours("sequence_step")),
    ]
    print("| figure | ONNX Runtime | Headway | ratio |\n| --- | --- | --- | --- |")
    for name, other, own in rows:
        print(f"| {name} | {'–' if other is None else f'{other:.2f}'} | {own:.2f} | "
              f"{'–' if other is None else f'{other / own:.2f}'} |")
    conditions, kernel = told["conditions"], rounds[0]["headway"]["kernel"]
    print(f"\n{args.hidden} hidden units, horizon {HORIZON}, {args.rounds} rounds in turns, medians of the rounds; "
          f"{conditions['cpu']['cpus']} cores of {conditions['cpu']['model']} ({', '.join(conditions['cpu']['features'])}); "
          f"ONNX Runtime {conditions['onnxruntime']} (one window: {told['best']['single']}; many: {told['best']['many']}), "
          f"called from Python {conditions['python']}; Headway's kernel {kernel}.")


if __name__ == "__main__":
    main()
