// Derivatives of the dynamics, of every instruction set: to rounding those of dual numbers through the whole chain at
// once, which know nothing of segments and tables; and those of forward dynamics against M and differences.
#include "kernels.hpp"

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wpsabi"
#pragma GCC diagnostic ignored "-Wignored-attributes"
#endif
#define FLEXARM_ISA test
#define FLEXARM_WIDTH 2
#include "wide/pack.hpp"  // what the others need first
// clang-format: keep
#include "slopes/tangent.hpp"

namespace test_slopes {
namespace {

namespace lanes = flexarm::lanes;

/// dtau/dq and dtau/dv, side by side.
template <class Sp>
void whole_chain(const lanes::KernelArm& arm, const double* wrenches, const double* q0, const double* v0,
                 const double* a0, double* out) {
  using C = Chain<Sp, LaneDual>;
  const lanes::Layout& layout = arm.layout();
  const int nq = layout.nq, nv = layout.nv;
  const lanes::Memory memory(C::memory_needed(layout) + static_cast<std::size_t>(nq + 3 * nv) * sizeof(LaneDual));
  LaneDual* q = static_cast<LaneDual*>(memory.get());
  LaneDual *v = q + nq, *a = v + nv, *tau = a + nv;
  C chain(layout, arm.numbers().data(), Arena(tau + nv));
  for (int i = 0; i < nq; ++i) q[i] = LaneDual{} + q0[i];
  for (int i = 0; i < nv; ++i) {
    v[i] = LaneDual{} + v0[i];
    a[i] = LaneDual{} + a0[i];
    tau[i] = LaneDual{};
  }
  for (int i = 0; i < 6 * layout.loads; ++i) chain.wrench[i] = LaneDual{} + wrenches[i];
  const double* p = arm.numbers().data();
  const typename Sp::Lin base = Sp::read(p);
  for_directions(q, nq + nv, [&](int first, int count) {  // q and v lie in one row
    chain.move(q, v);
    chain.forces(base, a, tau);
    for (int k = 0; k < count; ++k)
      for (int i = 0; i < nv; ++i) out[(first + k) * nv + i] = slope_of(tau[i], k);
  });
}

/// Where columns are small against all of the matrix, they are sums of terms that are not.
void check_columns(const Eigen::MatrixXd& found, const Eigen::MatrixXd& expected, double tolerance) {
  const double all = expected.norm() / std::sqrt(static_cast<double>(expected.cols()));
  for (Eigen::Index k = 0; k < expected.cols(); ++k) {
    CAPTURE(k);
    CHECK((found.col(k) - expected.col(k)).norm() < tolerance * (expected.col(k).norm() + 0.01 * all));
  }
}

void check(const flexarm::Arm& arm, double bent = 0.1, bool loaded = false, const std::vector<bool>& given = {}) {
  using namespace flexarm;
  const int nq = arm.nq(), nv = arm.nv();
  std::vector<Load> loads;
  for (std::size_t n = 0; loaded && n < arm.size(); ++n)
    for (const bool world : {true, false}) {
      loads.push_back(Load::at_end(arm, n, world));
      if (arm.link(n).beam() && n % 2 == 1) loads.push_back(Load::at_slice(arm, n, 0.2, world));
    }
  Eigen::VectorXd wrenches = flexarm_test::wave(6 * static_cast<int>(loads.size()), 0.3, 2.0);
  const lanes::KernelArm known = lanes::KernelArm::of(arm).loaded(arm, loads);
  Eigen::VectorXd q, v;
  flexarm_test::place(arm, 0.7, q, v, bent);
  const Eigen::VectorXd a = flexarm_test::wave(nv, 0.4, 1.0), tau = flexarm_test::wave(nv, 0.2, 1.0);
  Eigen::MatrixXd expected(nv, nq + nv), found(nv, nq + nv), alone = Eigen::MatrixXd::Zero(nv, nq), M(nv, nv);
  const auto truth = [&](const Eigen::VectorXd& x) {
    (known.layout().planar
         ? whole_chain<::Plane<LaneDual>>
         : whole_chain<::Space<LaneDual>>)(known, wrenches.data(), q.data(), v.data(), x.data(), expected.data());
  };
  for (const lanes::Kernels* kernels : flexarm_test::all_kernels()) {
    CAPTURE(std::string(kernels->name));
    const lanes::KernelArm grouped = known.grouped(kernels->width, given);
    const lanes::SlopesOf of{known.layout(), grouped.layout(), known.numbers().data(), grouped.numbers().data(),
                             nullptr};
    const lanes::Memory memory(kernels->slopes_memory(of));
    truth(a);
    for (int twice = 0; twice < 2; ++twice)
      kernels->inverse_slopes(of, memory.get(), wrenches.data(), q.data(), v.data(), a.data(), found.data(),
                              found.data() + nv * nq, nullptr);
    check_columns(found, expected, 1e-12);
    kernels->inverse_slopes(of, memory.get(), wrenches.data(), q.data(), v.data(), a.data(), alone.data(), nullptr,
                            nullptr);
    check_columns(alone, expected.leftCols(nq), 1e-12);
    // forward: M da + dtau = 0 in the rows that are free
    flexarm_test::OnKernels on(arm, *kernels, given, loads);
    kernels->load(on.memory.get(), wrenches.data());
    Eigen::VectorXd x = a, accelerations = a;
    Eigen::MatrixXd by_tau(nv, nv), left(nv, nq + nv), unit = Eigen::MatrixXd::Zero(nv, nv);
    REQUIRE(kernels->forward(on.memory.get(), q.data(), v.data(), tau.data(), x.data()) == lanes::Outcome::good);
    kernels->mass_matrix(on.memory.get(), M.data());
    REQUIRE(kernels->forward_slopes(of, memory.get(), wrenches.data(), q.data(), v.data(), tau.data(),
                                    accelerations.data(), found.data(), found.data() + nv * nq,
                                    by_tau.data()) == lanes::Outcome::good);
    CHECK(accelerations == x);
    truth(x);
    left = M * found + expected;
    unit = M * by_tau - Eigen::MatrixXd::Identity(nv, nv);
    for (int i = 0; i < nv; ++i) {
      if (given.empty() || !given[static_cast<std::size_t>(i)]) continue;
      CHECK(found.row(i).norm() == 0.0);
      CHECK(by_tau.row(i).norm() == 0.0);
      CHECK(by_tau.col(i).norm() == 0.0);
      left.row(i).setZero();
      unit.row(i).setZero();
    }
    const double size = (M.cwiseAbs() * found.cwiseAbs() + expected.cwiseAbs()).maxCoeff();
    CHECK(left.cwiseAbs().maxCoeff() < 1e-10 * size);
    CHECK(unit.cwiseAbs().maxCoeff() < 1e-10 * (M.cwiseAbs() * by_tau.cwiseAbs()).maxCoeff());
  }
}

}  // namespace

TEST_CASE("derivatives are those of dual numbers through the whole chain") {
  for (int order : {0, 1, 2, 3, flexarm::kExact})
    for (const bool loaded : {false, true}) {
      CAPTURE(order);
      CAPTURE(loaded);
      const double bent = order == 0 ? 0.003 : 0.1;  // where the cut inertia is positive definite
      check(flexarm_test::spatial_arm(order), bent, loaded);
      check(flexarm_test::flat({0, 0, 1}, {3, 0, 0, 0, 0}, order, 0.02), bent, loaded);
      check(flexarm_test::flat({0, 1, 0}, {0, 2, 0, 0, 1}, order), bent, loaded);
      check(flexarm_test::flat({0, 0, 1}, {3, 3, 3, 1, 1}, order, 0.01), bent, loaded);
      check(flexarm_test::tree_arm(order), bent, loaded);
      check(flexarm_test::flat_tree(order), bent, loaded);
    }
  check(flexarm_test::floating_arm());
  check(flexarm_test::floating_arm(), 3.0, true);
}

TEST_CASE("derivatives of arms of many links, and of prescribed joints") {
  std::vector<flexarm::Link> links;
  for (int k = 0; k < 40; ++k)
    links.emplace_back(flexarm::Joint::revolute(k % 2 ? Eigen::Vector3d(0, 1, 0) : Eigen::Vector3d(0, 0, 1)),
                       flexarm_test::body(0.3, {0.1, 0, 0}), std::nullopt, std::nullopt);
  std::vector<bool> given(40, false);
  given[0] = given[17] = true;
  const flexarm::Arm rigid(std::move(links), {0, 0, -9.81});
  check(rigid);
  check(rigid, 0.1, true, given);
  std::vector<bool> first(13, false);
  first[1] = true;
  check(flexarm_test::spatial_arm(2), 0.1, true, first);
  check(flexarm_test::spatial_arm(flexarm::kExact), 3.0, false, first);
}

TEST_CASE("derivatives of forward dynamics, as the library has them") {
  using namespace flexarm;
  const Arm arm = flexarm_test::spatial_arm(kExact);
  const std::vector<Load> loads{Load::at_end(arm, 2, true)};
  std::vector<bool> given(static_cast<std::size_t>(arm.nv()), false);
  given[0] = true;
  ForwardDerivatives d(arm, loads, given);
  oracle::Oracle truth(arm, given, loads);
  truth.wrenches[0] << 1.0, -2.0, 3.0, 0.1, 0.2, -0.3;
  d.set_wrench(0, truth.wrenches[0]);
  Eigen::VectorXd q, v;
  flexarm_test::place(arm, 0.4, q, v);
  const Eigen::VectorXd tau = flexarm_test::wave(arm.nv(), 0.2, 1.0), known = flexarm_test::wave(arm.nv(), 0.6, 1.0);
  d.a = known;
  ForwardDerivatives copy = d;
  CHECK(copy(arm, q, v, tau) == Status::ok);
  CHECK((copy.a - truth.forward(q, v, tau, known)).norm() < 1e-8 * copy.a.norm());
  const auto along = [&](int k, const Eigen::VectorXd& at, double h, const auto& f) {
    return flexarm_test::slope(f, at, Eigen::VectorXd::Unit(arm.nv(), k), h);
  };
  Eigen::MatrixXd by_q(arm.nv(), arm.nv()), by_v = by_q, by_tau = by_q;
  for (int k = 0; k < arm.nv(); ++k) {
    by_q.col(k) = along(k, q, 5e-6, [&](const Eigen::VectorXd& x) { return truth.forward(x, v, tau, known); });
    by_v.col(k) = along(k, v, 0.3, [&](const Eigen::VectorXd& x) { return truth.forward(q, x, tau, known); });
    by_tau.col(k) = along(k, tau, 1e-2, [&](const Eigen::VectorXd& x) { return truth.forward(q, v, x, known); });
  }
  CHECK((copy.dq - by_q).norm() < 1e-6 * by_q.norm());
  CHECK((copy.dv - by_v).norm() < 1e-6 * by_v.norm());
  CHECK((copy.dtau - by_tau).norm() < 1e-6 * by_tau.norm());
  q[0] = std::numeric_limits<double>::quiet_NaN();
  CHECK(d(arm, q, v, tau) == Status::not_finite);
}

}  // namespace test_slopes
