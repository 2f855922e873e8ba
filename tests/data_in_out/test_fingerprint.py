"""What a file knows its batch by: numbers, arrays and flexarm's objects by their values, a user's code by its name."""

import array
import collections
import functools
import math
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

import flexarm as fa
import numpy as np
import pandas as pd
import pytest
import scipy.interpolate as si
from arms import SCENES
from flexarm.data.store.fingerprint import difference, marks
from messages import refuses


def mark(value, name=None):
    return marks({"law": value}, name)["law"]


def closure(a):
    return lambda t: a * t


def keyword(a):
    def f(t, *, gain=a):
        return gain * t

    return f


def recursive(a):
    def f(t):
        return a * t if t < 1 else f(t - 1)

    return f


def product(a, b):
    return a * b


class Law:
    def __init__(self, a):
        self.a = a

    def __call__(self, t):
        return self.a * t

    def method(self, t):
        return self.a + t


@dataclass
class Point:
    x: float
    y: float = 1.0

    def __call__(self, t):
        return self.x * t


class OwnPD(fa.PD):
    pass


@dataclass(slots=True)
class Slots:
    x: float


Named = collections.namedtuple("Named", "x")


class Table(dict):
    def __call__(self, t):
        return self["x"] * t


class Gain(float):
    __call__ = float.__mul__


def event(a):
    def f(t, q, v):
        return q[0]

    f.direction = a
    return f


def directed(a):
    f = functools.partial(product, 1.0)
    f.direction = a
    return f


def local(a):
    class Of:
        def __call__(self, t):
            return a * t

    return Of()


def gains(a):
    class Of:
        gain = a

    return Of()


def properties(a):
    class Of:
        __slots__ = ()

        @property
        def gain(self):
            return a

    return Of()


X = np.arange(5.0)


VALUES = [
    lambda a: a, lambda a: np.float32(a), lambda a: np.array([a]), lambda a: {"x": [a]}, lambda a: {(a, 1)},
    lambda a: range(int(a)), lambda a: np.array([a, None], dtype=object), lambda a: np.full((int(a), 2), 1.0).T,
    lambda a: fa.Motion([0, 1, 2], [0, a, 0]), lambda a: fa.PD(a, 1), lambda a: fa.Torque(1.0).scaled(a),
    lambda a: fa.LinearController.pid(a, 1, 0, rate=100.0), lambda a: fa.Load(force=(a, 0, 0)),
    lambda a: fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=a))]), lambda a: fa.Torque(0.01 * a),
    lambda a: fa.StrainFeedback(a, 0.05, 0.01, 1, washout=20.0),
]  # fmt: skip
CODE = [
    closure, keyword, recursive, Law, Point, lambda a: Law(a).method, lambda a: functools.partial(product, a),
    lambda a: {"events": [closure(a)]}, lambda a: closure(np.array([a])), lambda a: closure(Law(a)),
    lambda a: fa.Torque(closure(a)), lambda a: fa.Load(force=closure(a)), lambda a: fa.PD(1, 1, reference=closure(a)),
    lambda a: fa.Torque(closure(1)).scaled(a), lambda a: fa.Sampled(closure(a), 100.0), lambda a: OwnPD(a, 1),
    Slots, Named, lambda a: Table(x=a), Gain, event, directed, local, gains, properties,
    lambda a: collections.deque([a]), lambda a: array.array("d", [a]), lambda a: (a * X).dot,
    lambda a: np.random.default_rng(int(a)).normal,
    lambda a: functools.lru_cache(closure(a)), lambda a: functools.wraps(product)(closure(a)),
    lambda a: np.vectorize(closure(a)), lambda a: np.ma.MaskedArray([1.0, 2.0], mask=[False, a > 1]),
    lambda a: np.poly1d([a, 1]), lambda a: eval("lambda a: lambda t: a * t", {})(a), lambda a: closure(a).__call__,
    lambda a: pd.Series([1.0, 2.0], index=[0.0, a]), lambda a: pd.DataFrame({"x": [a]}),
    lambda a: fa.Torque(si.CubicSpline(X, a * X)), lambda a: si.PchipInterpolator(X, a * X),
    lambda a: si.Akima1DInterpolator(X, a * X), lambda a: si.interp1d(X, a * X),
    lambda a: si.make_interp_spline(X, a * X),
]  # fmt: skip


@pytest.mark.parametrize("way", VALUES, ids=range(len(VALUES)))
def test_the_same_values_are_the_same_and_others_others(way):
    assert mark(way(1.0)) == mark(way(1.0))
    assert mark(way(1.0)) != mark(way(2.0))


@pytest.mark.parametrize("way", CODE, ids=range(len(CODE)))
def test_code_needs_a_name_and_its_numbers_count_beside_it(way):
    with refuses("name='law 1'", "code"):
        mark(way(1.0))
    assert mark(way(1.0), "A") == mark(way(1.0), "A")
    assert mark(way(1.0), "A") != mark(way(2.0), "A")


def test_kinds_and_shapes_of_numbers_count():
    values = [1, 1.0, True, "1", None, -0.0, 0.0, np.float32(1), np.ones(1), np.ones((1, 1)), [1], (1,), np.nan, 1j]
    assert len({mark(x) for x in values}) == len(values)
    assert mark(np.float64(2)) == mark(2.0) and mark(np.nan) == mark(np.nan)


def test_another_name_is_another_batch():
    assert marks({"law": closure(1)}, "A") != marks({"law": closure(1)}, "B")
    for bad in ("", 3):
        with refuses(f"name = {bad!r}"):
            marks({}, bad)


@pytest.mark.parametrize("law", [math.sin, np.sin, len, print, np.random.default_rng(0), Path("x").exists, Law, open])
def test_what_is_compiled_or_has_a_state_needs_a_name(law):
    with refuses("name="):
        mark(law)
    assert mark(law, "A") == mark(law, "A")


def test_a_generator_counts_by_its_state():
    rng = np.random.default_rng(0)
    before = mark(lambda t: rng.normal() * t, "A")
    assert mark(rng, "A") == mark(np.random.default_rng(0), "A")
    rng.normal()
    assert mark(lambda t: rng.normal() * t, "A") != before


def test_functions_that_all_call_each_other():
    """There are 20! ways through them."""
    calls = ", ".join(f"f{k}" for k in range(20))
    code = "\n".join(f" def f{k}(t): return a, {calls}" for k in range(20))
    held = {}
    exec(f"def make(a):\n{code}\n return f0", held)
    assert mark(held["make"](1.0), "A") == mark(held["make"](1.0), "A") != mark(held["make"](2.0), "A")


def test_a_net_of_torch_counts_by_its_weights():
    nn = pytest.importorskip("torch.nn")
    one, other = nn.Linear(2, 1), nn.Linear(2, 1)
    assert mark(one, "A") != mark(other, "A")
    other.load_state_dict(one.state_dict())
    assert mark(one, "A") == mark(other, "A")


def test_a_law_that_was_used_is_the_same():
    law = si.CubicSpline(X, X)
    before = mark(law, "A")
    law(0.5)
    assert mark(law, "A") == before


@pytest.mark.parametrize(
    ("law", "kind"),
    [
        (threading.Lock(), "_thread.lock"), ((x for x in X), "builtins.generator"), ({}.keys(), "builtins.dict_keys"),
        (np.frompyfunc(product, 2, 1), "numpy.ufunc"), (Law(threading.Lock()), "_thread.lock"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_by_its_name(law, kind):
    with refuses("law", kind, "state"):
        mark(law, "A")


def test_an_open_file_is_left_out_by_getstate(tmp_path):
    class Logs(Law):
        def __getstate__(self):
            return {"a": self.a}

    with (tmp_path / "log").open("w") as f:
        one, other, kept = Law(1), Logs(1), mark(Logs(1), "A")
        one.log = other.log = f
        with refuses("law", "_io.TextIOWrapper", "state"):
            mark(one, "A")
        assert mark(other, "A") == kept != mark(Logs(2), "A")


def test_a_module_in_a_closure_counts_by_its_name():
    def law(module):
        return lambda t: module.sin(t)

    assert mark(law(np), "A") == mark(law(np), "A") != mark(law(math), "A")


def test_values_kept_for_speed_do_not_count():
    arm = fa.load("ist").arm
    before = mark(arm)
    arm.forward_dynamics(arm.zero, np.zeros(arm.nv))
    fa.simulate(arm, [0, 1e-3])
    assert mark(arm) == before


def test_laws_of_scenes_are_compared_without_a_name_here_and_in_another_process():
    code, here = "import data_in_out.test_fingerprint as t; print(t.scenes())", Path(__file__).parents[1]
    found = scenes()
    run = subprocess.run([sys.executable, "-O", "-c", code], cwd=here, capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    assert eval(run.stdout) == found and len(set(found)) == len(found)


def scenes():
    """The marks of what the shipped scenes are made of."""
    every = [fa.load(path.stem) for path in sorted(SCENES.glob("*.toml"))]
    return [mark({"arm": s.arm, "drive": s.drive, "loads": s.loads, "control": s.control, "t": s.t}) for s in every]


def test_flexarms_version_belongs_to_it_and_what_differs_is_said():
    one = marks({"drive 0": 1.0, "t": 2})
    assert one["flexarm"] == fa.__version__
    assert difference(one, marks({"drive 0": 2.0, "t": 2})) == "with another drive 0"
    assert "of flexarm 0.0.1, this is" in difference({**one, "flexarm": "0.0.1"}, one)


def test_a_batch_with_a_function_and_a_file_has_a_name(tmp_path):
    arm, t = fa.load("ist").arm, np.linspace(0, 0.02, 5)

    def run(w, **more):
        law = fa.Torque(lambda t: np.sin(w * t))
        return fa.simulate_batch(arm, t, np.zeros((8, arm.nq)), drive={0: law}, **more)

    path = tmp_path / "g.h5"
    with refuses("drive 0", "name='law 1'", "code"):
        run(20.0, out=path)
    assert not path.exists() and not run(20.0).status.any()  # in memory there is nothing to continue
    run(20.0, out=path, name="sine")
    assert run(20.0, out=path, name="sine").stats["resumed"] == 8
    with refuses("another batch", "drive 0"):
        run(2.0, out=path, name="sine")
    with refuses("another batch", "another name"):
        run(20.0, out=path, name="sine 2")
    assert run(2.0, out=path, name="sine", resume=False).stats["resumed"] == 0
