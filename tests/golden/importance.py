"""Writes importance.json: diagonal importances in PyTorch that `tests/learning` must reproduce.

    python3 -m venv .venv && .venv/bin/pip install torch
    .venv/bin/python tests/golden/importance.py

Every output of every step is differentiated on its own with torch.autograd.grad, in double precision, and then squared or
made absolute: written from the formulas, without sharing anything with the Rust code. Inputs and weights are f32 numbers.
The script refuses a case in which squaring the summed gradient instead would go unnoticed.
"""

import json
import math
import pathlib

import torch

HIDDEN, HORIZON, DT, LIMIT = 5, 4, 0.1, 3.0
MEAN, SPREAD = [7.0, 6.5, -0.5, 9.0], [4.0, 4.0, 2.0, 6.0]
NAMES = ["input", "recurrent", "bias", "head", "head_bias"]


def make_event(steps, phase, gap, follower, leader):
    t = [i * 0.1 + phase for i in range(steps)]
    return {
        "spacing_m": [round(gap + 0.5 * math.sin(2 * x), 4) for x in t],
        "follower_speed_mps": [round(follower + 0.6 * math.cos(x), 4) for x in t],
        "leader_speed_mps": [round(leader + 0.9 * math.sin(1.3 * x), 4) for x in t],
    }


EVENTS = [make_event(16, 0.0, 5.0, 7.0, 6.5), make_event(11, 0.8, 9.0, 4.5, 4.6), make_event(16, 1.7, 12.0, 9.0, 9.2)]


def single(x):
    """The f32 number nearest to x, as a double."""
    return torch.tensor(x, dtype=torch.float32).double()


def main():
    torch.manual_seed(11)
    torch.set_num_threads(1)
    cell, head = torch.nn.LSTMCell(4, HIDDEN), torch.nn.Linear(HIDDEN, 1)
    with torch.no_grad():
        cell.bias_hh.zero_()  # one bias here; torch's second is kept at zero
        head.weight.normal_(0.0, 1.5)
    cell, head = cell.double(), head.double()
    trained = [cell.weight_ih, cell.weight_hh, cell.bias_ih, head.weight, head.bias]
    mean, spread, dt = single(MEAN), single(SPREAD), single(DT)
    events = [{k: single(v) for k, v in event.items()} for event in EVENTS]

    def accelerate(window):
        h = c = torch.zeros(1, HIDDEN, dtype=torch.double)
        for x in window:
            h, c = cell(((x - mean) / spread)[None], (h, c))
        return LIMIT * torch.tanh(head(h))[0, 0]

    def drive(event, closed):
        """(acceleration, spacing, speed, recorded acceleration) of every step from the horizon on."""
        s, v, l = (list(event[k]) for k in ("spacing_m", "follower_speed_mps", "leader_speed_mps"))
        recorded, steps = list(v), []
        for t in range(HORIZON - 1, len(l) - 1):
            window = [torch.stack([v[k], l[k], l[k] - v[k], s[k]]) for k in range(t - HORIZON + 1, t + 1)]
            a = accelerate(window)
            next_v = v[t] + dt * a
            next_s = s[t] + dt * ((l[t] + l[t + 1]) / 2 - (v[t] + next_v) / 2)
            steps.append((a, next_s, next_v, (recorded[t + 1] - recorded[t]) / dt))
            if closed:
                v[t + 1], s[t + 1] = next_v, next_s
        return steps

    opened = [step for event in events for step in drive(event, closed=False)]
    closed = [step for event in events for step in drive(event, closed=True)]

    def gradient(y):
        return [g.detach() for g in torch.autograd.grad(y, trained, retain_graph=True)]

    def mean_of(of, outputs):
        sums = [torch.zeros_like(p) for p in trained]
        for y in outputs:
            for total, g in zip(sums, gradient(y)):
                total += of(g)
        return {name: (total / len(opened)).flatten().tolist() for name, total in zip(NAMES, sums)}

    square, absolute = torch.square, torch.abs
    each = [y for _, s, v, _ in closed for y in (s, v)]
    golden = {
        "made_by": "tests/golden/importance.py",
        "torch": torch.__version__,
        "hidden": HIDDEN, "horizon": HORIZON, "dt_s": DT, "accel_limit_mps2": LIMIT, "mean": MEAN, "spread": SPREAD,
        "events": EVENTS,
        "weights": {name: p.detach().flatten().tolist() for name, p in zip(NAMES, trained)},
        "samples": len(opened),
        "fisher": {
            "open_loop": mean_of(square, [a for a, *_ in opened]),
            "empirical": mean_of(square, [(a - recorded) ** 2 / 2 for a, _, _, recorded in opened]),
            "closed_loop": mean_of(square, each),
        },
        "jacobian": {
            "open_loop": mean_of(absolute, [a for a, *_ in opened]),
            "closed_loop": mean_of(absolute, each),
        },
        "squared_norm": {
            "open_loop": mean_of(absolute, [a**2 for a, *_ in opened]),
            "closed_loop": mean_of(absolute, [s**2 + v**2 for _, s, v, _ in closed]),
        },
    }
    summed = [torch.square(g).sum().item() for g in gradient(sum(a for a, *_ in opened))]
    right = [sum(golden["fisher"]["open_loop"][name]) for name in NAMES]
    if any(0.5 < wrong / len(opened) / own < 2 for wrong, own in zip(summed, right)):
        raise SystemExit("not a hard case: the square of the sum is close to the sum of squares")
    path = pathlib.Path(__file__).with_suffix(".json")
    path.write_text(json.dumps(golden, indent=None, separators=(",", ":")) + "\n")
    print(f"{path.name}: {len(opened)} steps")


if __name__ == "__main__":
    main()
