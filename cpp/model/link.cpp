#include "flexarm/link.hpp"

#include <Eigen/Eigenvalues>

#include "flexarm/check.hpp"

namespace flexarm {

void RigidBody::check() const {
  non_negative("mass", mass);
  finite("com", com);
  finite("end", end);
  if (!inertia.allFinite()) bad_value("inertia", inertia.reshaped().transpose(), "must be finite");
  const double scale = inertia.cwiseAbs().maxCoeff();
  if ((inertia - inertia.transpose()).cwiseAbs().maxCoeff() > 1e-12 * scale)
    bad_value("inertia", inertia.reshaped().transpose(), "must be symmetric");
  const Eigen::Vector3d moments = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(inertia).eigenvalues();
  if (moments[0] < -1e-12 * scale)
    bad_value("inertia", inertia.reshaped().transpose(), "must not have a negative principal moment");
  // A plate has equality, and tables round. A single nonzero moment is about the axis of a planar arm.
  if (moments[1] > 1e-12 * scale && moments[2] > 1.01 * (moments[0] + moments[1])) {
    std::ostringstream right;
    right << "no body has the principal moments " << moments.transpose()
          << " kg m^2: none is larger than the sum of the others; are they about the centre of mass?";
    bad_value("inertia", inertia.reshaped().transpose(), right.str());
  }
}

Link::Link(Joint joint, std::optional<RigidBody> hub, std::optional<Beam> beam, std::optional<RigidBody> tip)
    : joint_(std::move(joint)),
      hub_(hub.value_or(RigidBody{})),
      tip_(tip.value_or(RigidBody{})),
      beam_(std::move(beam)) {
  hub_.check();
  tip_.check();
}

double Link::mass() const { return hub_.mass + (beam_ ? beam_->mass() : 0.0) + tip_.mass; }

SliceTable Link::slice_at(double x) const {
  if (!beam_) bad_value("x", x, "this link has no beam; leave x out for its end");
  return beam_->slice_at(x);
}

}  // namespace flexarm
