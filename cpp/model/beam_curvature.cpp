// Beams that are curved or twisted at rest.
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

#include "beam_profile.hpp"
#include "flexarm/check.hpp"
#include "flexarm/spatial.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::Vector4d;

namespace {

constexpr double kMostTurned = 500.0;  ///< rad; equations of all points together are solved
constexpr int kLooks = 100;            ///< samples in the check of a curvature

/// Of a quaternion w x y z of any length.
Matrix3d rotation_of(const Vector4d& p) {
  return Eigen::Quaterniond(p[0], p[1], p[2], p[3]).normalized().toRotationMatrix();
}

}  // namespace

/// The integrands along the beam at Gauss points.
struct RestShape {
  GaussRule rule;
  std::array<std::vector<ShapeSet>, 3> K;  ///< one or none, of the rows of the curvature that are not zero
  Eigen::Matrix4Xd turn;                   ///< slope of R's quaternion, w x y z (Eq. 25)
  Eigen::Matrix3Xd place;                  ///< x' = R e1 (Eq. 24)
  std::vector<Mat6X<double>> slope;        ///< of [J_T; J_R] (Eq. 37, 39)

  RestShape(const MatrixXd& given, double length) : rule(1, length) {
    for (Index c = 0; c < 3; ++c)
      if (!given.col(c).isZero(0.0)) K[static_cast<std::size_t>(c)].emplace_back(torsion, given.col(c), length);
  }

  /// K, or its integral from 0.
  Vector3d at(double X, bool integral) const {
    Vector3d out = Vector3d::Zero();
    for (Index c = 0; c < 3; ++c)
      for (const ShapeSet& shape : K[static_cast<std::size_t>(c)]) {
        const ShapeValues v = shape.at(X);
        out[c] = integral ? v.slope[0] : v.strain[0];
      }
    return out;
  }
};

namespace {

/// Checks that the shape at rest is possible with the known sections and can be integrated.
void check_bend(const RestShape& shape, const Along<SectionLaw>* sections, double length) {
  const GaussRule rule(kLooks, length);
  double turned = 0.0;
  for (Index j = 0; j < rule.points.size(); ++j) {
    const double X = rule.points[j];
    const Vector3d k = shape.at(X, false);
    turned += rule.weights[j] * k.norm();
    if (!sections) continue;
    const SectionLaw law = sections->at(X);
    const double stretch = law.rigidity_of(extension), flap = law.rigidity_of(bending_z),
                 edge = law.rigidity_of(bending_y);  // over the former, squares of radii of gyration
    const double folded = stretch > 0.0 ? std::sqrt(3.0 / stretch * (flap * k[1] * k[1] + edge * k[2] * k[2])) : 0.0;
    if (!(folded < 1.0))
      bad_value("curvature", k.transpose(),
                "at x = " + std::to_string(X) + " m folds the beam: its radius must be above half the section's size");
  }
  if (!(turned < kMostTurned))
    bad_value("curvature", shape.at(0.0, false).transpose(),
              "at x = 0 and so on turns the beam's sections by " + std::to_string(static_cast<long>(turned)) +
                  " rad in all, beyond " + std::to_string(static_cast<int>(kMostTurned)) +
                  "; is it in 1/m? Split the beam, if so");
}

}  // namespace

bool Beam::curved_about(int axis) const {
  for (int c = 0; c < 3; ++c)
    if (c != axis && !rest_->K[static_cast<std::size_t>(c)].empty()) return false;
  return true;
}

SliceAtRest Beam::rest_at(double X) const {
  SliceAtRest out;
  out.x[0] = X;
  if (!rest_) return out;
  const Eigen::RowVectorXd w = integral_weights(rest_->rule, length_, X);
  out.x = rest_->place * w.transpose();
  out.p = (Vector4d::Unit(0) + rest_->turn * w.transpose()).normalized();
  out.R = rotation_of(out.p);
  out.K = rest_->at(X, false);
  out.theta = rest_->at(X, true);
  out.J.setZero(6, ne_);
  for (Index j = 0; j < w.size(); ++j) out.J += w[j] * rest_->slope[static_cast<std::size_t>(j)];
  return out;
}

/// R' = R K~ as a quaternion, p' = p (0, K) / 2, and J_R' = R dK/dq, J_T' = J_R x x' + R dphi/dq.
void Beam::curve(const Profile* profile) {
  const MatrixXd& given = options_.curvature;
  if (given.cols() != 3 || !given.allFinite())
    bad_value("curvature", "", "must be finite, with a column for each of K1, K2, K3");
  if (ne_ > 0 && options_.order != kExact)
    bad_value(
        "order", options_.order,
        "must be \"exact\" where the beam has a curvature at rest: the other orders are series about a straight beam");
  const auto made = std::make_shared<RestShape>(given, length_);
  RestShape& s = *made;
  check_bend(s, profile, length_);
  const int n = enough_gauss_points(options_, shapes_, length_, tapers_) + 8;
  s.rule = GaussRule(n, length_);
  std::vector<Vector3d> K;
  MatrixXd W(n, n), system = MatrixXd::Identity(4 * n, 4 * n);
  std::vector<Eigen::Matrix4d> Q(static_cast<std::size_t>(n));
  for (Index j = 0; j < n; ++j) {
    const double X = s.rule.points[j];
    W.row(j) = integral_weights(s.rule, length_, X);
    const Vector3d k = s.at(X, false);
    Q[static_cast<std::size_t>(j)] << 0.0, -k.transpose(), k, -tilde(k);
  }
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j) system.block<4, 4>(4 * i, 4 * j) -= 0.5 * W(i, j) * Q[static_cast<std::size_t>(j)];
  const Eigen::VectorXd p = system.partialPivLu().solve(Vector4d(Vector4d::Unit(0)).replicate(n, 1));
  s.turn.resize(4, n);
  s.place.resize(3, n);
  s.slope.assign(static_cast<std::size_t>(n), Mat6X<double>::Zero(6, ne_));
  std::vector<StrainMatrix> strains;
  std::vector<Matrix3d> R;
  for (Index j = 0; j < n; ++j) {
    const Vector4d at = p.segment<4>(4 * j);
    strains.push_back(strains_at(s.rule.points[j]));
    R.push_back(rotation_of(at));
    s.turn.col(j) = 0.5 * Q[static_cast<std::size_t>(j)] * at;
    s.place.col(j) = R.back().col(0);
    s.slope[static_cast<std::size_t>(j)].bottomRows<3>() = R.back() * strains.back().topRows<3>();
  }
  for (Index i = 0; i < n; ++i) {
    Eigen::Matrix3Xd J_R = Eigen::Matrix3Xd::Zero(3, ne_), phi(3, ne_);
    for (Index j = 0; j < n; ++j) J_R += W(i, j) * s.slope[static_cast<std::size_t>(j)].bottomRows<3>();
    const StrainMatrix& e = strains[static_cast<std::size_t>(i)];
    phi << e.row(StrainRow::eps), e.row(StrainRow::phi12), e.row(StrainRow::phi13);
    s.slope[static_cast<std::size_t>(i)].topRows<3>() =
        R[static_cast<std::size_t>(i)] * phi - tilde(Vector3d(s.place.col(i))) * J_R;
  }
  rest_ = made;
  const int about = plane_ == Plane::xy ? 2 : 1;
  if (plane_ != Plane::none && !curved_about(about)) plane_ = Plane::none;
}

}  // namespace flexarm
