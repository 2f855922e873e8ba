#include "kinks.hpp"

#include <algorithm>
#include <cmath>

#include "arm/resistance.hpp"
#include "arrays.hpp"
#include "setup/single.hpp"

namespace flexarm {

namespace {

constexpr double kAtLimit = 1e-9;  // parts of a limit of friction: nearer is at it

/// Past a stop or along a rope.
signed char piece(double depth, bool damped) { return depth > 0.0 ? (damped && depth < kSoftEntry ? 1 : 2) : 0; }

/// @param kept, push  what the contact would remember, and its force on the arm
signed char piece(const Contact& contact, const double* kept, const double* push) {
  const double gap = kept[lanes::kRemembered - 2], normal = kept[lanes::kRemembered - 1];
  if (!(normal > 0.0)) return gap < 0.0 ? 1 : 0;
  if (contact.coulomb == 0.0) return 2;
  const double most = contact.coulomb * normal, bent = Eigen::Map<const Eigen::Vector3d>(kept + 1).norm();
  const double drag = std::sqrt(std::max(0.0, Eigen::Map<const Eigen::Vector3d>(push).squaredNorm() - normal * normal));
  return static_cast<signed char>(2 + (contact.tangential_stiffness * bent > most * (1.0 - kAtLimit) ? 1 : 0) +
                                  (drag > most * (1.0 - kAtLimit) ? 2 : 0));
}

}  // namespace

Kinks::Kinks(const System& s) {
  const Arm& arm = s.arm;
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const Joint& joint = arm.link(n).joint();
    const auto motions = static_cast<int>(joint.motions().size());
    for (int i = 0; joint.passive() && i < joint.nv(); ++i) {
      const JointForce& f = joint.forces()[static_cast<std::size_t>(i)];
      const bool ball = i == motions;  // its three rates are alike
      if (i > motions || f.limit_stiffness == 0.0 || s.ws.prescribed[static_cast<std::size_t>(arm.first(n) + i)])
        continue;
      if (std::isfinite(f.lower) || std::isfinite(f.upper))
        stops_.push_back({static_cast<int>(arm.first_q(n)) + i, ball, f.limit_damping > 0.0, f.lower, f.upper});
    }
  }
  for (std::size_t k = 0; k < arm.struts().size(); ++k)
    if (arm.struts()[k].tension_only) ropes_.push_back(static_cast<int>(k));
  const auto struts = static_cast<Eigen::Index>(arm.struts().size());
  driven_.setZero(struts);
  lines_.motion.resize(3, struts);
  lines_.jacobian.resize(arm.nv(), struts);
  limits_ = !s.ws.limits.empty() || std::any_of(s.ws.feedback.begin(), s.ws.feedback.end(),
                                                [](const auto& f) { return std::isfinite(f.law->limit); });
  touching_.resize(lanes::kRemembered * arm.contacts().size());
  pushes_.resize(3 * arm.contacts().size());
  count_ =
      stops_.size() + ropes_.size() + arm.contacts().size() + (limits_ ? s.ws.feedback.size() + s.ws.limits.size() : 0);
}

void Kinks::look(System& s, signed char* out) {
  for (const Stop& stop : stops_) {
    if (stop.ball) {
      *out++ = piece(BallTurn<double>(s.q.data() + stop.q).angle - stop.upper, stop.damped);
      continue;
    }
    const double q = s.q[stop.q];
    *out++ = static_cast<signed char>(piece(q - stop.upper, stop.damped) - piece(stop.lower - q, stop.damped));
  }
  if (!ropes_.empty()) {
    driven_.setZero();
    for (const AppliedLoad& l : s.ws.loads)
      if (l.load.strut >= 0) driven_[l.load.strut] += l.wrench[0];
    strut_motion(s.arm, s.ws, s.q, s.v, driven_, lines_);
    for (int k : ropes_) {
      const Strut& rope = s.arm.struts()[static_cast<std::size_t>(k)];
      const signed char now = piece(lines_.motion(0, k) - rope.length, rope.damping > 0.0);
      *out++ = lines_.motion(2, k) < 0.0 ? now : static_cast<signed char>(-1);
    }
  }
  if (const std::size_t n = s.arm.contacts().size(); n > 0) {
    s.ws.chain_to_move().move(s.q.data(), s.v.data());
    s.ws.chain().contacts(touching_.data(), pushes_.data());
    for (std::size_t k = 0; k < n; ++k)
      *out++ = piece(s.arm.contacts()[k], touching_.data() + lanes::kRemembered * k, pushes_.data() + 3 * k);
  }
  if (limits_) sides(s.ws.feedback, s.ws.limits, s.q, s.v, out);
}

}  // namespace flexarm
