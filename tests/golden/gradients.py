"""Writes gradients.json: ten updates in PyTorch that `tests/learning` must follow.

    python3 -m venv .venv && .venv/bin/pip install torch
    .venv/bin/python tests/golden/gradients.py

The case is meant to be hard: events of two lengths in one minibatch, saturated accelerations, and both penalties active
(simulated followers run into their leaders and drive backwards). The script refuses to write a case that is not.
Written window by window, from the formulas, without sharing anything with the Rust code.
"""

import json
import math
import pathlib

import torch

HIDDEN, HORIZON, DT, LIMIT = 6, 4, 0.1, 3.0
UPDATES, RATE, CLIP = 10, 0.01, 1.0
MEAN, SPREAD = [6.0, 5.0, -1.0, 8.0], [4.0, 4.0, 2.0, 6.0]


def make_event(steps, phase, gap, follower, leader):
    t = [i * 0.1 + phase for i in range(steps)]
    return {
        "spacing_m": [round(gap + 0.5 * math.sin(2 * x) - 0.1 * i, 4) for i, x in enumerate(t)],
        "follower_speed_mps": [round(max(0.0, follower + 0.6 * math.cos(x)), 4) for x in t],
        "leader_speed_mps": [round(max(0.0, leader - 0.9 * i * 0.1 + 0.4 * math.sin(1.3 * x)), 4) for i, x in enumerate(t)],
    }


EVENTS = [
    make_event(24, 0.0, 3.0, 7.0, 5.0),  # runs into its leader
    make_event(17, 0.8, 9.0, 0.5, 0.6),  # can be driven backwards
    make_event(24, 1.7, 12.0, 9.0, 9.0),
]


def main():
    torch.manual_seed(7)
    torch.set_num_threads(1)
    cell = torch.nn.LSTMCell(4, HIDDEN)
    head = torch.nn.Linear(HIDDEN, 1)
    with torch.no_grad():
        cell.bias_hh.zero_()  # one bias here; torch's second is kept at zero
        cell.weight_hh.mul_(1.5)
        head.weight.normal_(0.0, 6.0)
        head.bias.fill_(-1.5)
    trained = [cell.weight_ih, cell.weight_hh, cell.bias_ih, head.weight, head.bias]
    names = ["input", "recurrent", "bias", "head", "head_bias"]
    mean, spread = torch.tensor(MEAN), torch.tensor(SPREAD)
    events = [{k: torch.tensor(v) for k, v in event.items()} for event in EVENTS]

    def accelerate(window):
        h = c = torch.zeros(1, HIDDEN)
        for x in window:
            h, c = cell(((x - mean) / spread)[None], (h, c))
        return LIMIT * torch.tanh(head(h))[0, 0]

    def minibatch():
        squares, crash, backward, count, seen = 0.0, 0.0, 0.0, 0, []
        for event in events:
            s, v, l = (list(event[k]) for k in ("spacing_m", "follower_speed_mps", "leader_speed_mps"))
            recorded_s, recorded_v = list(s), list(v)
            for t in range(HORIZON - 1, len(l) - 1):
                window = [torch.stack([v[k], l[k], l[k] - v[k], s[k]]) for k in range(t - HORIZON + 1, t + 1)]
                a = accelerate(window)
                v[t + 1] = v[t] + DT * a
                s[t + 1] = s[t] + DT * ((l[t] + l[t + 1]) / 2 - (v[t] + v[t + 1]) / 2)
                squares = squares + (s[t + 1] - recorded_s[t + 1]) ** 2 + (v[t + 1] - recorded_v[t + 1]) ** 2
                crash = crash + torch.relu(-s[t + 1])
                backward = backward + torch.relu(-v[t + 1])
                count += 1
                seen.append(abs(a.item()) / LIMIT)
        return (squares + 1000 * crash + 1000 * backward) / count, crash.item(), backward.item(), max(seen)

    def flat(tensors):
        return {name: tensor.detach().flatten().tolist() for name, tensor in zip(names, tensors)}

    optimiser = torch.optim.Adam(trained, RATE)
    golden = {
        "made_by": "tests/golden/gradients.py",
        "torch": torch.__version__,
        "hidden": HIDDEN, "horizon": HORIZON, "dt_s": DT, "accel_limit_mps2": LIMIT,
        "learning_rate": RATE, "clip_norm": CLIP, "mean": MEAN, "spread": SPREAD,
        "events": EVENTS, "weights": flat(trained), "updates": [],
    }
    crashes = backwards = saturated = 0
    for _ in range(UPDATES):
        loss, crash, backward, most = minibatch()
        optimiser.zero_grad()
        loss.backward()
        gradient = flat([p.grad for p in trained])
        norm = torch.nn.utils.clip_grad_norm_(trained, CLIP).item()
        optimiser.step()
        golden["updates"].append({"loss": loss.item(), "norm": norm, "gradient": gradient, "weights": flat(trained)})
        crashes += crash > 0
        backwards += backward > 0
        saturated += most > 0.99
    if min(crashes, backwards, saturated) < UPDATES // 2:
        raise SystemExit(f"not a hard case: {crashes} crash, {backwards} backward, {saturated} saturated updates")
    path = pathlib.Path(__file__).with_suffix(".json")
    path.write_text(json.dumps(golden, indent=None, separators=(",", ":")) + "\n")
    print(f"{path.name}: {crashes} of {UPDATES} updates crash, {backwards} drive backwards, {saturated} saturate")


if __name__ == "__main__":
    main()
