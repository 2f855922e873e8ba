"""The linear loop: the arm without samples, its controllers with them, as one map over their common period."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import cached_property
from math import gcd, lcm
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from .laws import Channel, HeldLaw, RunningLaw, Tap, acted_on, with_names
from .plant import Plant

_MOST_DELAYED = 300  # samples that are under way at once, behind delays
_MOST = 1000  # samples in a common period
_SAME = 1e-9  # parts of a period by which times are the same
Complex = NDArray[np.complex128]


class _Rows:
    """The numbers of a loop as linear functions: rows over its states at the beginning of a period, and over inputs."""

    def __init__(self, sizes: dict[Any, int], inputs: int) -> None:
        self.at: dict[Any, slice] = {}
        first = 0
        for name, size in sizes.items():
            self.at[name] = slice(first, first + size)
            first += size
        self.size = first
        self.S = np.hstack([np.eye(first), np.zeros((first, inputs))])

    def __getitem__(self, name: Any) -> Array:
        return np.asarray(self.S[self.at[name]])

    def __setitem__(self, name: Any, value: Array) -> None:
        self.S[self.at[name]] = value

    def push(self, name: Any, value: Array) -> None:
        """Puts value at the head of a chain."""
        old = self[name]
        self[name] = np.vstack([value, old[: len(old) - len(value)]])

    def entry(self, name: Any, index: int, size: int) -> Array:
        """The value put into a chain `index` values ago."""
        return self[name][index * size : (index + 1) * size].copy()


class Hybrid:
    """A plant with continuous and sampled linear laws. `factors` of its methods multiply each channel's output.

    The continuous part has the plant's states, those of continuous controllers and of sensors' low passes; sampled laws
    read it, and hold their forces until the next, `delay` behind their sample. Samples of all laws begin together.
    """

    def __init__(self, plant: Plant, running: Sequence[RunningLaw], held: Sequence[HeldLaw], memory: int) -> None:
        self.plant, self.held = plant, list(held)
        self._running, self._memory = running, memory
        own = [law for law in running if not law.acts]
        self.laws = [law for law in running if law.acts]
        channels: list[Channel] = []
        for law in self.laws:
            output = sum(c.control == law.control for c in channels)
            at = acted_on(plant.arm, law.column)
            channels.append(Channel(law.control, output, None, law.limit, law.kind, at))
        channels += [
            Channel(x.control, i, x.rate, float(limit), x.kind, acted_on(plant.arm, x.columns[:, i]))
            for x in self.held for i, limit in enumerate(x.limit)
        ]  # fmt: skip
        self.channels = with_names(channels)
        self.nh = sum(x.columns.shape[1] for x in self.held)
        n, nq, nv = plant.A.shape[0], plant.arm.nq, plant.arm.nv
        used = sorted({int(i) for law in running for i in np.flatnonzero(law.by_q[nq:])})
        self._used, self.n0 = used, n + len(used) + memory
        A = np.zeros((self.n0, self.n0))
        A[:n, :n] = plant.A
        first = n + len(used)  # of the controllers' states; before them, the integrals of those that a law reads
        A[n + np.arange(len(used)), first + np.array(used, dtype=int)] = 1.0
        self._columns = np.zeros((self.n0, len(self.laws)))
        for law in own:
            A -= np.outer(self._force_inputs(law.column[:, None])[:, 0], self._row(law))
        for k, law in enumerate(self.laws):
            self._columns[:, k] = self._force_inputs(law.column[:, None])[:, 0]
        self._rows = np.array([self._row(law) for law in self.laws]).reshape(-1, self.n0)
        self._A = A
        forces = np.zeros((nv, 0))
        self._held_inputs = self._force_inputs(forces)
        for x in self.held:
            inputs = self._force_inputs(x.columns if x.enters is None else x.enters)
            self._held_inputs = np.hstack([self._held_inputs, inputs])
        self.taps: list[Tap] = [tap for law in self.held for tap in law.taps]
        self.filters = [tap.filter for tap in self.taps]
        self.n = self.n0 + sum(len(f.matrices()[1]) for f in self.filters if f is not None)

    def _row(self, law: RunningLaw) -> Array:
        nq, nv = self.plant.arm.nq, self.plant.arm.nv
        arm = self.plant.reads(law.by_q[None, :nq], law.by_v[None, :nv])[0]
        return np.concatenate([arm, law.by_q[nq:][self._used], law.by_v[nv:]])

    def _force_inputs(self, columns: Array) -> Array:
        """Columns (nv, m), or with the states of controllers (nv + states, m), of forces as inputs of the states ahead
        of the filters."""
        nv = self.plant.arm.nv
        above, last = self.plant.forces(columns[:nv]), columns[nv:]
        return np.vstack([above, np.zeros((self.n0 - len(above) - len(last), columns.shape[1])), last])

    # -- the continuous part -------------------------------------------------------------------------------------------

    def _continuous(
        self, factors: Array, forces: Array, broken: Sequence[int] = ()
    ) -> tuple[Array, Array, Array, Array]:
        """A, B, rows C and D of the taps: x' = A x + B u, y = C x + D u, with u the held forces, then the outputs of
        `broken` continuous laws, then `forces` (nv, m)."""
        closed = [k for k in range(len(self.laws)) if k not in broken]
        A = self._A - (self._columns[:, closed] * factors[closed]) @ self._rows[closed]
        opened = [k for k in broken if k < len(self.laws)]
        B = np.hstack([self._held_inputs, self._columns[:, opened], self._force_inputs(forces)])
        C, D = self._outputs(A, B, self.taps)
        for j, f in enumerate(self.filters):
            if f is None:
                continue
            (Af, Bf), n = f.matrices(), A.shape[0]
            A = np.block([[A, np.zeros((n, len(Af)))], [np.outer(Bf, C[j]), Af]])
            B = np.vstack([B, np.outer(Bf, D[j])])
            C = np.pad(C, ((0, 0), (0, len(Af))))
            C[j], D[j] = np.eye(A.shape[0])[n], 0.0
        return A, B, C, D

    def _outputs(self, A: Array, B: Array, taps: Sequence[Any]) -> tuple[Array, Array]:
        """Rows by the states and by the inputs of taps with by_q, by_v, by_a."""
        nq, nv, n = self.plant.arm.nq, self.plant.arm.nv, self.plant.A.shape[0]
        by_q = np.array([x.by_q for x in taps]).reshape(-1, nq)
        by_v, by_a = (np.array([getattr(x, name) for x in taps]).reshape(-1, nv) for name in ("by_v", "by_a"))
        C = np.zeros((len(taps), A.shape[0]))
        C[:, :n] = self.plant.reads(by_q, by_v)
        felt = self.plant.feels(by_a)
        return C + felt @ A[:n], felt @ B[:n]

    # -- with samples --------------------------------------------------------------------------------------------------

    @cached_property
    def period(self) -> float | None:
        """The time after which all samples repeat (s); None without sampled laws.

        Raises:
            ValueError: rates without a common period.
        """
        if not self.held:
            return None
        rates = {f"control[{x.control}].rate": x.rate for x in self.held}
        rates |= {f"rate of reading {k} of control[{x.control}]": tap.rate for x in self.held
                  for k, tap in enumerate(x.taps) if tap.rate is not None}  # fmt: skip
        return common_period(rates)

    @cached_property
    def _events(self) -> tuple[list[tuple[float, int, Any]], dict[Any, int], dict[Any, tuple[Any, int]]]:
        """(time, kind, content) over a period, in order: 0, the look of a tap; 1, a law; 2, forces set in. The sizes of
        the chains that keep values for later events; and by (law, sample, tap) the look that it reads and how many
        periods ago that was."""
        P = self.period
        assert P is not None
        events: dict[tuple[float, int, Any], None] = {}
        chains: dict[Any, int] = {}
        reads: dict[Any, tuple[Any, int]] = {}
        first = 0

        def phase(t: float) -> tuple[float, int]:
            lag = -int(np.floor(t / P + _SAME))
            return max(t + lag * P, 0.0), lag

        for j, law in enumerate(self.held):
            late = law.late
            for k in range(round(P * law.rate)):
                t = k / law.rate
                events[(t, 1, (j, k))] = None
                for i, tap in enumerate(law.taps):
                    looked = t if tap.rate is None else np.floor(t * tap.rate + 1e-6) / tap.rate
                    if looked >= t - _SAME * P and not tap.delay:
                        continue
                    at, lag = phase(looked - tap.delay)
                    name = ("look", first + i, round(at / P, 9))
                    events[(at, 0, name)] = None
                    lag -= int(at > t + _SAME * P)
                    reads[j, k, i] = name, lag
                    chains[name] = max(chains.get(name, 0), lag + 1)
                for d, (delay, outputs) in enumerate(late):
                    at, lag = phase(t + delay)
                    lag = -lag  # periods behind the sample's
                    if lag == 0 and at <= t + _SAME * P:
                        continue
                    index = lag - int(t > at + _SAME * P)
                    events[(at, 2, (j, d, k, index))] = None
                    chains["wait", j, d, k] = len(outputs) * (index + 1)
            first += len(law.taps)
        if sum(chains.values()) > max(_MOST_DELAYED, 2 * len(events)):
            raise ValueError(f"delay: {sum(chains.values())} samples are under way; at most {_MOST_DELAYED} can be")
        scale = 1.0 / (_SAME * P)
        return sorted(events, key=lambda e: (round(e[0] * scale), e[1], str(e[2]))), chains, reads

    def _period(
        self, factors: Array, broken: Sequence[int] = (), forces: Array | None = None, outputs: Sequence[Any] = ()
    ) -> tuple[Array, Array, Array, Array, NDArray[np.int_]]:
        """Z, B, C, D over a period: S+ = Z S + B w, y = C S + D w. w: of each of the `broken` channels its output in
        each of its samples, then `forces` (nv, m), held; y: the outputs that those channels compute, negative, then
        `outputs` at the beginning. Last, which of all states S are: those that something later depends on."""
        import scipy.linalg as la  # slow to import

        P = self.period
        assert P is not None
        given = np.zeros((self.plant.arm.nv, 0)) if forces is None else forces
        A, B, taps, direct = self._continuous(factors, given)
        n, nh, m = A.shape[0], self.nh, given.shape[1]
        events, chains, reads = self._events
        offset, held_at, tap_at = len(self.laws), [0], [0]
        for law in self.held:
            held_at.append(held_at[-1] + law.columns.shape[1])
            tap_at.append(tap_at[-1] + len(law.taps))
        late = [[outputs for _, outputs in law.late] for law in self.held]
        counts = [round(P * law.rate) for law in self.held for _ in range(law.columns.shape[1])]
        start = np.concatenate([[0], np.cumsum([counts[c - offset] for c in broken])]).astype(int)
        nw = int(start[-1])
        rows = _Rows({"x": n, "h": nh, **{("law", j): len(x.A) for j, x in enumerate(self.held)}, **chains}, nw + m)
        W = np.hstack([np.zeros((nw + m, rows.size)), np.eye(nw + m)])
        returned = np.zeros((nw, rows.size + nw + m))
        C, D = self._outputs(A, B, outputs)
        said = C @ rows["x"] + D[:, :nh] @ rows["h"] + D[:, nh:] @ W[nw:]
        flows: dict[float, Array] = {}
        now = 0.0

        def flow(span: float) -> None:
            if span <= _SAME * P:
                return
            key = round(span / P, 12)
            if key not in flows:
                whole = np.zeros((n + nh + m,) * 2)
                whole[:n] = np.hstack([A, B])
                flows[key] = la.expm(span * whole)[:n]
            rows["x"] = flows[key] @ np.vstack([rows["x"], rows["h"], W[nw:]])

        def look(tap: int) -> Array:
            return np.asarray(taps[tap] @ rows["x"] + direct[tap, :nh] @ rows["h"] + direct[tap, nh:] @ W[nw:])

        answers: dict[Any, Array] = {}
        for at, group in _grouped(events):
            flow(at - now)
            now = max(now, at)
            for kind, content in group:
                if kind == 0:
                    rows.push(content, look(content[1])[None])
                elif kind == 1:
                    j, k = content
                    law, columns = self.held[j], slice(held_at[j], held_at[j + 1])
                    y = np.array([
                        rows.entry(*reads[j, k, i], 1)[0] if (j, k, i) in reads else look(tap_at[j] + i)
                        for i in range(len(law.taps))
                    ]).reshape(len(law.taps), rows.S.shape[1])  # fmt: skip
                    x = rows["law", j]
                    u = law.C @ x - law.D @ y
                    rows["law", j] = law.A @ x - law.B @ y
                    for i in range(len(u)):
                        c = offset + columns.start + i
                        if c in broken:
                            w = start[list(broken).index(c)] + k
                            returned[w], u[i] = -u[i], W[w]
                        else:
                            u[i] = factors[c] * u[i]
                    for d, outputs in enumerate(late[j]):
                        if ("wait", j, d, k) in chains:
                            rows.push(("wait", j, d, k), u[outputs])
                        else:
                            answers[j, d] = u[outputs]  # all laws look before any force sets in
                else:
                    j, d, k, index = content
                    answers[j, d] = rows.entry(("wait", j, d, k), index, len(late[j][d]))
            for (j, d), u in answers.items():
                h = rows["h"].copy()
                h[[held_at[j] + i for i in late[j][d]]] = u
                rows["h"] = h
            answers.clear()
        flow(P - now)
        size = rows.size
        keep = _needed(rows.S[:, :size], np.vstack([returned, said])[:, :size])
        end, out = rows.S[keep], np.vstack([returned, said])
        return end[:, keep], end[:, size:], out[:, keep], out[:, size:], keep

    # -- models, poles, motions ----------------------------------------------------------------------------------------

    def with_held(self, held: Sequence[HeldLaw]) -> Hybrid:
        """The same with other sampled laws."""
        return Hybrid(self.plant, self._running, held, self._memory)

    def alone(self, control: int) -> Hybrid:
        """With the laws of one controller, and those that are no loop; a sampled one has those without samples beside
        it."""
        held = [x for x in self.held if x.control == control]
        running = [x for x in self._running if held or x.control == control or not x.acts]
        return Hybrid(self.plant, running, held, self._memory)

    def ones(self) -> Array:
        """No change of any output."""
        return np.ones(len(self.channels))

    def model(self, forces: Array, outputs: Sequence[Any], factors: Array | None = None) -> tuple[Array, ...]:
        """A, B, C, D of the closed loop, from forces (nv, m) to outputs; over a period where it has one."""
        f = self.ones() if factors is None else factors
        if self.held:
            return self._period(f, (), forces, outputs)[:4]
        A, B, _, _ = self._continuous(f, forces)
        return A, B, *self._outputs(A, B, outputs)

    def opened(self, broken: Sequence[int]) -> tuple[Array, Array, Array, Array]:
        """A, B, C, D of the loop gain, from outputs of channels to the outputs that they compute, negative; the others
        closed.

        Raises:
            ValueError: continuous and sampled channels mixed.
        """
        sampled = [self.channels[c].rate is not None for c in broken]
        if all(sampled) and self.held:
            return self._period(self.ones(), broken)[:4]
        if any(sampled) or self.held:
            raise ValueError("a continuous loop beside sampled ones has no loop gain")
        A, B, _, _ = self._continuous(self.ones(), np.zeros((self.plant.arm.nv, 0)), broken)
        C = np.zeros((len(broken), A.shape[0]))
        C[:, : self.n0] = self._rows[list(broken)]
        return A, B, C, np.zeros((len(broken), len(broken)))

    def matrix(self, factors: Array | None = None) -> Array:
        """Of x' = A x, or of S+ = Z S over a period."""
        return self.model(np.zeros((self.plant.arm.nv, 0)), (), factors)[0]

    def poles(self, factors: Array | None = None) -> tuple[Complex, Complex | None]:
        """Poles s (1/s), the fastest growing first, and z of each over a period, or None."""
        values = np.linalg.eigvals(self.matrix(factors)).astype(complex)
        if self.period is None:
            return values[_order(values)], None
        s = logarithm(values, self.period)
        order = _order(s)
        return s[order], values[order]

    def motions(self) -> tuple[Complex, Complex]:
        """Poles s (1/s) and the motions of the arm that go with them: small displacements of its rates, (nv, n)."""
        if self.period is None:
            s, X = np.linalg.eig(self.matrix())
            keep = np.arange(len(X))
        else:
            Z, *_, keep = self._period(self.ones())
            z, X = np.linalg.eig(Z)
            s = logarithm(z.astype(complex), self.period)
        arm = keep < self.plant.A.shape[0]
        T = self.plant.T[: self.plant.arm.nv]
        return s.astype(complex), np.asarray((T[:, keep[arm]] @ X[arm]).astype(complex))

    def growth(self, factors: Array | None = None) -> float:
        """Of the fastest growing motion (1/s)."""
        return float(self.poles(factors)[0].real.max(initial=-np.inf))


def _order(s: Complex) -> NDArray[np.int_]:
    return np.lexsort((s.imag, np.abs(s.imag), -np.where(np.isfinite(s.real), np.round(s.real, 9), -1e300)))


def logarithm(z: Complex, period: float) -> Complex:
    """s of z = exp(s period), |Im s| up to pi / period; -inf for z = 0."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.abs(z)) / period + 1j * np.where(z == 0, 0.0, np.angle(z) / period))


def _grouped(events: Iterable[tuple[float, int, Any]]) -> Iterable[tuple[float, list[tuple[int, Any]]]]:
    """Events of one time together."""
    groups: list[tuple[float, list[tuple[int, Any]]]] = []
    for at, kind, content in events:
        if not groups or at - groups[-1][0] > 1e-9 * max(at, 1e-300):
            groups.append((at, []))
        groups[-1][1].append((kind, content))
    return groups


def _needed(Z: Array, C: Array) -> NDArray[np.int_]:
    """The states that something later depends on."""
    keep = np.arange(len(Z))
    while True:
        used = Z[np.ix_(keep, keep)].any(axis=0) | C[:, keep].any(axis=0)
        if used.all():
            return keep
        keep = keep[used]


def common_period(rates: dict[str, float]) -> float:
    """The shortest time (s) in which all of some rates (Hz) have a whole number of samples.

    Raises:
        ValueError: there is none with up to 1000 samples.
    """
    fastest = max(rates.values())
    parts = [Fraction(rate / fastest).limit_denominator(_MOST) for rate in rates.values()]
    if all(abs(float(x) * fastest - rate) <= _SAME * rate for x, rate in zip(parts, rates.values(), strict=True)):
        common = Fraction(gcd(*(x.numerator for x in parts)), lcm(*(x.denominator for x in parts)))
        if 1 / common <= _MOST:
            return float(1 / common) / fastest
    named = ", ".join(f"{name} = {rate:.10g}" for name, rate in rates.items())
    raise ValueError(
        f"{named} (Hz): have no common period of up to {_MOST} samples; give rates with whole ratios, such as 1000 "
        "and 250"
    )
