#include "loops_told.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <sstream>
#include <utility>

#include "arrays.hpp"
#include "flexarm/ci.hpp"
#include "flexarm/kinematics.hpp"
#include "flexarm/workspace.hpp"
#include "setup/single.hpp"

namespace flexarm {

namespace {

constexpr double kTied = 1e-7;       // of the size of a row: rows that differ by less depend on one another
constexpr double kNear = 0.1;        // of that difference at the start: a singular position is near
constexpr double kPart = 1e-3;       // of a row, or of its part of a motion, that has a part in it
constexpr double kOpen = 1e-7;       // of the way of the motions: a gap that they leave
constexpr double kRounding = 1e-12;  // m, or rad
constexpr int kRounds = 5;           // of closing a loop that is nearly closed

/// Rigid rows at a state, and how they depend on one another.
class Rows {
 public:
  Rows(const Arm& arm, const std::vector<bool>& given) : arm_(arm), ws_(arm, given) {
    const lanes::Layout& layout = ws_.chain().layout();  // of an arm that moves in a plane, the rows there
    for (int k = 0; k < layout.loops; ++k)
      for (int i = 0; i < layout.loop[k].rows; ++i)
        if (layout.loop[k].rigid(layout.loop[k].row[i])) of_.push_back(k);
    G_.resize(arm.nv(), static_cast<Eigen::Index>(of_.size()));
    motion_.resize(3, G_.cols());
  }
  bool none() const { return of_.empty(); }
  /// Closes the loops near q, v as far as the coordinates that are not given allow.
  void close(Eigen::VectorXd& q, Eigen::VectorXd& v) {
    for (int k = 0; k < kRounds; ++k) ws_.chain_to_move().project({}, q.data(), v.data(), ws_.spare.data());
  }
  /// The rows there, to unit size in the norm of the inverse mass matrix, by columns.
  void find(const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
    move_chain(ws_, q, v);
    ws_.chain().loop_rows(motion_.data(), G_.data());
    composite_mass_matrix(arm_, ws_);
    Eigen::MatrixXd all = G_;
    ws_.M.llt().matrixL().solveInPlace(all);
    size_ = all.colwise().norm().transpose();
    const double least = kRounding * size_.maxCoeff();  // such a row is nothing but rounding
    for (double& x : size_) x = x > least ? x : std::numeric_limits<double>::infinity();
    const auto n = static_cast<Eigen::Index>(ws_.free.size());
    Eigen::MatrixXd M(n, n), free(n, G_.cols());
    for (Eigen::Index k = 0; k < n; ++k) {
      for (Eigen::Index l = 0; l < n; ++l) M(k, l) = ws_.M(ws_.free[k], ws_.free[l]);
      free.row(k) = G_.row(ws_.free[k]);
    }
    if (n > 0) M.llt().matrixL().solveInPlace(free);
    for (Eigen::Index r = 0; r < G_.cols(); ++r) free.col(r) /= size_[r];
    Eigen::MatrixXd square = Eigen::MatrixXd::Zero(std::max(n, G_.cols()), G_.cols());
    square.topRows(n) = free;
    svd_.compute(square, Eigen::ComputeFullV);
  }
  const Eigen::VectorXd& sizes() const { return svd_.singularValues(); }
  Eigen::Index rank() const { return (sizes().array() > kTied).count(); }
  /// A combination of rows: the k-th of those that depend on one another the least.
  Eigen::VectorXd combination(Eigen::Index k) const { return svd_.matrixV().col(k).cwiseQuotient(size_); }
  /// The rates by a combination, and its size beside the inertia there.
  Eigen::VectorXd by_rates(const Eigen::VectorXd& combination) const { return G_ * combination; }
  double size_of(const Eigen::VectorXd& by, int rate) const {
    return std::abs(by[rate]) / std::sqrt(ws_.M(rate, rate));
  }
  /// The largest g, with the loop it is of.
  std::pair<double, int> gap() const {
    Eigen::Index at = 0;
    const double most = motion_.row(0).cwiseAbs().maxCoeff(&at);
    return {most, of_[static_cast<std::size_t>(at)]};
  }
  /// The loops that have a part in a combination.
  std::set<int> loops(const Eigen::VectorXd& combination) const {
    const Eigen::VectorXd parts = (combination.array() == 0.0).select(0.0, combination.cwiseProduct(size_).cwiseAbs());
    std::set<int> out;
    for (Eigen::Index r = 0; r < parts.size(); ++r)
      if (parts[r] > kPart * parts.maxCoeff()) out.insert(of_[static_cast<std::size_t>(r)]);
    return out;
  }

 private:
  const Arm& arm_;
  Workspace ws_;
  std::vector<int> of_;
  Eigen::MatrixXd G_;
  Eigen::Matrix3Xd motion_;
  Eigen::VectorXd size_;
  Eigen::JacobiSVD<Eigen::MatrixXd> svd_;
};

std::string named(const std::set<int>& loops) {
  std::ostringstream text;
  for (const int k : loops) text << (k == *loops.begin() ? "" : " and ") << "loop [" << k << "]";
  return text.str();
}

/// Of prescribed motions within the next h; empty where all loops can be closed then.
std::string contradiction(const Arm& arm, const std::vector<Drive>& drives, Rows& rows, Eigen::VectorXd q,
                          Eigen::VectorXd v, double t, double h) {
  double way = 0.0;
  rows.find(q, v);
  struct Tie {
    Eigen::VectorXd by;
    std::vector<int> moved;
    std::set<int> loops;
  };
  std::vector<Tie> ties;  // of motions, which nothing free can undo
  for (Eigen::Index k = rows.rank(); k < rows.sizes().size(); ++k) {
    const Eigen::VectorXd combination = rows.combination(k);
    Tie tie{rows.by_rates(combination), {}, rows.loops(combination)};
    for (const Drive& d : drives)
      if (d.motion && rows.size_of(tie.by, d.coordinate) > kPart) tie.moved.push_back(d.coordinate);
    if (!tie.moved.empty()) ties.push_back(std::move(tie));
  }
  if (ties.empty()) return {};
  const Eigen::VectorXd before = q;
  displace(arm, before, h * v, q);
  for (const Drive& d : drives) {
    if (!d.motion) continue;
    const MotionValue m = d.motion(t + h);
    const Eigen::Index i = arm.coordinate_of(d.coordinate);
    way = std::max(way, std::abs(m.q - before[i]));
    q[i] = m.q;
    v[d.coordinate] = m.v;
  }
  rows.close(q, v);
  rows.find(q, v);
  const auto [gap, loop] = rows.gap();
  if (!(gap > kOpen * way + kRounding)) return {};
  const std::vector<std::string> names = arm.coordinates();
  for (const Tie& tie : ties) {
    if (tie.loops.count(loop) == 0) continue;
    std::ostringstream text;
    const int last = tie.moved.back();
    text << named(tie.loops) << " cannot be closed at t = " << t + h << " s: ";
    if (tie.moved.size() == 1) {
      text << "nothing is free to follow the motion of '" << names[static_cast<std::size_t>(last)]
           << "', which would have to stand still, not move at " << v[last] << ": leave this motion away";
      return text.str();
    }
    text << "the motions of ";
    for (const int i : tie.moved)
      text << (i == tie.moved.front() ? ""
               : i == last            ? " and "
                                      : ", ")
           << "'" << names[static_cast<std::size_t>(i)] << "'";
    text << " contradict one another there";
    double rest = 0.0;
    for (const int i : tie.moved)
      if (i != last) rest -= tie.by[i] * v[i];
    text << ", where '" << names[static_cast<std::size_t>(last)] << "' would have to move at " << rest / tie.by[last]
         << ", not at " << v[last] << ": leave one of these motions away, which then follows, or take its values from "
         << "assemble";
    return text.str();
  }
  return {};
}

}  // namespace

std::string told_of_loops(const System& s, const Eigen::VectorXd& start, double t, double h) {
  if (s.arm.loops().empty() || !all_finite(s.q) || !all_finite(s.v)) return {};
  Rows rows(s.arm, s.ws.prescribed);
  if (rows.none()) return {};
  for (const double ahead : {h, 1e2 * h, 1e4 * h, 1e6 * h, 1e8 * h})
    if (const std::string text = contradiction(s.arm, s.drives, rows, s.q, s.v, t, ahead); !text.empty()) return text;
  rows.find(start, s.v);
  const Eigen::Index rank = rows.rank();
  if (rank == 0) return {};
  const double usual = rows.sizes()[rank - 1];
  rows.find(s.q, s.v);
  if (!(rows.sizes()[rank - 1] < kNear * usual)) return {};
  std::ostringstream text;
  text << named(rows.loops(rows.combination(rank - 1))) << " came to a singular position at t = " << t
       << " s, where equations depend on one another that did not at the start: beyond it the loops cannot be closed, "
       << "or in more ways than one; keep away from it, or let a loop give way (stiffness)";
  return text.str();
}

}  // namespace flexarm
