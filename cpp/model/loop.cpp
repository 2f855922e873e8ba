#include "flexarm/loop.hpp"

namespace flexarm {

std::vector<Loop::Row> Loop::rows() const {
  std::vector<Row> out;
  const bool slides = kind == prismatic || kind == cylindrical;
  for (int axis = 0; axis < 3; ++axis) {
    const bool free = (slides && axis == 2) || (kind == planar && axis < 2);
    if (!free) out.push_back({false, axis, 0});
  }
  if (kind == fixed || kind == prismatic)
    for (int axis = 0; axis < 3; ++axis) out.push_back({true, (axis + 1) % 3, (axis + 2) % 3});
  if (kind == revolute || kind == cylindrical || kind == planar)
    for (int axis = 0; axis < 2; ++axis) out.push_back({true, axis, 2});
  if (kind == universal) out.push_back({true, 0, 1});
  return out;
}

std::optional<Loop::Kind> Loop::named(const std::string& wanted) {
  for (int kind = fixed; kind <= spherical; ++kind)
    if (wanted == name(static_cast<Kind>(kind))) return static_cast<Kind>(kind);
  return {};
}

const char* Loop::name(Kind kind) {
  constexpr const char* names[] = {"fixed", "revolute", "prismatic", "cylindrical", "universal", "planar", "spherical"};
  return names[kind];
}

}  // namespace flexarm
