"""Meshes in views: thinned out to what fits, in the page, in pictures."""

from __future__ import annotations

import json
import re
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from flexarm.view.meshes import Mesh, thinned, welded

trimesh = pytest.importorskip("trimesh")


def ball(detail: int, radius: float = 0.1) -> Mesh:
    made = trimesh.creation.icosphere(subdivisions=detail, radius=radius)
    return Mesh(1, np.asarray(made.vertices), np.asarray(made.faces, dtype=np.int64), "#FF0000")


def test_thinned_meshes_keep_their_shape() -> None:
    meshes = [ball(6), ball(5, 0.02)]
    assert sum(len(m.faces) for m in meshes) > 100_000
    fewer = thinned(meshes, 8000)
    assert 2000 < sum(len(m.faces) for m in fewer) <= 8000
    for m, radius in zip(fewer, (0.1, 0.02), strict=True):
        assert np.allclose(np.linalg.norm(m.vertices, axis=1), radius, rtol=0.03)
        made = trimesh.Trimesh(m.vertices, m.faces, process=False)
        assert abs(made.volume) == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.1)
    assert thinned(meshes, 200_000) == meshes


def test_equal_corners_are_welded() -> None:
    soup = ball(3)
    corners = soup.vertices[soup.faces].reshape(-1, 3)  # as an .stl has them
    vertices, faces = welded(corners, np.arange(len(corners)).reshape(-1, 3))
    assert len(vertices) == len(soup.vertices) and len(faces) == len(soup.faces)
    assert np.allclose(np.sort(vertices, axis=0), np.sort(soup.vertices, axis=0), atol=1e-7)


@pytest.fixture
def arm(tmp_path: Path) -> fa.Arm:
    """A pendulum that looks like a red ball of 80 000 triangles and a blue box."""
    file = tmp_path / "ball.stl"
    trimesh.creation.icosphere(subdivisions=6, radius=100.0).export(file)
    looks = [
        fa.Look("mesh", [1e-3] * 3, file=str(file), at=fa.Placement((0.5, 0, 0)), colour="#FF0000"),
        fa.Look("box", (0.2, 0.1, 0.1), on="base", colour="#0000FF"),
    ]
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.5, 0, 0), (0.01, 0.01, 0.01)), looks=looks)])


def test_a_page_with_a_large_mesh_stays_small(arm: fa.Arm) -> None:
    pytest.importorskip("jupyter_threejs_sage")
    page = arm.show([0.3], open=False).html()
    assert len(page) < 3e6
    text = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert text
    body = json.loads(text[1])["tracks"][0]["body"]
    (mesh,) = body["meshes"]
    assert mesh["colour"] == "#FF0000" and np.allclose(mesh["centre"], [0.5, 0, 0], atol=1e-3)
    assert np.allclose(np.array(mesh["scale"]) * 32767, 0.1, rtol=0.02)
    assert {s["part"] for s in body["solids"] if not s.get("under")} == {"look"}  # the inertia's box gives way


def test_a_picture_shows_mesh_and_box(arm: fa.Arm) -> None:
    pixels = arm.show([0.3], open=False).image().astype(int)
    red = pixels[..., 0] - pixels[..., 2] > 100
    blue = pixels[..., 2] - pixels[..., 0] > 60
    assert red.sum() > 1500 and blue.sum() > 300
    assert np.argwhere(red)[:, 1].mean() != pytest.approx(np.argwhere(blue)[:, 1].mean(), abs=50)
