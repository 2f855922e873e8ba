#include "held_laws.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "flexarm/check.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kOneTime = 1e-6;  // parts of a period by which two times are still one

/// Which of the times first + k period is t; -1: none.
long number(double t, double first, double period) {
  const double k = std::round((t - first) / period);
  return k >= 0.0 && std::abs(first + k * period - t) <= kOneTime * period ? static_cast<long>(k) : -1;
}

}  // namespace

HeldLaws::HeldLaws(const std::vector<Sampler>& samplers, int nv) : times_({}, samplers, nv), columns_(nv, 0) {
  for (std::size_t k = 0; k < samplers.size(); ++k) {
    const Sampler& s = samplers[k];
    const LinearLaw* law = s.law.target<LinearLaw>();
    if (!law || law->read)
      bad_value("samplers[" + std::to_string(k) + "]", "a law of its own", "must be a LinearLaw that reads no sensors");
    const Index nx = law->x.size(), nu = law->columns.cols();
    const long slots = s.delay > 0.0 ? static_cast<long>(std::floor(s.delay / s.period + kOneTime)) + 1 : 0;
    one_time_ = std::min(one_time_, kOneTime * s.period);
    lines_.push_back({*law, s.first, s.period, s.delay, size_, size_ + nx, size_ + nx + nu, slots});
    const Index before = columns_.cols();
    columns_.conservativeResize(Eigen::NoChange, before + nu);
    columns_.rightCols(nu) = law->columns;
    for (Index i = 0; i < nu; ++i) acting_.push_back(size_ + nx + i);
    size_ += nx + nu * (1 + slots);
  }
}

void HeldLaws::pass(double t, const VectorXd& q, const VectorXd& v, VectorXd& z, const std::vector<MatrixXd*>& slopes,
                    const MatrixXd& E) {
  const Index n = v.size();
  for (Line& l : lines_) {
    const Index nx = l.law.x.size(), nu = l.law.columns.cols();
    if (const long k = number(t, l.first, l.period); k >= 0) {
      const Index to = l.slots > 0 ? l.coming + nu * static_cast<Index>(k % l.slots) : l.u;
      l.law.x = z.segment(l.x, nx);
      z.segment(to, nu) = l.law.sample(l.first + static_cast<double>(k) * l.period, q, v, VectorXd());
      z.segment(l.x, nx) = l.law.x;
      for (MatrixXd* s : slopes) {
        MatrixXd dx = s->middleRows(2 * n + l.x, nx), du, de = -l.law.by_v * s->middleRows(n, n);
        de -= (E.size() > 0 ? MatrixXd(l.law.by_q * E) : l.law.by_q) * s->topRows(n);
        l.law.slopes(dx, de, du);
        s->middleRows(2 * n + l.x, nx) = dx;
        s->middleRows(2 * n + to, nu) = du;
      }
    }
    if (l.slots == 0) continue;
    if (const long k = number(t, l.first + l.delay, l.period); k >= 0) {
      const Index from = l.coming + nu * static_cast<Index>(k % l.slots);
      z.segment(l.u, nu) = VectorXd(z.segment(from, nu));
      for (MatrixXd* s : slopes) s->middleRows(2 * n + l.u, nu) = MatrixXd(s->middleRows(2 * n + from, nu));
    }
  }
}

}  // namespace flexarm
