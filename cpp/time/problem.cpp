#include "flexarm/problem.hpp"

#include "flexarm/check.hpp"

namespace flexarm {

namespace {

/// @throws std::invalid_argument naming a matrix whose size fits neither the others nor an arm of nq, nv
void check_law(const LinearLaw& law, Eigen::Index nq, Eigen::Index nv) {
  const Eigen::Index nx = law.A.rows(), ny = law.B.cols(), nu = law.C.rows();
  const auto size = [](const char* name, const auto& m, Eigen::Index rows, Eigen::Index cols) {
    if (m.rows() != rows || m.cols() != cols)
      bad_value(std::string("size of a law's ") + name, std::to_string(m.rows()) + " x " + std::to_string(m.cols()),
                "must be " + std::to_string(rows) + " x " + std::to_string(cols));
  };
  size("A", law.A, nx, nx);
  size("B", law.B, nx, ny);
  size("C", law.C, nu, nx);
  size("D", law.D, nu, ny);
  size("columns", law.columns, nv, nu);
  size("limit", law.limit, nu, 1);
  size("reach", law.reach, nu, 1);
  size("u0", law.u0, nu, 1);
  size("windup", law.windup, nx, nu);
  if (!law.read) {
    size("by_q", law.by_q, ny, nq);
    size("by_v", law.by_v, ny, nv);
  }
  if (law.offset.size() > 0) size("offset", law.offset, ny, 1);
  if (law.resolution.size() > 0) size("resolution", law.resolution, ny, 1);
  if (law.start.size() > 0) size("start", law.start, nx, ny);
}

}  // namespace

void Problem::check() const {
  const auto check_vector = [](const char* name, const Eigen::VectorXd& x, int n) {
    if (x.size() != n) bad_value(std::string(name) + " length", x.size(), "must be " + std::to_string(n));
    if (!x.allFinite()) bad_value(name, "nan or inf", "must be finite");
  };
  check_vector("q0", q0, arm->nq());
  check_vector("v0", v0, arm->nv());
  check_vector("tau", tau, arm->nv());
  for (const Drive& d : drives) {
    if (d.column.size() > 0) {
      if (d.column.size() != arm->nv() || !d.force || d.motion)
        bad_value("length of a drive's column", d.column.size(),
                  "must be " + std::to_string(arm->nv()) + ", with a force");
      continue;
    }
    if (d.coordinate < 0 || d.coordinate >= arm->nv() || !d.motion == !d.force)
      bad_value("drive of coordinate", d.coordinate, "needs a coordinate of the arm and a motion or a force");
    if (d.motion && arm->coordinate_of(d.coordinate) < 0)
      bad_value("motion of coordinate", d.coordinate, "a ball's coordinates cannot be prescribed");
  }
  for (const Sampler& s : samplers)
    if (const LinearLaw* law = s.law.target<LinearLaw>()) check_law(*law, arm->nq(), arm->nv());
}

bool Problem::asks_functions() const {
  const auto unsampled = [](const auto& all) {
    return std::any_of(all.begin(), all.end(), [](const auto& x) { return x.breaks.size() == 0; });
  };
  const auto follows = [](const Feedback& f) { return f.reference && f.breaks.size() == 0; };
  return unsampled(drives) || unsampled(loads) || std::any_of(feedback.begin(), feedback.end(), follows);
}

void check_times(const Eigen::VectorXd& t) {
  if (t.size() < 2) bad_value("t", t.size(), "needs at least two times");
  if (!t.allFinite()) bad_value("t", "nan or inf", "must be finite");
  for (Eigen::Index k = 0; k + 1 < t.size(); ++k)
    if (!(t[k + 1] > t[k])) bad_value("t[" + std::to_string(k + 1) + "]", t[k + 1], "t must increase");
}

}  // namespace flexarm
