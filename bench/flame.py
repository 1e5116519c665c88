"""Draws where an update of training spends its time: docs/training.svg.

    cargo install inferno && apt-get install linux-perf
    cargo bench --bench lstm --no-run
    python3 bench/flame.py target/release/deps/lstm-<hash>

Samples `cargo bench --bench lstm -- windows` (one thread, pieces of eight events of 150 steps, 64 and then 128 hidden units) with
`perf` and draws with `inferno-flamegraph`. Everything is inlined into one function for each kernel, so stacks come from
debug information; of their dozens of frames only those that name a pass, a kernel or a part of one are kept.
"""

import argparse
import collections
import pathlib
import re
import subprocess
import tempfile

PARTS = {
    "add_products": "products",
    "tile": "tile",
    "begin": "gates: first step",
    "go_on": "gates: later steps",
    "back": "derivatives of gates",
    "fma": "fma",
    "load": "load",
    "store": "store",
    "div": "div",
    "tanh": "tanh",
    "gates": "sigmoids and tanh",
}


def shortened(frames):
    """What of a stack is worth a box."""
    kept = []
    for frame in frames:
        name = re.sub(r"<.*", "", frame).split("::")[-1] or frame
        if match := re.fullmatch(r"headway::lstm::passes::Passes<T>::(\w+)", frame):
            kept = [match[1]]
        elif match := re.match(r"run_vectorised<headway::lstm::\w+::(\w+)<f32>>", frame):
            kept.append(match[1])
        elif kept and (part := PARTS.get(name)) and part not in kept:
            kept.append(part)
    return kept or ["the benchmark itself"]


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("binary")
    cli.add_argument("--out", type=pathlib.Path, default=pathlib.Path("docs/training.svg"))
    cli.add_argument("--inferno", default="", metavar="FOLDER/", help="where inferno's programs are, unless they are on the path")
    args = cli.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        data = f"{folder}/perf.data"
        bench = [args.binary, "--bench", "windows", "--min-time", "3"]
        subprocess.run(["perf", "record", "-q", "-o", data, "-F", "499", "--call-graph", "dwarf,8192", *bench], check=True)
        script = subprocess.run(["perf", "script", "-i", data], check=True, capture_output=True).stdout
    collapsed = subprocess.run([f"{args.inferno}inferno-collapse-perf"], input=script, check=True, capture_output=True)
    samples = collections.Counter()
    for line in collapsed.stdout.decode().splitlines():
        stack, count = line.rsplit(" ", 1)
        samples[";".join(shortened(stack.split(";")))] += int(count)
    title = ["--title", "An update of training, one thread", "--countname", "ns", "--nametype", "Part:"]
    folded = "\n".join(f"{stack} {count}" for stack, count in sorted(samples.items()))
    svg = subprocess.run([f"{args.inferno}inferno-flamegraph", *title], input=folded.encode(), check=True, capture_output=True)
    args.out.write_bytes(svg.stdout)
    total = sum(samples.values())
    for stack, count in samples.most_common(12):
        print(f"{count / total:6.1%}  {stack}")


if __name__ == "__main__":
    main()
