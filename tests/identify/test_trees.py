"""A fit on a tree: the mass in one hand, by its name, from two encoders."""

from __future__ import annotations

import flexarm as fa
import numpy as np
import pytest
from arms import two_arms

MASS = "link.left fore.hub.mass"


@pytest.mark.filterwarnings("ignore")
def test_the_mass_of_a_hand_is_found() -> None:
    arm = two_arms(n=1)
    sensors = [fa.sensors.Encoder(k, pulses=None) for k in ("left elbow", "right elbow")]
    drive = {"left shoulder": fa.Torque(0.4), "right elbow": fa.Torque(-0.1)}
    scene = fa.Scene(arm, t=np.linspace(0.0, 0.5, 26), drive=drive, sensors=sensors,
                     options={"integrator": "implicit", "step": 5e-3})  # fmt: skip
    run = scene.run()
    rng = np.random.default_rng(0)
    data = fa.Data(
        run.t, {k: s.read(run).y[:, 0] + 1e-5 * rng.normal(size=26) for k, s in zip("lr", sensors, strict=True)}
    )
    fit = fa.identify(scene, data, {MASS: 0.5}, outputs={"l": "sensor.0", "r": "sensor.1"}, starts=1)
    assert fit.values[MASS] == pytest.approx(0.4, rel=5e-3)
