#include "flexarm/problem.hpp"

#include "flexarm/check.hpp"

namespace flexarm {

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
