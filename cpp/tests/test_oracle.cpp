// The library's functions of a workspace against the oracle: loads, laws and prescribed rates at once, of every order
// and joint.
#include <doctest/doctest.h>

#include "arms.hpp"
#include "flexarm/ab.hpp"
#include "flexarm/ci.hpp"
#include "oracle/oracle.hpp"

namespace test_oracle {
using namespace flexarm;
using flexarm_test::wave;

namespace {

double largest(const Eigen::MatrixXd& m) { return m.cwiseAbs().maxCoeff(); }

void check(const Arm& arm, double size, double tolerance) {
  const std::size_t last = arm.size() - 1;
  std::vector<Load> loads{Load::at_end(arm, 0, true), Load::at_end(arm, last, false)};
  if (arm.link(last).beam()) {
    loads.push_back(Load::at_slice(arm, last, 0.3, true));
    loads.push_back(Load::along(arm, last, 0.1, 0.4, false));
  }
  std::vector<bool> given(static_cast<std::size_t>(arm.nv()), false);
  given[0] = true;
  Workspace ws(arm, given, loads);
  oracle::Oracle truth(arm, given, loads);
  for (std::size_t l = 0; l < loads.size(); ++l)
    ws.loads[l].wrench = truth.wrenches[l] = wave(6, 0.4 + static_cast<double>(l), 2.0);
  Feedback law{wave(arm.nv(), 0.1), wave(arm.nq(), 0.2), wave(arm.nv(), 0.3), {}, {}, 0.3};
  const std::vector<Feedback> laws{law};
  ws.feed_back(laws);
  ws.feedback[0].offset = 0.1;
  truth.feedback = {{&law, 0.1}};
  for (double phase : {0.3, 1.7}) {
    const Eigen::VectorXd q = arm.zero() + wave(arm.nq(), phase, size), v = wave(arm.nv(), phase + 1.0, 0.7),
                          x = wave(arm.nv(), phase + 2.0, 1.3);
    inverse_dynamics(arm, ws, q, v, x);
    const Eigen::VectorXd tau = ws.tau;
    CHECK(largest(truth.inverse(q, v, x) - tau) < tolerance * largest(tau));
    composite_mass_matrix(arm, ws);
    CHECK(largest(truth.mass_matrix(q) - ws.M) < tolerance * largest(ws.M));
    ws.a = x;
    REQUIRE(forward_dynamics_ab(arm, ws, q, v, x) == Status::ok);
    const Eigen::VectorXd a = truth.forward(q, v, x, x);
    CHECK(largest(ws.M * (a - ws.a)) < 1e3 * tolerance * (largest(ws.M * a) + largest(tau)));
    move_arm(arm, ws, q, v);
    REQUIRE(factor_shifted(arm, ws, q, v, {1e-3, 1e-5}) == Status::ok);
    Eigen::VectorXd solved(arm.nv());
    solve_shifted(arm, ws, x, solved);
    const Eigen::MatrixXd S = truth.shifted(q, v, 1e-3, 1e-5);
    CHECK(largest(truth.solve_free(S, x) - solved) < 1e4 * tolerance * largest(solved));

    const Energy e = energy(arm, ws, q, v);
    CHECK(truth.potential(q) == doctest::Approx(e.potential).epsilon(1e-12));
    CHECK(0.5 * v.dot(truth.mass_matrix(q) * v) == doctest::Approx(e.kinetic).epsilon(1e-12));
    const Momentum p = momentum(arm, ws, q, v);
    CHECK(largest(truth.momentum(q, v) - p.momentum) < tolerance * largest(p.momentum));
    CHECK(largest(truth.mass_moment(q) - p.mass * p.centre_of_mass) < 1e-12);
    move_arm(arm, ws, q, v);
    accelerate_arm(arm, ws, x);
    Mat6X<double> J(6, arm.nv());
    slice_jacobian(arm, ws, last, J);
    CHECK(largest(truth.jacobian(last, nullptr, q) - J) < 1e-12);
    const Eigen::VectorXd motion = slice_motion(arm, ws, last).acceleration;
    CHECK(largest(truth.motion(last, nullptr, q, v, x) - motion) < 10 * tolerance * largest(motion));
    const oracle::Pose pose = truth.pose(last, nullptr, q);
    CHECK(largest(pose.p - slice_pose(ws, last).p) < 1e-12);
    CHECK(largest(pose.R - slice_pose(ws, last).R) < 1e-12);
  }
}

Arm one(flexarm::StrainCounts modes, int order, const Joint& joint) {
  std::vector<Link> links;
  links.emplace_back(joint, flexarm_test::body(0.5, {0.1, 0.2, 0}), flexarm_test::beam(modes, order, 0.01),
                     flexarm_test::body(0.3, {0.1, 0, 0.02}));
  links.emplace_back(joint, flexarm_test::body(0.2, {0.1, 0.2, 0}), flexarm_test::beam(modes, order),
                     flexarm_test::body(0.3, {0.1, 0, 0}));
  return Arm(std::move(links), {1.0, 2.0, -9.81});
}

}  // namespace

TEST_CASE("the library says what the oracle says, of every order and joint") {
  JointForce spring;
  spring.stiffness = 3.0;
  spring.damping = 0.4;
  spring.reflected_inertia = 0.05;
  spring.lower = -0.03;
  spring.upper = 0.03;
  spring.limit_stiffness = 50.0;
  spring.limit_damping = 2.0;
  JointForce held = spring;
  held.lower = -std::numeric_limits<double>::infinity();
  Placement seat;
  seat.position = {0.03, 0.02, 0.01};
  seat.rotation = Eigen::AngleAxisd(0.4, Eigen::Vector3d(0.48, 0.6, 0.64)).toRotationMatrix();
  const Joint cardan({{true, {0, 0.6, 0.8}}, {false, {1, 0, 0}}, {true, {0, 1, 0}}}, false, {"a", "b", "c"},
                     {spring, spring, spring}, seat, seat);
  const Joint ball({{true, {0, 0, 1}}}, true, {"a", "x", "y", "z"}, {spring, held, held, held}, seat, seat);
  for (int order : {0, 1, 2, 3, kExact}) {
    CAPTURE(order);
    const double tolerance = 1e-12, size = order == 0 ? 0.03 : 1.0;  // far out the cut kinetic energy is not positive
    check(flexarm_test::spatial_arm(order), 0.1 * size, tolerance);
    check(flexarm_test::tree_arm(order), 0.1 * size, tolerance);
    check(flexarm_test::flat_tree(order), 0.1 * size, tolerance);
    for (const Joint& joint : {cardan, ball}) {
      check(one({3, 0, 0, 1, 0}, order, joint), 0.3 * size, tolerance);
      check(one({0, 2, 0, 0, 1}, order, joint), 0.3 * size, tolerance);
      check(one({2, 2, 1, 1, 1}, order, joint), 0.3 * size, tolerance);
      check(one({2, 1, 1, 1, 1, 2}, order, joint), 0.3 * size, tolerance);
      check(one({2, 0, 0, 0, 0, 2}, order, joint), 0.3 * size, tolerance);
      check(one({0, 0, 2, 0, 0}, order, joint), 3.0 * size, tolerance);
      if (order > 0) check(one({0, 0, 2, 0, 0}, order, joint), 40.0, order < kExact ? tolerance : 1e-11);
    }
  }
  check(flexarm_test::floating_arm(), 0.1, 1e-12);
}

}  // namespace test_oracle
