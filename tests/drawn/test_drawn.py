"""What holds for every scene: a number that is returned is finite, and right by another way; what fails says so in one
kind of error; what a result says of itself is true; what is saved is loaded."""

from __future__ import annotations

import copy
import json
import pickle
import sys
import warnings
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))

from scenes import SEEDS, arm, drawn, note, state

JUNK = [
    None, True, "", "abc", "nan", [], [1], [1, 2, 3], {}, {"type": "x"}, float("nan"), float("inf"), -1, 0, 1e308,
    5e-324, 2**63, 10**400, 1 + 2j, b"abc", object(), set(), "\x00", 400, "exact", np.float32(1.5), np.zeros((0, 3)),
]  # fmt: skip


def built(scene: dict[str, Any]) -> fa.Arm:
    """The arm of a scene; a scene that is refused is no example."""
    try:
        return fa.Arm.from_dict(scene)
    except ValueError:
        assume(False)
        raise


def or_refused(f: Any) -> Any:
    """What f returns, all of it finite, or None where it raises ValueError; nothing else may come out of it."""
    try:
        x = f()
    except ValueError as e:
        assert not isinstance(e, np.linalg.LinAlgError) and "array must not contain" not in str(e)
        note("answers refused")
        return None
    note("answers")
    for part in x if isinstance(x, tuple) else (x,):
        assert np.isfinite(part).all()
    return x


@drawn(40, arm(wild=True), SEEDS, st.sampled_from([1.0, 1.0, 1e-9, 1e5, 1e150]))
def test_finite_or_refused(scene: dict[str, Any], seed: int, size: float) -> None:
    made = built(scene)
    q, v, tau = state(made, seed, size)
    answers = [or_refused(f) for f in (
        lambda: made.forward_dynamics(q, v, tau),
        lambda: made.forward_dynamics(q, v, tau, "ci"),
        lambda: made.inverse_dynamics(q, v, tau),
        lambda: made.mass_matrix(q),
        lambda: made.energy(q, v),
        lambda: made.frame(q),
        lambda: made.jacobian(q),
        lambda: made.jacobian_rate(q, v),
        lambda: made.velocity(q, v),
        lambda: made.acceleration(q, v, tau),
        lambda: made.momentum(q, v),
        lambda: made.joint_reaction(q, v, tau, 0),
        lambda: made.inverse_derivatives(q, v, tau),
        lambda: tuple(made.forward_derivatives(q, v, tau)),
    )]  # fmt: skip
    assume(any(x is not None for x in answers))


@drawn(40, arm(), SEEDS)
def test_one_way_against_another(scene: dict[str, Any], seed: int) -> None:
    """AB, CI and inverse dynamics; kinetic energy and the mass matrix; Jacobians and velocities; a file in between."""
    made = built(json.loads(json.dumps(scene)))
    assert fa.Arm.from_dict(json.loads(json.dumps(made.to_dict()))) == made == pickle.loads(pickle.dumps(made))
    q, v, tau = state(made, seed)
    M, h = made.mass_matrix(q), made.bias(q, v)
    assume(made.nv > 0 and np.diag(M).min() > 0)
    d = 1.0 / np.sqrt(np.diag(M))
    least = float(np.linalg.eigvalsh(d[:, None] * M * d)[0])
    assume(least > 1e-6)  # an order-0 mass matrix may not be positive
    ab, ci = made.forward_dynamics(q, v, tau), made.forward_dynamics(q, v, tau, "ci")
    size = float(np.linalg.norm(d * (np.abs(h) + np.abs(tau)))) + float(np.linalg.norm(ab / d))
    assert np.linalg.norm(d * (M @ ab + h - tau)) < 1e-9 * size / least**0.5
    assert np.linalg.norm((ab - ci) / d) < 1e-10 * size / least
    assert np.linalg.norm(d * (made.inverse_dynamics(q, v, ab) - tau)) < 1e-9 * size / least**0.5
    assert made.energy(q, v)[0] == pytest.approx(0.5 * v @ M @ v, abs=1e-9 * np.abs(v) @ np.abs(M) @ np.abs(v))
    J = made.jacobian(q)
    np.testing.assert_allclose(J @ v, made.velocity(q, v), rtol=1e-9, atol=1e-9 * (np.abs(J) @ np.abs(v)).max())


def in_reach(r: fa.Result) -> bool:
    """Whether no beam has run away."""
    return all(
        bool((np.linalg.norm(r.tip_deflection(k), axis=-1) < 100 * link.beam.length).all())
        for k, link in enumerate(r.arm.links)
        if link.beam is not None
    )


# "gauss" tells what slides by its looks within a step: a joint that chatters between these may have the friction of the
# other way in a row, and did with steps of 2e-3
INTEGRATORS = st.sampled_from(
    [("ida", {}), ("implicit", {"step": 1e-3}), ("gauss", {"step": 2e-4}), ("rk4", {"step": 2e-4})]
)


@drawn(24, arm(most=2), SEEDS, INTEGRATORS, st.sampled_from([0.0, 1.0, 30.0]))
def test_a_run_keeps_its_word(
    tmp_path_factory: pytest.TempPathFactory, scene: dict[str, Any], seed: int, how: tuple[str, Any], size: float
) -> None:
    """Every row finite, or an error that holds the rows until then; friction within stiction, and against the motion;
    beams within reach, or a warning that they left their order's range (shear at order 2 and bending at order 3, pulled
    far out of it, have led 10 and 120 lengths away; all integrators agree); what is saved is what is loaded."""
    made = built(scene)
    assume(made.nv > 0)
    q, v, tau = state(made, seed, size)
    name, options = how
    t = np.linspace(0.0, 0.02, 5)
    left_range = False
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            r = fa.simulate(made, t, q, v, tau=tau, integrator=name, **options)
        assert len(r.t) == len(t)
        note("to the end")
    except fa.SimulationError as e:
        r = e.result
        left_range = "at order" in str(e)  # an error tells it in its text
        assert np.isfinite(e.time) and str(pickle.loads(pickle.dumps(e))) == str(e)
    except ValueError:
        assume(False)
    for x in (r.q, r.v, r.a, r.tau):
        assert len(x) == len(r.t) and np.isfinite(x).all()
    left_range = left_range or any(issubclass(w.category, fa.errors.RangeWarning) for w in said)
    assert in_reach(r) or left_range
    if r.friction is not None:
        most, slides = np.zeros(made.nv), np.zeros(made.nv)
        for k, link in enumerate(made.links):
            if link.joint.nv and np.any(link.joint.coulomb):
                most[made.joint_rates(k)] = link.joint.stiction
                slides[made.joint_rates(k)] = link.joint.coulomb
        assert (np.abs(r.friction) <= most * (1 + 1e-6) + 1e-12).all()
        moving = np.abs(r.v) > 1e-6
        assert (r.friction * np.sign(r.v) <= 1e-9)[moving].all()
        assert (np.abs(r.friction) <= slides * (1 + 1e-6) + 1e-12)[moving].all()
    path = tmp_path_factory.mktemp("run") / "run.npz"
    if len(r.t):
        r.save(path)
        again = fa.Result.load(path)
        for field in ("t", "q", "v", "a", "tau"):
            np.testing.assert_array_equal(getattr(again, field), getattr(r, field))


@drawn(16, arm(most=2), SEEDS)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_rollout_keeps_its_word(scene: dict[str, Any], seed: int) -> None:
    """Scenarios side by side: each finite to its end or to its failure, NaN after it, and the same bits beside
    others. (So few that they go one by one differ by rounding.)"""
    made = built(scene)
    assume(made.nv > 0)
    rng = np.random.default_rng(seed)
    B, n = 5, 12
    starts = [state(made, seed + k, float(rng.choice([0.0, 1.0, 10.0])))[:2] for k in range(B)]
    q0, v0 = (np.array([s[i] for s in starts]) for i in (0, 1))
    tau = rng.normal(size=(B, n, made.nv))
    try:
        runs = fa.rollout(made, q0, v0, tau, step=2e-3)
    except ValueError:
        assume(False)
    failed = {f.index for f in runs.failures}
    for k in range(B):
        rows = np.isfinite(runs.q[k]).all(axis=-1)
        done = int(rows.sum())
        assert rows[:done].all() and not rows[done:].any()  # then NaN, to the end
        assert (done == n + 1) == (k not in failed)
        np.testing.assert_array_equal(np.isfinite(runs.v[k]).all(axis=-1), rows)
    fewer = fa.rollout(made, q0[1:], v0[1:], tau[1:], step=2e-3)
    np.testing.assert_array_equal(fewer.q[1], runs.q[2])


def places(x: Any, found: list[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    """Every entry of a nested structure, as (container, key)."""
    for key, value in list(x.items()) if isinstance(x, dict) else list(enumerate(x)):
        found.append((x, key))
        if isinstance(value, (dict, list)):
            places(value, found)
    return found


@drawn(60, arm(), SEEDS)
def test_one_thing_wrong_is_one_kind_of_error(scene: dict[str, Any], seed: int) -> None:
    """A value of another type, a bad number, a key too many or too few: an arm, or ValueError; nothing else."""
    rng = np.random.default_rng(seed)
    scene = copy.deepcopy(scene)
    all_places = places(scene, [])
    box, key = all_places[rng.integers(len(all_places))]
    kind = rng.integers(4)
    if kind == 0 and isinstance(box, dict):
        del box[key]
    elif kind == 1 and isinstance(box, dict):
        box[f"{key}x"] = box.pop(key)
    else:
        box[key] = JUNK[rng.integers(len(JUNK))]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            made = fa.Arm.from_dict(scene)
    except ValueError as e:
        assert str(e)
        note("refused in words")
    else:
        or_refused(lambda: made.mass_matrix(made.zero))


@drawn(40, SEEDS)
def test_damaged_files_are_named(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    """Bytes of a saved run flipped or cut off: the same run, or ValueError with the file's name."""
    rng = np.random.default_rng(seed)
    folder = tmp_path_factory.mktemp("damage")
    r = fa.simulate(
        fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1)))]), [0, 0.1, 0.2], [0.3], [0.1]
    )
    r.save(folder / "run.npz")
    data = bytearray((folder / "run.npz").read_bytes())
    if rng.random() < 0.3:
        data = data[: rng.integers(len(data))]
    else:
        for at in rng.integers(len(data), size=rng.integers(1, 8)):
            data[at] ^= 1 << int(rng.integers(8))
    (folder / "run.npz").write_bytes(bytes(data))
    try:
        again = fa.Result.load(folder / "run.npz")
    except ValueError as e:
        assert "run.npz" in str(e)
        note("found damaged")
    else:
        np.testing.assert_array_equal(again.q, r.q)
