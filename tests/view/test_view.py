"""Views of arms: what is drawn stands where `arm.frame` says, pages are whole and small, pictures are not blank."""

from __future__ import annotations

import base64
import json
import re
import sys
import tempfile
import webbrowser
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from flexarm.view import body, stage, still, track
from messages import refuses
from scipy.spatial.transform import Rotation

from tests.arms import STEEL, masts, paper_link, random_arm, satellite

SIZE = (4.0, 3.0)


def chain(links: int) -> fa.Arm:
    beam = fa.Beam(0.3, fa.Tube(0.01, 0.001), STEEL, {"bending_y": 2, "bending_z": 2})
    return fa.Arm([fa.Link(fa.Revolute("yz"[k % 2]), beam=beam) for k in range(links)])


def swing(arm: fa.Arm, t: np.ndarray, size: float = 0.3) -> fa.Result:
    """A motion that is given, not simulated: each coordinate a sine of its own."""
    rate = np.linspace(1.0, 12.0, arm.nv)
    q = size * np.sin(t[:, None] * rate) * np.where([" bending" in name for name in arm.coordinates], 0.05, 1.0)
    zero = np.zeros((len(t), arm.nv))
    return fa.Result(arm, t, q, zero, zero, zero)


def unpacked(page: str) -> dict:
    text = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert text
    return json.loads(text[1])


# -- geometry ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_nodes_stand_where_the_arm_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, 3)
    q = arm.zero + 0.05 * rng.normal(size=(5, arm.nq))
    made = track.make_track(arm, np.arange(5.0), q)
    found = made.body
    for i, (k, x) in enumerate(found.places):
        if x is not None:
            p, R = arm.frame(q, k, x)
            assert np.allclose(made.position[:, i], p, atol=1e-12)
            assert np.allclose(Rotation.from_quat(made.quaternion[:, i]).as_matrix(), R, atol=1e-12)
    node, at = found.tips[0]
    end = made.position[:, node] + Rotation.from_quat(made.quaternion[:, node]).apply(at)
    assert np.allclose(end, arm.frame(q)[0], atol=1e-12)


def test_branches_begin_where_their_parents_end() -> None:
    """Joints and rods of a tree, and the paths of all its ends, in the picture and in the page."""
    arm = satellite()
    rng = np.random.default_rng(2)
    q = arm.zero + np.where(np.arange(arm.nq) > 6, 0.05, 0.0) * rng.normal(size=(5, arm.nq))
    made = track.make_track(arm, np.arange(5.0), q)
    ends = np.stack(made.tips(made.t), axis=1)
    assert np.allclose(ends, arm.end_places(q), atol=1e-9)
    names = {label["text"]: label for label in made.body.labels}
    places = {"shoulder": (0.4, 0, 0), "left panel fixed": (0, 0.4, 0), "right panel fixed": (0, -0.4, 0)}
    for name, place in places.items():
        label = names[name]
        assert made.body.places[label["node"]] == (0, None) and np.allclose(label["at"], place)
    assert body.length(arm) == pytest.approx(2.4)
    on_slices = track.make_track(masts(), np.zeros(1), masts().zero[None])
    label = {x["text"]: x for x in on_slices.body.labels}["hoist prismatic"]
    assert on_slices.body.places[label["node"]] == (0, 0.5) and np.allclose(label["at"], (0.01, 0.02, 0.03))
    assert len(on_slices.body.tips) == 5
    pytest.importorskip("jupyter_threejs_sage")
    view = fa.simulate(arm, np.linspace(0, 0.1, 3)).animate()
    assert len(unpacked(view.html())["tracks"][0]["body"]["tips"]) == 3


@pytest.mark.parametrize("seed", range(4))
def test_pieces_of_links_meet(seed: int) -> None:
    """A joint's place on the link below, seen from above, where nothing is moved: link frames follow from it."""
    rng = np.random.default_rng(seed)
    place = fa.Placement(rng.normal(size=3), rng.normal(size=3))
    other = fa.Placement(rng.normal(size=3), rng.normal(size=3))
    hub = fa.RigidBody(1.0, end=(0.1, 0.2, 0.0))
    links = [fa.Link(fa.Revolute("z", inboard=place, outboard=other), hub), fa.Link(fa.Prismatic("y"), hub)]
    arm = fa.Arm(links)
    q = np.array([[0.7, 0.3]])
    made = track.make_track(arm, np.zeros(1), q)
    (low, start), (high, end) = made.body.bars[0]["ends"]
    R = Rotation.from_quat(made.quaternion[0])
    a = made.position[0, low] + R[low].apply(start)
    b = made.position[0, high] + R[high].apply(end)
    assert np.allclose(b - a, 0.3 * arm.frame(q[0], 0)[1][:, 1])
    first = made.body.axes[0]
    assert np.allclose(first["direction"], Rotation.from_rotvec(place.rotation).apply((0, 0, 1)))


def test_bending_is_magnified_and_strain_is_not() -> None:
    arm = paper_link(1, 2)
    q = np.array([0.4, 0.01, -0.002])
    view = arm.show(q, magnify=3.0, open=False)
    made = view.tracks[0]
    assert np.allclose(made.position[0, made.body.tips[0][0]], arm.frame((0.4, 0.03, -0.006))[0])
    clamp = made.body.beams[0]["first"]
    assert np.allclose(made.strain[0, clamp], arm.strain(q)[[5, 1, 2]])
    assert "bending magnified 3 times" in view.notes


def test_surface_strain_is_that_of_fibres() -> None:
    """Against the length of a fibre between two near sections, from frames alone."""
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=fa.Beam(1.0, fa.Rectangle(0.02, 0.03), STEEL,
                 {"bending_y": 2, "bending_z": 2, "extension": 1}, order="exact"))])  # fmt: skip
    q = np.array([0.08, 0.01, -0.05, 0.02, 0.001])
    outline = body.outline(arm.links[0].beam.section)
    x, h = 0.3, 1e-5
    ends = []
    for place in (x - h, x + h):
        p, R = arm.frame(q, 0, place)
        ends.append(p + np.column_stack([np.zeros(4), outline]) @ R.T)
    fibre = np.linalg.norm(ends[1] - ends[0], axis=1) / (2 * h) - 1
    strain = stage.surface_strain(arm.strain(q, 0, x)[[5, 1, 2]], outline)
    assert np.ptp(fibre) > 1e-3
    assert np.allclose(strain, fibre, rtol=1e-5, atol=1e-9)


def test_outlines_have_the_sections_integrals() -> None:
    general = fa.sections.GeneralSection(6e-4, 2e-8, 4.5e-8, 1e-9)
    matrix = fa.SectionMatrix.of(fa.Rectangle(0.02, 0.03), STEEL)
    sections = [
        fa.Rectangle(0.02, 0.03),
        fa.sections.IBeam(0.1, 0.06, 0.008, 0.005),
        fa.Circle(0.01),
        fa.sections.Ellipse(0.02, 0.04),
    ]
    for section in sections:
        y, z = body.outline(section).T
        after_y, after_z = np.roll(y, -1), np.roll(z, -1)
        cross = y * after_z - after_y * z
        area = cross.sum() / 2
        second = (cross * (y**2 + y * after_y + after_y**2)).sum() / 12
        exact = isinstance(section, (fa.Rectangle, fa.sections.IBeam))
        assert abs(area) == pytest.approx(section.area, rel=1e-9 if exact else 0.01)
        assert abs(second) == pytest.approx(section.second_moment_z, rel=1e-9 if exact else 0.02)
    for section, y, z in ((general, 0.03, 0.02), (matrix, 0.02, 0.03)):
        assert np.allclose(np.ptp(body.outline(section), axis=0), (y, z))


def test_a_rigid_body_is_the_box_of_its_inertia() -> None:
    m, a, b, c = 2.0, 0.1, 0.2, 0.05
    hub = fa.RigidBody(m, (0.1, 0, 0), m / 12 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]))
    made = body.make_body(fa.Arm([fa.Link(fa.Revolute("z"), hub, tip=fa.RigidBody(1.0))]), [0])
    box = next(s for s in made.solids if s["part"] == "hub")
    assert np.allclose(np.abs(box["axes"]) @ box["size"], (a, b, c))
    ball = next(s for s in made.solids if s["part"] == "tip")
    assert ball["kind"] == "ball" and 4 / 3 * np.pi * ball["size"][0] ** 3 * 7800 == pytest.approx(1.0)


@pytest.mark.parametrize(
    "inertia", [(0.008, 0.02, 0.02), (0.02, 0.008, 0.02), (0.02, 0.02, 0.008), (0.01, 0.02, 0.015, 2e-3, -3e-3, 1e-3)]
)
def test_faces_of_solids_point_outwards(inertia: tuple[float, ...]) -> None:
    hub = fa.RigidBody(2.0, (0.1, -0.2, 0.3), inertia, end=(0.2, 0.1, 0))
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub, chain(1).links[0].beam, fa.RigidBody(0.1))])
    solids = body.make_body(arm, [5]).solids
    assert {s["kind"] for s in solids} == {"box", "ball", "cylinder"}
    for solid in solids:
        a, b, c, d = np.moveaxis(still._solid_faces(solid), 1, 0)
        volume = (np.cross(a, b) * c + np.cross(a, c) * d).sum() / 6  # by Gauss' theorem: below 0 where faces look in
        s, pi = solid["size"], np.pi
        whole = {"box": np.prod(s), "ball": 4 / 3 * pi * s[0] ** 3, "cylinder": pi * s[0] * s[-1] ** 2}[solid["kind"]]
        assert 0.85 * whole < volume < 1.001 * whole  # round ones have corners


def test_walls_of_boxes_have_no_seams() -> None:
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(2.0, inertia=(0.02, 0.02, 0.008)))])
    pixels = fa.results.View([track.make_track(arm, np.zeros(1), arm.zero[None])], 1.0).image().reshape(-1, 3)
    grey = pixels[(pixels.max(axis=1) < 170) & (np.ptp(pixels.astype(int), axis=1) < 40)]  # neither floor nor axis
    _, counts = np.unique(grey, axis=0, return_counts=True)
    assert np.sort(counts)[-3:].sum() > 0.91 * len(grey) > 9100  # of three walls, each in one colour


def test_patches_lie_on_the_faces() -> None:
    piezo = fa.Piezo(62e9, 0.3, 7800, -180e-12)
    patches = [fa.Patch(0.1, 0.2, 0.01, 5e-4, piezo, "y"), fa.Patch(0.3, 0.4, 0.002, 5e-4, piezo, "-z")]
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 2}, patches=patches)
    made = body.make_body(fa.Arm([fa.Link(fa.Fixed(), beam=beam)]), [9])
    layers = [b["outlines"][0] for b in made.beams if b["part"] == "patch"]
    extents = [(*layer.min(axis=0), *layer.max(axis=0)) for layer in layers]
    assert np.allclose(extents[0], (0.001, -0.005, 0.0015, 0.005))
    assert np.allclose(extents[1], (-0.0015, -0.005, -0.001, 0.005))
    assert np.allclose(extents[2], (-0.001, -0.0105, 0.001, -0.01)) and len(layers) == 3
    first = made.beams[1]
    places = [made.places[i][1] for i in (first["first"], first["first"] + first["count"] - 1)]
    assert np.allclose(places, (0.1, 0.2))


def test_loads_are_drawn_where_and_as_they_act() -> None:
    arm = paper_link()
    loads = [fa.Load(force=(1, 2, 0), axes="section"), fa.Load(0, along=(0.1, 0.3), force=(0, 0, 5)),
             fa.Load(0, 0.2, moment=lambda t: (0, 0, t))]  # fmt: skip
    q = np.array([0.5, 0.01, 0.0, 0.0])
    made = arm.show(q, loads=loads, t=2.0, open=False).tracks[0]
    assert np.allclose(made.force[0, 0], arm.frame(q)[1] @ (1, 2, 0))
    assert np.allclose(made.force[0, 1], (0, 0, 1.0))  # 5 N/m on 0.2 m
    assert np.allclose(made.position[0, made.body.loads[1]], arm.frame(q, 0, 0.2)[0])
    assert np.allclose(made.moment[0, 2], (0, 0, 2.0))


# -- frames ------------------------------------------------------------------------------------------------------------


def test_frames_are_thinned_out_to_what_a_curve_needs() -> None:
    arm = chain(2)
    fine = swing(arm, np.linspace(0.0, 4.0, 8001))
    made = fine.animate().tracks[0]
    assert 50 < len(made.t) < 2000 and made.t[-1] == 4.0
    for t in np.linspace(0.05, 3.95, 37):
        q = fine.q[round(t * 2000)]
        p, R, strain, *_ = made.at(float(round(t * 2000) / 2000))
        assert np.allclose(p[made.body.tips[0][0]], arm.frame(q)[0], atol=1e-3 * 0.6)
        node = made.body.beams[1]["first"]
        assert np.allclose(R[node], arm.frame(q, 1, 0.0)[1], atol=5e-3)
        assert np.allclose(strain[node], arm.strain(q, 1, 0.0)[[5, 1, 2]], atol=2e-2 * np.abs(made.strain).max())


def test_a_page_gives_the_frames_back() -> None:
    pytest.importorskip("jupyter_threejs_sage")
    view = swing(chain(2), np.linspace(0.0, 1.0, 200)).animate()
    told = unpacked(view.html())["tracks"][0]
    numbers = np.frombuffer(base64.b64decode(told["frames"]), "<i2").reshape(len(told["t"]), -1)
    columns, k = {}, 0
    for name, c in told["columns"].items():
        n = len(c["centre"])
        part = numbers[:, k : k + n * c["count"]].reshape(len(numbers), c["count"], n)
        columns[name], k = np.array(c["centre"]) + np.array(c["scale"]) * part, k + n * c["count"]
    made = view.tracks[0]
    for name in ("position", "quaternion", "strain"):
        x = getattr(made, name)
        assert np.allclose(columns[name], x, atol=2e-5 * np.ptp(x) + 1e-12), name
    assert k == numbers.shape[1]


def test_ten_links_for_ten_seconds_take_less_than_three_megabytes() -> None:
    pytest.importorskip("jupyter_threejs_sage")
    view = swing(chain(10), np.linspace(0.0, 10.0, 10001), 0.5).animate()
    assert len(view.tracks[0].t) > 300
    assert len(view.html().encode()) < 3e6


def test_a_page_asks_for_nothing_from_elsewhere() -> None:
    pytest.importorskip("jupyter_threejs_sage")
    page = paper_link().show(open=False).html()
    assert not re.search(r"<(?:script|link|img|iframe)[^>]*(?:src|href)\s*=", page)
    assert not re.search(r"\b(?:fetch|XMLHttpRequest|import)\(\s*['\"]https?:", page)
    assert "@@" not in page and page.count("</script>") == 3


def test_names_that_matplotlib_takes_for_its_own(tmp_path: Path) -> None:
    """Dollars begin no formula, and a line that hides a name from its legend hides none here."""
    dollars, hidden = "a$\\frac{1$b", "_1"
    beam = fa.Beam(0.3, fa.Tube(0.01, 0.001), STEEL, {"bending_y": 2})
    arm = fa.Arm([fa.Link(fa.Revolute(name=name), beam=beam, name=f"{name} l") for name in (dollars, hidden)])
    run = swing(arm, np.linspace(0.0, 1.0, 11))
    figures = [
        run.plot(),
        arm.modes(lock=[0, 1]).plot(),
        run.to_data().plot(),
        fa.sensors.StrainGauge(link=0).read(run).plot(),
    ]
    figures.append(run.animate(titles=[dollars]).figure())
    for figure in figures:
        figure.savefig(tmp_path / "figure.png", dpi=50)
    for figure in figures[:1] + figures[2:3]:
        words = [text.get_text().strip() for text in figure.axes[0].get_legend().get_texts()]
        assert sum("_1" in word for word in words) and sum("frac" in word for word in words)


def test_names_that_are_html() -> None:
    """No "<" of a name stands in a page's script, whatever follows it; the browser parses "<!--" there, too."""
    pytest.importorskip("jupyter_threejs_sage")
    name = "<!--<script></SCRIPT>&lt;\u2028"
    solid = fa.RigidBody(1.0, inertia=(1, 1, 1), end=(1, 0, 0))
    arm = fa.Arm([fa.Link(fa.Revolute(name=name[:-1]), solid, name=f"{name[:-1]} link")])
    view = swing(arm, np.linspace(0.0, 1.0, 3)).animate(titles=[name])
    page = view.html()
    data = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert data and "<" not in data[1]
    told = json.loads(data[1])["tracks"][0]
    assert told["title"] == name and told["body"]["labels"][0]["text"] == name[:-1]
    assert "<!--" not in re.search(r"<title>(.*?)</title>", page, re.DOTALL)[1]  # type: ignore[index]
    assert "<script" not in view._repr_html_()


def test_many_rows_keep_the_last() -> None:
    made = swing(chain(1), np.linspace(0.0, 1.0, 45_678)).animate().tracks[0]
    assert made.t[0] == 0.0 and made.t[-1] == 1.0 and (np.diff(made.t) > 0).all()


def test_two_runs_stand_side_by_side() -> None:
    run = swing(chain(1), np.linspace(0.0, 1.0, 50))
    view = run.animate(run, titles=["stiff", "soft"])
    assert [t.title for t in view.tracks] == ["stiff", "soft"]
    assert view.figure(0.5, SIZE).axes and view.times == (0.0, 1.0)


# -- modes -------------------------------------------------------------------------------------------------------------


def test_a_mode_moves_as_its_shape() -> None:
    arm = paper_link()
    modes = arm.modes(lock=[0])
    view = modes.animate(1, amplitude=1e-6)
    made = view.tracks[0]
    shapes = arm.mode_shapes(modes, 9)
    size = np.linalg.norm(shapes.displacement[:, :, 1], axis=1).max()
    tip = made.position[0, made.body.tips[0][0]] - arm.frame(modes.q)[0]
    assert np.allclose(tip, 1e-6 * shapes.displacement[-1, :, 1] / size, rtol=1e-3, atol=1e-10)
    assert view.times[1] == pytest.approx(2 * np.pi / modes.frequencies[1])
    assert f"{modes.frequencies[1] / 2 / np.pi:.4g} Hz" in made.title
    assert np.allclose(made.position[0], made.position[-1])


def test_modes_of_balls_and_of_nothing_elastic() -> None:
    body_ = fa.RigidBody(1.0, (0.1, 0, 0), (0.01, 0.01, 0.01), (0.2, 0, 0))
    arm = fa.Arm([fa.Link(fa.Spherical(stiffness=2.0), body_), fa.Link(fa.Free(), body_)], (0, 0, -9.81))
    modes = arm.modes(lock=[1])
    for k in range(len(modes.frequencies)):
        made = modes.animate(k).tracks[0]
        assert np.isfinite(made.position).all() and np.ptp(made.position[:, :, :], axis=0).max() < 1.0


def test_a_mode_that_only_turns() -> None:
    beam = fa.Beam(0.5, fa.Circle(0.01), STEEL, {"torsion": 2})
    modes = fa.Arm([fa.Link(fa.Fixed(), beam=beam)]).modes()
    made = modes.animate(-1).tracks[0]
    quarter = int(made.t.searchsorted(made.t[-1] / 4))
    turns = Rotation.from_quat(made.quaternion[0]) * Rotation.from_quat(made.quaternion[quarter]).inv()
    assert made.title.startswith("mode 1:") and turns.magnitude().max() == pytest.approx(0.5, rel=1e-3)
    with refuses("amplitude = 0.01"):
        modes.animate(0, amplitude=0.01)


def test_loads_that_a_file_does_not_keep_are_missed(tmp_path: Path) -> None:
    run = swing(chain(1), np.linspace(0.0, 1.0, 20))
    run.loads = (fa.Load(force=(0, 1, 0)),)
    assert len(run.animate().tracks[0].body.loads) == 1
    run.save(tmp_path / "run.npz")
    assert any("without its loads" in note for note in fa.Result.load(tmp_path / "run.npz").animate().notes)


# -- files -------------------------------------------------------------------------------------------------------------


def test_pictures_and_films_are_written(tmp_path: Path) -> None:
    from PIL import Image

    view = swing(chain(2), np.linspace(0.0, 0.2, 20)).animate()
    view.save(tmp_path / "arm.png", t=0.1, size=SIZE)
    picture = np.asarray(Image.open(tmp_path / "arm.png").convert("RGB"))
    assert picture.shape == (600, 800, 3) and 0.01 < (picture < 200).any(axis=-1).mean() < 0.5
    told: list[float] = []
    view.save(tmp_path / "arm.gif", fps=20, size=SIZE, progress=told.append)
    assert told == [0.0, 0.2, 0.4, 0.6, 0.8]
    with Image.open(tmp_path / "arm.gif") as film:
        assert film.n_frames == 5 and film.info["duration"] == 50
        first = np.asarray(film.convert("RGB"), int)
        assert np.abs(view.image(0.0, SIZE).astype(int) - first).max() < 40  # of a palette of 256 colours
        film.seek(3)
        assert np.abs(np.asarray(film.convert("RGB"), int) - first).max() > 100
    assert view.image(0.0, SIZE).shape == (300, 400, 3)


def test_a_film_by_ffmpeg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import shutil

    view = swing(chain(1), np.linspace(0.0, 0.2, 20)).animate()
    if shutil.which("ffmpeg"):
        view.save(tmp_path / "arm.mp4", size=SIZE)
        assert (tmp_path / "arm.mp4").read_bytes()[4:8] == b"ftyp"
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with refuses("arm.mp4", "ffmpeg"):
        view.save(tmp_path / "arm.mp4")


def test_show_opens_a_browser(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("jupyter_threejs_sage")
    opened: list[str] = []
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("BROWSER", "any")
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or False)
    view = paper_link().show()
    assert isinstance(view, fa.results.View) and ".save(" in repr(view)
    assert len(opened) == 1 and Path(opened[0].removeprefix("file://")).exists()
    assert "no browser was found" in capsys.readouterr().err
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER", "WSL_DISTRO_NAME"):
        monkeypatch.delenv(name, raising=False)
    assert view.open().exists() and len(opened) == (1 if sys.platform.startswith("linux") else 2)
    assert view._repr_html_().startswith("<iframe srcdoc=")


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda a: a.show([1.0, 2.0], open=False), ("q has shape (2,)", "4", "numbers")),
        (lambda a: a.show([np.nan] * 4, open=False), ("q =", "finite")),
        (lambda a: a.show(magnify=0, open=False), "magnify = 0"),
        (lambda a: a.show(magnify=np.inf, open=False), "magnify = inf"),
        (lambda a: a.show(loads=[3], open=False), ("loads[0] = 3", "Load")),
        (lambda a: a.show(t="x", open=False), "t = 'x'"),
        (lambda a: a.show(open=False).save("arm.pdf"), ".html"),
        (lambda a: a.show(open=False).save("/no/such/folder/arm.png", size=SIZE), ("no such file", "folder")),
        (lambda a: a.show(open=False).save("arm.png", t=3.0), ("t = 3.0", "0 to 0")),
        (lambda a: a.show(open=False).save("arm.png", size=(0.1, 2)), "size ="),
        (lambda a: a.modes().animate(99), ("mode = 99", "-4 to 3")),
        (lambda a: a.modes().animate(0, -1.0), "amplitude = -1.0"),
        (lambda a: swing(a, np.zeros(0)).animate(), "rows"),
        (lambda a: fa.Result(a, np.arange(3.0), *[np.full((3, 4), np.nan)] * 4).animate(), "q[0, 0] = nan"),
        (lambda a: fa.Result(a, np.arange(4.0), *[np.zeros((3, 4))] * 4).animate(), "(4, 4)"),
        (lambda a: fa.Result(a, np.arange(3.0)[::-1], *[np.zeros((3, 4))] * 4).animate(), "increase"),
        (lambda a: swing(a, np.arange(3.0)).animate(3), ("others[0] = 3", "Result")),
        (lambda a: swing(a, np.arange(3.0)).animate(speed=0), "speed = 0"),
        (lambda a: swing(a, np.arange(3.0)).animate(titles=["a", "b"]), ("1", "list")),
        (lambda a: swing(a, np.arange(3.0)).animate().save("a.gif", fps=0), ("fps = 0", "1 to 50")),
    ],
)
def test_bad_arguments_are_named(call, said: str) -> None:
    with refuses(said):
        call(paper_link())


def test_without_the_extra_pages_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jupyter_threejs_sage", None)
    with refuses("flexarm[view]", error=ImportError):
        paper_link().show()


def test_joints_are_called_by_their_names() -> None:
    bar = fa.RigidBody(1.0, com=(0.15, 0, 0), end=(0.3, 0, 0))
    made = body.make_body(fa.Arm([fa.Link(fa.Revolute("z", name=name), bar) for name in ("elbow", None)]), [0, 0])
    assert [label["text"] for label in made.labels] == ["elbow", "link 1 revolute"]
    named = [fa.Link(fa.Revolute("z"), bar, name="upper"), fa.Link(fa.Revolute("z", name="wrist"), bar, name="hand")]
    made = body.make_body(fa.Arm(named), [0, 0])
    assert [label["text"] for label in made.labels] == ["upper revolute", "wrist"]
