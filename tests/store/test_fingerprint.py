"""What a file of a batch knows its batch by: what a callable reads and calls, and no more than that."""

import datetime
import functools
import importlib
import math
import os
import random
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from datetime import date
from enum import Enum
from pathlib import Path
from typing import NamedTuple

import flexarm as fa
import numpy as np
import pytest
from flexarm.store.fingerprint import difference, marks

GAIN = 2.0
TABLE = {"a": np.arange(3.0), "b": [1, 2]}


def mark(value, name=None):
    return marks({"law": value}, name)["law"]


def scaled(t):
    """Reads a global."""
    return GAIN * t


def through(t):
    return scaled(t) + 1


def loop(n):
    return 0 if n == 0 else back(n - 1)


def back(n):
    return loop(n) + GAIN


def closure(a):
    return lambda t: a * t


def keyword(a):
    def f(t, *, gain=a):
        return gain * t

    return f


def decorated(a):
    def wrap(f):
        @functools.wraps(f)
        def g(t):
            return a * f(t)

        return g

    return wrap(math.sin)


class Law:
    rate = 3.0

    def __init__(self, a):
        self.a = a

    def __call__(self, t):
        return self.a * t * self.rate

    def method(self, t):
        return scaled(t) + self.a


@dataclass
class Point:
    x: float
    y: float = 1.0

    def __call__(self, t):
        return self.x * t


class Kind(Enum):
    ONE = 1
    TWO = 2


class Pair(NamedTuple):
    x: float
    y: float = 1.0

    def __call__(self, t):
        return self.x * t + self.y


class Slots:
    __slots__ = ("a",)

    def __init__(self, a):
        self.a = a


class Frozen(Point):
    @functools.cached_property
    def slow(self):
        return np.eye(3)


def user(value):
    return lambda t: value


WAYS = [
    closure, keyword, decorated, Law, Point, Pair, Slots, Frozen, lambda a: Law(a).method,
    lambda a: functools.partial(pow, a),
    lambda a: np.array([a]), lambda a: {"x": [a]}, lambda a: {(a, 1)}, lambda a: user(Law(a)),
    lambda a: user([Point(a)]), lambda a: user(Kind(int(a))), lambda a: fa.Torque(closure(a)),
    lambda a: fa.Motion([0, 1, 2], [0, a, 0]), lambda a: np.float32(a),
    lambda a: fa.Load(force=closure(a)), lambda a: fa.PD(a, 1), lambda a: fa.PD(1, 1, reference=closure(a)),
    lambda a: fa.Torque(1.0).scaled(a), lambda a: fa.Torque(closure(1)).scaled(a), lambda a: range(int(a)),
    lambda a: fa.Sampled(closure(a), 100.0), lambda a: fa.LinearController.pid(a, 1, 0, rate=100.0),
    lambda a: fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=a))]),
    lambda a: np.polynomial.Polynomial([a]), lambda a: np.array([a, None], dtype=object),
]  # fmt: skip


@pytest.mark.parametrize("way", WAYS, ids=range(len(WAYS)))
def test_the_same_is_the_same_and_another_another(way):
    assert mark(way(1.0)) == mark(way(1.0))
    assert mark(way(1.0)) != mark(way(2.0))


@pytest.mark.parametrize("law", [scaled, through, lambda t: through(t), loop, Law(1.0).method, user(scaled)])
def test_what_it_reads_and_calls_belongs_to_it(law, monkeypatch):
    before = mark(law)
    monkeypatch.setitem(globals(), "GAIN", 3.0)
    assert mark(law) != before
    monkeypatch.setitem(globals(), "GAIN", 2.0)
    assert mark(law) == before
    monkeypatch.setitem(globals(), "TABLE", 0)
    assert mark(law) == before  # which it does not read
    monkeypatch.setattr(Law, "rate", 4.0)
    assert (mark(law) != before) == (getattr(law, "__self__", None) is not None)


def test_lambdas_on_one_line_are_told_apart():
    a, b, c = lambda t: 1 * t, lambda t: 2 * t, lambda t: (lambda s: s * 3)(t)
    found = [mark(x) for x in (a, b, c)]
    assert len(set(found)) == 3
    k = 2.0
    d, e = lambda t: 3 * k, lambda t: 4 * k
    assert mark(d) != mark(e)
    inner, other = (lambda: (lambda t: t + 1))(), lambda t: t + 2  # fmt: skip
    assert mark(inner) != mark(other)


def test_what_cannot_be_looked_into_is_refused_unless_named():
    rng, count = np.random.default_rng(1), 0

    log, held = [], {"n": 0}

    def keeps(t):
        held["n"] += 1
        return held["n"]

    def counts(t):
        nonlocal count
        count += 1
        return count

    class Filter:
        def __init__(self):
            self.y = 0.0

        def __call__(self, t):
            self.y += t
            return self.y

    read = eval("lambda t: t")  # without source
    class Steps:
        def __init__(self):
            self.n = 0

        def next_one(self):
            self.n = self.n + 1
            return self.n

        def twice(self):
            return self.next_one() * 2

    steps = Steps()
    assert mark(lambda t: steps.n * t)  # which asks for nothing that changes it
    cases = {
        "next_one.. changes it": lambda t: steps.next_one(), "'drive 0' is a .*Steps, whose next_one": steps.twice,
        "a numpy.random.*Generator": lambda t: rng.normal(), "'np.random.rand'": lambda t: np.random.rand(),  # noqa: NPY002
        "random.Random": lambda t: random.random(), "changes 'count'": counts, "__call__.. changes it": Filter(),
        "changes 'log'": lambda t: log.append(t) or 1.0, "changes 'held'": keeps,
        "no source": read, "open..": lambda t: float(open("x").read()), "time..": lambda t: time.time(),
        "list_iterator": user(iter([1, 2])), "environ": lambda t: os.environ["A"], "_thread": user(threading.Lock()),
    }  # fmt: skip
    for says, law in cases.items():
        with pytest.raises(ValueError, match=f"(?s){says}.*give fingerprint="):
            mark({"drive 0": law})
        assert mark(law, "A") == mark(law, "A")
        assert marks({"x": law}, "A") != marks({"x": law}, "B")
    for bad in ("", 3):
        with pytest.raises(ValueError, match="fingerprint = "):
            marks({}, bad)
    with pytest.raises(ValueError, match="'drive 0', reads 'value' is a numpy"):  # where it is
        mark({"drive 0": user([rng])})


def test_what_reads_files_or_clocks_by_methods_and_packages_is_refused():
    here = Path(__file__)
    files = importlib.import_module("scipy.io")

    class Own:
        """Its own method of such a name is looked into."""

        def __call__(self, t):
            return self.read_text() * t

        def read_text(self):
            return 2.0

    assert mark(Own()) == mark(Own())
    cases = {
        "read_text..": lambda t: float(len(here.read_text())), "read_bytes..": lambda t: Path("x").read_bytes()[0],
        "now..": lambda t: datetime.datetime.now().second, "today..": lambda t: date.today().day,
        "loadmat..": lambda t: files.loadmat("x.mat")["gain"], "__import__..": lambda t: __import__("time").time(),
        "import_module..": lambda t: importlib.import_module("gains").K, "is loadmat": user(files.loadmat),
        "open..": lambda t: float(here.open().read()),
    }  # fmt: skip
    for says, law in cases.items():
        with pytest.raises(ValueError, match=f"(?s){says}.*give fingerprint="):
            mark({"drive 0": law})


def test_a_name_stands_only_for_what_is_not_seen(monkeypatch):
    rng = np.random.default_rng(1)

    def law(t):
        return GAIN * rng.normal()

    before = mark(law, "A")
    monkeypatch.setitem(globals(), "GAIN", 3.0)
    assert mark(law, "A") != before


LAB = '''
import functools, numpy as np, scipy.interpolate, {helper}
from {helper} import law as theirs
class Law:
    {comment}"""What it is."""
    def __init__(self, a): self.a = a
    def __call__(self, t{hint}): return {helper}.K * self.a["gain"] * np.sin(t) + theirs(t) + max({{1, 2, 3}})
    @functools.cached_property
    def kept(self): return 1
def late(t):
    import {helper} as lab, math
    return lab.K * math.pi * t
spline = scipy.interpolate.CubicSpline([0, 1, 2], [0.0, 1.0, 0.0])
made = [Law({{"gain": 2.0}}), late, lambda t: spline(t), lambda t: [theirs, Law][0](t)]
'''


def lab(folder, name, law="return K * t", gain=1.0, **how):
    how = {"comment": "", "hint": "", **how}
    (folder / f"{name}_helper.py").write_text(f"K = {gain}\ndef law(t):\n    {law}\n")
    (folder / f"{name}.py").write_text(LAB.format(helper=f"{name}_helper", **how))


SHOW = """
import sys
sys.path.insert(0, {folder!r})
from flexarm.store.fingerprint import marks
import lab
print([marks({{"x": x}})["x"] for x in lab.made])
"""


def in_a_lab(tmp_path, monkeypatch, **how):
    """The marks of its laws, and where it is."""
    folder = tmp_path / str(len(list(tmp_path.iterdir())))
    folder.mkdir()
    lab(folder, "lab", **how)
    with monkeypatch.context() as m:
        m.syspath_prepend(str(folder))
        for name in ("lab", "lab_helper"):
            m.delitem(sys.modules, name, raising=False)
        return [mark(x) for x in importlib.import_module("lab").made], folder


def test_comments_do_not_matter_and_what_is_imported_does(tmp_path, monkeypatch):
    def same(**how):
        return [a == b for a, b in zip(first, in_a_lab(tmp_path, monkeypatch, **how)[0], strict=True)]

    first, folder = in_a_lab(tmp_path, monkeypatch)
    assert len(set(first)) == 4
    assert all(same(comment='"""Other words."""\n\n    # a comment\n    ', hint=": float"))
    assert same(gain=2.0) == [False, False, True, False]  # read as a module's attribute, at the top or inside
    assert same(law="return K * t * t") == [False, True, True, False]  # what is called
    code = SHOW.format(folder=str(folder))  # another process, where strings have other hashes
    run = subprocess.run([sys.executable, "-O", "-c", code], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    assert eval(run.stdout) == first


def test_a_source_that_was_edited_since_is_refused(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    lab(tmp_path, "edited", law="return 2 * t")
    module = importlib.import_module("edited_helper")
    mark(module.law)
    later = time.time() + 5
    (tmp_path / "edited_helper.py").write_text("K = 1.0\ndef law(t):\n    return 7 * t\n")
    os.utime(tmp_path / "edited_helper.py", (later, later))
    with pytest.raises(ValueError, match="edited since"):
        mark(module.law)


def test_flexarms_version_belongs_to_it_and_what_differs_is_said():
    one = marks({"drive 0": 1.0, "t": 2})
    assert one["flexarm"] == fa.__version__
    assert difference(one, marks({"drive 0": 2.0, "t": 2})) == "with another drive 0"
    assert "of flexarm 0.0.1, this is" in difference({**one, "flexarm": "0.0.1"}, one)
    assert difference(None, one) == "whose marks cannot be read"


def test_laws_of_scenes_and_installed_packages_are_looked_into():
    for path in sorted(fa.scene.SCENES.glob("*.toml")):
        scene, again = fa.load(path.stem), fa.load(path.stem)
        parts = [{"arm": s.arm, "drive": s.drive, "loads": s.loads, "control": s.control} for s in (scene, again)]
        assert marks(parts[0]) == marks(parts[1]), path
    assert mark(np.sin) == mark(np.sin) != mark(np.cos) and mark(math.sin) != mark(np.sin)
    assert mark(lambda t: np.add(t, 1)) and mark(np.mean)
    assert mark("x".upper) != mark("y".upper) and mark(functools.lru_cache(scaled)) != mark(scaled)


@pytest.mark.filterwarnings("ignore:drive of.*the steps passed that by")  # which is true of noise
def test_the_batch_of_the_report(tmp_path):
    arm, t = fa.load("ist").arm, np.linspace(0, 0.02, 5)

    def run(w, **more):
        law = fa.Torque(lambda t: np.sin(w * t))
        return fa.simulate_batch(arm, t, np.zeros((8, arm.nq)), drive={0: law}, out=tmp_path / "g.h5", **more)

    run(20.0)
    assert run(20.0).stats["resumed"] == 8
    with pytest.raises(ValueError, match="holds another batch, with another drive 0"):
        run(2.0)
    fresh = run(2.0, resume=False)
    rng = np.random.default_rng(0)
    noisy = {"drive": {0: fa.Torque(lambda t: rng.normal())}, "out": Path(tmp_path / "n.h5")}
    with pytest.raises(ValueError, match="fingerprint="):
        fa.simulate_batch(arm, t, **noisy)
    fa.simulate_batch(arm, t, **noisy, fingerprint="noise of seed 0")
    assert fa.simulate_batch(arm, t, **noisy, fingerprint="noise of seed 0").stats["resumed"] == 1
    with pytest.raises(ValueError, match="with another fingerprint"):
        fa.simulate_batch(arm, t, **noisy, fingerprint="noise of seed 1")
    assert fresh.stats["resumed"] == 0
