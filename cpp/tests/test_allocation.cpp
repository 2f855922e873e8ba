// Nothing is allocated after set-up: malloc and its kin are replaced by ones that count while a flag of this thread is
// up.
#include <doctest/doctest.h>

#include <cerrno>
#include <cstdlib>
#include <vector>

#include "arms.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/ida.hpp"
#include "flexarm/step.hpp"

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define FLEXARM_SANITIZED
#endif
#endif
#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(FLEXARM_SANITIZED)
#define FLEXARM_COUNTS_MALLOC
#endif

#ifdef FLEXARM_COUNTS_MALLOC

namespace {
thread_local bool counting = false;
thread_local long allocations = 0, bytes = 0;
void note(std::size_t n) {
  if (!counting) return;
  ++allocations;
  bytes += static_cast<long>(n);
}
}  // namespace

extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
#define FLEXARM_EXPORTED __attribute__((visibility("default")))
FLEXARM_EXPORTED void* malloc(std::size_t n) noexcept {
  note(n);
  return __libc_malloc(n);
}
FLEXARM_EXPORTED void* calloc(std::size_t n, std::size_t size) noexcept {
  note(n * size);
  return __libc_calloc(n, size);
}
FLEXARM_EXPORTED void* realloc(void* p, std::size_t n) noexcept {
  note(n);
  return __libc_realloc(p, n);
}
FLEXARM_EXPORTED void* aligned_alloc(std::size_t alignment, std::size_t n) noexcept {
  note(n);
  return __libc_memalign(alignment, n);
}
FLEXARM_EXPORTED int posix_memalign(void** out, std::size_t alignment, std::size_t n) noexcept {
  note(n);
  *out = __libc_memalign(alignment, n);
  return *out ? 0 : ENOMEM;
}
}

using namespace flexarm;

namespace {

template <class F>
long allocated_by(const F& f) {
  allocations = bytes = 0;
  counting = true;
  f();
  counting = false;
  return allocations;
}

/// Every kind of joint force, beam order and load that the hot path meets.
void check_arm(const Arm& arm, const std::vector<bool>& prescribed) {
  const std::vector<Load> loads{Load::at_end(arm, arm.size() - 1, true)};
  Workspace ws(arm, prescribed, loads);
  ws.loads[0].wrench << 0.1, 0.2, 0.3, 0.01, 0.02, 0.03;
  std::vector<Feedback> laws(1);
  Feedback& law = laws[0];
  law.column = Eigen::VectorXd::Unit(arm.nv(), 0);
  law.by_q = flexarm_test::wave(arm.nq(), 0.1);
  law.by_v = flexarm_test::wave(arm.nv(), 0.2);
  ws.feed_back(laws);
  Eigen::VectorXd q = arm.zero(), v = flexarm_test::wave(arm.nv(), 0.4);
  const Eigen::VectorXd tau = flexarm_test::wave(arm.nv(), 0.7);
  CHECK(allocated_by([&] { forward_dynamics_ab(arm, ws, q, v, tau); }) == 0);
  CHECK(allocated_by([&] { inverse_dynamics<double>(arm, ws, q, v, ws.a); }) == 0);
  take_composite(arm, ws);
  CHECK(allocated_by([&] { composite_mass_matrix(arm, ws); }) == 0);
  CHECK(allocated_by([&] { forward_dynamics_ci(arm, ws, q, v, tau); }) == 0);
  ImplicitStep implicit(arm, 1e-5);
  Rk4Step rk4(arm, 1e-7);
  Status status = Status::ok;
  const auto steps = [&](auto& step) {
    for (int k = 0; k < 5 && status == Status::ok; ++k) status = step(ws, q, v, tau);
  };
  CHECK(allocated_by([&] { steps(implicit); }) == 0);
  CHECK(status == Status::ok);
  CHECK(allocated_by([&] { steps(rk4); }) == 0);
  CHECK(status == Status::ok);
}

}  // namespace

TEST_CASE("the counter counts") {
  CHECK(allocated_by([] { std::vector<double> x(100), y(x); }) >= 2);
  CHECK(allocated_by([] { Eigen::VectorXd x = Eigen::VectorXd::Zero(100); }) >= 1);
}

TEST_CASE("dynamics and steps allocate nothing") {
  for (int order : {0, 1, 2, 3, kExact}) {
    CAPTURE(order);
    const Arm arm = flexarm_test::spatial_arm(order);
    check_arm(arm, {});
    std::vector<bool> first(static_cast<std::size_t>(arm.nv()), false);
    first[1] = true;
    check_arm(arm, first);
  }
  check_arm(flexarm_test::floating_arm(), {});
  std::vector<Link> many;  // more elastic coordinates than Eigen's small kernels take
  many.emplace_back(Joint::revolute({0, 0, 1}), flexarm_test::body(0.5, {0.075, 0, 0}),
                    flexarm_test::beam({12, 12, 8, 4, 4}, 2), flexarm_test::body(0.2, {0.04, 0, 0.01}));
  check_arm(Arm(std::move(many)), {});
}

TEST_CASE("an arm and what AB, inverse dynamics and steps need take memory in proportion to its links") {
  const auto taken = [](std::size_t links) {
    std::vector<Link> parts;
    for (std::size_t k = 0; k < links; ++k)
      parts.emplace_back(Joint::revolute({0, 0, 1}), flexarm_test::body(0.5, {0.1, 0, 0}), std::nullopt, std::nullopt);
    allocated_by([&] {
      const Arm arm(std::move(parts));
      Workspace ws(arm);
      ImplicitStep implicit(arm, 1e-3);
      Rk4Step rk4(arm, 1e-3);
      Eigen::VectorXd q = arm.zero(), v = q, tau = q;
      implicit(ws, q, v, tau);
      rk4(ws, q, v, tau);
    });
    return bytes;
  };
  CHECK(taken(800) < 2.1 * static_cast<double>(taken(400)));
}

TEST_CASE("a step of IDA allocates nothing: longer runs allocate no more") {
  const Arm arm = flexarm_test::floating_arm();
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(arm.nv()), v0 = flexarm_test::wave(arm.nv(), 0.3, 0.5);
  for (LinearSolver solver : {LinearSolver::dense, LinearSolver::chain}) {
    IdaOptions options;
    options.linear_solver = solver;
    const Event event{[](double, const Eigen::VectorXd&, const Eigen::VectorXd&) { return 1.0; }};
    long steps = 0;
    const auto run = [&](double end) {
      const Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(3, 0.0, end);
      const long count = allocated_by([&] {
        const Trajectory r = simulate_ida(arm, {}, t, arm.zero(), v0, zero, options, {}, {}, {event});
        steps = r.stats.steps;
        CHECK(r.failure.empty());
      });
      return count;
    };
    const long few = run(1e-3), few_steps = steps, many = run(4e-3);
    CHECK(steps > 2 * few_steps);
    CHECK(many == few);
  }
}

#else

TEST_CASE("SKIPPED: dynamics and steps allocate nothing") {
  MESSAGE("SKIPPED, not passed: malloc cannot be replaced in this build (a sanitizer, or no glibc)");
}

#endif
