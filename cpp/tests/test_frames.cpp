// Frames, Jacobians, motions and sums on the kernels, against the equations on Eigen.
#include <doctest/doctest.h>

#include "flexarm/derivatives.hpp"
#include "flexarm/kinematics.hpp"
#include "kernels.hpp"

using namespace flexarm;
using Eigen::Vector3d;

namespace {

std::vector<PlacedSlice> places(const Arm& arm) {
  std::vector<PlacedSlice> out;
  for (std::size_t n = 0; n < arm.size(); ++n) {
    out.emplace_back(arm, n);
    if (arm.link(n).beam())
      for (double part : {0.0, 0.37, 1.0}) out.emplace_back(arm, n, part * arm.link(n).beam()->length());
  }
  return out;
}

/// Largest difference, in the size of what is compared.
template <class A, class B>
double apart(const A& a, const B& b) {
  return (a - b).cwiseAbs().maxCoeff() / (1e-3 + b.cwiseAbs().maxCoeff());
}

/// [velocity; acceleration] and Jacobian of a place in dual numbers.
struct Duals {
  VecX<Tangent> motion{12};
  Mat6X<Tangent> J;
  void evaluate(const Arm& arm, SweepWorkspace<Tangent>& ws, const TangentState& state, const PlacedSlice& at) {
    move_arm(arm, ws, state.q, state.v);
    accelerate_arm(arm, ws, state.a, Vector3d::Zero());
    Slice<Tangent> slice(arm.link(at.link()).ne());
    if (at.table())
      arm.link(at.link()).move_slice(*at.table(), ws.links[at.link()], true, slice);
    else
      slice = ws.links[at.link()].end;
    const SliceMotion<Tangent> m = slice_motion(arm, ws, at.link(), slice, state.a);
    motion << m.velocity, m.acceleration;
    J = slice_jacobian(arm, ws, at.link(), slice);
  }
  Eigen::VectorXd slope() const {
    return motion.unaryExpr([](const Tangent& x) { return x.d[0]; });
  }
};

void check(const Arm& arm, double bent = 0.1) {
  const lanes::KernelArm* known = lanes::KernelArm::in_space(arm);
  REQUIRE(known != nullptr);
  CHECK(!known->layout().planar);
  const int nq = arm.nq(), nv = arm.nv();
  Workspace eigen(arm), ws(arm);
  eigen.frames = {};
  REQUIRE(bool(ws.frames));
  Eigen::VectorXd q, v, a = flexarm_test::wave(nv, 1.1, 1.0);
  flexarm_test::place(arm, 0.7, q, v, bent);
  const Vector3d base(0.3, 0.2, 9.0);
  Mat6X<double> J(6, nv), expected_J(6, nv);
  for (const lanes::FrameKernels* kernels : flexarm_test::all_frames()) {
    ws.frames = Held<lanes::SingleFrames>(new lanes::SingleFrames(arm, *kernels));
    for (Workspace* w : {&eigen, &ws}) {
      move_arm(arm, *w, q, v);
      accelerate_arm(arm, *w, a, base);
    }
    for (std::size_t n = 0; n < arm.size(); ++n) {
      CHECK(apart(link_pose(ws, n).p, link_pose(eigen, n).p) < 1e-13);
      CHECK(apart(link_pose(ws, n).R, link_pose(eigen, n).R) < 1e-13);
      CHECK(apart(slice_pose(ws, n).p, slice_pose(eigen, n).p) < 1e-13);
      CHECK(apart(slice_motion(arm, ws, n).acceleration, slice_motion(arm, eigen, n).acceleration) < 1e-12);
    }
    const Energy e = energy(arm, ws, q, v), expected_e = energy(arm, eigen, q, v);
    CHECK(e.kinetic == doctest::Approx(expected_e.kinetic).epsilon(1e-12));
    CHECK(e.potential == doctest::Approx(expected_e.potential).epsilon(1e-12));
    const Momentum m = momentum(arm, ws, q, v), expected_m = momentum(arm, eigen, q, v);
    CHECK(apart(m.momentum, expected_m.momentum) < 1e-12);
    CHECK(m.mass == doctest::Approx(expected_m.mass).epsilon(1e-13));
    CHECK(apart(m.centre_of_mass, expected_m.centre_of_mass) < 1e-12);
    const lanes::Memory memory(kernels->slopes_memory(known->layout()));
    for (const PlacedSlice& at : places(arm)) {
      CAPTURE(at.link());
      CAPTURE(bool(at.table()));
      CHECK(apart(slice_pose(ws, at).p, slice_pose(eigen, at).p) < 1e-13);
      CHECK(apart(slice_pose(ws, at).R, slice_pose(eigen, at).R) < 1e-13);
      CHECK(apart(slice_in_link(ws, at).p, slice_in_link(eigen, at).p) < 1e-13);
      CHECK(apart(slice_in_link(ws, at).R, slice_in_link(eigen, at).R) < 1e-13);
      slice_jacobian(arm, ws, at, J);
      slice_jacobian(arm, eigen, at, expected_J);
      CHECK(apart(J, expected_J) < 1e-12);
      const SliceMotion<double> motion = slice_motion(arm, ws, at), expected = slice_motion(arm, eigen, at);
      CHECK(apart(motion.velocity, expected.velocity) < 1e-12);
      CHECK(apart(motion.acceleration, expected.acceleration) < 1e-12);
      CHECK(apart(J * v, expected.velocity) < 1e-12);
      // derivatives
      Eigen::MatrixXd by_q(12, nq), by_v(12, nv);
      kernels->slopes(known->layout(), known->numbers().data(), memory.get(), at.place(), at.numbers(), q.data(),
                      v.data(), a.data(), by_q.data(), by_v.data());
      SweepWorkspace<Tangent> dual(arm);
      TangentState state(arm);
      state.set(q, v, a);
      Duals duals;
      for (int i = 0; i < nq + nv; ++i) {
        Tangent& x = i < nq ? state.q[i] : state.v[i - nq];
        x.d[0] = 1.0;
        duals.evaluate(arm, dual, state, at);
        x.d[0] = 0.0;
        const Eigen::VectorXd column = i < nq ? by_q.col(i) : by_v.col(i - nq);
        const double size = 1e-3 + (i < nq ? by_q : by_v).cwiseAbs().maxCoeff();
        CHECK((column - duals.slope()).cwiseAbs().maxCoeff() < 1e-11 * size);
      }
      kernels->jacobian_rate(known->layout(), known->numbers().data(), memory.get(), at.place(), at.numbers(), q.data(),
                             v.data(), J.data());
      for (int i = 0; i < nq; ++i) state.q[i].d[0] = v[i];
      duals.evaluate(arm, dual, state, at);
      expected_J = duals.J.unaryExpr([](const Tangent& x) { return x.d[0]; });
      CHECK(apart(J, expected_J) < 1e-11);
    }
  }
}

/// Planar, but for the axes of bodies; one link is rigid with a beam that does not bend.
Arm flat(const Vector3d& axis, std::array<int, 5> modes, int order) {
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
    CHECK(lanes::KernelArm::of(flat({0, 0, 1}, {3, 0, 0, 0, 0}, order))->layout().planar);
    check(flat({0, 0, 1}, {3, 0, 0, 0, 0}, order));
    check(flat({0, 1, 0}, {0, 2, 0, 0, 1}, order));
  }
}

TEST_CASE("kinematics of arms in space, also bent by many turns") {
  for (int order : {1, 2})
    for (double bent : {0.1, 7.0}) {
      check(flexarm_test::spatial_arm(order), bent);
      check(flat({0, 0, 1}, {2, 1, 1, 1, 1}, order), bent);
    }
}

TEST_CASE("a place asked for outside of the arm is refused") {
  const Arm arm = flexarm_test::spatial_arm();
  CHECK_THROWS_AS(PlacedSlice(arm, 3), std::invalid_argument);
  CHECK_THROWS_AS(PlacedSlice(arm, 0, 0.1), std::invalid_argument);
  CHECK_THROWS_AS(PlacedSlice(arm, 1, 0.6), std::invalid_argument);
}
