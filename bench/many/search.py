"""A search without gradients for feedback gains, in the vectorised environment.

    python bench/many/search.py [-o DIR] [--generations 6] [--candidates 24]

The task is flexarm.tasks.VibrationSuppression with a tip mass drawn from 10 to 60 g for every episode: u is linear in
what is observed, u = -(k1 angle + k2 rate + k3 curvature + k4 its rate), and the cross-entropy method seeks k for the
greatest mean reward: once with the joint alone (k1, k2: PD), once with the strain gauge too. All candidates of a
generation run at once, each on the same eight starts and masses, others in each generation; the best are then tried on
64 starts that the search has not seen. Also measured: environment steps a second.
Writes search.csv and search.png into DIR (default: here).
"""

from __future__ import annotations

import argparse
import csv
import platform
import time
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from flexarm.env import FlexarmVectorEnv

matplotlib.use("Agg")
import matplotlib.pyplot as plt

BLUE, ORANGE, GREY = "#0072B2", "#D55E00", "#888888"
TASK, MASSES = "vibration-suppression", {"link.0.tip.mass": (0.01, 0.06)}
#: a natural size of each gain, in units of the greatest torque: per rad, rad/s, 1/m, 1/m/s
SIZE = np.array([4.0, 1.0, 0.5, 0.02])
ROUNDS = 8  # starts of each candidate
KINDS = {"joint alone": 2, "joint and strain": 4}


def returns(gains: np.ndarray, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Of gains (candidates, 4), over starts of seeds first .. first + count - 1: the mean reward a step, and the root
    mean square distance of the arm's end from its place in the second half of the episode (mm); (candidates,) each."""
    envs = FlexarmVectorEnv(len(gains) * count, TASK, randomize=MASSES, autoreset_mode="Disabled")
    observed, _ = envs.reset(seed=[first + k for k in range(count)] * len(gains))
    home, off = envs.task.arm.frame(envs.task.arm.zero)[0], np.zeros(envs.num_envs)
    K, total, alive = np.repeat(gains, count, axis=0), np.zeros(envs.num_envs), np.ones(envs.num_envs, bool)
    for k in range(envs.task.horizon):
        observed, reward, terminated, _, _ = envs.step(-np.clip((K * observed).sum(axis=1, keepdims=True), -1, 1))
        total += np.where(alive, reward, -1.0)
        alive &= ~terminated
        if 2 * k >= envs.task.horizon:
            off += 2 / envs.task.horizon * ((envs.state.end - home) ** 2).sum(axis=1)
    mean, square = (x.reshape(len(gains), count).mean(axis=1) for x in (total, off))
    return mean / envs.task.horizon, 1e3 * np.sqrt(square)


def search(free: int, generations: int, candidates: int) -> tuple[np.ndarray, list[float]]:
    """The cross-entropy method over the first `free` gains: those found, and the elite's mean of each generation."""
    rng = np.random.default_rng(0)
    mean, spread, kept = np.zeros(4), np.where(np.arange(4) < free, 1.0, 0.0), []
    for n in range(generations):
        tried = mean + spread * rng.standard_normal((candidates, 4))
        found, _ = returns(tried * SIZE, 1000 * (n + 1), ROUNDS)
        best = np.argsort(found)[-candidates // 5 :]
        mean, spread = tried[best].mean(axis=0), tried[best].std(axis=0) + 0.02 * (np.arange(4) < free)
        kept.append(float(found[best].mean()))
    return mean * SIZE, kept


def trace(gains: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of one start, 30 g at the tip: times (s) and how far the arm's end is from its place (mm)."""
    envs = FlexarmVectorEnv(1, TASK)
    observed, _ = envs.reset(seed=4)
    home, off = envs.task.arm.frame(envs.task.arm.zero)[0], []
    for _ in range(envs.task.horizon):
        off.append(1e3 * float(np.linalg.norm(envs.state.end[0] - home)))
        observed, *_ = envs.step(-np.clip((gains * observed).sum(axis=1, keepdims=True), -1, 1))
    return envs.task.period * np.arange(len(off)), np.array(off)


def speed(task: str, count: int) -> float:
    """Environment steps a second, of random actions, on all cores."""
    envs = FlexarmVectorEnv(count, task)
    envs.reset(seed=0)
    actions = [envs.action_space.sample() for _ in range(4)]
    steps = max(20, 4000 // count)
    best = np.inf
    for _ in range(3):
        begin = time.perf_counter()
        for k in range(steps):
            envs.step(actions[k % 4])
        best = min(best, (time.perf_counter() - begin) / steps)
    return count / best


def draw(found: dict[str, Any], path: Path) -> None:
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    for (name, (gains, kept, unseen)), colour in zip(found.items(), (ORANGE, BLUE), strict=True):
        left.plot(np.arange(1, len(kept) + 1), kept, "o-", color=colour, label=f"{name}; unseen starts {unseen:.3f}")
        t, off = trace(gains)
        right.plot(t, off, color=colour, label=name)
    t, off = trace(np.zeros(4))
    right.plot(t, off, color=GREY, linewidth=1, label="no action", zorder=0)
    left.set(xlabel="generation", ylabel="mean reward a step of the best fifth")
    right.set(xlabel="time (s)", ylabel="arm's end from its place (mm)", yscale="log", ylim=(0.01, 300))
    for ax in (left, right):
        ax.grid(True, color="#DDDDDD", linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
        ax.legend(frameon=False)
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", dest="folder", type=Path, default=Path())
    parser.add_argument("--generations", type=int, default=6)
    parser.add_argument("--candidates", type=int, default=24)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    rows: list[tuple[str, str]] = []
    found = {}

    def score(name: str, gains: np.ndarray) -> float:
        reward, off = (float(x[0]) for x in returns(gains[None], 500_000, 64))
        rows.append((f"{name}: reward a step, 64 unseen starts", f"{reward:.4f}"))
        rows.append((f"{name}: rms distance in the second half (mm)", f"{off:.3g}"))
        return reward

    for name, free in KINDS.items():
        begin = time.perf_counter()
        gains, kept = search(free, given.generations, given.candidates)
        took = time.perf_counter() - begin
        unseen = score(name, gains)
        found[name] = (gains, kept, unseen)
        rows.append((f"{name}: search (s)", f"{took:.1f}"))
        rows.append((f"{name}: gains", " ".join(f"{g:.4g}" for g in gains)))
    score("no action", np.zeros(4))
    for task in ("vibration-suppression", "tip-tracking"):
        rows += [(f"{task}: environment steps a second, {n} at once", f"{speed(task, n):.0f}") for n in (1, 16, 256)]
    with (given.folder / "search.csv").open("w", newline="", encoding="utf-8") as f:
        csv.writer(f, lineterminator="\n").writerows([("quantity", "found"), *rows])
    draw(found, given.folder / "search.png")
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")
    for quantity, value in rows:
        print(f"{quantity:62s} {value}")


if __name__ == "__main__":
    main()
