"""How fast Headway trains beside PyTorch and beside the machine's matrix products, in one run.

    python3 -m venv .venv && .venv/bin/pip install torch numpy pandas pyarrow
    cargo build --release
    .venv/bin/python bench/training.py

In turn, `--rounds` times: updates of `bench/torch_protocol.py` (32 events of 150 steps, closed loop, forward, backward, clipped,
Adam; with windows and with a carried state, 128 and 64 hidden units), eager and with its LSTM cell compiled by `torch.compile`;
matrix products of the shapes that training multiplies, by PyTorch's library; and `headway bench training`, which trains on
generated events of the same size and multiplies with the libraries that Headway could use. Medians and ratios are printed as
Markdown tables; `--out` gets every figure as JSON. Nothing else should run on the machine.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import time

import torch

import torch_protocol as protocol

STEPS, MINIBATCH = 150, 32
# One event with windows: 140 windows, 9 recurrent products of hidden x 4 hidden, forward and twice that backward.
SHAPES = {"forward": (512, 128, 288), "backward": (128, 512, 288), "weights": (128, 20160, 512)}


def events(count, seed=1):
    """Smooth leaders and followers: what is in them does not change the arithmetic."""
    generator = torch.Generator().manual_seed(seed)
    wave = torch.cumsum(0.1 * torch.randn(count, STEPS, generator=generator), 1)
    leader = (12 + wave).clamp(min=0)
    return (20 + 0.1 * torch.cumsum(0.1 * torch.randn(count, STEPS, generator=generator), 1), leader.roll(3, 1), leader)


class Torch:
    """Updates of one configuration in PyTorch."""

    def __init__(self, hidden, carried, compiled):
        torch.manual_seed(42)
        self.model, self.carried = protocol.CarFollowing(hidden, 3.0), carried
        if compiled:
            self.model.lstm = torch.compile(self.model.lstm)
        self.optimiser = torch.optim.Adam(self.model.parameters(), 1e-3)
        self.events = events(MINIBATCH)
        self.update()

    def update(self):
        loss = protocol.task_loss(self.model, self.events, slice(None), self.carried)
        self.optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), 1.0)
        self.optimiser.step()

    def events_per_s(self, updates):
        began = time.perf_counter()
        for _ in range(updates):
            self.update()
        return updates * MINIBATCH / (time.perf_counter() - began)


def product_gflops(shape, threads):
    """Of PyTorch's library, 10^9 operations a second."""
    m, k, n = shape
    torch.set_num_threads(threads)
    a, b, out = torch.randn(m, k), torch.randn(k, n), torch.empty(m, n)
    torch.mm(a, b, out=out)
    times = max(1, int(4e9 / (2 * m * k * n)))
    began = time.perf_counter()
    for _ in range(times):
        torch.mm(a, b, out=out)
    return times * 2 * m * k * n / (time.perf_counter() - began) / 1e9


def headway(args, hidden):
    """{name of a figure: its value} of one round."""
    command = [args.binary, "bench", "training", "--json", "--repeats", "1", "--hidden", str(hidden), "--events", "128"]
    answer = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
    return answer["kernel"], {figure["name"]: figure["median"] for figure in answer["figures"]}


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--binary", default="target/release/headway")
    cli.add_argument("--rounds", type=int, default=5)
    cli.add_argument("--updates", type=int, default=4, help="of PyTorch in each round")
    cli.add_argument("--no-compile", action="store_true", help="leave torch.compile out")
    cli.add_argument("--out", help="file for every figure")
    args = cli.parse_args()

    torch.set_num_threads(2)
    opponents = {}
    for hidden in (128, 64):
        for carried in (False, True):
            for compiled in (False, True)[: 1 if args.no_compile else 2]:
                opponents[hidden, carried, compiled] = Torch(hidden, carried, compiled)
    samples = {}

    def note(name, value):
        samples.setdefault(name, []).append(value)

    for _ in range(args.rounds):
        for (hidden, carried, compiled), opponent in opponents.items():
            torch.set_num_threads(2)
            rate = opponent.events_per_s(args.updates * (4 if carried else 1))
            note(f"torch_{hidden}_{'carried' if carried else 'window'}_{'compiled' if compiled else 'eager'}", rate)
        for threads in (1, 2):
            for name, shape in SHAPES.items():
                note(f"torch_product_{name}_{threads}", product_gflops(shape, threads))
        for hidden in (128, 64):
            kernel, figures = headway(args, hidden)
            for name, value in figures.items():
                note(f"headway_{hidden}_{name}", value)

    median = {name: statistics.median(values) for name, values in samples.items()}
    print(f"{os.cpu_count()} cores, {platform.machine()}, kernel {kernel}, PyTorch {torch.__version__} with 2 threads; "
          f"medians of {args.rounds} rounds\n")
    print("| training, events/s | PyTorch eager | compiled | Headway, 1 thread | 2 threads | 2 threads / best of PyTorch |")
    print("| --- | --- | --- | --- | --- | --- |")
    for hidden in (128, 64):
        for memory in ("window", "carried"):
            eager, compiled = (median.get(f"torch_{hidden}_{memory}_{how}", 0.0) for how in ("eager", "compiled"))
            one, two = (median[f"headway_{hidden}_{memory}_{threads}"] for threads in (1, 2))
            print(f"| {hidden} hidden, memory {memory} | {eager:.0f} | {compiled:.0f} | {one:.0f} | {two:.0f} "
                  f"| {two / max(eager, compiled):.2f} |")
    print("\n| GFLOP/s, 128 hidden | threads | PyTorch | gemm | nalgebra |\n| --- | --- | --- | --- | --- |")
    best = {1: 0.0, 2: 0.0}
    for name in SHAPES:
        for threads in (1, 2):
            rates = [median[f"torch_product_{name}_{threads}"]]
            rates += [median[f"headway_128_{library}_{name}_{threads}"] for library in ("gemm", "nalgebra")]
            best[threads] = max(best[threads], *rates)
            print(f"| product `{name}` | {threads} | " + " | ".join(f"{rate:.0f}" for rate in rates) + " |")
    for threads in (1, 2):
        reached = median[f"headway_128_window_gflops_{threads}"]
        mean = statistics.mean(max(median[f"torch_product_{name}_{threads}"],
                                   median[f"headway_128_gemm_{name}_{threads}"],
                                   median[f"headway_128_nalgebra_{name}_{threads}"]) for name in SHAPES)
        print(f"\nA whole update, {threads} threads: {reached:.0f} GFLOP/s, {100 * reached / best[threads]:.0f} % of the best rate "
              f"of any shape and library, {100 * reached / mean:.0f} % of the mean over the shapes of the best library.")
    if args.out:
        with open(args.out, "w") as out:
            json.dump({"samples": samples, "median": median, "kernel": kernel, "torch": torch.__version__}, out, indent=1)


if __name__ == "__main__":
    main()
