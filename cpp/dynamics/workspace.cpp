#include "flexarm/workspace.hpp"

#include <string>
#include <utility>

#include "arrays.hpp"
#include "flexarm/check.hpp"
#include "setup/single.hpp"
#include "step/feedback.hpp"

namespace flexarm {

Workspace::Workspace(const Arm& arm, const std::vector<bool>& given, const std::vector<Load>& applied)
    : tau(Eigen::VectorXd::Zero(arm.nv())),
      a(tau),
      prescribed(given),
      rhs(tau),
      total(tau),
      rest(tau),
      spare(tau),
      nq_(arm.nq()),
      q_(Eigen::VectorXd::Zero(arm.nq())),
      v_(tau) {
  if (!given.empty() && given.size() != static_cast<std::size_t>(arm.nv()))
    bad_value("prescribed", std::to_string(given.size()) + " entries",
              "must be one for each of the arm's " + std::to_string(arm.nv()) + " rates, or none");
  prescribed.resize(static_cast<std::size_t>(arm.nv()), false);
  for (std::size_t n = 0; n < arm.size(); ++n)
    for (int k = 0; k < arm.link(n).nj() + arm.link(n).ne(); ++k) {
      const int i = arm.first(n) + k;
      if (!prescribed[static_cast<std::size_t>(i)])
        free.push_back(i);
      else if (k >= arm.link(n).nj())
        bad_value("prescribed", arm.coordinates()[static_cast<std::size_t>(i)], "must be a joint's");
    }
  rhs.resize(static_cast<Eigen::Index>(free.size()));
  factor.compute(Eigen::MatrixXd::Identity(1, 1));  // a copy must not read unset memory
  for (const Load& load : applied) loads.push_back({load});
  wrenches_.resize(6 * applied.size());
  const lanes::KernelArm& known = lanes::KernelArm::of(arm);
  chain_ = Held<lanes::Single>(applied.empty() ? new lanes::Single(known, prescribed)
                                               : new lanes::Single(known.loaded(arm, applied), prescribed));
  frames = Held<lanes::SingleFrames>(new lanes::SingleFrames(arm));
}

void Workspace::place(const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  q_ = q;
  v_ = v;
  placed_ = false;
}

lanes::Single& Workspace::placed_chain() {
  if (!placed_) chain_to_move().move(q_.data(), v_.data());
  return chain();
}

lanes::Single& Workspace::chain_to_move() {
  placed_ = true;
  return chain();
}

lanes::Single& Workspace::chain() {
  if (!loads.empty()) {
    for (std::size_t i = 0; i < loads.size(); ++i) Eigen::Map<Vec6<double>>(wrenches_.data() + 6 * i) = loads[i].wrench;
    chain_->load(wrenches_.data());
  }
  if (!remembered.empty()) chain_->recall(remembered.data());
  if (!loop_forces.empty()) chain_->hold(loop_forces.data());
  return *chain_;
}

void remember_contacts(const Arm& arm, Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  ws.noted = false;
  if (arm.contacts().empty()) return;
  ws.remembered.resize(lanes::kRemembered * arm.contacts().size());
  ws.chain_to_move().move(q.data(), v.data());
  ws.chain().contacts(ws.remembered.data(), nullptr);
}

void note_contacts(Workspace& ws) {
  if (ws.remembered.empty()) return;
  ws.note.resize(ws.remembered.size());
  ws.chain().contacts(ws.note.data(), nullptr);
  ws.noted = true;
}

bool remember_note(Workspace& ws) {
  if (!ws.noted) return false;
  ws.remembered = ws.note;
  ws.noted = false;
  return true;
}

void contact_forces(Workspace& ws, double* out) { ws.chain().contacts(nullptr, out); }

void Workspace::feed_back(const std::vector<Feedback>& laws) {
  for (const Feedback& law : laws)
    if (law.column.size() != a.size() || law.by_v.size() != a.size() || law.by_q.size() != nq_)
      bad_value("column, by_q, by_v of a feedback law",
                std::to_string(law.column.size()) + ", " + std::to_string(law.by_q.size()) + ", " +
                    std::to_string(law.by_v.size()),
                "their lengths must be nv, nq, nv: " + std::to_string(a.size()) + ", " + std::to_string(nq_) + ", " +
                    std::to_string(a.size()));
  feedback.clear();
  for (const Feedback& law : laws) feedback.push_back({&law});
  const Eigen::Index n = static_cast<Eigen::Index>(laws.size()), nv = a.size();
  feedback_numbers.setZero(n * (2 * nv + nq_ + 1));
  for (Eigen::Index l = 0; l < n; ++l) {
    const Feedback& law = laws[static_cast<std::size_t>(l)];
    feedback_numbers.segment(l * nv, nv) = law.column;
    feedback_numbers.segment(n * nv + l * nq_, nq_) = law.by_q;
    feedback_numbers.segment(n * (nv + nq_) + l * nv, nv) = law.by_v;
    feedback_numbers[n * (2 * nv + nq_) + l] = law.limit;
  }
  make_room_for_limits(*this);
}

void make_room_for_limits(Workspace& ws) {
  const Eigen::Index laws = static_cast<Eigen::Index>(ws.feedback.size()),
                     count = static_cast<Eigen::Index>(ws.limits.size());
  FeedbackLaws<double> counted;
  counted.laws = static_cast<int>(laws);
  counted.nv = static_cast<int>(ws.a.size());
  counted.limits = static_cast<int>(count);
  Arena scratch;
  counted.lay_out(scratch);
  const Eigen::Index numbers = laws * (2 * ws.a.size() + ws.nq() + 1);
  const Eigen::Index size = numbers + count + static_cast<Eigen::Index>(scratch.bytes() / sizeof(double));
  if (ws.feedback_numbers.size() != size) ws.feedback_numbers.conservativeResizeLike(Eigen::VectorXd::Zero(size));
  for (Eigen::Index c = 0; c < count; ++c)
    ws.feedback_numbers[numbers + c] = ws.limits[static_cast<std::size_t>(c)].most;
}

}  // namespace flexarm
