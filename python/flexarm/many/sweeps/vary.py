"""The parameters of a sweep: grids, lists, random draws, Latin hypercubes, and their combinations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from ..._check import (
    Array,
    array,
    at_least,
    between,
    choice,
    flag,
    instance,
    known_keys,
    number,
    path_of,
    whole,
    within,
)
from ...run.scene.scene import SCENES, shallow, tomllib
from .quantities import QUANTITIES, quantity

#: of a [[vary]] block; the last two are drawn
KINDS = ("grid", "list", "random", "latin_hypercube")
DISTRIBUTIONS = ("uniform", "loguniform", "normal", "lognormal")
_SPACED = ("from", "to", "count", "scale")
_MOST = 100_000_000  # scenarios


def _spaced(where: str, table: Mapping[str, Any]) -> Array:
    """{from, to, count, scale}: equal steps, or equal ratios."""
    known_keys(where, table, _SPACED)
    missing = [k for k in _SPACED[:3] if k not in table]
    if missing:
        raise ValueError(f"{where}: missing {', '.join(missing)}; such as {{ from = 0.1, to = 0.5, count = 5 }}")
    a, b = (float(array(f"{where}.{k}", number(f"{where}.{k}", table[k]))) for k in ("from", "to"))
    count = within(f"{where}.count", whole(f"{where}.count", table["count"]), 1, _MOST)
    if choice(f"{where}.scale", table.get("scale", "linear"), ("linear", "log")) == "linear":
        return np.linspace(a, b, count)
    if not (a > 0 and b > 0):
        raise ValueError(f"{where}.from = {a}, to = {b}: must be positive where scale is log")
    return np.asarray(np.geomspace(a, b, count))


def _listed(where: str, value: Any) -> Array:
    """A list of numbers (n,), or of vectors (n, k)."""
    if isinstance(value, Mapping):
        return _spaced(where, value)
    values = array(where, value)
    if values.ndim not in (1, 2) or not len(values):
        raise ValueError(f"{where} has shape {values.shape}: must be a list of numbers, or of equally long lists")
    return values


def _distribution(where: str, table: Any) -> Any:
    """A frozen scipy.stats distribution of {uniform = [a, b]} and the like."""
    from scipy import stats

    if hasattr(table, "ppf"):  # one of scipy.stats itself, from Python
        return table
    known_keys(where, table, DISTRIBUTIONS)
    if len(table) != 1:
        raise ValueError(f"{where} = {table!r}: must name one distribution: {', '.join(DISTRIBUTIONS)}")
    (name, numbers), *_ = table.items()
    a, b = array(f"{where}.{name}", numbers, (2,)).tolist()
    if name in ("uniform", "loguniform"):
        if not a < b or (name == "loguniform" and not a > 0):
            want = "low < high" if name == "uniform" else "0 < low < high"
            raise ValueError(f"{where}.{name} = [{a}, {b}]: must be [low, high] with {want}")
        return stats.uniform(a, b - a) if name == "uniform" else stats.loguniform(a, b)
    if not b > 0 or (name == "lognormal" and not a > 0):
        want = "mean, deviation" if name == "normal" else "median, deviation of the logarithm"
        raise ValueError(f"{where}.{name} = [{a}, {b}]: must be [{want}], with a positive deviation")
    return stats.norm(a, b) if name == "normal" else stats.lognorm(b, scale=a)


@dataclass(frozen=True)
class Vary:
    """One block of a sweep: parameters that vary together.

    Args:
        kind: "grid": every combination of the values; "list": the first values of all, then the second, ...;
            "random": independent draws; "latin_hypercube": draws in which each parameter is spread evenly over its
            distribution (scipy.stats.qmc).
        values: by path (as `simulate_batch(parameters=)` has them). Of grid and list: numbers, vectors, or
            {from, to, count, scale = "linear" or "log"}. Of the drawn kinds: one of {uniform = [low, high]},
            {loguniform = [low, high]}, {normal = [mean, deviation]}, {lognormal = [median, deviation of the
            logarithm]}, or from Python a frozen distribution of scipy.stats.
        count, seed: of the drawn kinds: number of draws, and seed of the random numbers. Blocks of one sweep are drawn
            independently, whether their seeds differ or not.
    """

    kind: str
    values: Mapping[str, Any]
    count: int | None = None
    seed: int = 0
    where: str = field(default="vary", repr=False, compare=False)

    def __post_init__(self) -> None:
        choice(f"{self.where}.kind", self.kind, KINDS)
        if not isinstance(self.values, Mapping) or not self.values:
            raise ValueError(f"{self.where}.values = {self.values!r}: must be a table of at least one parameter")
        if self.drawn and self.count is None:
            raise ValueError(f"{self.where}.count: a {self.kind} block needs it, such as count = 100")
        if not self.drawn and self.count is not None:
            raise ValueError(f"{self.where}.count = {self.count}: a {self.kind} block has as many as its values say")
        if self.drawn:
            within(f"{self.where}.count", whole(f"{self.where}.count", self.count), 1, _MOST)
        at_least(f"{self.where}.seed", self.seed, 0)

    @property
    def drawn(self) -> bool:
        """Whether its values are drawn."""
        return self.kind in KINDS[2:]

    def parameters(self, before: int = 0) -> dict[str, Array]:
        """The value of each parameter in each of this block's scenarios, (n,) or (n, k).

        Args:
            before: drawn blocks of the same seed before this one in its sweep; draws of each number are independent.
        """
        at = {path: f"{self.where}.values.{path!r}" for path in self.values}
        if self.drawn:
            return self._draws(before, {path: _distribution(at[path], v) for path, v in self.values.items()})
        listed = {path: _listed(at[path], v) for path, v in self.values.items()}
        if self.kind == "list":
            _equal(f"{self.where}: a list block", {k: len(v) for k, v in listed.items()})
            return listed
        return _product([{path: v} for path, v in listed.items()])

    def _draws(self, before: int, laws: Mapping[str, Any]) -> dict[str, Array]:
        assert self.count is not None
        rng = np.random.default_rng([self.seed, before] if before else self.seed)
        if self.kind == "random":
            u = rng.random((self.count, len(laws)))
        else:
            from scipy.stats import qmc

            u = qmc.LatinHypercube(d=len(laws), seed=rng).random(self.count)
        return {path: np.asarray(law.ppf(u[:, k]), dtype=float) for k, (path, law) in enumerate(laws.items())}


def _equal(field_name: str, sizes: Mapping[str, int]) -> None:
    if len(set(sizes.values())) > 1:
        raise ValueError(
            f"{field_name} needs as many values of each; there are {', '.join(f'{v} of {k}' for k, v in sizes.items())}"
        )


def _product(blocks: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """All combinations; the last block varies fastest."""
    sizes = [len(next(iter(b.values()))) for b in blocks]
    total = int(np.prod([float(n) for n in sizes]))
    if total > _MOST:
        raise ValueError(f"this sweep has {total:.3g} scenarios: at most {_MOST} are possible")
    index = np.unravel_index(np.arange(total), sizes)
    return {path: v[i] for b, i in zip(blocks, index, strict=True) for path, v in b.items()}


@dataclass(frozen=True)
class SweepPlan:
    """A sweep: parameters that vary, and quantities of each run.

    Args:
        vary: blocks of parameters.
        combine: "product": every scenario of a block with every one of the others, the last fastest; "zip": the first
            of all, then the second, ...
        outputs: quantities of each run: names of docs/sweeps.md, or functions of a Result
            that give one number.
        link: the link whose beam is observed; -1 is the last.
        band: of "settling": the part of the whole way.
        trajectories: whether q and v are stored, too; every: of which output times.
        title: of tables and figures.
    """

    vary: Sequence[Vary]
    combine: str = "product"
    outputs: Sequence[str | Callable[[Any], float]] = ("tip_deflection", "settling", "strain")
    link: int | str = -1
    band: float = 0.02
    trajectories: bool = False
    every: int = 1
    title: str = "sweep"

    def __post_init__(self) -> None:
        choice("combine", self.combine, ("product", "zip"))
        if isinstance(self.outputs, str) or not self.outputs:
            raise ValueError(f"outputs = {self.outputs!r}: must be a list of names: {', '.join(QUANTITIES)}")
        for output in self.outputs:
            quantity(output)
        if not self.vary:
            raise ValueError("vary: a sweep needs at least one block")
        between("band", self.band, 0, 1)
        at_least("every", self.every, 1)
        flag("trajectories", self.trajectories)
        instance("title", self.title, str, "text")
        paths = [path for v in self.vary for path in v.values]
        twice = {p for p in paths if paths.count(p) > 1}
        if twice:
            raise ValueError(f"vary: {sorted(twice)[0]!r} is varied twice")

    def parameters(self) -> dict[str, Array]:
        """By path, the value in each scenario: (B,) or (B, k)."""
        seeds = [v.seed if v.drawn else None for v in self.vary]
        blocks = [v.parameters(seeds[:k].count(v.seed)) for k, v in enumerate(self.vary)]
        if self.combine == "product":
            return _product(blocks)
        sizes = {f"vary[{k}]": len(next(iter(b.values()))) for k, b in enumerate(blocks)}
        _equal('combine = "zip"', sizes)
        return {path: v for b in blocks for path, v in b.items()}

    def grid(self) -> dict[str, Array] | None:
        """The axes, where the sweep is one grid of numbers; else None."""
        if len(self.vary) != 1 or self.vary[0].kind != "grid":
            return None
        axes = {path: _listed(path, v) for path, v in self.vary[0].values.items()}
        return axes if all(v.ndim == 1 for v in axes.values()) else None

    @classmethod
    def load(cls, path: str | Path) -> SweepPlan:
        """Reads a sweep file (TOML); see docs/sweeps.md. A bare name such as "ist" means a sweep shipped with flexarm.

        Args:
            path: of the sweep file.

        Raises:
            ValueError: unreadable file, bad TOML, unknown key (the nearest known one is named) or bad value.
        """
        p = path_of("sweep", path)
        try:
            if not p.exists() and p.parent == Path() and (SCENES / "sweeps" / f"{p.name}.toml").exists():
                p = SCENES / "sweeps" / f"{p.name}.toml"
            with p.open("rb") as f, shallow("sweep"):
                return sweep_from_dict(tomllib.load(f), p.stem)
        except OSError as e:
            raise ValueError(f"sweep {str(path)!r}: {e.strerror}") from None
        except ValueError as e:
            raise ValueError(f"sweep {str(path)!r}: {e}") from None


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Paths written as TOML tables (link.0.tip.mass = ...), joined by dots; tables of values stay as they are."""
    out: dict[str, Any] = {}
    for key, value in table.items():
        leaf = not isinstance(value, Mapping) or any(k in value for k in ("from", "to", *DISTRIBUTIONS))
        out.update({prefix + key: value} if leaf else _flat(value, f"{prefix}{key}."))
    return out


def sweep_from_dict(d: Mapping[str, Any], name: str = "sweep") -> SweepPlan:
    """A SweepPlan from the structure of a sweep file."""
    known_keys("sweep", d, [f.name for f in fields(SweepPlan)])
    blocks = d.get("vary")
    if not isinstance(blocks, (list, tuple)) or not blocks:
        raise ValueError(f"vary = {blocks!r}: must be a list of at least one table ([[vary]])")
    found = []
    for k, block in enumerate(blocks):
        where = f"vary[{k}]"
        known_keys(where, block, ("kind", "values", "count", "seed"))
        values = block.get("values")
        given = {"kind": "grid", **block, "values": _flat(values) if isinstance(values, Mapping) else values}
        found.append(Vary(**given, where=where))
    return SweepPlan(**{"title": name, **d, "vary": found})
