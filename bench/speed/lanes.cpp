// What bounds an arm's forward dynamics in lanes: bench/speed/lanes.py runs it, once alone for the times, and once
// under callgrind, which counts the instructions of `flexarm_measured` and how often its data are not in the first
// cache.
//   cmake --preset release && cmake --build --preset release && build/release/bench_lanes [times]
// Prints CSV: a work, its lanes, how many evaluations of an arm were counted, their operations and, with `times`, the
// nanoseconds of one in each round; then what the processor can do at best, in the vectors of these lanes.
#include <cstdio>
#include <limits>
#include <string>

#include "common.hpp"
#include "flexarm/batch.hpp"

namespace {

using namespace flexarm;

/// Arms, each in a state of its own, that rk4 takes through a few steps side by side.
class Batch {
 public:
  static constexpr int kArms = 64, kSteps = 5, kLinks = 7;
  explicit Batch(const Arm& arm) : q0_(arm.nq(), kArms), q_(arm.nq(), 2 * kArms) {
    problem_.problems = {std::make_shared<Problem>(arm)};
    problem_.scenarios = kArms;
    problem_.t = Eigen::VectorXd::LinSpaced(kSteps + 1, 0.0, 1e-7 * kSteps);
    problem_.step = 1e-7;
    problem_.every = kSteps;
    problem_.method.name = "rk4";
    for (int k = 0; k < q0_.size(); ++k) {
      const bool joint = k % arm.nq() % (arm.nq() / kLinks) == 0;
      q0_.data()[k] = (joint ? 0.2 : 2e-4) * std::sin(k);
    }
    problem_.q0 = {q0_.data(), arm.nq(), 0};
    out_.q = q_.data();
    out_.status = status_;
    out_.reached = reached_;
  }
  int run() { return run_batch(problem_, out_, 1).lanes; }
  static constexpr int evaluations() { return 4 * kArms * kSteps; }

 private:
  BatchProblem problem_;
  Eigen::MatrixXd q0_, q_;
  int status_[kArms];
  double reached_[kArms];
  BatchOutput out_;
};

/// Nanoseconds of an instruction when the units for its kind are never idle.
struct Units {
  double arithmetic, load, line;  ///< line: of the second cache, into the first
};

constexpr int kTurns = 20000, kChains = 12, kNear = 1024, kFar = 24 * 1024;  // doubles: 8 kB, 192 kB
alignas(64) double memory[kFar];

/// The fastest of many rounds.
template <class F>
double least(const F& f, double instructions) {
  double best = std::numeric_limits<double>::infinity();
  for (int round = 0; round < 50; ++round) best = std::min(best, microseconds(f, 1));
  return 1e3 * best / instructions;
}
template <class F>
Units units_of(const F& f, int width) {
  const auto loads = [&](int doubles, int apart) {
    return least(
        [&] {
          for (int turn = 0; turn < 100; ++turn) f.load(doubles, apart);
        },
        100.0 * doubles / apart);
  };
  return {least([&] { f.arithmetic(); }, 1.0 * kChains * kTurns), loads(kNear, width), loads(kFar, 8)};
}

#define FLEXARM_FILLS(name, width, set)                                                                      \
  struct name {                                                                                              \
    typedef double Pack __attribute__((vector_size(8 * width)));                                             \
    [[gnu::target(set), gnu::noinline]] void arithmetic() const {                                            \
      Pack x[kChains] = {}, by = x[0] + 0.999, plus = x[0] + 0.1;                                            \
      for (int turn = 0; turn < kTurns; ++turn) _Pragma("GCC unroll 12") for (int k = 0; k < kChains; ++k) { \
          x[k] = x[k] * by + plus;                                                                           \
          asm volatile("" : "+x"(x[k]));                                                                     \
        }                                                                                                    \
    }                                                                                                        \
    [[gnu::target(set), gnu::noinline]] void load(int doubles, int apart) const {                            \
      for (int i = 0; i < doubles; i += 8 * apart) _Pragma("GCC unroll 8") for (int k = 0; k < 8; ++k) {     \
          Pack x = *reinterpret_cast<const Pack*>(memory + i + k * apart);                                   \
          asm volatile("" : : "x"(x));                                                                       \
        }                                                                                                    \
    }                                                                                                        \
  }

Units units(int lanes) {
#if defined(__x86_64__)
  FLEXARM_FILLS(OfEight, 8, "avx512f");
  FLEXARM_FILLS(OfFour, 4, "avx2,fma");
  if (lanes == 8) return units_of(OfEight{}, 8);
  if (lanes == 4) return units_of(OfFour{}, 4);
#endif
  throw std::runtime_error("the processor's units are known for AVX-512 and AVX2 alone; lanes: " +
                           std::to_string(lanes));
}

}  // namespace

// Callgrind collects inside this function alone, and writes what it found after each call.
extern "C" [[gnu::noinline]] int flexarm_measured(Batch* batch) { return batch->run(); }

int main(int argc, char** argv) {
  const bool times = argc > 1 && std::string(argv[1]) == "times";
  const auto volatile measured = &flexarm_measured;  // so that no compiler makes a version of it under another name
  int lanes = 0;
  std::printf("work,lanes,evaluations,ns\n");
  for (int order : {kExact, 2})
    for (Basis basis : {Basis::clamped_free, Basis::legendre}) {
      Batch batch(chain(Batch::kLinks, {3, 3, 1, 0, 0}, order, false, basis));
      lanes = batch.run();
      std::vector<double> rounds{0.0};
      if (times) {
        rounds.clear();
        for (int k = 0; k < 15; ++k)
          rounds.push_back(1e3 * cpu_microseconds([&] { batch.run(); }, 5) / batch.evaluations());
      } else {
        measured(&batch);
      }
      std::printf("\"7 x (3+3+1), %s, %s\",%d,%d,%.5g\n", order == 2 ? "order 2" : "exact",
                  basis == Basis::legendre ? "Legendre" : "clamped-free", lanes, batch.evaluations(),
                  *std::min_element(rounds.begin(), rounds.end()));
    }
  if (!times) return 0;
  const Units best = units(lanes);
  std::printf("# arithmetic %.5g load %.5g line %.5g\n", best.arithmetic, best.load, best.line);
}
