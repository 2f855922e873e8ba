#include "flexarm/load.hpp"

#include "flexarm/check.hpp"
#include "flexarm/quadrature.hpp"

namespace flexarm {

namespace {

const Beam& beam_of(const Arm& arm, std::size_t link) {
  if (link >= arm.size()) bad_value("link", link, "there is no such link");
  if (!arm.link(link).beam()) bad_value("link", link, "has no beam; load its end");
  return *arm.link(link).beam();
}

}  // namespace

Load Load::at_end(const Arm& arm, std::size_t link, bool world_axes) {
  if (link >= arm.size()) bad_value("link", link, "there is no such link");
  return {link, world_axes, {}, -1, {}};
}

Load Load::at_slice(const Arm& arm, std::size_t link, double x, bool world_axes) {
  return {link, world_axes, {{beam_of(arm, link).slice_at(x), 1.0}}, -1, {}};
}

Load Load::on_strut(const Arm& arm, std::size_t strut) {
  if (strut >= arm.struts().size()) bad_value("strut", strut, "there is no such strut");
  return {0, false, {}, static_cast<int>(strut), {}};
}

Load Load::along(const Arm& arm, std::size_t link, double a, double b, bool world_axes) {
  const Beam& beam = beam_of(arm, link);
  if (!(a >= 0.0 && a < b && b <= beam.length()))
    bad_value("along", std::to_string(a) + " to " + std::to_string(b),
              "must go up along the beam, from 0 to its length, " + std::to_string(beam.length()) + " m");
  const GaussRule rule(static_cast<int>(beam.slices().size()), b - a);
  Load load{link, world_axes, {}, -1, {}};
  for (Eigen::Index g = 0; g < rule.points.size(); ++g)
    load.points.push_back({beam.slice_at(a + rule.points[g]), rule.weights[g]});
  return load;
}

}  // namespace flexarm
