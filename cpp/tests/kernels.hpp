// The fast kernels, of every instruction set that this processor has, against the equations on Eigen.
#pragma once

#include <doctest/doctest.h>

#include "arms.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/step.hpp"
#include "lanes/single.hpp"

namespace flexarm {
namespace lanes {
extern const Kernels kernels_base;
#ifdef FLEXARM_HAS_AVX2
extern const Kernels kernels_avx2;
#endif
#ifdef FLEXARM_HAS_AVX512
extern const Kernels kernels_avx512;
#endif
}  // namespace lanes
}  // namespace flexarm

namespace {

using namespace flexarm;
using Eigen::Vector3d;

std::vector<const lanes::Kernels*> all_kernels() {
  std::vector<const lanes::Kernels*> out{&lanes::kernels_base};
#ifdef FLEXARM_HAS_AVX2
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) out.push_back(&lanes::kernels_avx2);
#endif
#ifdef FLEXARM_HAS_AVX512
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) out.push_back(&lanes::kernels_avx512);
#endif
  return out;
}

/// One arm on one set of kernels.
struct Fast {
  const lanes::Kernels& kernels;
  lanes::KernelArm fast;
  lanes::Memory memory;
  Fast(const Arm& arm, const lanes::Kernels& k, const std::vector<bool>& given)
      : kernels(k), fast(lanes::KernelArm::of(arm)->grouped(k.width, given)), memory(k.memory(fast.layout())) {
    kernels.begin(fast.layout(), fast.numbers().data(), memory.get());
  }
};

/// A place with beams bent by some tenths of their length (or turned by `bent` radians), and rates.
void place(const Arm& arm, double phase, Eigen::VectorXd& q, Eigen::VectorXd& v, double bent = 0.1) {
  q = flexarm_test::wave(arm.nq(), phase, 1.0);
  v = flexarm_test::wave(arm.nv(), phase + 1.0, 1.0);
  for (std::size_t n = 0; n < arm.size(); ++n)
    for (int k = 0; k < arm.link(n).ne(); ++k) {
      const double size = 0.05 + arm.link(n).beam()->tip().linear.col(k).norm();
      q[arm.first_q(n) + arm.link(n).joint().nq() + k] *= bent / size;
      v[arm.first(n) + arm.link(n).nj() + k] *= 0.5 / size;
    }
}

/// Everything that the kernels offer, against the same on Eigen, in the size of the terms that are summed.
void check(const Arm& arm, bool planar, const std::vector<bool>& given = {}, double bent = 0.1) {
  REQUIRE(lanes::KernelArm::of(arm) != nullptr);
  CHECK(lanes::KernelArm::of(arm)->layout().planar == planar);
  const int nv = arm.nv();
  CAPTURE(nv);
  for (const lanes::Kernels* kernels : all_kernels()) {
    CAPTURE(std::string(kernels->name));
    Fast fast(arm, *kernels, given);
    Workspace ws(arm, given);
    ws.fast = FastPath();
    take_composite(arm, ws);
    for (double phase : {0.1, 0.9, 2.0}) {
      Eigen::VectorXd q, v, x(nv), tau = flexarm_test::wave(nv, phase, 1.0), forces(nv);
      place(arm, phase, q, v, bent);
      x = flexarm_test::wave(nv, 2.0 * phase, 1.0);
      ws.a = x;
      CHECK(kernels->forward(fast.memory.get(), q.data(), v.data(), tau.data(), x.data()));
      inverse_dynamics<double>(arm, ws, q, v, x);
      const Eigen::VectorXd left = ws.tau - tau;
      composite_mass_matrix(arm, ws);
      const Eigen::MatrixXd M = ws.M;
      const double size = (ws.M.cwiseAbs() * x.cwiseAbs() + tau.cwiseAbs()).maxCoeff() + ws.tau.cwiseAbs().maxCoeff();
      for (int i : ws.free) CHECK(std::abs(left[i]) < 1e-10 * size);
      inverse_dynamics<double>(arm, ws, q, v, tau);
      kernels->inverse(fast.memory.get(), q.data(), v.data(), tau.data(), forces.data());
      CHECK((forces - ws.tau).cwiseAbs().maxCoeff() < 1e-10 * ws.tau.cwiseAbs().maxCoeff());

      const flexarm::Shift shift{1e-3, 1e-5};  // D, K and the shift, by their effect
      inverse_dynamics<double>(arm, ws, q, v, tau, true);
      REQUIRE(factor_shifted(arm, ws, q, v, shift, true) == Status::ok);
      Eigen::VectorXd expected = Eigen::VectorXd::Zero(nv);
      solve_shifted(arm, ws, tau, expected);
      double twice = 0.0;
      CHECK(kernels->factor(fast.memory.get(), {shift.damping, shift.stiffness}, v.data(), &twice));
      kernels->solve(fast.memory.get(), tau.data(), x.data());
      CHECK((x - expected).cwiseAbs().maxCoeff() < 1e-7 * expected.cwiseAbs().maxCoeff());
      CHECK(twice == doctest::Approx(v.dot(M * v)).epsilon(1e-11));
      CHECK(ws.twice_kinetic == doctest::Approx(v.dot(M * v)).epsilon(1e-11));
    }
  }
}

JointForce spring() {
  JointForce f;
  f.stiffness = 3.0;
  f.rest = 0.2;
  f.damping = 0.4;
  f.reflected_inertia = 0.05;
  f.lower = -0.3;
  f.upper = 0.3;
  f.limit_stiffness = 50.0;
  f.limit_damping = 2.0;
  return f;
}

/// Links in one plane about `axis`, with everything that a joint may have.
Arm flat(const Vector3d& axis, std::array<int, 5> modes, int order, double damping = 0.0) {
  Placement seat;
  seat.position = {0.03, 0.02, 0.01};
  seat.rotation = Eigen::AngleAxisd(0.4, axis).toRotationMatrix();
  std::vector<Link> links;
  links.emplace_back(Joint::revolute(-axis), flexarm_test::body(0.5, {0.075, 0.01, -0.02}),
                     flexarm_test::beam(modes, order, damping), flexarm_test::body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(Joint({{true, axis}}, false, {"turn"}, {spring()}, seat, seat), std::nullopt,
                     flexarm_test::beam(modes, order), std::nullopt);
  links.emplace_back(Joint::fixed(), flexarm_test::body(0.1, {0.02, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(Joint::prismatic({0.6 * (1 - axis[0]), 0.8 * axis[2], 0.8 * axis[1]}),
                     flexarm_test::body(0.3, {0.1, 0, 0}), std::nullopt, std::nullopt);
  return Arm(std::move(links), {1.0, 2.0, -9.81});
}

}  // namespace
