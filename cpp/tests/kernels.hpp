// Every instruction set's kernels against the oracle.
#pragma once

#include <doctest/doctest.h>

#include "arms.hpp"
#include "flexarm/ab.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/derivatives.hpp"
#include "oracle/oracle.hpp"
#include "sanitized.hpp"
#include "setup/single.hpp"

namespace flexarm {
namespace lanes {
extern const Kernels kernels_base;
extern const FrameKernels frames_base;
#ifdef FLEXARM_HAS_AVX2
extern const Kernels kernels_avx2;
extern const FrameKernels frames_avx2;
#endif
#ifdef FLEXARM_HAS_AVX512
extern const Kernels kernels_avx512;
extern const FrameKernels frames_avx512;
#endif
}  // namespace lanes
}  // namespace flexarm

namespace flexarm_test {

namespace lanes = flexarm::lanes;

inline std::vector<const lanes::Kernels*> all_kernels() {
  std::vector<const lanes::Kernels*> out{&lanes::kernels_base};
#ifdef FLEXARM_HAS_AVX2
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) out.push_back(&lanes::kernels_avx2);
#endif
#ifdef FLEXARM_HAS_AVX512
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq")) out.push_back(&lanes::kernels_avx512);
#endif
  return out;
}

inline std::vector<const lanes::FrameKernels*> all_frames() {
  std::vector<const lanes::FrameKernels*> out;
  for (const lanes::Kernels* k : all_kernels()) {
    if (k == &lanes::kernels_base) out.push_back(&lanes::frames_base);
#ifdef FLEXARM_HAS_AVX2
    if (k == &lanes::kernels_avx2) out.push_back(&lanes::frames_avx2);
#endif
#ifdef FLEXARM_HAS_AVX512
    if (k == &lanes::kernels_avx512) out.push_back(&lanes::frames_avx512);
#endif
  }
  return out;
}

/// One arm on one set of kernels.
struct OnKernels {
  const lanes::Kernels& kernels;
  lanes::KernelArm known;
  lanes::Memory memory;
  OnKernels(const flexarm::Arm& arm, const lanes::Kernels& k, const std::vector<bool>& given,
            const std::vector<flexarm::Load>& loads = {})
      : kernels(k),
        known(lanes::KernelArm::of(arm).loaded(arm, loads).grouped(k.width, given)),
        memory(k.memory(known.layout())) {
    kernels.begin(known.layout(), known.numbers().data(), memory.get());
  }
};

/// A place with beams bent by some tenths of their length (or turned by `bent` radians), and rates.
inline void place(const flexarm::Arm& arm, double phase, Eigen::VectorXd& q, Eigen::VectorXd& v, double bent = 0.1) {
  q = wave(arm.nq(), phase, 1.0);
  v = wave(arm.nv(), phase + 1.0, 1.0);
  for (std::size_t n = 0; n < arm.size(); ++n)
    for (int k = 0; k < arm.link(n).ne(); ++k) {
      const double size = 0.05 + arm.link(n).beam()->tip().linear.col(k).norm();
      q[arm.first_q(n) + arm.link(n).joint().nq() + k] *= bent / size;
      v[arm.first(n) + arm.link(n).nj() + k] *= 0.5 / size;
    }
}

inline int lowest_order(const flexarm::Arm& arm) {
  int lowest = 2;
  for (const flexarm::Link& link : arm.links())
    if (link.beam()) lowest = std::min(lowest, link.beam()->order());
  return lowest;
}

/// Everything that the kernels offer, against the same of the oracle, in the size of the terms that are summed.
inline void check(const flexarm::Arm& arm, bool planar, const std::vector<bool>& given = {}, double bent = 0.1) {
  CHECK(lanes::KernelArm::of(arm).layout().planar == planar);
  const int nv = arm.nv();
  CAPTURE(nv);
  const oracle::Oracle truth(arm, given);
  const auto is_free = [&](int i) { return given.empty() || !given[static_cast<std::size_t>(i)]; };
  for (double phase : {0.1, 0.9, 2.0}) {
    if (kSanitized && phase != 0.9) continue;
    Eigen::VectorXd q, v;
    place(arm, phase, q, v, bent);
    const Eigen::VectorXd tau = wave(nv, phase, 1.0), given_a = wave(nv, 2.0 * phase, 1.0);
    const Eigen::MatrixXd M = truth.mass_matrix(q);
    const Eigen::VectorXd expected_forces = truth.inverse(q, v, tau);
    const bool definite = M.llt().info() == Eigen::Success;  // at order 0, not everywhere
    const flexarm::lanes::Shift shift{1e-3, 1e-5};           // D, K and the shift, by their effect
    const Eigen::MatrixXd S = truth.shifted(q, v, shift.damping, shift.stiffness);
    const bool factors = S.llt().info() == Eigen::Success;
    const Eigen::VectorXd expected = truth.solve_free(S, tau);
    CHECK((definite || lowest_order(arm) == 0));
    CHECK((factors || !definite));
    for (const lanes::Kernels* kernels : all_kernels()) {
      CAPTURE(std::string(kernels->name));
      OnKernels on(arm, *kernels, given);
      void* self = on.memory.get();
      Eigen::VectorXd x = given_a, forces(nv);
      CHECK((kernels->forward(self, q.data(), v.data(), tau.data(), x.data()) == lanes::Outcome::good) == definite);
      Eigen::MatrixXd composite(nv, nv);
      kernels->mass_matrix(self, composite.data());
      CHECK((composite - M).cwiseAbs().maxCoeff() < 1e-12 * M.cwiseAbs().maxCoeff());
      CHECK(composite == composite.transpose());
      if (definite) {
        const Eigen::VectorXd own = truth.inverse(q, v, x), left = own - tau;
        const double size = (M.cwiseAbs() * x.cwiseAbs() + tau.cwiseAbs()).maxCoeff() + own.cwiseAbs().maxCoeff();
        for (int i = 0; i < nv; ++i) CHECK((!is_free(i) || std::abs(left[i]) < 1e-10 * size));
        kernels->forces(self, x.data(), forces.data());  // goes on from there
        CHECK((forces - own).cwiseAbs().maxCoeff() < 1e-10 * size);
      }
      kernels->inverse(self, q.data(), v.data(), tau.data(), forces.data());
      CHECK((forces - expected_forces).cwiseAbs().maxCoeff() < 1e-10 * expected_forces.cwiseAbs().maxCoeff());
      kernels->move(self, q.data(), nullptr);
      kernels->mass_matrix(self, composite.data());
      CHECK((composite - M).cwiseAbs().maxCoeff() < 1e-12 * M.cwiseAbs().maxCoeff());
      kernels->move(self, q.data(), v.data());
      double twice = 0.0;
      CHECK((kernels->factor(self, shift, v.data(), &twice) == lanes::Outcome::good) == factors);
      CHECK(twice == doctest::Approx(v.dot(M * v)).epsilon(1e-11));
      if (!factors) continue;
      kernels->solve(self, tau.data(), x.data());
      CHECK((x - expected).cwiseAbs().maxCoeff() < 1e-7 * expected.cwiseAbs().maxCoeff());
    }
  }
}

/// Differences of fourth order of f along direction x of a state.
template <class F>
Eigen::VectorXd slope(const F& f, const Eigen::VectorXd& at, const Eigen::VectorXd& x, double h) {
  const Eigen::VectorXd a = f(at + h * x) - f(at - h * x), b = f(at + 2.0 * h * x) - f(at - 2.0 * h * x);
  return (8.0 * a - b) / (12.0 * h);
}

/// One in so many columns of derivatives is compared with differences of the oracle, which take long under sanitizers.
inline constexpr int kEvery = kSanitized ? 5 : 1;

/// The derivatives of inverse dynamics against differences of the oracle's.
inline void check_slopes(const flexarm::Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  const lanes::KernelArm& known = lanes::KernelArm::of(arm);
  const int nq = arm.nq(), nv = arm.nv();
  const Eigen::VectorXd a = wave(nv, 0.4, 1.0);
  const oracle::Oracle truth(arm);
  Eigen::MatrixXd expected(nv, nq + nv), found(nv, nq + nv);
  expected.setZero();
  for (int k = 0; k < nq; k += kEvery)
    expected.col(k) =
        slope([&](const Eigen::VectorXd& x) { return truth.inverse(x, v, a); }, q, Eigen::VectorXd::Unit(nq, k), 5e-6);
  for (int k = 0; k < nv; k += kEvery)
    expected.col(nq + k) =
        slope([&](const Eigen::VectorXd& x) { return truth.inverse(q, x, a); }, v, Eigen::VectorXd::Unit(nv, k), 1e-4);
  for (const lanes::Kernels* kernels : all_kernels()) {
    CAPTURE(std::string(kernels->name));
    const lanes::KernelArm grouped = known.grouped(kernels->width, {});
    const lanes::SlopesOf of{known.layout(), grouped.layout(), known.numbers().data(), grouped.numbers().data(),
                             nullptr};
    const lanes::Memory memory(kernels->slopes_memory(of));
    kernels->inverse_slopes(of, memory.get(), nullptr, q.data(), v.data(), a.data(), found.data(),
                            found.data() + nv * nq, nullptr);
    for (int k = 0; k < nq + nv; ++k)
      if ((k < nq ? k : k - nq) % kEvery == 0)
        CHECK((found.col(k) - expected.col(k)).norm() < 5e-7 * (expected.col(k).norm() + 1e-3 * found.norm()));
  }
}

inline void check_slopes(const flexarm::Arm& arm, double bent = 0.1) {
  Eigen::VectorXd q, v;
  place(arm, 0.9, q, v, bent);
  check_slopes(arm, q, v);
}

inline flexarm::JointForce spring() {
  flexarm::JointForce f;
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
inline flexarm::Arm flat(const Eigen::Vector3d& axis, flexarm::StrainCounts modes, int order, double damping = 0.0) {
  flexarm::Placement seat;
  seat.position = {0.03, 0.02, 0.01};
  seat.rotation = Eigen::AngleAxisd(0.4, axis).toRotationMatrix();
  std::vector<flexarm::Link> links;
  links.emplace_back(flexarm::Joint::revolute(-axis), body(0.5, {0.075, 0.01, -0.02}), beam(modes, order, damping),
                     body(0.2, {0.04, 0, 0.01}));
  links.emplace_back(flexarm::Joint({{true, axis}}, false, {"turn"}, {spring()}, seat, seat), std::nullopt,
                     beam(modes, order), std::nullopt);
  links.emplace_back(flexarm::Joint::fixed(), body(0.1, {0.02, 0, 0}), std::nullopt, std::nullopt);
  links.emplace_back(flexarm::Joint::prismatic({0.6 * (1 - axis[0]), 0.8 * axis[2], 0.8 * axis[1]}),
                     body(0.3, {0.1, 0, 0}), std::nullopt, std::nullopt);
  return flexarm::Arm(std::move(links), {1.0, 2.0, -9.81});
}

}  // namespace flexarm_test
