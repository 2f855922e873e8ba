#include "flexarm/batch.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <thread>

#include "batch_lanes.hpp"
#include "flexarm/check.hpp"
#include "flexarm/dry_friction.hpp"

namespace flexarm {

void fill_rows(const BatchProblem& p, const BatchOutput& out, Eigen::Index scenario, Eigen::Index row) {
  const Eigen::Index rows = p.rows();
  const auto fill = [&](double* block, int n) {
    if (block) std::fill_n(block + (scenario * rows + row) * n, (rows - row) * n, std::nan(""));
  };
  fill(out.q, p.row_q());
  for (double* block : {out.v, out.a, out.tau}) fill(block, p.row_v());
}

namespace {

using Index = Eigen::Index;

constexpr auto kLookTime = std::chrono::milliseconds(50);
constexpr Index kWorthThread = 32;  // steps that are worth a thread

/// Of a scenario that has not begun.
void leave_out(const BatchProblem& p, const BatchOutput& out, Index scenario) {
  fill_rows(p, out, scenario, 0);
  if (out.reached) out.reached[scenario] = p.t[0];
}

/// What the workers share.
struct Shared {
  const BatchProblem& problem;
  const BatchSteps steps;  // of the first problem
  const BatchOutput& out;
  const std::function<bool(double)>& alive;
  std::atomic<Index> next{0};      // scenario that nobody has taken
  std::atomic<long long> done{0};  // steps
  std::atomic<bool> stop{false};
  std::chrono::steady_clock::time_point looked = {};  // of the calling thread alone

  /// Of the calling thread: asks `alive` when it is time to.
  void look_around() {
    if (!alive) return;
    const auto now = std::chrono::steady_clock::now();
    if (now - looked < kLookTime) return;
    looked = now;
    const double all = static_cast<double>(problem.scenarios) * static_cast<double>(steps.count());
    if (!alive(std::min(1.0, static_cast<double>(done) / all))) stop = true;
  }
};

/// One thread's memory, and the scenarios it runs.
class Worker {
 public:
  Worker(Shared& shared, bool calling)
      : shared_(shared),
        calling_(calling),
        width_(LaneGroup::width(shared.problem)),
        group_(shared.problem, shared.steps, shared.out, [this](long steps) { return tell(steps); }) {}

  void run() {
    const Index all = shared_.problem.scenarios;
    while (!shared_.stop) {
      const Index first = shared_.next.fetch_add(width_);
      if (first >= all) return;
      run_scenarios(first, std::min(first + width_, all));
    }
  }
  const BatchStats& stats() const { return stats_; }

 private:
  bool tell(long steps) {
    shared_.done += steps;
    if (calling_) shared_.look_around();
    return !shared_.stop;
  }
  void run_scenarios(Index first, Index end) {
    while (first < end) {
      const Index alike = group_.alike(first, end - first);
      group_.run(first, alike, stats_);
      first += alike;
      if (!group_.broken()) continue;
      shared_.stop = true;  // a function has ended the batch
      for (; first < end; ++first) leave_out(shared_.problem, shared_.out, first);
    }
  }

  Shared& shared_;
  bool calling_;
  Index width_;
  LaneGroup group_;
  BatchStats stats_;
};

void check(const BatchProblem& p, const BatchOutput& out, int workers) {
  if (p.scenarios < 0) bad_value("scenarios", p.scenarios, "must not be negative");
  if (p.problems.size() != 1 && static_cast<Index>(p.problems.size()) != p.scenarios)
    bad_value("problems", p.problems.size(), "must be one, or one for each scenario");
  check_times(p.t);
  positive("step", p.step);
  if (p.every < 1) bad_value("every", p.every, "must be at least 1");
  const auto& methods = OneStep::methods();
  const auto method =
      std::find_if(methods.begin(), methods.end(), [&](const auto& m) { return m.name == p.method.name; });
  if (method == methods.end()) bad_value("integrator", p.method.name, "is none that batches have");
  if (!(p.method.spectral_radius >= 0.0 && p.method.spectral_radius <= 1.0))
    bad_value("spectral_radius", p.method.spectral_radius, "must be from 0 to 1");
  const Problem& one = *p.problems[0];
  const auto moves = [](const Problem& x) {
    std::vector<int> found;
    for (const Drive& d : x.drives)
      if (d.motion) found.push_back(d.coordinate);
    return found;
  };
  for (const auto& x : p.problems) {
    x->check();
    if (!method->rubs) refuse_friction(*x->arm, method->name.c_str());
    if (x->arm->nq() != one.arm->nq() || x->arm->nv() != one.arm->nv())
      bad_value("problems", "an arm", "must have the sizes of the first");
    if (x->loads.size() != one.loads.size() || x->feedback.size() != one.feedback.size() ||
        x->samplers.size() != one.samplers.size() || x->events.size() != one.events.size() || moves(*x) != moves(one))
      bad_value("problems", "one of them", "must have as many laws as the first, and the same motions");
    for (const Feedback& f : x->feedback)
      if (f.column.size() != one.arm->nv() || f.by_q.size() != one.arm->nq() || f.by_v.size() != one.arm->nv())
        bad_value("feedback", "a law", "must have nv, nq and nv numbers");
  }
  if (!out.status) bad_value("status", "null", "must be given");
  if (workers < 1) bad_value("workers", workers, "must be at least 1");
}

/// Threads that are told to stop, and waited for, however their scope is left.
struct Team {
  Shared& shared;
  std::vector<std::thread> threads = {};
  ~Team() {
    shared.stop = true;
    join();
  }
  void join() {
    for (std::thread& t : threads)
      if (t.joinable()) t.join();
  }
};

}  // namespace

BatchStats run_batch(const BatchProblem& problem, const BatchOutput& out, int workers,
                     const std::function<bool(double)>& alive) {
  check(problem, out, workers);
  std::fill_n(out.status, problem.scenarios, static_cast<int>(BatchStatus::not_done));
  Shared shared{problem, {*problem.problems[0], problem.t, problem.step}, out, alive};
  const Index steps = problem.scenarios * shared.steps.count();
  const Index group = LaneGroup::width(problem);
  const Index useful = std::max<Index>(1, std::min((problem.scenarios + group - 1) / group, steps / kWorthThread));
  const int count = static_cast<int>(std::min<Index>(workers, useful));
  std::vector<std::unique_ptr<Worker>> all;
  for (int k = 0; k < count; ++k) all.push_back(std::make_unique<Worker>(shared, k == 0));
  std::mutex mutex;
  std::condition_variable finished;
  int running = count - 1;
  std::exception_ptr error;
  {
    Team team{shared};
    for (int k = 1; k < count; ++k)
      team.threads.emplace_back([&, k] {
        std::exception_ptr caught;
        try {
          all[static_cast<std::size_t>(k)]->run();
        } catch (...) {
          caught = std::current_exception();
          shared.stop = true;
        }
        const std::lock_guard<std::mutex> lock(mutex);
        if (caught && !error) error = caught;
        --running;
        finished.notify_one();
      });
    all[0]->run();
    std::unique_lock<std::mutex> lock(mutex);
    while (running > 0) {
      finished.wait_for(lock, kLookTime);
      lock.unlock();
      if (!shared.stop) shared.look_around();
      lock.lock();
    }
    lock.unlock();
    team.join();
  }
  if (error) std::rethrow_exception(error);
  BatchStats stats;
  stats.workers = count;
  stats.lanes = static_cast<int>(group);
  for (const auto& w : all) {
    stats.steps += w->stats().steps;
    stats.evaluations += w->stats().evaluations;
    stats.factorisations += w->stats().factorisations;
    stats.iterations += w->stats().iterations;
  }
  for (Index b = shared.next; b < problem.scenarios; ++b) leave_out(problem, out, b);  // nobody has taken these
  for (Index b = 0; b < problem.scenarios; ++b)
    stats.interrupted = stats.interrupted || out.status[b] == static_cast<int>(BatchStatus::not_done);
  return stats;
}

}  // namespace flexarm
