#include "flexarm/batch.hpp"

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
#include "flexarm/step.hpp"
#include "system.hpp"

namespace flexarm {

void fill_rows(const BatchProblem& p, const BatchOutput& out, Eigen::Index scenario, Eigen::Index row) {
  const auto rows = static_cast<Eigen::Index>(p.rows.size());
  const auto fill = [&](double* block, int n) {
    if (block) std::fill_n(block + (scenario * rows + row) * n, (rows - row) * n, std::nan(""));
  };
  fill(out.q, p.arms[0]->nq());
  for (double* block : {out.v, out.a, out.tau}) fill(block, p.arms[0]->nv());
}

namespace {

using Index = Eigen::Index;

constexpr auto kLookTime = std::chrono::milliseconds(50);
constexpr Index kWorthThread = 32;  // steps that are worth a thread

/// What the workers share.
struct Shared {
  const BatchProblem& problem;
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
    const double all = static_cast<double>(problem.scenarios) * static_cast<double>(problem.lengths.size());
    if (!alive(static_cast<double>(done) / all)) stop = true;
  }
};

bool differs(const BatchTable& t) { return t.scenario != 0; }
bool changes(const BatchTable& t) { return t.time != 0; }

/// One thread's memory, and the scenarios it runs one after the other.
class Worker {
 public:
  Worker(Shared& shared, bool calling)
      : shared_(shared),
        p_(shared.problem),
        calling_(calling),
        group_(LaneGroup::width(shared.problem)),
        lanes_(shared.problem, shared.out, [this](long steps) {
          shared_.done += steps;
          if (calling_) shared_.look_around();
          return !shared_.stop;
        }) {
    for (const BatchForce& f : p_.forces) {
      own_laws_ = own_laws_ || differs(f.column);
      varies_ = varies_ || changes(f.value);
    }
    for (const BatchLoad& l : p_.loads) {
      own_laws_ = own_laws_ || l.places.size() > 1;
      varies_ = varies_ || changes(l.wrench);
    }
    for (const BatchMotion& m : p_.motions) varies_ = varies_ || changes(m.value);
    for (const BatchFeedback& f : p_.feedback) {
      own_laws_ = own_laws_ || differs(f.column) || differs(f.by_q) || differs(f.by_v) || differs(f.limit);
      varies_ = varies_ || changes(f.reference);
    }
  }

  void run() {
    while (!shared_.stop) {
      const Index first = shared_.next.fetch_add(group_);
      if (first >= p_.scenarios) return;
      run_group(first, std::min(group_, p_.scenarios - first));
    }
  }
  const BatchStats& stats() const { return stats_; }

 private:
  /// Side by side where the kernels know the arms, one after the other where not.
  void run_group(Index first, Index count) {
    for (const Index end = first + count; first < end;) {
      const Index side_by_side = group_ > 1 ? lanes_.alike(first, end - first) : 0;
      if (side_by_side > 0) {
        lanes_.run(first, side_by_side, stats_);
        first += side_by_side;
        continue;
      }
      b_ = first++;
      prepare();
      const BatchStatus status = run_scenario();
      if (shared_.out.status) shared_.out.status[b_] = static_cast<int>(status);
      if (shared_.out.reached) shared_.out.reached[b_] = p_.times[static_cast<std::size_t>(step_)];
      fill_rows(p_, shared_.out, b_, row_done_);
    }
  }

  /// The system and the method, made anew where the arm or the laws are others than before.
  void prepare() {
    const Arm* arm = p_.arms[p_.arms.size() == 1 ? 0 : static_cast<std::size_t>(b_)];
    if (arm == arm_ && !own_laws_) return;
    const int nq = arm->nq(), nv = arm->nv();
    const auto vector = [this](const BatchTable& t, int n) {
      return Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(t.at(b_), n));
    };
    system_.reset();
    tau_ = Eigen::VectorXd::Zero(nv);
    std::vector<Feedback> laws;
    for (const BatchFeedback& f : p_.feedback) {
      Feedback law{vector(f.column, nv), vector(f.by_q, nq), vector(f.by_v, nv)};
      law.reference = [this, &f](double) { return *f.reference.at(b_, half_); };
      law.limit = *f.limit.at(b_);
      laws.push_back(std::move(law));
    }
    drives_.clear();
    for (const BatchMotion& m : p_.motions) {
      Drive d{m.coordinate, {}, {}};
      d.motion = [this, &m](double) {
        const double* value = m.value.at(b_, half_);
        return MotionValue{value[0], value[1], value[2]};
      };
      drives_.push_back(std::move(d));
    }
    for (const BatchForce& f : p_.forces) {
      Drive d{0, {}, [this, &f](double) { return *f.value.at(b_, half_); }};
      d.column = vector(f.column, nv);
      drives_.push_back(std::move(d));
    }
    loads_.clear();
    for (const BatchLoad& l : p_.loads)
      loads_.push_back({l.places[l.places.size() == 1 ? 0 : static_cast<std::size_t>(b_)],
                        [this, &l](double) { return Vec6<double>(l.wrench.at(b_, half_)); }});
    control_ = std::make_unique<Control>(std::move(laws), std::vector<Sampler>{}, nv);
    system_ = std::make_unique<System>(*arm, drives_, loads_, tau_, control_.get());
    if (arm != arm_) {
      if (p_.rk4)
        method_ = std::make_unique<Rk4Step>(*arm, p_.lengths[0]);
      else
        method_ = std::make_unique<ImplicitStep>(*arm, p_.lengths[0], ImplicitOptions{p_.spectral_radius, p_.rtol});
      row_.q.resize(1, nq);
      for (Trajectory::Rows* x : {&row_.v, &row_.a, &row_.tau, &row_.friction}) x->resize(1, nv);
      q_ = Eigen::VectorXd(nq);
      arm_ = arm;
    }
    system_->rubbing = method_->rubbing();
  }

  /// Holds a row of tau. @return whether the forces have changed
  bool hold(Index row) {
    const Eigen::Map<const Eigen::VectorXd> tau(p_.tau.at(b_, row), arm_->nv());
    if (tau_ == tau) return false;
    tau_ = tau;
    system_->drive(0.0);
    return true;
  }

  BatchStatus run_scenario() {
    System& s = *system_;
    const auto steps = static_cast<Index>(p_.lengths.size());
    const Step::Counts before = method_->counts();
    const Step::Given given = varies_ ? Step::Given([this](double c) {
      half_ = 2 * step_ + static_cast<Index>(2.0 * c);
      system_->drive(0.0);
    })
                                      : Step::Given();
    step_ = row_done_ = half_ = 0;
    s.q = Eigen::Map<const Eigen::VectorXd>(p_.q0.at(b_), arm_->nq());
    s.v = Eigen::Map<const Eigen::VectorXd>(p_.v0.at(b_), arm_->nv());
    tau_ = Eigen::Map<const Eigen::VectorXd>(p_.tau.at(b_, p_.hold[0]), arm_->nv());
    s.a.setZero();
    s.ws.a.setZero();
    s.drive(0.0);
    Status status = method_->start(s.ws, s.q, s.v, s.tau);
    long since = 0;
    bool stopped = false;
    while (status == Status::ok && write_row() && step_ < steps && !stopped) {
      const auto k = static_cast<std::size_t>(step_);
      status = method_->advance(p_.lengths[k], s.ws, s.q, s.v, s.tau, given);
      if (status != Status::ok) break;
      ++step_;
      half_ = 2 * step_;
      if (step_ < steps && p_.hold[k + 1] != p_.hold[k] && hold(p_.hold[k + 1]))
        status = method_->jump(s.ws, s.q, s.v, s.tau);
      ++since;
      if (pace_.due() || step_ == steps) {
        shared_.done += since;
        since = 0;
        if (calling_) shared_.look_around();
        stopped = shared_.stop && step_ < steps;
      }
    }
    const Step::Counts& after = method_->counts();
    stats_.steps += step_;
    stats_.evaluations += after.evaluations - before.evaluations;
    stats_.factorisations += after.factorisations - before.factorisations;
    stats_.iterations += after.iterations - before.iterations;
    if (stopped) return BatchStatus::not_done;
    if (status == Status::ok && row_done_ < static_cast<Index>(p_.rows.size())) status = Status::not_finite;
    return static_cast<BatchStatus>(status);
  }

  /// Writes the state, if a row is due. @return whether it is finite
  bool write_row() {
    if (row_done_ == static_cast<Index>(p_.rows.size()) || p_.rows[static_cast<std::size_t>(row_done_)] != step_)
      return true;
    System& s = *system_;
    q_ = s.q;
    if (shared_.out.a || shared_.out.tau) {
      row_.done = 0;
      const bool good = s.record(row_, false);
      s.q = q_;
      if (!good) return false;
    }
    for (std::size_t n = 0; n < arm_->size(); ++n) arm_->link(n).joint().normalise(q_.data() + arm_->first_q(n));
    put(shared_.out.q, q_.data(), arm_->nq());
    put(shared_.out.v, s.v.data(), arm_->nv());
    put(shared_.out.a, row_.a.data(), arm_->nv());
    put(shared_.out.tau, row_.tau.data(), arm_->nv());
    ++row_done_;
    return true;
  }

  void put(double* block, const double* x, int n) const {
    if (block) std::copy(x, x + n, block + (b_ * static_cast<Index>(p_.rows.size()) + row_done_) * n);
  }

  Shared& shared_;
  const BatchProblem& p_;
  bool calling_;
  Index group_;  // scenarios taken at once
  Pace pace_;
  LaneGroup lanes_;
  bool own_laws_ = false;  // whether columns or gains differ from scenario to scenario
  bool varies_ = false;    // whether anything changes within a step
  Index b_ = 0;            // scenario
  Index step_ = 0, half_ = 0, row_done_ = 0;
  const Arm* arm_ = nullptr;
  std::vector<Drive> drives_;
  std::vector<LoadDrive> loads_;
  Eigen::VectorXd tau_;  // held now
  std::unique_ptr<Control> control_;
  std::unique_ptr<System> system_;
  std::unique_ptr<Step> method_;
  Trajectory row_;     // of one row
  Eigen::VectorXd q_;  // with quaternions of unit length
  BatchStats stats_;
};

void check(const BatchProblem& p, const BatchOutput& out, int workers) {
  if (p.scenarios < 0) bad_value("scenarios", p.scenarios, "must not be negative");
  if (p.arms.size() != 1 && static_cast<Index>(p.arms.size()) != p.scenarios)
    bad_value("arms", p.arms.size(), "must be one, or one for each scenario");
  for (const Arm* arm : p.arms)
    if (arm->nq() != p.arms[0]->nq() || arm->nv() != p.arms[0]->nv())
      bad_value("arms", "an arm", "must have the sizes of the first");
  const std::size_t steps = p.lengths.size();
  if (steps == 0) bad_value("steps", 0, "must be at least one");
  for (double h : p.lengths) positive("step", h);
  if (p.times.size() != steps + 1) bad_value("times", p.times.size(), "must be one more than the steps");
  if (p.hold.size() != steps) bad_value("hold", p.hold.size(), "must be as many as the steps");
  for (std::size_t k = 0; k < p.rows.size(); ++k)
    if (p.rows[k] < 0 || p.rows[k] > static_cast<Index>(steps) || (k > 0 && p.rows[k] <= p.rows[k - 1]))
      bad_value("rows", p.rows[k], "must increase, from 0 to the number of steps");
  for (const BatchLoad& l : p.loads)
    if (l.places.size() != 1 && static_cast<Index>(l.places.size()) != p.scenarios)
      bad_value("places of a load", l.places.size(), "must be one, or one for each scenario");
  for (const Arm* arm : p.arms)
    if (p.rk4) refuse_friction(*arm, "rk4");
  if (!p.q0.data || !p.v0.data || !p.tau.data) bad_value("q0, v0, tau", "null", "must be given");
  positive("rtol", p.rtol);
  if (!(p.spectral_radius >= 0.0 && p.spectral_radius <= 1.0))
    bad_value("spectral_radius", p.spectral_radius, "must be from 0 to 1");
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
  Shared shared{problem, out, alive};
  const Index steps = problem.scenarios * static_cast<Index>(problem.lengths.size());
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
  for (Index b = shared.next; b < problem.scenarios; ++b) {  // nobody has taken these
    fill_rows(problem, out, b, 0);
    if (out.reached) out.reached[b] = problem.times[0];
  }
  for (Index b = 0; b < problem.scenarios; ++b)
    stats.interrupted = stats.interrupted || out.status[b] == static_cast<int>(BatchStatus::not_done);
  return stats;
}

}  // namespace flexarm
