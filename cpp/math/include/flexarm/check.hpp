// Checks of arguments: constructors call these, kernels never do.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>

namespace flexarm {

/// Throws std::invalid_argument "field = value: the right values".
template <class T>
[[noreturn]] void bad_value(const std::string& field, const T& value, const std::string& right) {
  std::ostringstream text;
  text << field << " = " << value << ": " << right;
  throw std::invalid_argument(text.str());
}
inline double positive(const std::string& field, double value) {
  if (!(value > 0.0) || !std::isfinite(value)) bad_value(field, value, "must be positive and finite");
  return value;
}
inline double non_negative(const std::string& field, double value) {
  if (!(value >= 0.0) || !std::isfinite(value)) bad_value(field, value, "must not be negative, and finite");
  return value;
}
inline Eigen::Vector3d finite(const std::string& field, const Eigen::Vector3d& value) {
  if (!value.allFinite()) bad_value(field, value.transpose(), "must be finite");
  return value;
}

}  // namespace flexarm
