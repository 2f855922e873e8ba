"""What the programs behind docs/speed.md make of what they measured."""

from pathlib import Path

import numpy as np
import pytest

BENCH = Path(__file__).resolve().parents[2] / "bench" / "speed"
DUMP = """# callgrind format
positions: instr line
events: Ir D1mr
summary: 38 2

ob=(1) /some/library
fn=(1) f
0x100 7 10 2
+4 7 10
* +1 3
calls=2 0x900
+4 * 500
-8 9 5
cob=(2) /some/program
cfn=(2) g
calls=1 0x20
0x104 9 90

ob=(2)
fn=(2)
0x20 1 6
+3 1 4
"""


@pytest.fixture
def bench(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCH))


def test_a_callgrind_dump_is_counted_where_it_was_spent(bench, tmp_path):
    import counts

    (tmp_path / "dump").write_text(DUMP)
    events, where = counts.executed(tmp_path / "dump")
    assert events == {"Ir": 38, "D1mr": 2}
    assert sum(c.total() for c in where.values()) == 38
    assert where["/some/library"] == {0x100: 15, 0x104: 13}
    assert where["/some/program"] == {0x20: 6, 0x23: 4}


@pytest.mark.parametrize(
    ("instruction", "operands", "expected"),
    [
        ("addsd", "0x8(%rax),%xmm1", 1),
        ("mulpd", "%xmm1,%xmm2", 2),
        ("vmulpd", "(%rax),%ymm1,%ymm2", 4),
        ("vfmadd231sd", "%xmm1,%xmm2,%xmm3", 2),
        ("vfnmadd213pd", "%zmm1,%zmm2,%zmm3", 16),
        ("sqrtsd", "%xmm1,%xmm2", 1),
        ("movapd", "%xmm1,%xmm2", 0),
        ("addps", "%xmm1,%xmm2", 0),
    ],
)
def test_arithmetic_on_doubles_is_told_from_other_instructions(bench, instruction, operands, expected):
    import counts

    assert counts.operations_of(instruction, operands) == expected


@pytest.mark.parametrize(
    ("instruction", "operands", "expected"),
    [
        ("vmovapd", "0x20(%rax,%rbx,8),%ymm1", True),
        ("vmovapd", "%ymm1,0x20(%rax)", False),
        ("vfmadd231pd", "0x10(%rip),%ymm1,%ymm2        # 40 <x+0x10>", True),
        ("cmp", "%rax,0x8(%rdi)", True),
        ("lea", "0x8(%rax),%rbx", False),
    ],
)
def test_loads_are_told_from_stores(bench, instruction, operands, expected):
    import lanes

    assert lanes.is_load(instruction, operands) is expected


def test_lanes_pay_from_the_batch_after_which_all_are_faster(bench):
    import speed_batch

    def rows(*us):
        return [{"count": 2**k, "us": x} for k, x in enumerate(us)]

    assert speed_batch.crossover(rows(10, 10, 5, 2), 10.0) == "4"
    assert speed_batch.crossover(rows(10, 5, 10, 2), 10.0) == "8"  # once more slower
    assert speed_batch.crossover(rows(10, 10, 10, 9.5), 10.0) == "never"
    assert speed_batch.crossover(rows(5, 4), 10.0) == "1"


def test_the_fastest_run_that_is_accurate_enough_is_found_and_failures_are_not(bench):
    import speed_batch

    runs = [
        {"batch": 9, "error": None},
        {"batch": 5, "error": 1e-2},
        {"batch": 3, "error": 1e-3},
        {"batch": 2, "error": 1e-4},
    ]
    assert speed_batch.fastest(runs, 1e-3) == runs[2]
    assert speed_batch.fastest(runs, 1e-5) is None


def test_a_ratio_says_by_how_much_its_aim_is_missed(bench):
    import speed_common

    assert speed_common.ratio(0.3, 0.4, below=True) == "**0.3** (aim ≤ 0.4: met)"
    assert "by a factor of 2" in speed_common.ratio(0.8, 0.4, below=True)
    assert "by a factor of 3" in speed_common.ratio(10.0, 30.0, below=False)
    assert "not measured" in speed_common.ratio(float("nan"), 30.0, below=False)


def test_aims_are_of_medians_of_ratios_of_the_same_round(bench):
    import aims

    times = {"a": np.array([1.0, 2.0, 30.0]), "b": np.array([2.0, 4.0, 5.0])}
    assert aims.Aim("", 1.0, "a").value(times) == 2.0
    assert aims.Aim("", 1.0, "a", "b", "one by one").value(times) == 0.5
    assert aims.Aim("", 1.0, "b", "a", "% more").value(times) == 100.0
    wanted = aims.aims(["x"], ["y"])
    assert wanted[-1].work == "python: y" and (wanted[-2].work, wanted[-2].base) == ("one: x", "alone: x")


def test_aims_against_exudyn_are_of_its_setting_and_of_fronts(bench):
    import peer_report

    def run(case, method, error, cpu_s, setting=""):
        return {"case": case, "method": method, "setting": setting, "error": error, "cpu_s": cpu_s}

    runs = [
        run("a", *peer_report.EXUDYN[:1], 4e-6, 0.1, peer_report.EXUDYN[1]),
        run("a", "flexarm gauss", 1e-5, 1e-3),
        run("a", "flexarm ida", 1e-5, 4e-3),
        run("a", "flexarm gauss", 1e-4, 1e-4),
        run("c", "Exudyn exact", 1e-5, 0.05),
        run("c", "flexarm gauss", 1e-5, 0.01),
    ]
    found = [ratio for _, ratio, _ in peer_report.aims(runs)]
    assert found == pytest.approx([100, 25, None, 5])  # at 1e-6 m neither has a run


def test_settings_that_failed_are_one_line_for_each_case_and_method(bench):
    import peer_report

    def run(case, method, setting, note=""):
        return {"case": case, "method": method, "setting": setting, "error": None, "note": note}

    said = "stopped at t = {t} s: the motion ran away in steps of {h} s; it grows: take a smaller step (rk4 is stable "
    said += "below 2.83 over the highest frequency, here 704 rad/s of link 0 bending_y 2: below {limit} s), or another"
    rk4 = "flexarm rk4, order exact"
    failed = [
        run("a", rk4, "3 legendre modes, step 0.005 s", said.format(t=0.1, h=0.005, limit=0.00402)),
        run("a", f"{rk4}, all strains", "6 legendre modes, step 0.0025 s", said.format(t=0.2, h=1e-3, limit=0.000472)),
        run("a", "Exudyn ANCF", "8 elements, step 0.01 s", "solver failed: not converged"),
        run("b", rk4, "3 legendre modes, step 0.005 s", "the motion ran away"),
        run("b", "MuJoCo", "8 elements"),
    ]
    assert peer_report.failures(failed) == [
        "- a: 2 of flexarm rk4, in steps of 0.0025 to 0.005 s: the motion ran away; "
        "the longest stable step of these models is 0.000472 to 0.00402 s",
        "- a: 1 of Exudyn ANCF, in steps of 0.01 s: solver failed",
        "- b: 1 of flexarm rk4, in steps of 0.005 s: the motion ran away",
        "- b: 1 of MuJoCo",
    ]


def test_coordinates_of_rods_are_sorted_for_the_peer(bench):
    import peer_rods

    rods = peer_rods.Rods("", 2, 2, 1, 1, True, (0, 0, 0), 5)
    x = np.arange(10.0)  # joint, two along y, one along z, torsion; twice
    np.testing.assert_array_equal(peer_rods.soromox_order(rods, x), [0, 4, -3, 1, 2, 5, 9, -8, 6, 7])
