"""The paper's protocol in PyTorch: an outside reference for accuracy, gradients and speed.

    python3 -m venv .venv && .venv/bin/pip install torch numpy pandas pyarrow
    .venv/bin/python bench/torch_protocol.py --splits protocol_random.csv --method naive --events \
        waymo.parquet ngsim_i80.parquet ...

Events are cut to their first `--steps` steps; shorter ones and those closer than 0.5 m are left out.
With `--splits FILE` (columns event_id, task, split; task 1 is learned first) the tasks and splits are those of the file.
Without it, tasks are thirds by mean follower speed over the cut steps, fast first, split 70 / 15 / 15 at random.
Consolidation is `sum_latest`: importance adds up over tasks, the anchor is the latest; importance is taken open loop.
Writes one JSON object: per stage and task the pooled spacing MSE (m^2), speed MSE (m^2/s^2), collision rate (%),
and `train_events_per_s`, counting training events x epochs over the time spent in training steps alone.
`bench/against_torch.py` compares it with Headway.
"""

import argparse
import json
import time

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import torch

DT = 0.1
HORIZON = 10


def read_events(paths, steps):
    """Columns spacing, sv_speed, lv_speed of every event with at least `steps` steps: three arrays (events, steps)."""
    names, spacing, follower, leader = [], [], [], []
    for path in paths:
        table = pq.read_table(path, columns=["event_id", "spacing", "sv_speed", "lv_speed"]).to_pandas()
        for name, event in table.groupby("event_id", sort=False):
            if len(event) < steps:
                continue
            event = event.iloc[:steps]
            if event.spacing.min() < 0.5:
                continue
            names.append(name)
            spacing.append(event.spacing.to_numpy())
            follower.append(event.sv_speed.to_numpy())
            leader.append(event.lv_speed.to_numpy())
    return names, [torch.tensor(np.stack(x), dtype=torch.float32) for x in (spacing, follower, leader)]


def tasks_from_file(path, names):
    """[(train_idx, test_idx)] in the order of the file's task numbers."""
    rows = pd.read_csv(path).set_index("event_id")
    absent = set(rows.index) - set(names)
    if absent:
        raise SystemExit(f"{len(absent)} events of {path} are in none of the --events files, e.g. {min(absent)}")
    place = {name: i for i, name in enumerate(names)}
    rows["idx"] = [place[name] for name in rows.index]
    return [
        tuple(group.idx[group.split == split].to_numpy(copy=True) for split in ("train", "test"))
        for _, group in rows.groupby("task", sort=True)
    ]


class CarFollowing(torch.nn.Module):
    """LSTM over the last HORIZON steps, from a zero state for every window; head gives acceleration in m/s^2."""

    def __init__(self, hidden, accel_limit):
        super().__init__()
        self.hidden, self.accel_limit = hidden, accel_limit
        self.lstm = torch.nn.LSTMCell(4, hidden)
        self.head = torch.nn.Linear(hidden, 1)
        torch.nn.init.normal_(self.head.weight, 0.0, 0.02)
        torch.nn.init.zeros_(self.head.bias)
        self.register_buffer("mean", torch.tensor([10.0, 10.0, 0.0, 20.0]))
        self.register_buffer("spread", torch.tensor([10.0, 10.0, 2.0, 20.0]))

    def window(self, x):
        """Acceleration for windows x (n, HORIZON, 4), written out so that it can be differentiated per sample."""
        n = x.shape[0]
        h = c = torch.zeros(n, self.hidden)
        x = (x - self.mean) / self.spread
        for t in range(HORIZON):
            z = x[:, t] @ self.lstm.weight_ih.T + self.lstm.bias_ih + h @ self.lstm.weight_hh.T + self.lstm.bias_hh
            i, f, g, o = z.chunk(4, -1)
            c = torch.sigmoid(f) * c + torch.sigmoid(i) * torch.tanh(g)
            h = torch.sigmoid(o) * torch.tanh(c)
        return torch.tanh(self.head(h))[:, 0] * self.accel_limit

    def drive_carried(self, spacing, follower, leader):
        """As `drive`, with one state carried along each event from its first step instead of a window's."""
        n, steps = spacing.shape
        h = c = torch.zeros(n, self.hidden)
        v, s = follower[:, HORIZON - 1], spacing[:, HORIZON - 1]
        out_s, out_v = [], []
        for t in range(steps - 1):
            now_v, now_s = (follower[:, t], spacing[:, t]) if t < HORIZON else (v, s)
            x = torch.stack([now_v, leader[:, t], leader[:, t] - now_v, now_s], -1)
            h, c = self.lstm((x - self.mean) / self.spread, (h, c))
            if t >= HORIZON - 1:
                accel = torch.tanh(self.head(h))[:, 0] * self.accel_limit
                next_v = v + DT * accel
                s = s + DT * ((leader[:, t] + leader[:, t + 1]) / 2 - (v + next_v) / 2)
                v = next_v
                out_s.append(s)
                out_v.append(v)
        return torch.stack(out_s, 1), torch.stack(out_v, 1)

    def drive(self, spacing, follower, leader):
        """Closed loop behind recorded leaders. Returns simulated spacing and speed, each (events, steps - HORIZON).

        The HORIZON windows that overlap at a step advance together, as one batch HORIZON times larger.
        """
        n, steps = spacing.shape
        h = c = torch.zeros(HORIZON, n, self.hidden)
        v, s = follower[:, HORIZON - 1], spacing[:, HORIZON - 1]
        out_s, out_v = [], []
        for t in range(steps - 1):
            now_v, now_s = (follower[:, t], spacing[:, t]) if t < HORIZON else (v, s)
            x = torch.stack([now_v, leader[:, t], leader[:, t] - now_v, now_s], -1)
            x = ((x - self.mean) / self.spread).expand(HORIZON, n, 4).reshape(-1, 4)
            h, c = self.lstm(x, (h.reshape(-1, self.hidden), c.reshape(-1, self.hidden)))
            h, c = h.reshape(HORIZON, n, -1), c.reshape(HORIZON, n, -1)
            if t >= HORIZON - 1:
                accel = torch.tanh(self.head(h[-1]))[:, 0] * self.accel_limit
                next_v = v + DT * accel
                s = s + DT * ((leader[:, t] + leader[:, t + 1]) / 2 - (v + next_v) / 2)
                v = next_v
                out_s.append(s)
                out_v.append(v)
            empty = torch.zeros(1, n, self.hidden)
            h, c = torch.cat([empty, h[:-1]]), torch.cat([empty, c[:-1]])
        return torch.stack(out_s, 1), torch.stack(out_v, 1)


def task_loss(model, events, idx, carried=False):
    spacing, follower, leader = (x[idx] for x in events)
    s, v = (model.drive_carried if carried else model.drive)(spacing, follower, leader)
    mse = ((s - spacing[:, HORIZON:]) ** 2).mean() + ((v - follower[:, HORIZON:]) ** 2).mean()
    return mse + 1000 * torch.relu(-s).mean() + 1000 * torch.relu(-v).mean()


@torch.no_grad()
def evaluate(model, events, idx):
    spacing, follower, leader = (x[idx] for x in events)
    s, v = model.drive(spacing, follower, leader)
    return {
        "spacing_mse": ((s - spacing[:, HORIZON:]) ** 2).mean().item(),
        "speed_mse": ((v - follower[:, HORIZON:]) ** 2).mean().item(),
        "collision_rate": 100 * (s.min(1)[0] <= 0).float().mean().item(),
    }


def importance(model, events, idx, method, rng, n_samples=2000):
    """Per-sample importance over recorded windows: mean g^2 (ewc) or mean |d y^2 / d theta| (mas)."""
    from torch.func import functional_call, grad, vmap

    spacing, follower, leader = events
    event = rng.choice(idx, n_samples)
    start = rng.integers(0, spacing.shape[1] - HORIZON, n_samples)
    x = torch.stack([
        torch.stack([follower[e, t:t + HORIZON], leader[e, t:t + HORIZON],
                     leader[e, t:t + HORIZON] - follower[e, t:t + HORIZON], spacing[e, t:t + HORIZON]], -1)
        for e, t in zip(event, start)
    ])
    parameters = {k: p.detach() for k, p in model.named_parameters()}
    wrapper = Window(model)
    names = {f"model.{k}": k for k in parameters}

    def output(params, sample):
        y = functional_call(wrapper, {w: params[k] for w, k in names.items()}, (sample[None],))[0]
        return y**2 if method == "mas" else y

    per_sample = vmap(grad(output), in_dims=(None, 0))
    total = {k: torch.zeros_like(p) for k, p in parameters.items()}
    for chunk in x.split(250):
        for k, g in per_sample(parameters, chunk).items():
            total[k] += (g.abs() if method == "mas" else g**2).sum(0)
    return {k: t / n_samples for k, t in total.items()}


class Window(torch.nn.Module):
    def __init__(self, model):
        super().__init__()
        self.model = model

    def forward(self, x):
        return self.model.window(x)


def main():
    cli = argparse.ArgumentParser()
    cli.add_argument("--events", nargs="+", required=True)
    cli.add_argument("--splits", help="CSV with columns event_id, task, split")
    cli.add_argument("--method", choices=["naive", "joint", "ewc", "mas"], default="naive")
    cli.add_argument("--strength", type=float, default=0.0, help="lambda")
    cli.add_argument("--proximal", action="store_true", help="proximal penalty step instead of the coupled loss term")
    cli.add_argument("--hidden", type=int, default=128)
    cli.add_argument("--accel-limit", type=float, default=3.0)
    cli.add_argument("--steps", type=int, default=150)
    cli.add_argument("--epochs", type=int, default=5)
    cli.add_argument("--batch", type=int, default=32)
    cli.add_argument("--lr", type=float, default=1e-3)
    cli.add_argument("--per-task", type=int, default=0, help="at most this many events a task; 0 for all")
    cli.add_argument("--seed", type=int, default=42)
    args = cli.parse_args()
    torch.manual_seed(args.seed)
    rng = np.random.default_rng(args.seed)

    names, events = read_events(args.events, args.steps)
    mean_speed = events[1].mean(1).numpy()
    low, high = np.percentile(mean_speed, [100 / 3, 200 / 3])
    groups = [mean_speed > high, (mean_speed > low) & (mean_speed <= high), mean_speed <= low]
    tasks = []
    for group in groups:
        idx = rng.permutation(np.flatnonzero(group))
        idx = idx[: args.per_task] if args.per_task else idx
        tasks.append((idx[: int(0.7 * len(idx))], idx[int(0.85 * len(idx)):]))
    if args.splits:
        tasks = tasks_from_file(args.splits, names)
    stages = [train for train, _ in tasks]
    if args.method == "joint":
        stages = [np.concatenate(stages)]

    model = CarFollowing(args.hidden, args.accel_limit)
    omega, anchor, table, seen, spent = None, None, [], 0, 0.0
    half = 0.5 if args.method == "ewc" else 1.0
    for train in stages:
        optimiser = torch.optim.Adam(model.parameters(), args.lr)
        for _ in range(args.epochs):
            order = rng.permutation(train)
            for at in range(0, len(order), args.batch):
                began = time.perf_counter()
                batch = order[at: at + args.batch]
                loss = task_loss(model, events, batch)
                if omega and not args.proximal:
                    for k, p in model.named_parameters():
                        loss = loss + half * args.strength * (omega[k] * (p - anchor[k]) ** 2).sum()
                optimiser.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
                optimiser.step()
                if omega and args.proximal:
                    with torch.no_grad():
                        for k, p in model.named_parameters():
                            pull = 2 * half * args.lr * args.strength * omega[k]
                            p.copy_((p + pull * anchor[k]) / (1 + pull))
                spent += time.perf_counter() - began
                seen += len(batch)
        if args.method in ("ewc", "mas"):
            new = importance(model, events, train, args.method, rng)
            omega = new if omega is None else {k: omega[k] + new[k] for k in new}
            anchor = {k: p.detach().clone() for k, p in model.named_parameters()}
        table.append([evaluate(model, events, test) for _, test in tasks])
    print(json.dumps({"args": vars(args), "events": len(mean_speed), "split_mps": [float(low), float(high)],
                      "torch": torch.__version__, "threads": torch.get_num_threads(),
                      "train_events_per_s": seen / spent, "stages": table}, indent=1))


if __name__ == "__main__":
    main()
