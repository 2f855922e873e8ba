"""Logs of ROS 2, written by two libraries that know nothing of flexarm, and read as data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns

pytest.importorskip("rosbags", exc_type=ImportError)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
BEGIN = 1_700_000_000 * 10**9  # ns
TIMES = 0.01 * np.arange(50) + 0.002
JOINTS = ["shoulder", "elbow_deg"]  # whose end is no unit
POSITIONS = np.column_stack([np.sin(TIMES), np.cos(3 * TIMES)])
EFFORTS = 0.1 * POSITIONS


def message(of: str, **values: Any) -> Any:
    return STORE.types[of](**values)


def header(t: float, begin: int = BEGIN) -> Any:
    stamp = begin + round(t * 1e9)
    time = message("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
    return message("std_msgs/msg/Header", stamp=time, frame_id="base")


def joints(t: float, names: list[str], positions: Any, efforts: Any, begin: int = BEGIN) -> Any:
    return message("sensor_msgs/msg/JointState", header=header(t, begin), name=names, position=np.array(positions),
                   velocity=np.zeros(0), effort=np.array(efforts))  # fmt: skip


def wrench(t: float, force: float) -> Any:
    vector = STORE.types["geometry_msgs/msg/Vector3"]
    both = message("geometry_msgs/msg/Wrench", force=vector(force, 0.0, -1.0), torque=vector(0.0, 0.0, 2 * force))
    return message("geometry_msgs/msg/WrenchStamped", header=header(t), wrench=both)


def states(begin: int = BEGIN) -> list[tuple[int, str, Any]]:
    """Messages by the time at which they came: 3 ms late; the joints of every second one in the other order."""
    found = []
    for k, t in enumerate(TIMES):
        turned = slice(None, None, -1 if k % 2 else 1)
        one = joints(t, JOINTS[turned], POSITIONS[k, turned], EFFORTS[k, turned], begin)
        found.append((BEGIN + round((t + 0.003) * 1e9), "/joint_states", one))
    return found


def others() -> list[tuple[int, str, Any]]:
    array, layout = STORE.types["std_msgs/msg/Float64MultiArray"], STORE.types["std_msgs/msg/MultiArrayLayout"]
    found = [(BEGIN + 10**7 * k, "/wrench", wrench(0.01 * k, float(k))) for k in range(20)]
    found += [(BEGIN + 10**7 * k, "/strain", array(layout([], 0), np.array([k, 2.0 * k]))) for k in range(20)]
    return [*found, (BEGIN, "/said", message("std_msgs/msg/String", data="hello"))]


def bag(folder: Path, plugin: StoragePlugin, messages: list[tuple[int, str, Any]]) -> Path:
    with Writer(folder, version=9, storage_plugin=plugin) as file:
        known = {}
        for _, topic, one in messages:
            if topic not in known:
                known[topic] = file.add_connection(topic, one.__msgtype__, typestore=STORE)
        for stamp, topic, one in sorted(messages, key=lambda x: x[0]):
            file.write(known[topic], stamp, STORE.serialize_cdr(one, one.__msgtype__))
    return folder


def same_joints(data: fa.Data) -> None:
    np.testing.assert_allclose(data.t, TIMES, atol=1e-9)
    for name, position, effort in zip(JOINTS, POSITIONS.T, EFFORTS.T, strict=True):
        np.testing.assert_array_equal(data[f"position/{name}"], position)
        np.testing.assert_array_equal(data[f"effort/{name}"], effort)


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_a_bag_gives_its_joints_by_name(tmp_path: Path, plugin: StoragePlugin) -> None:
    """As a folder, and as the file in it; velocities that no message has are left out, which is told."""
    first = [(BEGIN, "/said", message("std_msgs/msg/String", data="hello"))]  # the log begins with it
    folder = bag(tmp_path / "bag", plugin, [*first, *states(), *others()])
    (file,) = (x for x in folder.iterdir() if x.suffix in (".mcap", ".db3"))
    for path in (folder, file):
        with warns(fa.errors.DataWarning, "velocity/shoulder", "velocity/elbow_deg"):
            same_joints(fa.Data.load(path))
    wanted = [f"position/{name}" for name in JOINTS]
    data = fa.Data.load(folder, key="/joint_states", columns=wanted, units={wanted[1]: "deg"})
    assert data.names == tuple(wanted)
    np.testing.assert_allclose(data[wanted[1]], np.radians(POSITIONS[:, 1]))


def test_other_topics_are_read_by_the_paths_of_their_numbers(tmp_path: Path) -> None:
    folder = bag(tmp_path / "bag", StoragePlugin.MCAP, [*states(), *others()])
    data = fa.Data.load(folder, key="/wrench")
    assert data.names == tuple(f"wrench/{kind}/{axis}" for kind in ("force", "torque") for axis in "xyz")
    np.testing.assert_array_equal(data["wrench/torque/z"], 2 * data["wrench/force/x"])
    np.testing.assert_allclose(data.t, 0.01 * np.arange(20), atol=1e-9)
    strain = fa.Data.load(folder, key="/strain")
    np.testing.assert_array_equal(strain["data_1"], 2.0 * np.arange(20))  # without a header: the times of the log
    np.testing.assert_allclose(strain.t, 0.01 * np.arange(20), atol=1e-9)


def test_a_file_of_mcaps_own_library(tmp_path: Path) -> None:
    writing = pytest.importorskip("mcap_ros2.writer")
    path = tmp_path / "run.mcap"
    definition = STORE.generate_msgdef("sensor_msgs/msg/JointState", ros_version=2)[0]
    with path.open("wb") as f:
        file = writing.Writer(f)
        schema = file.register_msgdef("sensor_msgs/msg/JointState", definition)
        for t, position in zip(TIMES, POSITIONS, strict=True):
            stamp = BEGIN + round(t * 1e9)
            head = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}
            zero = {"velocity": [0.0, 1.0], "effort": [0.0, 0.0]}
            one = {"header": head, "name": JOINTS, "position": list(position), **zero}
            file.write_message("/joints", schema, one, log_time=stamp, publish_time=stamp)
        file.finish()
    data = fa.Data.load(path)
    np.testing.assert_array_equal(data["position/elbow_deg"], POSITIONS[:, 1])
    np.testing.assert_allclose(data.t, TIMES - TIMES[0], atol=1e-9)
    whole = path.read_bytes()
    for size in (len(whole) - 40, len(whole) // 2, 100, 5):
        path.write_bytes(whole[:size])
        with refuses("run.mcap", "whole log of ROS 2"):
            fa.Data.load(path)


def test_a_simulated_clock_keeps_its_times(tmp_path: Path) -> None:
    folder = bag(tmp_path / "bag", StoragePlugin.SQLITE3, states(begin=5 * 10**9))
    data = fa.Data.load(folder, columns=["position/shoulder"])
    np.testing.assert_allclose(data.t, 5 + TIMES, atol=1e-9)


def test_a_fit_takes_a_log(tmp_path: Path) -> None:
    """A body of 0.4 kg m² under a constant torque, by its closed form: what the arm's 0.25 kg m² lack is found."""
    joint = fa.Revolute("z", reflected_inertia=0.05)
    arm = fa.Arm([fa.Link(joint, fa.RigidBody(1.0, inertia=(1, 1, 0.25)))], gravity=(0, 0, 0))
    messages = [(BEGIN + round(t * 1e9), "/joint_states", joints(t, ["base"], [0.5 * 2.0 * t**2 / 0.4], [2.0]))
                for t in np.linspace(0, 1, 101)]  # fmt: skip
    data = fa.Data.load(bag(tmp_path / "bag", StoragePlugin.MCAP, messages), columns=["position/base", "effort/base"])
    options = {"integrator": "implicit", "step": 0.01}
    guess = fa.Scene(arm, {0: fa.Torque(0.0)}, sensors=(fa.sensors.Encoder(0),), options=options)
    found = fa.identify(guess, data, {"link.0.joint.reflected_inertia": None}, inputs={0: "effort/base"},
                        outputs={"position/base": "sensor.0"})  # fmt: skip
    assert found.values["link.0.joint.reflected_inertia"] == pytest.approx(0.4 - 0.25, rel=1e-4)


@pytest.mark.parametrize(
    ("load", "named"),
    [
        ({"key": "/joint_state"}, ("/joint_state", "/joint_states", "/wrench", "sensor_msgs/msg/JointState")),
        ({"key": "/said"}, ("/said", "std_msgs/msg/String", "no numbers", "/strain")),
        ({"columns": ["position/wrist"]}, ("position/wrist", "position/shoulder")),
    ],
)
def test_what_a_log_lacks_is_named(tmp_path: Path, load: dict[str, Any], named: tuple[str, ...]) -> None:
    folder = bag(tmp_path / "bag", StoragePlugin.MCAP, [*states(), *others()])
    with refuses("bag", *named):
        fa.Data.load(folder, **load)


def test_topics_and_joints_that_are_not_clear_are_refused(tmp_path: Path) -> None:
    with refuses("key", "/wrench", "/strain"):
        fa.Data.load(bag(tmp_path / "two", StoragePlugin.MCAP, others()))
    hand = [(BEGIN + 10**9, "/joint_states", joints(1.0, ["finger"], [0.1], [0.2]))]
    with refuses("/joint_states", "shoulder", "finger"):
        fa.Data.load(bag(tmp_path / "hand", StoragePlugin.MCAP, [*states(), *hand]))
    short = [(BEGIN, "/joint_states", joints(0.0, JOINTS, [0.1], []))]
    with refuses("/joint_states", "1 numbers of position", "2 joints"):
        fa.Data.load(bag(tmp_path / "short", StoragePlugin.MCAP, short))
    (tmp_path / "short" / "metadata.yaml").unlink()  # as where the recorder was killed
    with refuses("short", "metadata.yaml", ".mcap"):
        fa.Data.load(tmp_path / "short")
    with refuses("key", "/wrench"):
        fa.Data.load("x.csv", key="/wrench")


def test_a_damaged_database_is_told(tmp_path: Path) -> None:
    folder = bag(tmp_path / "bag", StoragePlugin.SQLITE3, states())
    (file,) = folder.glob("*.db3")
    file.write_bytes(file.read_bytes()[:5000])
    with refuses("bag", "whole log of ROS 2"):
        fa.Data.load(folder)
