#include "kalman_parts.hpp"

#include <cmath>

#include "flexarm/check.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::VectorXd;

std::string entry(const char* name, std::size_t k, const char* field) {
  return std::string(name) + "[" + std::to_string(k) + "]." + field;
}

JointForce checked_joint(const Arm& arm, const std::string& field, int rate) {
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const std::vector<JointForce>& forces = arm.link(n).joint().forces();
    const int k = rate - arm.first(n);
    if (k >= 0 && k < arm.link(n).nj()) return forces.empty() ? JointForce() : forces[static_cast<std::size_t>(k)];
  }
  bad_value(field, rate, "must be the index of a joint's rate in v");
}

void check(const Arm& arm, std::size_t k, const KalmanSensor& s) {
  if (s.by_q.size() != arm.nv() || s.by_v.size() != arm.nv() || !s.by_q.allFinite() || !s.by_v.allFinite())
    bad_value(entry("sensors", k, "by_q"), s.by_q.size(), "by_q and by_v must be of finite numbers, one for each rate");
  for (int i = 0; i < arm.nv(); ++i)
    if (s.by_q[i] != 0.0 && arm.coordinate_of(i) < 0)
      bad_value(entry("sensors", k, "by_q"), "of a ball",
                "a ball has no coordinates to be read; take its rates or a place");
  positive(entry("sensors", k, "noise"), s.noise);
  if (!std::isfinite(s.offset)) bad_value(entry("sensors", k, "offset"), s.offset, "must be finite");
  const Index order = s.F.rows();
  if (s.F.cols() != order || s.before.size() != order || s.after.size() != order || !s.F.allFinite() ||
      !s.before.allFinite() || !s.after.allFinite())
    bad_value(entry("sensors", k, "F"), order, "F, before and after must be of one size, and finite");
}

void check(const Arm& arm, const std::vector<KalmanParameter>& parameters) {
  for (std::size_t k = 0; k < parameters.size(); ++k) {
    const KalmanParameter& p = parameters[k];
    if (p.kind != KalmanParameter::payload) checked_joint(arm, entry("parameters", k, "rate"), p.rate);
    for (std::size_t l = 0; l < k; ++l)
      if (parameters[l].kind == p.kind && (p.kind == KalmanParameter::payload || parameters[l].rate == p.rate))
        bad_value(entry("parameters", k, "kind"), static_cast<int>(p.kind), "is there twice");
    if (!std::isfinite(p.start)) bad_value(entry("parameters", k, "start"), p.start, "must be finite");
    non_negative(entry("parameters", k, "deviation"), p.deviation);
    non_negative(entry("parameters", k, "drift"), p.drift);
  }
}

namespace {
KalmanSensor linear(const Arm& arm, double noise) {
  KalmanSensor s;
  s.by_q = s.by_v = VectorXd::Zero(arm.nv());
  s.noise = noise;
  return s;
}
}  // namespace

KalmanSensor KalmanSensor::encoder(const Arm& arm, int rate, double noise) {
  KalmanSensor s = linear(arm, noise);
  checked_joint(arm, "rate", rate);
  s.by_q[rate] = 1.0;
  return s;
}

KalmanSensor KalmanSensor::tachometer(const Arm& arm, int rate, double noise) {
  KalmanSensor s = linear(arm, noise);
  checked_joint(arm, "rate", rate);
  s.by_v[rate] = 1.0;
  return s;
}

KalmanSensor KalmanSensor::gauge(const Arm& arm, std::size_t link, double x, double y, double z, double noise) {
  KalmanSensor s = linear(arm, noise);
  if (link >= arm.size()) bad_value("link", link, "there is no such link");
  const SliceTable slice = arm.link(link).slice_at(x);
  const Index at = arm.first(link) + arm.link(link).nj(), n = arm.link(link).ne();
  s.by_q.segment(at, n) =
      slice.strains.row(StrainRow::eps) + z * slice.strains.row(StrainRow::K2) - y * slice.strains.row(StrainRow::K3);
  return s;
}

KalmanSensor KalmanSensor::camera(const Arm& arm, std::size_t link, std::optional<double> x,
                                  const Eigen::Vector3d& along, double noise) {
  KalmanSensor s = linear(arm, noise);
  s.at.emplace(arm, link, x);
  s.along = along;
  return s;
}

}  // namespace flexarm
