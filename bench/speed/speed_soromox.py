"""Worker of bench/speed/speed_batch.py: SoRoMoX (JAX), rods of geometric variable strain on the processor.

Double precision, and one core: the process binds itself to one where the system can. The rods are those of
bench/speed/peer_rods.py: circular, so that both programs twist alike, strains in Legendre polynomials.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import soromox
from peer_rods import RODS, Rods, soromox_order, state
from soromox.systems.components import JointSpec, LinkSpec
from soromox.systems.gvs import GVS
from soromox.systems.gvs.specs import GVSSegment, StrainBasisSpec

LOOP = 200  # evaluations in a compiled loop
BATCHES = (64, 512)


def robot(rods: Rods) -> GVS:
    segments = []
    for k in range(rods.count):
        link = LinkSpec.circular(
            length=rods.length,
            radius=rods.radius,
            density=rods.density,
            reference_strain=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            young_modulus=rods.youngs_modulus,
            poisson_ratio=rods.poisson_ratio,
        )
        names = {"kappa_x": rods.torsion, "kappa_y": rods.bending_z, "kappa_z": rods.bending_y}
        basis = StrainBasisSpec(
            "legendre", tuple(n for n, m in names.items() if m), [max(m - 1, 0) for m in names.values()] + [0, 0, 0]
        )
        joint = JointSpec(type="revolute", axis="y" if k % 2 else "z") if rods.hinged else JointSpec(type="fixed")
        segments.append(GVSSegment(link=link, joint=joint, basis=basis, num_gauss_points=rods.points))
    # the base in the world's axes: SoRoMoX would stand it upright
    return GVS.from_segments(segments, gravity=jnp.array(rods.gravity), base_pose=jnp.array([0, 0, 0, 1.0, 0, 0, 0]))


def seconds(run: Callable[[], Any]) -> float:
    """CPU time of the fastest of five runs, after one that compiles."""
    jax.block_until_ready(run())
    times = []
    for _ in range(5):
        start = time.process_time()
        jax.block_until_ready(run())
        times.append(time.process_time() - start)
    return min(times)


def measure(rods: Rods) -> dict[str, Any]:
    """One forward dynamics in a compiled loop, and of a batch, in microseconds; and accelerations to compare."""
    model = robot(rods)
    n = model.num_internal_dofs
    y = jnp.concatenate([jnp.array(soromox_order(rods, x)) for x in state(rods)])

    def rate(y: jax.Array) -> jax.Array:
        return model.forward_dynamics(jnp.array(0.0), y)

    @jax.jit
    def loop(y: jax.Array) -> jax.Array:
        return jax.lax.fori_loop(0, LOOP, lambda _, x: x + 1e-12 * rate(x), y)

    many = jax.jit(jax.vmap(rate))
    batch = min(seconds(lambda b=b: many(y + 1e-6 * jnp.arange(b)[:, None])) / b for b in BATCHES)
    alone = seconds(lambda: loop(y)) / LOOP
    a = np.asarray(rate(y))[n:].tolist()
    return {"name": rods.name, "coordinates": n, "loop_us": 1e6 * alone, "batch_us": 1e6 * batch, "a": a}


if __name__ == "__main__":
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    jax.config.update("jax_enable_x64", True)
    print(json.dumps({"kind": "versions", "SoRoMoX": soromox.__version__, "JAX": jax.__version__}), flush=True)
    for rods in RODS:
        print(json.dumps({"kind": "rods", **measure(rods)}), flush=True)
