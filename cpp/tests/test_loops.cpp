// Closed loops of every instruction set: equations of the joints written once more on the oracle's poses, and its mass
// matrix with their forces.
#include "batches.hpp"
#include "flexarm/derivatives.hpp"
#include "flexarm/kinematics.hpp"
#include "kernels.hpp"

namespace test_loops {
using namespace flexarm;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using P = Strut::Point;

namespace {

constexpr double kRigid = std::numeric_limits<double>::infinity();

/// The joint's frame on a side.
oracle::Pose frame_of(const Arm& arm, const oracle::Oracle& truth, const Loop::Side& side, const VectorXd& q) {
  oracle::Pose on;
  if (side.at.link >= 0) {
    const auto link = static_cast<std::size_t>(side.at.link);
    if (side.at.on == P::origin) {
      on = truth.link_pose(link, q);
    } else if (side.at.on == P::slice) {
      const SliceTable table = arm.link(link).slice_at(side.at.x);
      on = truth.pose(link, &table, q);
    } else {
      on = truth.pose(link, nullptr, q);
    }
  }
  return {on.p + on.R * side.at.offset, on.R * side.axes};
}

/// g of all rows.
VectorXd equations(const Arm& arm, const oracle::Oracle& truth, const VectorXd& q) {
  std::vector<double> out;
  for (const Loop& loop : arm.loops()) {
    const oracle::Pose a = frame_of(arm, truth, loop.a, q), b = frame_of(arm, truth, loop.b, q);
    const Matrix3d R = a.R.transpose() * b.R;
    const Vector3d d = a.R.transpose() * (b.p - a.p);
    const bool slides = loop.kind == Loop::prismatic || loop.kind == Loop::cylindrical;
    for (int k = 0; k < 3; ++k)
      if (!(slides && k == 2) && !(loop.kind == Loop::planar && k < 2)) out.push_back(d[k]);
    if (loop.kind == Loop::fixed || loop.kind == Loop::prismatic)
      for (const double x : {R(1, 2), R(2, 0), R(0, 1)}) out.push_back(x);
    if (loop.kind == Loop::revolute || loop.kind == Loop::cylindrical || loop.kind == Loop::planar)
      for (const double x : {R(0, 2), R(1, 2)}) out.push_back(x);
    if (loop.kind == Loop::universal) out.push_back(R(0, 1));
  }
  return Eigen::Map<VectorXd>(out.data(), static_cast<Eigen::Index>(out.size()));
}

std::vector<bool> rigid_rows(const Arm& arm) {
  std::vector<bool> out;
  for (const Loop& loop : arm.loops())
    for (const Loop::Row& r : loop.rows()) out.push_back(std::isinf(r.turns ? loop.angular_stiffness : loop.stiffness));
  return out;
}

/// dg/dq (rows x nv), of arms without balls.
MatrixXd slopes_of(const Arm& arm, const oracle::Oracle& truth, const VectorXd& q) {
  MatrixXd out(equations(arm, truth, q).size(), arm.nv());
  for (int k = 0; k < arm.nv(); ++k)
    out.col(k) = flexarm_test::slope([&](const VectorXd& x) { return equations(arm, truth, x); }, q,
                                     VectorXd::Unit(arm.nv(), k), 1e-4);
  return out;
}

Matrix3d turned(double angle) { return Eigen::AngleAxisd(angle, Vector3d(1, 2, 2) / 3.0).toRotationMatrix(); }

Arm with_loops(const Arm& arm, std::vector<Loop> loops) {
  return Arm(arm.links(), arm.gravity(), arm.seats(), {}, {}, std::move(loops));
}

Loop loop(Loop::Kind kind, const P& a, const P& b, const Matrix3d& axes_a, const Matrix3d& axes_b,
          double stiffness = kRigid, double angular = kRigid) {
  return {{a, axes_a},
          {b, axes_b},
          kind,
          stiffness,
          std::isinf(stiffness) ? 0.0 : 3.0,
          angular,
          std::isinf(angular) ? 0.0 : 0.2};
}

/// Of each kind: between the world and the last link, and two links.
std::vector<Arm> closed(const Arm& base, int last) {
  const P ground{-1, P::end, 0.0, {0.2, 0.1, -0.3}}, tip{last, P::end, 0.0, {0.02, 0.01, 0.03}},
      inner{1, P::slice, 0.2, {0.01, -0.02, 0.0}}, own{last, P::origin, 0.0, {0.0, 0.05, 0.01}};
  std::vector<Arm> out;
  for (const Loop::Kind kind : {Loop::fixed, Loop::revolute, Loop::prismatic, Loop::cylindrical, Loop::universal,
                                Loop::planar, Loop::spherical})
    out.push_back(with_loops(base, {loop(kind, ground, tip, turned(0.3), turned(-0.4))}));
  out.push_back(with_loops(base, {loop(Loop::cylindrical, inner, own, turned(0.8), turned(0.1)),
                                  loop(Loop::revolute, ground, tip, turned(0.2), turned(0.1), 200.0, 5.0)}));
  out.push_back(with_loops(base, {loop(Loop::revolute, tip, ground, turned(0.2), turned(0.1), kRigid, 5.0)}));
  return out;
}

/// In the plane: the axes have z as one of theirs.
std::vector<Arm> closed_flat(const Arm& base) {
  const int last = static_cast<int>(base.size()) - 1;
  const P ground{-1, P::end, 0.0, {0.2, 0.1, 0.0}}, tip{last, P::end, 0.0, {0.02, 0.01, 0.0}};
  const Matrix3d about = Eigen::AngleAxisd(0.6, Vector3d::UnitZ()).toRotationMatrix();
  Matrix3d along;
  along << 0, 0, 1, 1, 0, 0, 0, 1, 0;  // its third axis is x
  return {with_loops(base, {loop(Loop::revolute, ground, tip, about, Matrix3d::Identity())}),
          with_loops(base, {loop(Loop::prismatic, ground, tip, about * along, along)}),
          with_loops(base, {loop(Loop::revolute, ground, tip, about, Matrix3d::Identity(), 300.0)}),
          with_loops(base, {loop(Loop::fixed, tip, ground, about, Matrix3d::Identity(), kRigid, 4.0)})};
}

double size(const VectorXd& x) { return x.norm() + 1e-300; }

/// The part of x that no columns of A make.
double beyond(const MatrixXd& A, const VectorXd& x) {
  if (A.norm() == 0.0) return x.norm();
  return (x - A * A.colPivHouseholderQr().solve(x)).norm();
}

void check(const Arm& arm, const std::vector<bool>& given = {}) {
  const oracle::Oracle truth(arm, given);
  VectorXd q, v;
  flexarm_test::place(arm, 0.4, q, v);
  const VectorXd tau = flexarm_test::wave(arm.nv(), 0.3, 2.0);
  const MatrixXd G = slopes_of(arm, truth, q).transpose();
  const VectorXd g = equations(arm, truth, q);
  Workspace ws(arm, given);
  CAPTURE(std::string(Loop::name(arm.loops()[0].kind)));
  Eigen::Matrix2Xd found;
  loop_motion(arm, ws, q, v, found);
  CHECK((found.row(0).transpose() - g).norm() < 1e-13);
  CHECK((found.row(1).transpose() - G.transpose() * v).norm() < 1e-9 * size(G.transpose() * v));

  // forces of compliant rows, columns of rigid ones
  const std::vector<bool> rigid = rigid_rows(arm);
  VectorXd springs = VectorXd::Zero(arm.nv());
  std::vector<int> hard;
  std::size_t row = 0;
  for (const Loop& one : arm.loops())
    for (const Loop::Row& r : one.rows()) {
      const auto k = static_cast<Eigen::Index>(row);
      const double stiffness = r.turns ? one.angular_stiffness : one.stiffness,
                   damping = r.turns ? one.angular_damping : one.damping;
      if (rigid[row])
        hard.push_back(static_cast<int>(row));
      else
        springs -= G.col(k) * (stiffness * g[k] + damping * G.col(k).dot(v));
      ++row;
    }
  MatrixXd H(arm.nv(), static_cast<Eigen::Index>(hard.size()));
  for (std::size_t k = 0; k < hard.size(); ++k) H.col(static_cast<Eigen::Index>(k)) = G.col(hard[k]);
  MatrixXd H_free = H;
  for (std::size_t k = 0; k < given.size(); ++k)
    if (given[k]) H_free.row(static_cast<Eigen::Index>(k)).setZero();

  for (const lanes::Kernels* kernels : flexarm_test::all_kernels()) {
    CAPTURE(std::string(kernels->name));
    flexarm_test::OnKernels on(arm, *kernels, given);
    void* self = on.memory.get();
    VectorXd a = flexarm_test::wave(arm.nv(), 0.1, 3.0);
    REQUIRE(kernels->forward(self, q.data(), v.data(), tau.data(), a.data()) == lanes::Outcome::good);
    // M a - (tau - h) lies in the columns
    VectorXd left = truth.inverse(q, v, a) - tau - springs;
    for (std::size_t k = 0; k < given.size(); ++k)
      if (given[k]) left[static_cast<Eigen::Index>(k)] = 0.0;
    CHECK(beyond(H_free, left) < 1e-8 * size(truth.inverse(q, v, a)));
    // d^2 g / dt^2 = 0
    const auto rates = [&](double t) { return VectorXd(slopes_of(arm, truth, q + t * v) * v); };
    const double h = 1e-4;
    const VectorXd second =
        G.transpose() * a + (8.0 * (rates(h) - rates(-h)) - (rates(2.0 * h) - rates(-2.0 * h))) / (12.0 * h);
    VectorXd terms = VectorXd::Zero(second.size());
    for (Eigen::Index k = 0; k < terms.size(); ++k) terms[k] = G.col(k).cwiseProduct(a).cwiseAbs().sum();
    for (int k : hard) CHECK(std::abs(second[k]) < 1e-8 * terms.norm());

    // solve: [M + shift, -G; G^T, 0]
    const lanes::Shift shift{0.01, 0.002};
    double twice = 0.0;
    REQUIRE(kernels->factor(self, shift, v.data(), &twice) == lanes::Outcome::good);
    MatrixXd S = truth.shifted(q, v, shift.damping, shift.stiffness);
    row = 0;
    for (const Loop& one : arm.loops())
      for (const Loop::Row& r : one.rows()) {
        const auto k = static_cast<Eigen::Index>(row);
        if (!rigid[row++])
          S += G.col(k) * G.col(k).transpose() *
               (shift.stiffness * (r.turns ? one.angular_stiffness : one.stiffness) +
                shift.damping * (r.turns ? one.angular_damping : one.damping));
      }
    VectorXd r = flexarm_test::wave(arm.nv(), 0.7, 1.0), x(arm.nv());
    kernels->solve(self, r.data(), x.data());
    left = S * x - r;
    for (std::size_t k = 0; k < given.size(); ++k)
      if (given[k]) left[static_cast<Eigen::Index>(k)] = 0.0;
    CHECK(beyond(H_free, left) < 1e-8 * size(left + r));
    CHECK((H.transpose() * x).norm() < 1e-9 * (H.norm() + 1e-300) * size(x));
  }
}

/// Exact derivatives of the accelerations on the loops.
void check_slopes(const Arm& arm) {
  VectorXd q, v;
  flexarm_test::place(arm, 0.4, q, v);
  const VectorXd tau = flexarm_test::wave(arm.nv(), 0.3, 2.0);
  Workspace ws(arm);
  const auto forward = [&](const VectorXd& at, const VectorXd& rate, const VectorXd& force) {
    Workspace one(arm);
    REQUIRE(forward_dynamics(arm, one, at, rate, force) == Status::ok);
    return VectorXd(one.a);
  };
  ForwardDerivatives found(arm);
  REQUIRE(found(arm, q, v, tau) == Status::ok);
  CHECK((found.a - forward(q, v, tau)).norm() < 1e-11 * size(found.a));
  for (int k = 0; k < arm.nv(); ++k) {
    const VectorXd one = VectorXd::Unit(arm.nv(), k);
    const VectorXd by_q = flexarm_test::slope([&](const VectorXd& x) { return forward(x, v, tau); }, q, one, 1e-5),
                   by_v = flexarm_test::slope([&](const VectorXd& x) { return forward(q, x, tau); }, v, one, 1e-4),
                   by_tau = flexarm_test::slope([&](const VectorXd& x) { return forward(q, v, x); }, tau, one, 1.0);
    CHECK((found.dq.col(k) - by_q).norm() < 1e-5 * size(by_q));
    CHECK((found.dv.col(k) - by_v).norm() < 1e-5 * (size(by_v) + 1e-3 * size(found.a)));
    CHECK((found.dtau.col(k) - by_tau).norm() < 1e-6 * size(by_tau));
  }
}

}  // namespace

TEST_CASE("loops of every joint on arms in the plane and in space, chains and trees") {
  for (int order : {1, 2, kExact}) {
    CAPTURE(order);
    for (const Arm& arm : closed(flexarm_test::spatial_arm(order), 2)) check(arm);
    for (const Arm& arm : closed_flat(flexarm_test::flat_tree(order))) check(arm);
  }
  for (const Arm& arm : closed(flexarm_test::tree_arm(2), 8)) check(arm);
  std::vector<bool> some(static_cast<std::size_t>(flexarm_test::tree_arm().nv()), false);
  some[0] = some[6] = true;
  for (const Arm& arm : closed(flexarm_test::tree_arm(2), 8)) check(arm, some);
}

TEST_CASE("an arm with loops in a plane stays one in the plane") {
  for (const Arm& arm : closed_flat(flexarm_test::flat_tree(2))) CHECK(lanes::KernelArm::of(arm).layout().planar);
}

TEST_CASE("the derivatives of accelerations on loops") {
  for (const Arm& arm : closed(flexarm_test::spatial_arm(2), 2)) check_slopes(arm);
  for (const Arm& arm : closed_flat(flexarm_test::flat_tree(kExact))) check_slopes(arm);
  check_slopes(closed(flexarm_test::tree_arm(3), 8).back());
}

TEST_CASE("arms with loops in a pack move as they do alone, closed, with their energy") {
  for (const bool planar : {true, false}) {
    const Arm base = planar ? flexarm_test::flat_tree(2) : flexarm_test::spatial_arm(2);
    VectorXd q, v;
    flexarm_test::place(base, 0.3, q, v);
    q *= 1e-2;
    const oracle::Oracle there(base);
    const int last = static_cast<int>(base.size()) - 1;
    const oracle::Pose tip = there.pose(static_cast<std::size_t>(last), nullptr, q);
    const auto make = [&](double stiffness) {
      return with_loops(base, {loop(planar ? Loop::revolute : Loop::spherical, {-1, P::end, 0.0, tip.p},
                                    {last, P::end, 0.0, {0, 0, 0}}, Matrix3d::Identity(), Matrix3d::Identity()),
                               loop(Loop::spherical, {1, P::slice, 0.2, {0, 0, 0}}, {-1, P::end, 0.0, tip.p},
                                    Matrix3d::Identity(), Matrix3d::Identity(), stiffness)});
    };
    const Arm arm = make(50.0), other = make(70.0);
    constexpr int kScenarios = 5, kSteps = 60;
    BatchProblem p = flexarm_test::batch_of({&arm, &other, &arm, &other, &other}, kScenarios, 1e-3, kSteps);
    MatrixXd q0(arm.nq(), kScenarios), v0 = MatrixXd::Zero(arm.nv(), kScenarios);
    q0.colwise() = q;
    flexarm_test::begin_at(p, q0, v0, 0);
    for (const char* method : {"implicit", "rk4"}) {
      CAPTURE(std::string(method));
      if (std::string(method) == "rk4" && !planar) continue;  // its beams are stiff
      p.method.name = method;
      const auto run = [&](bool side_by_side) {
        p.lanes = side_by_side;
        MatrixXd ends(2 * arm.nq(), kScenarios);
        std::vector<int> status(kScenarios);
        BatchOutput out;
        out.q = ends.data();
        out.status = status.data();
        run_batch(p, out, 1);
        for (const int s : status) CHECK(s == 0);
        return ends;
      };
      const MatrixXd all = run(true), alone = run(false);
      CHECK(alone.allFinite());
      CHECK((all - alone).cwiseAbs().maxCoeff() < 1e-9 * alone.cwiseAbs().maxCoeff());
      const VectorXd end = alone.bottomRows(arm.nq()).col(0);
      CHECK((end - q).norm() > 1e-4);
      const VectorXd g = equations(arm, there, end);
      CHECK(g.head(3).norm() < 1e-13);
    }
  }
}

TEST_CASE("bad loops") {
  const Arm base = flexarm_test::spatial_arm();
  const P a{-1, P::end, 0.0, {1, 0, 0}}, b{1, P::end, 0.0, {0, 0, 0}};
  const Matrix3d one = Matrix3d::Identity();
  const auto said = [&](const Loop& wrong) {
    try {
      with_loops(base, {wrong});
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string("nothing");
  };
  CHECK(said(loop(Loop::fixed, a, b, one, one)) == "nothing");
  CHECK(said(loop(Loop::fixed, a, a, one, one)).find("loops[0].b.link = -1") == 0);
  CHECK(said(loop(Loop::fixed, a, b, 2.0 * one, one)).find("loops[0].axes_a") == 0);
  CHECK(said(loop(Loop::fixed, a, b, one, one, -1.0)).find("loops[0].stiffness = -1") == 0);
  CHECK(said({{a, one}, {b, one}, Loop::fixed, kRigid, 1.0}).find("loops[0].damping = 1") == 0);
  CHECK(said(loop(Loop::fixed, a, {7, P::end, 0.0, {0, 0, 0}}, one, one)).find("loops[0].b.link = 7") == 0);
}

}  // namespace test_loops
