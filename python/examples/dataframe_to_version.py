# %% [markdown]
# # From a data frame to a trained version
#
# Beside a server: `headway --database tutorial.db`. The cells can be run one by one in an editor, or all as a script.
# With recorded events, read them into `fast` and `slow` instead of making them up.

# %%
"""A data frame becomes a trained version, and two plots."""

import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from headway import Client

STEPS, DT_S = 150, 0.1
model = Client(os.environ.get("HEADWAY_URL", "http://127.0.0.1:8080")).create_model(
    "tutorial", method="ewc", settings={"hidden": 24, "schedule": "manual", "promotion": "auto"}
)

# %% [markdown]
# ## Events
#
# A driver of the intelligent driver model (IDM) behind leaders whose speed wanders: a row for each step.


# %%
def recorded(speed_mps: float, count: int, seed: int) -> pd.DataFrame:
    """Events around this speed, told apart by seed and number."""
    random = np.random.default_rng(seed)
    frames = []
    for number in range(count):
        drift = random.normal(0, 0.25, STEPS).cumsum()
        leader = np.clip(speed_mps + drift - drift.mean(), 0, None)
        follower, spacing = np.empty(STEPS), np.empty(STEPS)
        follower[0], spacing[0] = leader[0], 3 + 1.3 * leader[0]
        for step in range(1, STEPS):
            v, gap = follower[step - 1], spacing[step - 1]
            desired = 2 + 1.3 * v + v * (v - leader[step - 1]) / (2 * np.sqrt(1.2 * 1.8))
            accel = max(1.2 * (1 - (v / 33) ** 4 - (max(desired, 0) / gap) ** 2), -v / DT_S)
            follower[step] = v + accel * DT_S
            between = leader[step - 1] + leader[step] - v - follower[step]
            spacing[step] = gap + between / 2 * DT_S
        frame = {"event_id": f"{seed}-{number}", "t": np.arange(STEPS) * DT_S, "spacing_m": spacing}
        frames.append(pd.DataFrame({**frame, "follower_speed_mps": follower, "leader_speed_mps": leader}))
    return pd.concat(frames, ignore_index=True)


fast, slow = recorded(22.0, 60, seed=1), recorded(5.0, 60, seed=2)

# %% [markdown]
# ## Learning one after the other

# %%
for regime, events in {"fast": fast, "slow": slow}.items():
    batch = model.upload(events, regime=regime)
    made = model.train()
    print(f"{regime}: {batch.accepted} events, {batch.rejected_count} refused; version {made.version}")
    print(model.evaluation(made.version)[["regime", "spacing_mse", "collision_rate_percent"]].to_string(index=False))

# %% [markdown]
# ## What was forgotten

# %%
figures = Path(os.environ.get("HEADWAY_FIGURES", "."))
axes = model.forgetting().T.plot(marker="o", ylabel="spacing error / when just learned", xlabel="version")
axes.set_xticks([1, 2])
plt.savefig(figures / "forgetting.png", dpi=120)

# %% [markdown]
# ## How it drives
#
# Behind the leader of an event that it never saw, from the first window on.

# %%
unseen = recorded(5.0, 1, seed=3)
columns = unseen[["follower_speed_mps", "leader_speed_mps", "spacing_m"]].to_numpy().T
horizon = model.info().settings["horizon"]
initial = dict(zip(["follower_speed_mps", "leader_speed_mps", "spacing_m"], columns[:, :horizon].tolist(), strict=True))
drive = model.simulate(initial, columns[1, horizon:])
figure, (upper, lower) = plt.subplots(2, 1, sharex=True)
for axis, at, driven, unit in [
    (upper, 2, drive.spacing_m, "spacing, m"),
    (lower, 0, drive.follower_speed_mps, "speed, m/s"),
]:
    axis.plot(unseen["t"], columns[at], label="recorded")
    axis.plot(unseen["t"][horizon:], driven, label=f"version {drive.version}")
    axis.set_ylabel(unit)
upper.legend()
lower.set_xlabel("time, s")
plt.savefig(figures / "trajectories.png", dpi=120)
print(f"root mean square error of the spacing: {np.sqrt(np.mean((drive.spacing_m - columns[2, horizon:]) ** 2)):.2f} m")
