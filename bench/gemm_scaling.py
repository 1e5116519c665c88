"""How much faster two processes multiply matrices than one, for the shapes that an update multiplies.

    .venv/bin/pip install torch
    .venv/bin/python bench/gemm_scaling.py

Every process has one thread and matrices of its own. One and two of them take turns, `--rounds` times; a round lasts
`--seconds` after all of them have begun. Prints the medians of GFLOP/s and of the speed-up as a Markdown table: training on two
threads is to be compared with these (`bench/training.py`).
"""

import argparse
import statistics
import time
from multiprocessing import get_context

SHAPES = {"forward": (512, 128, 288), "backward": (128, 512, 288), "weights": (128, 20160, 512)}


def multiply(shape, ready, seconds, rates):
    import torch

    torch.set_num_threads(1)
    m, k, n = shape
    a, b, c = torch.randn(m, k), torch.randn(k, n), torch.empty(m, n)
    torch.mm(a, b, out=c)
    ready.wait()
    began, products = time.perf_counter(), 0
    while time.perf_counter() - began < seconds:
        torch.mm(a, b, out=c)
        products += 1
    rates.put(2e-9 * m * k * n * products / (time.perf_counter() - began))


def rate(context, shape, processes, seconds):
    """GFLOP/s of all processes together."""
    ready, rates = context.Barrier(processes), context.Queue()
    workers = [context.Process(target=multiply, args=(shape, ready, seconds, rates)) for _ in range(processes)]
    for worker in workers:
        worker.start()
    total = sum(rates.get() for _ in workers)
    for worker in workers:
        worker.join()
    return total


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--rounds", type=int, default=5)
    cli.add_argument("--seconds", type=float, default=1.0)
    args = cli.parse_args()
    context = get_context("spawn")
    print("| product | one process, GFLOP/s | two | speed-up |\n| --- | --- | --- | --- |")
    speed_ups = []
    for name, shape in SHAPES.items():
        rounds = [[rate(context, shape, processes, args.seconds) for processes in (1, 2)] for _ in range(args.rounds)]
        one, two = (statistics.median(column) for column in zip(*rounds))
        speed_ups.append(statistics.median(two / one for one, two in rounds))
        print(f"| {name} | {one:.0f} | {two:.0f} | {speed_ups[-1]:.2f} |", flush=True)
    print(f"\nmean of the speed-ups: {statistics.mean(speed_ups):.2f}")


if __name__ == "__main__":
    main()
