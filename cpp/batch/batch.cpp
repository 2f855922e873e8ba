#include "flexarm/batch.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "batch_lanes.hpp"
#include "flexarm/check.hpp"
#include "flexarm/dry_friction.hpp"
#include "flexarm/simulate.hpp"

namespace flexarm {

void fill_rows(const BatchProblem& p, const BatchOutput& out, Eigen::Index scenario, Eigen::Index row) {
  const Eigen::Index rows = p.rows();
  const auto fill = [&](double* block, int n) {
    if (block) std::fill_n(block + (scenario * rows + row) * n, (rows - row) * n, std::nan(""));
  };
  fill(out.q, p.row_q());
  for (double* block : {out.v, out.a, out.tau}) fill(block, p.row_v());
  fill(out.contacts, p.row_contacts());
  fill(out.loops, p.row_loops());
}

void throw_again(const BatchProblem& problem, Eigen::Index scenario) {
  if (problem.problems.size() == 1) throw;
  std::throw_with_nested(ScenarioError(scenario));
}

namespace {

using Index = Eigen::Index;

constexpr auto kLookTime = std::chrono::milliseconds(50);
constexpr Index kWorthThread = 32;  // steps that are worth a thread
constexpr long kParts = 1000;       // of a run of an integrator, which count as steps
constexpr double kEven = 1e-9;      // parts of a time between two of t, by which it may differ from the others

/// The row of forces that is held at a time, of a method without kernels: a sampled controller, whose steps end there.
Sampler held(const BatchProblem& p, Index scenario) {
  const Eigen::VectorXd& t = p.t;
  const Index last = t.size() - 2, nv = p.problems[0]->arm->nv();
  const double first = t[0], period = (t[last + 1] - first) / static_cast<double>(last + 1);
  for (Index k = 0; k <= last; ++k)
    if (std::abs(t[k + 1] - t[k] - period) > kEven * period)
      bad_value("tau", "forces that are held", "need equal steps of t, in scenarios that run one by one");
  const auto law = [&p, scenario, first, period, last, nv](double now, const Eigen::VectorXd&, const Eigen::VectorXd&,
                                                           const Eigen::VectorXd&, Eigen::VectorXd& force) {
    const Index k = std::min(static_cast<Index>(std::lround((now - first) / period)), last);
    force.setZero(nv);
    force.head(p.row_v()) = Eigen::Map<const Eigen::VectorXd>(p.tau.at(scenario, k), p.row_v());
  };
  return {first, period, 0.0, law};
}

/// A scenario's problem, with the numbers of the tables in it.
Problem with_tables(const BatchProblem& p, Index scenario) {
  using Row = Eigen::Map<const Eigen::VectorXd>;
  Problem out = p.of(scenario);
  if (p.q0.data) out.q0.head(p.row_q()) = Row(p.q0.at(scenario), p.row_q());
  if (p.v0.data) out.v0.head(p.row_v()) = Row(p.v0.at(scenario), p.row_v());
  if (p.tau.data && p.tau.time == 0) out.tau.head(p.row_v()) += Row(p.tau.at(scenario), p.row_v());
  if (p.tau.data && p.tau.time != 0) out.samplers.push_back(held(p, scenario));
  return out;
}

/// Of a scenario that has not begun.
void leave_out(const BatchProblem& p, const BatchOutput& out, Index scenario) {
  fill_rows(p, out, scenario, 0);
  if (out.reached) out.reached[scenario] = p.t[0];
}

/// Shared by the workers.
struct Shared {
  const BatchProblem& problem;
  const std::optional<BatchSteps> steps;  // of the first problem, in the kernels
  const BatchOutput& out;
  const std::function<bool(double)>& alive;
  const Index count;               // of steps, of all scenarios
  const Index width;               // scenarios that a worker takes at once
  std::atomic<Index> next{0};      // scenario that nobody has taken
  std::atomic<long long> done{0};  // steps
  std::atomic<bool> stop{false};
  std::chrono::steady_clock::time_point looked = {};  // of the calling thread alone

  /// Of the calling thread: asks `alive` when it is time to.
  void look_around() {
    if (!alive || stop) return;
    const auto now = std::chrono::steady_clock::now();
    if (now - looked < kLookTime) return;
    looked = now;
    if (!alive(std::min(1.0, static_cast<double>(done) / static_cast<double>(count)))) stop = true;
  }
};

/// One thread's memory, and the scenarios it runs.
class Worker {
 public:
  Worker(Shared& shared, bool calling) : shared_(shared), calling_(calling) {
    if (shared.steps)
      group_.emplace(shared.problem, *shared.steps, shared.out, [this](long steps) { return tell(steps); });
  }

  void run() {
    const Index all = shared_.problem.scenarios;
    while (!shared_.stop) {
      const Index first = shared_.next.fetch_add(shared_.width);
      if (first >= all) return;
      if (group_)
        run_scenarios(first, std::min(first + shared_.width, all));
      else
        integrate(first);
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
      const Index alike = group_->alike(first, end - first);
      group_->run(first, alike, stats_);
      first += alike;
      if (!group_->broken()) continue;
      shared_.stop = true;  // a function has ended the batch
      for (; first < end; ++first) leave_out(shared_.problem, shared_.out, first);
    }
  }

  /// A run of the problem by itself.
  void integrate(Index b) {
    const BatchProblem& p = shared_.problem;
    const double begin = p.t[0], end = p.t[p.t.size() - 1];
    long told = 0;
    std::exception_ptr watcher;  // its exception, which is no scenario's
    const auto alive = [&](double now) {
      const long before = std::exchange(told, static_cast<long>(kParts * (now - begin) / (end - begin)));
      try {
        return tell(told - before);
      } catch (...) {
        watcher = std::current_exception();
        return false;
      }
    };
    Trajectory run;
    run.reached = begin;
    run.failure = kInterrupted;
    try {
      const Problem problem = with_tables(p, b);
      run = p.integrate ? p.integrate(b, problem, p.t, alive)
                        : simulate_fixed(problem, p.t, *p.method.on(*problem.arm, p.step), p.step, alive);
    } catch (const Interrupted&) {
    } catch (...) {
      throw_again(p, b);
    }
    if (watcher) std::rethrow_exception(watcher);
    if (run.failure == kInterrupted) shared_.stop = true;
    write(b, run);
    tell(kParts - told);
  }
  void write(Index b, Trajectory& run) {
    const BatchProblem& p = shared_.problem;
    const BatchOutput& out = shared_.out;
    const Index rows = run.done == 0 ? 0 : (run.done - 1) / p.every + 1;
    const auto copy = [&](double* block, const Trajectory::Rows& x, int n) {
      for (Index k = 0; block && k < rows; ++k)
        std::copy_n(x.row(k * p.every).data(), n, block + (b * p.rows() + k) * n);
    };
    copy(out.q, run.q, p.row_q());
    copy(out.v, run.v, p.row_v());
    copy(out.a, run.a, p.row_v());
    copy(out.tau, run.tau, p.row_v());
    copy(out.contacts, run.contacts, p.row_contacts());
    copy(out.loops, run.loops, p.row_loops());
    fill_rows(p, out, b, rows);
    const BatchStatus failed = run.status == Status::ok ? BatchStatus::not_converged : BatchStatus(int(run.status));
    out.status[b] = static_cast<int>(run.failure == kInterrupted ? BatchStatus::not_done
                                     : !run.failure.empty()      ? failed
                                     : run.terminated            ? BatchStatus::ended
                                                                 : BatchStatus::ok);
    if (out.reached) out.reached[b] = run.failure.empty() && !run.terminated ? p.t[p.t.size() - 1] : run.reached;
    if (out.failure) out.failure[b] = run.failure;
    if (out.events) out.events[b] = std::move(run.events);
    if (out.stats) out.stats[b] = run.stats;
    stats_.steps += run.stats.steps;
    stats_.evaluations += run.stats.residuals;
    stats_.factorisations += run.stats.jacobians;
    stats_.iterations += run.stats.newton_iterations;
  }

  Shared& shared_;
  bool calling_;
  std::optional<LaneGroup> group_;
  BatchStats stats_;
};

void check(const BatchProblem& p, const BatchOutput& out, int workers) {
  if (p.scenarios < 0) bad_value("scenarios", p.scenarios, "must not be negative");
  if (p.problems.empty() || (p.problems.size() != 1 && static_cast<Index>(p.problems.size()) != p.scenarios))
    bad_value("problems", p.problems.size(), "must be one, or one for each scenario");
  check_times(p.t);
  if (p.every < 1) bad_value("every", p.every, "must be at least 1");
  const Problem& one = *p.problems[0];
  if (!p.integrate) p.method.on(*one.arm, p.step);  // which checks the options
  const auto moves = [](const Problem& x) {
    std::vector<int> found;
    for (const Drive& d : x.drives)
      if (d.motion) found.push_back(d.coordinate);
    return found;
  };
  for (const auto& x : p.problems) {
    x->check();
    if (x->arm->nq() != one.arm->nq() || x->arm->nv() != one.arm->nv() ||
        x->arm->contacts().size() != one.arm->contacts().size() || x->arm->loops().size() != one.arm->loops().size())
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

bool in_kernels(const std::string& method, const Arm& arm) {
  for (const OneStep::Traits& known : OneStep::methods())
    if (known.name == method) return known.rubs || rubs(arm).empty();
  return false;
}

bool BatchProblem::in_kernels() const {
  return !integrate && std::all_of(problems.begin(), problems.end(),
                                   [this](const auto& x) { return flexarm::in_kernels(method.name, *x->arm); });
}

BatchStats run_batch(const BatchProblem& problem, const BatchOutput& out, int workers,
                     const std::function<bool(double)>& alive) {
  check(problem, out, workers);
  std::fill_n(out.status, problem.scenarios, static_cast<int>(BatchStatus::not_done));
  std::optional<BatchSteps> steps;
  if (problem.in_kernels()) steps.emplace(*problem.problems[0], problem.t, problem.step);
  const Index of_all = problem.scenarios * (steps ? steps->count() : kParts);
  const Index group = steps ? LaneGroup::width(problem) : 1;
  Shared shared{problem, std::move(steps), out, alive, of_all, group};
  const Index useful = std::max<Index>(1, std::min((problem.scenarios + group - 1) / group, of_all / kWorthThread));
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
  stats.lanes = shared.steps ? static_cast<int>(group) : 0;
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
