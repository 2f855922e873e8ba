#include "flexarm/workspace.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "flexarm/check.hpp"
#include "lanes/feedback.hpp"
#include "lanes/single.hpp"

namespace flexarm {

Workspace::Workspace(const Arm& arm, const std::vector<bool>& given, const std::vector<Load>& applied)
    : SweepWorkspace<double>(arm, applied), a(Eigen::VectorXd::Zero(arm.nv())), prescribed(given), nq_(arm.nq()) {
  if (!given.empty() && given.size() != static_cast<std::size_t>(arm.nv()))
    bad_value("prescribed", std::to_string(given.size()) + " entries",
              "must be one for each of the arm's " + std::to_string(arm.nv()) + " rates, or none");
  prescribed.resize(static_cast<std::size_t>(arm.nv()), false);
  Eigen::Index widest = 0;
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Link& link = arm.link(n);
    std::vector<int> free_columns;
    for (int k = 0; k < link.nj() + link.ne(); ++k) {
      const int i = arm.first(n) + k;
      if (prescribed[i]) {
        if (k >= link.nj()) bad_value("prescribed", arm.coordinates()[i], "must be a joint's");
        continue;
      }
      free.push_back(i);
      if (k < link.nj()) free_columns.push_back(k);
    }
    ArticulatedLink b(std::move(free_columns), link.ne());
    b.T = b.turn = Eigen::VectorXd::Zero(b.D.rows());
    b.N.setZero();
    b.Ne = Eigen::VectorXd::Zero(link.ne());
    articulated.push_back(std::move(b));
    widest = std::max<Eigen::Index>(widest, link.nj() + link.ne());
  }
  rhs = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(free.size()));
  total = rhs_all = placed_a = Eigen::VectorXd::Zero(arm.nv());
  columns = Eigen::MatrixXd::Zero(6, widest);
  factor.compute(Eigen::MatrixXd::Identity(1, 1));  // so that a copy reads nothing that was never set
  wrenches_.resize(6 * applied.size());
  if (const lanes::KernelArm* known = lanes::KernelArm::of(arm))
    fast = FastPath(applied.empty() ? new lanes::Single(*known, prescribed)
                                    : new lanes::Single(known->loaded(arm, applied), prescribed));
  if (lanes::KernelArm::in_space(arm)) frames = Held<lanes::SingleFrames>(new lanes::SingleFrames(arm));
}

lanes::Single& Workspace::kernels() {
  lanes::Single& k = *fast.operator->();
  if (loads.empty()) return k;
  for (std::size_t i = 0; i < loads.size(); ++i) Eigen::Map<Vec6<double>>(wrenches_.data() + 6 * i) = loads[i].wrench;
  k.load(wrenches_.data());
  return k;
}

FastPath::FastPath() = default;
FastPath::FastPath(lanes::Single* arm) : arm_(arm) {}
FastPath::FastPath(const FastPath& other) : arm_(other.arm_ ? new lanes::Single(*other.arm_) : nullptr) {}
FastPath::FastPath(FastPath&&) noexcept = default;
FastPath& FastPath::operator=(FastPath&&) noexcept = default;
FastPath::~FastPath() = default;

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
  const auto scratch = FeedbackLaws<double>::scalars(static_cast<int>(n), static_cast<int>(nv));
  feedback_numbers.setZero(n * (2 * nv + nq_ + 1) + static_cast<Eigen::Index>(scratch));
  for (Eigen::Index l = 0; l < n; ++l) {
    const Feedback& law = laws[static_cast<std::size_t>(l)];
    feedback_numbers.segment(l * nv, nv) = law.column;
    feedback_numbers.segment(n * nv + l * nq_, nq_) = law.by_q;
    feedback_numbers.segment(n * (nv + nq_) + l * nv, nv) = law.by_v;
    feedback_numbers[n * (2 * nv + nq_) + l] = law.limit;
  }
}

}  // namespace flexarm
