// Frames, Jacobians, motions, reactions and sums on the kernels, against the oracle.
#include <doctest/doctest.h>

#include "flexarm/derivatives.hpp"
#include "flexarm/kinematics.hpp"
#include "kernels.hpp"

namespace test_frames {
using namespace flexarm;
using Eigen::Vector3d;

namespace {

/// A place, as the kernels and as the oracle know it.
struct Site {
  PlacedSlice at;
  std::optional<SliceTable> table;
  const SliceTable* slice() const { return table ? &*table : nullptr; }
};

std::vector<Site> places(const Arm& arm) {
  std::vector<Site> out;
  for (std::size_t n = 0; n < arm.size(); ++n) {
    out.push_back({PlacedSlice(arm, n), {}});
    if (arm.link(n).beam())
      for (double part : {0.0, 0.37, 1.0}) {
        const double x = part * arm.link(n).beam()->length();
        out.push_back({PlacedSlice(arm, n, x), arm.link(n).slice_at(x)});
      }
  }
  return out;
}

/// Largest difference, in the size of what is compared.
template <class A, class B>
double apart(const A& a, const B& b) {
  return (a - b).cwiseAbs().maxCoeff() / (1e-3 + b.cwiseAbs().maxCoeff());
}

void check(const Arm& arm, double bent = 0.1) {
  const lanes::KernelArm& known = lanes::KernelArm::in_space(arm);
  CHECK(!known.layout().planar);
  const int nq = arm.nq(), nv = arm.nv();
  const oracle::Oracle truth(arm);
  Workspace ws(arm);
  Eigen::VectorXd q, v, a = flexarm_test::wave(nv, 1.1, 1.0);
  flexarm_test::place(arm, 0.7, q, v, bent);
  Eigen::VectorXd rates(nq);
  coordinate_rates(arm, q, v, rates);
  Mat6X<double> J(6, nv);
  for (const lanes::FrameKernels* kernels : flexarm_test::all_frames()) {
    ws.frames = Held<lanes::SingleFrames>(new lanes::SingleFrames(arm, *kernels));
    move_arm(arm, ws, q, v);
    accelerate_arm(arm, ws, a);
    for (std::size_t n = 0; n < arm.size(); ++n) {
      CHECK(apart(link_pose(ws, n).p, truth.link_pose(n, q).p) < 1e-13);
      CHECK(apart(link_pose(ws, n).R, truth.link_pose(n, q).R) < 1e-13);
      CHECK(apart(slice_pose(ws, n).p, truth.pose(n, nullptr, q).p) < 1e-13);
      CHECK(apart(slice_motion(arm, ws, n).acceleration, truth.motion(n, nullptr, q, v, a)) < 1e-12);
    }
    const Energy e = energy(arm, ws, q, v);
    CHECK(e.kinetic == doctest::Approx(0.5 * v.dot(truth.mass_matrix(q) * v)).epsilon(1e-12));
    CHECK(e.potential == doctest::Approx(truth.potential(q)).epsilon(1e-12));
    const Momentum m = momentum(arm, ws, q, v);
    CHECK(apart(m.momentum, truth.momentum(q, v)) < 1e-12);
    double mass = 0.0;
    for (const Link& link : arm.links()) mass += link.mass();
    CHECK(m.mass == doctest::Approx(mass).epsilon(1e-13));
    CHECK(apart(m.mass * m.centre_of_mass, truth.mass_moment(q)) < 1e-12);
    const lanes::Memory memory(kernels->slopes_memory(known.layout()));
    for (const Site& site : places(arm)) {
      const PlacedSlice& at = site.at;
      const std::size_t n = at.link();
      CAPTURE(n);
      CAPTURE(at.on_beam());
      move_arm(arm, ws, q, v);
      accelerate_arm(arm, ws, a);
      const oracle::Pose pose = truth.pose(n, site.slice(), q), link = truth.link_pose(n, q);
      CHECK(apart(slice_pose(ws, at).p, pose.p) < 1e-13);
      CHECK(apart(slice_pose(ws, at).R, pose.R) < 1e-13);
      CHECK(apart(slice_in_link(ws, at).p, link.R.transpose() * (pose.p - link.p)) < 1e-13);
      CHECK(apart(slice_in_link(ws, at).R, link.R.transpose() * pose.R) < 1e-13);
      slice_jacobian(arm, ws, at, J);
      CHECK(apart(J, truth.jacobian(n, site.slice(), q)) < 1e-12);
      const SliceMotion motion = slice_motion(arm, ws, at);
      CHECK(apart(motion.velocity, J * v) < 1e-12);
      CHECK(apart(motion.acceleration, truth.motion(n, site.slice(), q, v, a)) < 1e-12);
      // derivatives, by differences
      Eigen::MatrixXd by_q(12, nq), by_v(12, nv);
      kernels->slopes(known.layout(), known.numbers().data(), memory.get(), at.place(), at.numbers(), q.data(),
                      v.data(), a.data(), by_q.data(), by_v.data());
      const auto moved = [&](const Eigen::VectorXd& q_, const Eigen::VectorXd& v_) {
        Eigen::VectorXd both(12);
        both << truth.jacobian(n, site.slice(), q_) * v_, truth.motion(n, site.slice(), q_, v_, a);
        return both;
      };
      for (int i = 0; i < nq + nv; i += flexarm_test::kEvery) {
        const bool of_q = i < nq;
        const Eigen::VectorXd expected =
            of_q ? flexarm_test::slope([&](const Eigen::VectorXd& x) { return moved(x, v); }, q,
                                       Eigen::VectorXd::Unit(nq, i), 1e-5)
                 : flexarm_test::slope([&](const Eigen::VectorXd& x) { return moved(q, x); }, v,
                                       Eigen::VectorXd::Unit(nv, i - nq), 1e-4);
        const Eigen::VectorXd column = of_q ? by_q.col(i) : by_v.col(i - nq);
        const double size = 1e-3 + (of_q ? by_q : by_v).cwiseAbs().maxCoeff();
        CHECK((column - expected).cwiseAbs().maxCoeff() < 1e-7 * size);
      }
      kernels->jacobian_rate(known.layout(), known.numbers().data(), memory.get(), at.place(), at.numbers(), q.data(),
                             rates.data(), J.data());
      const auto columns = [&](const Eigen::VectorXd& x) {
        return Eigen::VectorXd(truth.jacobian(n, site.slice(), x).reshaped());
      };
      CHECK(apart(Eigen::VectorXd(J.reshaped()), flexarm_test::slope(columns, q, rates, 1e-5)) < 1e-7);
    }
  }
}

/// What goes through a joint does the work of what is beyond it: its part along a freedom is that freedom's force.
void check_reactions(const Arm& arm) {
  std::vector<Load> loads{Load::at_end(arm, arm.size() - 1, true)};
  JointReactions reaction(arm, loads);
  Workspace ws(arm, {}, loads);
  ws.loads[0].wrench = flexarm_test::wave(6, 0.3, 2.0);
  reaction.set_wrench(0, ws.loads[0].wrench);
  Eigen::VectorXd q, v, a = flexarm_test::wave(arm.nv(), 1.1, 1.0);
  flexarm_test::place(arm, 0.7, q, v);
  inverse_dynamics(arm, ws, q, v, a);
  move_arm(arm, ws, q, v);
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Vec6<double> own = reaction(arm, q, v, a, n, false), below = reaction(arm, q, v, a, n, true);
    const oracle::JointMotion joint(arm.link(n).joint(), q.data() + arm.first_q(n), v.data() + arm.first(n));
    for (int k = 0; k < arm.link(n).nj(); ++k) {
      const int i = arm.first(n) + k;
      double passive = oracle::resistance(arm.link(n).joint(), k, q.data() + arm.first_q(n), v.data() + arm.first(n));
      if (arm.link(n).joint().passive())
        passive += arm.link(n).joint().forces()[static_cast<std::size_t>(k)].reflected_inertia * a[i];
      CHECK(joint.H.col(k).dot(own) + passive == doctest::Approx(ws.tau[i]).epsilon(1e-11));
    }
    // the same in the axes of the seat, about it
    CHECK(apart(below.head<3>(), joint.R * own.head<3>()) < 1e-12);
    CHECK(apart(below.tail<3>(), joint.R * own.tail<3>() + joint.p.cross(Vector3d(joint.R * own.head<3>()))) < 1e-12);
  }
}

/// Planar, but for the axes of bodies; one link is rigid with a beam that does not bend.
Arm flat(const Vector3d& axis, flexarm::StrainCounts modes, int order) {
  JointForce spring;
  spring.stiffness = 3.0;
  spring.reflected_inertia = 0.05;
  Placement seat;
  seat.position = {0.03, 0.02, 0.01};
  seat.rotation = Eigen::AngleAxisd(0.4, axis).toRotationMatrix();
  std::vector<Link> links;
  links.emplace_back(Joint::revolute(-axis), flexarm_test::body(0.5, {0.075, 0.01, -0.02}),
                     flexarm_test::beam(modes, order), flexarm_test::body(0.2, {0.04, 0.01, 0.01}));
  links.emplace_back(Joint({{true, axis}}, false, {"turn"}, {spring}, seat, seat), std::nullopt,
                     flexarm_test::beam({0, 0, 0, 0, 0}, order), flexarm_test::body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint::fixed(), flexarm_test::body(0.1, {0.02, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::prismatic({0.6 * (1 - axis[0]), 0.8 * axis[2], 0.8 * axis[1]}),
                     flexarm_test::body(0.3, {0.1, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::revolute(axis), std::nullopt, flexarm_test::beam(modes, order), std::nullopt);
  return Arm(std::move(links), {1.0, 2.0, -9.81});
}

}  // namespace

TEST_CASE("kinematics of arms that move in a plane, in space") {
  for (int order : {1, 2}) {
    CHECK(lanes::KernelArm::of(flat({0, 0, 1}, {3, 0, 0, 0, 0}, order)).layout().planar);
    check(flat({0, 0, 1}, {3, 0, 0, 0, 0}, order));
    check(flat({0, 1, 0}, {0, 2, 0, 0, 1}, order));
  }
}

TEST_CASE("kinematics of arms in space, also bent by many turns") {
  for (int order : {1, 2})
    for (double bent : {0.1, 7.0}) {
      check(flexarm_test::spatial_arm(order), bent);
      check(flexarm_test::tree_arm(order), bent);
      check(flat({0, 0, 1}, {2, 1, 1, 1, 1}, order), bent);
    }
}

TEST_CASE("what goes through joints") {
  check_reactions(flat({0, 0, 1}, {3, 0, 0, 0, 0}, 2));
  check_reactions(flat({0, 1, 0}, {2, 1, 1, 1, 1}, kExact));
  for (int order : {1, 2, 3, kExact}) check_reactions(flexarm_test::spatial_arm(order));
  check_reactions(flexarm_test::tree_arm());
}

TEST_CASE("a place asked for outside of the arm is refused") {
  const Arm arm = flexarm_test::spatial_arm();
  CHECK_THROWS_AS(PlacedSlice(arm, 3), std::invalid_argument);
  CHECK_THROWS_AS(PlacedSlice(arm, 0, 0.1), std::invalid_argument);
  CHECK_THROWS_AS(PlacedSlice(arm, 1, 0.6), std::invalid_argument);
}

}  // namespace test_frames
