"""How the frequencies of an arm fall with its payload, and how many shape functions that takes.

Shows: `arm.modes`, joints held or free; a payload that is changed with `dataclasses.replace`; the choice of a basis.
You see: the first two frequencies of a link over the mass at its end, and the errors of two shape functions, from the
characteristic equation of a clamped beam with a mass. "clamped-free", the modes of the bare beam, get worse with the
payload; "legendre" gets better for mode 1 and wants more functions for mode 2; "loaded", the modes of the beam with
this payload, are exact. And the shapes of the modes.
Takes: 2 s. Needs: nothing besides flexarm.

    python 02_modes_of_an_arm.py [--output DIR]
"""

import argparse
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq

parser = argparse.ArgumentParser(description="Frequencies of an arm over its payload.")
parser.add_argument("--output", type=Path, default=Path(), metavar="DIR", help="folder to write into (here)")
folder = parser.parse_args().output
folder.mkdir(parents=True, exist_ok=True)

link = fa.load("ist").arm.links[0]  # a shipped scene: the paper's steel link, 0.5 m long, 1 mm thick
beam = replace(link.beam, order=2)
section, steel = beam.section, beam.material
mass_per_length = steel.density * section.y * section.z
bending_stiffness = steel.youngs_modulus * section.z * section.y**3 / 12
beam_mass = mass_per_length * beam.length


def frequencies(basis: str, payload: float) -> np.ndarray:
    """The first two with the joint held, of two functions (Hz)."""
    tip = fa.RigidBody(mass=payload)
    bent = replace(beam, basis=basis, basis_tip=tip if basis == "loaded" else None, modes={"bending_y": 2})
    arm = fa.Arm([replace(link, beam=bent, tip=tip)])
    return arm.modes(lock=[0]).frequencies / (2 * np.pi)


def exact(payload: float) -> list[float]:
    """Of an Euler-Bernoulli beam (Hz): 1 + cos b cosh b = payload / mass * b (sin b cosh b - cos b sinh b)."""

    def zero(b: float) -> float:  # divided by cosh b
        return 1 / np.cosh(b) + np.cos(b) - payload / beam_mass * b * (np.sin(b) - np.cos(b) * np.tanh(b))

    found = [brentq(zero, low, high) for low, high in ((0.1, 2.2), (3.0, 4.75))]
    return [b**2 * np.sqrt(bending_stiffness / mass_per_length) / beam.length**2 / (2 * np.pi) for b in found]


payloads = beam_mass * np.array([0, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10])
truth = np.array([exact(m) for m in payloads])
bases = ("clamped-free", "legendre", "loaded")
found = {basis: np.array([frequencies(basis, m) for m in payloads]) for basis in bases}
errors = {basis: 100 * abs(f / truth - 1) for basis, f in found.items()}

print("Frequencies with the joint held (Hz), and the errors of two functions (%)\n")
print(f"{'payload':>9} {'exact':>15} {'clamped-free':>17} {'legendre':>17} {'loaded':>17}")
for k, (m, f) in enumerate(zip(payloads, truth, strict=True)):
    cells = " ".join(f"{errors[basis][k, 0]:8.3f} {errors[basis][k, 1]:8.3f}" for basis in bases)
    print(f"{1e3 * m:7.1f} g {f[0]:7.3f} {f[1]:7.3f} {cells}")

arm = fa.Arm([replace(link, beam=replace(beam, basis="legendre", modes={"bending_y": 4}), tip=fa.RigidBody(0.05))])
modes = arm.modes(lock=[0])
print(f"\nWith 50 g at the tip:\n{modes}")
modes.plot().savefig(folder / "modes.png", dpi=120)

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
for k in range(2):
    left.plot(payloads / beam_mass, truth[:, k], label=f"mode {k + 1}")
left.set(xlabel="payload / mass of the beam", ylabel="exact frequency (Hz)", yscale="log")
left.legend(frameon=False, loc="center right")
for basis, marker in zip(bases, "xos", strict=True):
    right.loglog(payloads[1:] / beam_mass, errors[basis][1:, 0] + 1e-6, marker + "-", label=f"2 {basis}")
right.set(xlabel="payload / mass of the beam", ylabel="error of mode 1 (%)")
right.legend(frameon=False, loc="lower right", bbox_to_anchor=(1, 0.05))
figure.savefig(folder / "payload.png", dpi=120)
print(f"The figures are {folder / 'payload.png'} and {folder / 'modes.png'}.")
