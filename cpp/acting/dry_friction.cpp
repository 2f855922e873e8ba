#include "flexarm/dry_friction.hpp"

#include <string>

#include "flexarm/check.hpp"

namespace flexarm {

std::vector<Rub> rubs(const Arm& arm) {
  std::vector<Rub> out;
  for (std::size_t n = 0; n < arm.size(); ++n) {
    const auto& forces = arm.link(n).joint().forces();
    for (std::size_t k = 0; k < forces.size(); ++k)
      if (forces[k].stiction > 0.0)
        out.push_back({arm.first(n) + static_cast<int>(k), forces[k].coulomb, forces[k].stiction});
  }
  return out;
}

void refuse_friction(const Arm& arm, const char* method) {
  for (const Rub& r : rubs(arm)) {
    const bool slides = r.coulomb > 0.0;
    bad_value((slides ? "coulomb of '" : "stiction of '") + arm.coordinates()[static_cast<std::size_t>(r.rate)] + "'",
              slides ? r.coulomb : r.stiction,
              std::string("\"") + method + "\" has no dry friction here: take \"implicit\" (C++: ImplicitStep)");
  }
}

void refuse_contact_friction(const Arm& arm, const std::string& what) {
  for (std::size_t k = 0; k < arm.contacts().size(); ++k)
    if (const double mu = arm.contacts()[k].coulomb; mu > 0.0)
      bad_value("contacts[" + std::to_string(k) + "].coulomb", mu,
                what + " knows no friction of contacts, which depends on the way that it has come: must be zero");
}

void refuse_loops(const Arm& arm, const std::string& what) {
  if (!arm.loops().empty()) bad_value("loops", arm.loops().size(), what + " knows no closed loops: there must be none");
}

}  // namespace flexarm
