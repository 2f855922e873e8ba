"""Saint-Venant's torsion and shear of a section by finite elements, for the tests of the sections' closed forms.

The warping function w of torsion makes J = int (w_y - z)^2 + (w_z + y)^2 dA least; the potential p of shear by a force
along y (Poisson's ratio zero) solves laplace p = -y / I without flux at the edges, and 1 / k = A int |grad p|^2 dA.
Elements are quadrilaterals of nine nodes. Both come without conditions at edges, also those of holes.
"""

from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import splu

_S = np.array([-1.0, 0.0, 1.0])
_G, _W = np.polynomial.legendre.leggauss(4)


def _lagrange(x):
    """Values and slopes of the three quadratic polynomials at x."""
    return (
        np.array([x * (x - 1) / 2, 1 - x * x, x * (x + 1) / 2]),
        np.array([x - 0.5, -2 * x, x + 0.5]),
    )


_V, _D = _lagrange(_G)  # (node, point)
_N = np.einsum("ip,jq->pqij", _V, _V).reshape(16, 9)
_DN = np.stack(
    [np.einsum("ip,jq->pqij", _D, _V).reshape(16, 9), np.einsum("ip,jq->pqij", _V, _D).reshape(16, 9)], axis=1
)
_WW = np.outer(_W, _W).reshape(16)


class Mesh:
    """Nodes (n, 2) and elements (m, 9), rows of three nodes after one another."""

    def __init__(self, nodes, elements):
        used, flat = np.unique(elements, return_inverse=True)
        self.nodes, self.elements = nodes[used], flat.reshape(elements.shape)
        at = self.nodes[self.elements]
        jacobian = np.einsum("pdi,eic->epdc", _DN, at)
        self.weight = np.abs(np.linalg.det(jacobian)) * _WW
        self.slope = np.einsum("epcd,pdi->epci", np.linalg.inv(jacobian), _DN)
        self.y, self.z = np.moveaxis(np.einsum("pi,eic->epc", _N, at), -1, 0)
        rows = np.repeat(self.elements, 9, axis=1).ravel()
        columns = np.tile(self.elements, (1, 9)).ravel()
        each = np.einsum("ep,epci,epcj->eij", self.weight, self.slope, self.slope)
        stiff = csr_array(coo_array((each.ravel(), (rows, columns))))
        self._solve = splu(stiff[1:, 1:].tocsc())

    def integral(self, f):
        return float((self.weight * f).sum())

    def _potential(self, each):
        load = np.zeros(len(self.nodes))
        np.add.at(load, self.elements, each)
        return np.concatenate([[0.0], self._solve.solve(load[1:])])

    def torsion_constant(self):
        z, y = self.z, self.y
        w = self._potential(np.einsum("ep,epci,cep->ei", self.weight, self.slope, np.array([z, -y])))
        grad = np.einsum("epci,ei->epc", self.slope, w[self.elements])
        return self.integral((grad[..., 0] - z) ** 2 + (grad[..., 1] + y) ** 2)

    def surface_shear(self, axis, distance):
        """Shear strain along a face at a distance, over its middle three quarters, per twist: in the elements there."""
        z, y = self.z, self.y
        w = self._potential(np.einsum("ep,epci,cep->ei", self.weight, self.slope, np.array([z, -y])))
        grad = np.einsum("epci,ei->epc", self.slope, w[self.elements])
        out, along = (y, z) if axis == "y" else (z, y)
        shear = grad[..., 1] + y if axis == "y" else z - grad[..., 0]
        at = (out > distance - 3e-4) & (np.abs(along) < 0.375 * (along.max() - along.min()))
        return float((shear * self.weight * at).sum() / (self.weight * at).sum())

    def shear_correction(self, axis):
        along = self.y if axis == "y" else self.z
        p = self._potential(np.einsum("ep,pi,ep->ei", self.weight, _N, along))
        second = self.integral(along**2)
        return second**2 / self.integral(np.ones_like(along)) / self.integral(along * (p[self.elements] @ _N.T))


def classical_stiffness(m, moduli):
    """Stiffness of (eps, K1, K2, K3) of an anisotropic section (4, 4): of the displacements w that warp it, three per
    node, those of the least energy. Moduli: (element, 6, 6), stress by strain in the order xx yy zz yz xz xy."""
    one, y, z = np.ones_like(m.y), m.y, m.z
    e = np.zeros((*y.shape, 6, 4))
    e[..., 0, 0], e[..., 0, 2], e[..., 0, 3] = one, z, -y
    e[..., 5, 1], e[..., 4, 1] = -z, y
    B = np.zeros((*y.shape, 6, 9, 3))
    dy, dz = m.slope[..., 0, :], m.slope[..., 1, :]
    B[..., 5, :, 0], B[..., 4, :, 0] = dy, dz
    B[..., 1, :, 1], B[..., 3, :, 1] = dy, dz
    B[..., 2, :, 2], B[..., 3, :, 2] = dz, dy
    B = B.reshape(*y.shape, 6, 27)
    stressed = np.einsum("ep,eij,epjk->epik", m.weight, moduli, B)
    dof = (3 * m.elements[:, :, None] + np.arange(3)).reshape(-1, 27)
    rows, columns = np.repeat(dof, 27, axis=1).ravel(), np.tile(dof, (1, 27)).ravel()
    each = np.einsum("epij,epik->ejk", B, stressed)
    K = csr_array(coo_array((each.ravel(), (rows, columns))))
    load = np.zeros((K.shape[0], 4))
    np.add.at(load, dof, np.einsum("epij,epik->ejk", stressed, e))
    far = int(np.argmax(np.abs(m.nodes - m.nodes[0]).sum(axis=1)))
    free = np.setdiff1d(np.arange(K.shape[0]), [0, 1, 2, 3 * far + 1])  # of the rigid motions, turning about x too
    w = splu(K[free][:, free].tocsc()).solve(load[free])
    return np.einsum("ep,epij,eik,epkl->jl", m.weight, e, moduli, e) - load[free].T @ w


def grid(u, v, place=lambda u, v: (u, v), keep=lambda u, v: np.ones_like(u, dtype=bool), ring=False):
    """Elements between the lines u and v (odd in number: every second is the middle of elements) of a plane that
    `place` maps to the section's; of these those whose middle `keep` takes. A ring closes on itself in v."""
    a, b = np.meshgrid(u, v, indexing="ij")
    nodes = np.stack(place(a, b), axis=-1).reshape(-1, 2)
    number = np.arange(a.size).reshape(a.shape)
    if ring:
        number[:, -1] = number[:, 0]
    i, j = np.meshgrid(np.arange(0, len(u) - 2, 2), np.arange(0, len(v) - 2, 2), indexing="ij")
    inside = keep(a[i + 1, j + 1], b[i + 1, j + 1])
    i, j = i[inside], j[inside]
    return Mesh(nodes, np.stack([number[i + p, j + q] for p in range(3) for q in range(3)], axis=-1))


def lines(*places, n=10):
    """n elements between each two of the places, with their middles, finer towards both ends, where corners are."""
    out = [places[0]]
    s = np.linspace(-1, 1, n + 1)
    share = np.sign(s) * (1 - (1 - np.abs(s)) ** 3)
    for a, b in pairwise(places):
        ends = (a + b) / 2 + (b - a) / 2 * share
        out += [x for lo, hi in pairwise(ends) for x in ((lo + hi) / 2, hi)]
    return np.array(out)
