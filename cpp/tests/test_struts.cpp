// Struts and tendons of every instruction set, against virtual work in the oracle.
#include "batches.hpp"
#include "flexarm/kinematics.hpp"
#include "kernels.hpp"

namespace test_struts {
using namespace flexarm;
using flexarm_test::tied;

TEST_CASE("struts and tendons on arms in the plane and in space, chains and trees, of every order") {
  for (int order : {0, 1, 2, 3, kExact}) {
    CAPTURE(order);
    const double bent = order == 0 ? 0.003 : 0.1;
    flexarm_test::check(tied(flexarm_test::flat({0, 0, 1}, {2, 0, 0, 0, 0}, order, 0.02)), true, {}, bent);
    flexarm_test::check(tied(flexarm_test::flat({0, 1, 0}, {0, 2, 0, 0, 1}, order)), true, {}, bent);
    flexarm_test::check(tied(flexarm_test::flat_tree(order)), true, {}, bent);
    flexarm_test::check(tied(flexarm_test::spatial_arm(order)), false, {}, bent);
    flexarm_test::check(tied(flexarm_test::tree_arm(order)), false, {}, bent);
  }
  flexarm_test::check(tied(flexarm_test::floating_arm()), false);
  std::vector<bool> some(static_cast<std::size_t>(flexarm_test::tree_arm().nv()), false);
  some[0] = some[6] = true;
  flexarm_test::check(tied(flexarm_test::tree_arm()), false, some);
}

TEST_CASE("the derivatives of struts") {
  for (const Arm& arm : {flexarm_test::flat({0, 0, 1}, {2, 0, 0, 0, 0}, 2, 0.02), flexarm_test::flat_tree(kExact),
                         flexarm_test::spatial_arm(3), flexarm_test::floating_arm()})
    flexarm_test::check_slopes(tied(arm));
}

TEST_CASE("lengths, rates and energy of struts") {
  for (const Arm& base : {flexarm_test::flat_tree(2), flexarm_test::tree_arm(kExact), flexarm_test::floating_arm()}) {
    const Arm arm = tied(base);
    const oracle::Oracle truth(arm);
    Eigen::VectorXd q, v;
    flexarm_test::place(arm, 0.4, q, v);
    Workspace ws(arm);
    StrutMotion found;
    strut_motion(arm, ws, q, v, Eigen::VectorXd::Zero(static_cast<Eigen::Index>(arm.struts().size())), found);
    for (std::size_t k = 0; k < arm.struts().size(); ++k) {
      const auto expected = truth.stretch(arm.struts()[k], q);
      const auto column = static_cast<Eigen::Index>(k);
      CHECK(found.motion(0, column) == doctest::Approx(expected.length).epsilon(1e-12));
      CHECK((found.jacobian.col(column) - expected.by_rates).norm() < 1e-12 * expected.by_rates.norm());
      CHECK(found.motion(1, column) == doctest::Approx(expected.by_rates.dot(v)).epsilon(1e-11));
    }
    CHECK(energy(arm, ws, q, v).potential == doctest::Approx(truth.potential(q)).epsilon(1e-11));
  }
}

TEST_CASE("a load in a strut pushes with it") {
  const Arm arm = tied(flexarm_test::flat_tree(2));
  const std::vector<Load> loads{Load::on_strut(arm, 2), Load::at_end(arm, 1, true), Load::on_strut(arm, 0)};
  std::vector<double> wrenches(18, 0.0);
  wrenches[0] = -20.0;
  wrenches[7] = 3.0;
  wrenches[12] = 7.0;
  oracle::Oracle truth(arm, {}, loads);
  for (std::size_t k = 0; k < 3; ++k) truth.wrenches[k] = Eigen::Map<const Vec6<double>>(wrenches.data() + 6 * k);
  Eigen::VectorXd q, v, a = flexarm_test::wave(arm.nv(), 0.2, 1.0), tau(arm.nv());
  flexarm_test::place(arm, 0.4, q, v);
  const Eigen::VectorXd expected = truth.inverse(q, v, a);
  for (const lanes::Kernels* kernels : flexarm_test::all_kernels()) {
    flexarm_test::OnKernels on(arm, *kernels, {}, loads);
    kernels->load(on.memory.get(), wrenches.data());
    kernels->inverse(on.memory.get(), q.data(), v.data(), a.data(), tau.data());
    CHECK((tau - expected).norm() < 1e-12 * expected.norm());
  }
  CHECK_THROWS_WITH_AS(Load::on_strut(arm, 4), "strut = 4: there is no such strut", std::invalid_argument);
}

TEST_CASE("arms with struts in a pack move as they do alone") {
  const Arm arm = tied(flexarm_test::flat({0, 0, 1}, {2, 0, 0, 0, 0}, 2, 0.01)),
            other = tied(flexarm_test::flat({0, 0, 1}, {2, 0, 0, 0, 0}, 2, 0.02));
  constexpr int kScenarios = 7, kSteps = 40;
  Eigen::MatrixXd q0(arm.nq(), kScenarios), v0(arm.nv(), kScenarios);
  for (int b = 0; b < kScenarios; ++b) {
    Eigen::VectorXd q, v;
    flexarm_test::place(arm, 0.3 * b, q, v);
    q0.col(b) = 1e-2 * q;
    v0.col(b) = 1e-2 * v;
  }
  const auto run = [&](bool side_by_side) {
    BatchProblem p = flexarm_test::batch_of({&arm, &other, &arm, &arm, &other, &arm, &arm}, kScenarios, 1e-3, kSteps);
    flexarm_test::begin_at(p, q0, v0, 0);
    p.method.name = "implicit";
    p.lanes = side_by_side;
    Eigen::MatrixXd q(2 * arm.nq(), kScenarios);
    std::vector<int> status(kScenarios);
    BatchOutput out;
    out.q = q.data();
    out.status = status.data();
    run_batch(p, out, 1);
    for (const int s : status) CHECK(s == 0);
    return q;
  };
  const Eigen::MatrixXd all = run(true), alone = run(false);
  CHECK(alone.allFinite());
  CHECK((all - alone).cwiseAbs().maxCoeff() < 1e-10 * alone.cwiseAbs().maxCoeff());
  CHECK((alone.bottomRows(arm.nq()) - alone.topRows(arm.nq())).cwiseAbs().maxCoeff() > 1e-3);
}

TEST_CASE("bad struts") {
  using P = Strut::Point;
  const Arm base = flexarm_test::flat_tree(2);
  const auto make = [&](const Strut& strut) { return Arm(base.links(), base.gravity(), base.seats(), {strut}); };
  const P a{-1, P::end, 0.0, {1, 0, 0}}, b{0, P::end, 0.0, {0, 0, 0}};
  CHECK_THROWS_WITH_AS(make({{a}}), "struts[0].points = 1 points: must be two or more", std::invalid_argument);
  CHECK_THROWS_WITH_AS(make({{a, b}, -1.0}), "struts[0].stiffness = -1: must not be negative, and finite",
                       std::invalid_argument);
  CHECK_THROWS_WITH_AS(make({{a, {9, P::end, 0.0, {0, 0, 0}}}}), "struts[0].points[1].link = 9: there is no such link",
                       std::invalid_argument);
  CHECK_THROWS_AS(make({{a, {0, P::slice, 7.0, {0, 0, 0}}}}), std::invalid_argument);
  CHECK_THROWS_AS(make({{a, {2, P::slice, 0.1, {0, 0, 0}}}}), std::invalid_argument);  // rigid
}

namespace {

/// A law that is curved in everything that it is asked with.
Vec6<double> drag(double t, const Eigen::Vector3d& p, const Eigen::Matrix3d& R, const Vec6<double>& u) {
  Vec6<double> out;
  out.head<3>() = (1.0 + t) * p.cross(R.col(1)) - u.head<3>() * u.head<3>().norm();
  out.tail<3>() = 0.3 * R.col(0) - 0.2 * u.tail<3>() * p.squaredNorm();
  return out;
}

/// On ends and slices, in both axes.
std::vector<Load> by_state(const Arm& arm) {
  const auto law = std::make_shared<const StateForce>(drag);
  std::vector<Load> loads;
  for (const bool world : {true, false})
    for (std::size_t n = 0; n < arm.size(); ++n) {
      loads.push_back(arm.link(n).beam() && n % 2 == 0 ? Load::at_slice(arm, n, 0.2, world)
                                                       : Load::at_end(arm, n, world));
      loads.back().by_state = law;
    }
  return loads;
}

}  // namespace

TEST_CASE("loads by the state of their slice") {
  for (const Arm& arm : {flexarm_test::flat({0, 1, 0}, {0, 2, 0, 0, 1}, 2), flexarm_test::flat_tree(kExact),
                         flexarm_test::spatial_arm(3), tied(flexarm_test::floating_arm())}) {
    const std::vector<Load> loads = by_state(arm);
    const int nq = arm.nq(), nv = arm.nv();
    Eigen::VectorXd q, v, a = flexarm_test::wave(nv, 0.2, 1.0), tau(nv), wrenches(6 * loads.size());
    flexarm_test::place(arm, 0.4, q, v);
    std::vector<Load> plain = loads;
    for (Load& load : plain) load.by_state = nullptr;
    oracle::Oracle truth(arm, {}, plain);
    wrenches.setZero();
    for (std::size_t k = 0; k < loads.size(); ++k) {
      const Load& load = loads[k];
      const SliceTable* slice = load.points.empty() ? nullptr : &load.points[0].slice;
      const oracle::Pose pose = truth.pose(load.link, slice, q);
      truth.wrenches[k] = drag(0.5, pose.p, pose.R, truth.jacobian(load.link, slice, q) * v);
      wrenches[6 * static_cast<Eigen::Index>(k)] = 0.5;  // the time
    }
    const Eigen::VectorXd expected = truth.inverse(q, v, a);
    for (const lanes::Kernels* kernels : flexarm_test::all_kernels()) {
      CAPTURE(std::string(kernels->name));
      flexarm_test::OnKernels on(arm, *kernels, {}, loads);
      void* self = on.memory.get();
      const auto forces = [&](const Eigen::VectorXd& at_q, const Eigen::VectorXd& at_v) {
        kernels->inverse(self, at_q.data(), at_v.data(), a.data(), tau.data());
        return Eigen::VectorXd(tau);
      };
      kernels->load(self, wrenches.data());
      CHECK((forces(q, v) - expected).norm() < 1e-11 * expected.norm());
      Eigen::VectorXd x = a;
      CHECK(kernels->forward(self, q.data(), v.data(), expected.data(), x.data()) == lanes::Outcome::good);
      CHECK((x - a).norm() < 1e-5 * a.norm());
      const lanes::KernelArm known = lanes::KernelArm::of(arm).loaded(arm, loads),
                             grouped = known.grouped(kernels->width, {});
      const lanes::SlopesOf of{known.layout(), grouped.layout(), known.numbers().data(), grouped.numbers().data(),
                               nullptr};
      const lanes::Memory memory(kernels->slopes_memory(of));
      Eigen::MatrixXd found(nv, nq + nv), differences(nv, nq + nv);
      kernels->inverse_slopes(of, memory.get(), wrenches.data(), q.data(), v.data(), a.data(), found.data(),
                              found.data() + nv * nq, nullptr);
      for (int k = 0; k < nq; ++k)
        differences.col(k) = flexarm_test::slope([&](const Eigen::VectorXd& at) { return forces(at, v); }, q,
                                                 Eigen::VectorXd::Unit(nq, k), 1e-5);
      for (int k = 0; k < nv; ++k)
        differences.col(nq + k) = flexarm_test::slope([&](const Eigen::VectorXd& at) { return forces(q, at); }, v,
                                                      Eigen::VectorXd::Unit(nv, k), 1e-3);
      CHECK((found - differences).norm() < 1e-7 * differences.norm());
      // the matrix of an implicit step has their slopes: by q at rest, where no ball's axes turn, and by v
      const lanes::Shift damping{1e-3, 0.0};
      double twice = 0.0;
      kernels->move(self, q.data(), v.data());
      REQUIRE(kernels->factor(self, damping, v.data(), &twice) == lanes::Outcome::good);
      kernels->solve(self, tau.data(), x.data());
      Eigen::MatrixXd S = truth.shifted(q, v, damping.damping, 0.0), by_load = found.rightCols(nv);
      Workspace ws(arm);
      InverseDerivatives without(arm, plain);
      for (std::size_t k = 0; k < loads.size(); ++k) without.set_wrench(k, truth.wrenches[k]);
      without(arm, q, v, a);
      S += damping.damping * (by_load - without.dv);
      const Eigen::VectorXd right = S.partialPivLu().solve(tau);
      CHECK((x - right).norm() < 1e-6 * right.norm());
    }
  }
}

}  // namespace test_struts
