// Piezo patches of a scene.
#include <algorithm>
#include <cmath>
#include <functional>

#include "flexarm/check.hpp"
#include "scene_parts.hpp"

namespace flexarm {

namespace {

Piezo read_piezo(const At& table) {
  table.known_keys({"youngs_modulus", "poisson_ratio", "density", "d31", "d15", "permittivity", "d32"});
  table.needs({"youngs_modulus", "poisson_ratio", "density", "d31"});
  const auto n = [&](const char* key) { return table.number(key, 0.0); };
  return within(table.where(), [&] {
    return Piezo(n("youngs_modulus"), n("poisson_ratio"), n("density"), n("d31"), n("d32"), n("d15"),
                 n("permittivity"));
  });
}

/// Width of the electrode along the patch, as a share of its width.
struct Profile {
  std::function<double(double)> share = [](double) { return 1.0; };  ///< at x metres from the clamp
  std::vector<double> kinks;
  bool varies = false;
};

double legendre_sum(const std::vector<double>& c, double s) {
  double sum = 0.0, p = 1.0, next = s;
  for (std::size_t n = 0; n < c.size(); ++n) {
    sum += c[n] * p;
    const double k = static_cast<double>(n) + 1.0, after = ((2.0 * k + 1.0) * s * next - k * p) / (k + 1.0);
    p = next;
    next = after;
  }
  return sum;
}

void check_share(const At& at, double worst) {
  if (worst > 1.0 + 1e-9) at.bad("reaches " + std::to_string(worst) + ": must stay from -1 to 1, a share of the width");
}

Profile smooth_profile(const At& at, double start, double end) {
  at.known_keys({"legendre"});
  const std::vector<double> c = at["legendre"].numbers();
  if (c.empty() || c.size() > kTerms) at["legendre"].bad("must be 1 to 60 numbers");
  double worst = 0.0;
  for (int k = 0; k <= 400; ++k) worst = std::max(worst, std::abs(legendre_sum(c, -1.0 + k / 200.0)));
  check_share(at, worst);
  Profile out;
  out.varies = true;
  out.share = [c, start, end](double x) {
    return std::clamp(legendre_sum(c, 2.0 * (x - start) / (end - start) - 1.0), -1.0, 1.0);
  };
  return out;
}

Profile read_profile(const At& at, double start, double end) {
  if (at.is(Value::Kind::table) && at.has("legendre")) return smooth_profile(at, start, end);
  std::vector<double> x, share;
  if (at.is(Value::Kind::table)) {
    at.known_keys({"x", "share"});
    at.needs({"x", "share"});
    x = at["x"].numbers();
    share = at["share"].numbers();
    const double slack = 1e-9 * (end - start);
    if (x.size() < 2 || share.size() != x.size()) at.bad("must have two or more of x and share each");
    if (!std::is_sorted(x.begin(), x.end(), std::less_equal<>()) || std::abs(x.front() - start) > slack ||
        std::abs(x.back() - end) > slack)
      at["x"].bad("must increase from start to end");
  } else {
    share = at.numbers();
    if (share.size() < 2) at.bad("must be two samples or more");
    for (std::size_t k = 0; k < share.size(); ++k)
      x.push_back(start + (end - start) * static_cast<double>(k) / static_cast<double>(share.size() - 1));
  }
  double worst = 0.0;
  for (const double s : share) worst = std::max(worst, std::abs(s));
  check_share(at, worst);
  Profile out;
  out.varies = true;
  out.kinks = x;
  out.share = [x, share](double place) { return interpolated(place, x, share); };
  return out;
}

/// Where the layer lies on the section at a place.
void seat(const SectionSpec& section, char axis, const std::optional<double>& offset, PatchLayer& layer) {
  const auto face = section.kind ? section.section().faces[axis == 'y' ? 0 : 1] : std::nullopt;
  if (!face) {
    if (!offset)
      throw std::invalid_argument(
          "offset: a section without such a face needs it, from the neutral axis to the patch (m)");
    layer.inner = *offset;
    return;
  }
  if (layer.width > face->breadth * (1.0 + 1e-9))
    bad_value("width", layer.width, "must be at most the face's, " + std::to_string(face->breadth) + " m");
  layer.inner = offset ? *offset : face->distance;
  layer.twist = face->twist ? *face->twist
                            : surface_twist(2.0 * face->distance, face->breadth, std::min(layer.width, face->breadth));
}

PatchLayer read_layer(const At& table) {
  PatchLayer layer;
  const std::string face = table.has("face") ? table["face"].choice({"y", "+y", "-y", "z", "+z", "-z"}) : "y";
  const std::string pair = table.has("pair") ? table["pair"].choice({"opposed", "same"}) : "opposed";
  if (pair == "same" && face.size() == 2) table["pair"].bad("needs two faces, 'y' or 'z', not '" + face + "'");
  layer.across = face.back() == 'y' ? 1 : 2;
  layer.plus = face[0] != '-';
  layer.minus = face[0] != '+';
  layer.opposed = pair == "opposed";
  layer.angle = table.number("angle", 0.0);
  layer.width = table["width"].number();
  layer.thickness = table["thickness"].number();
  if (!std::isfinite(layer.angle)) table["angle"].bad("must be finite");
  return layer;
}

}  // namespace

Patch read_patch(const At& table, const SectionAlong& section, double length) {
  table.known_keys({"start", "end", "width", "thickness", "material", "face", "angle", "profile", "offset", "pair",
                    "stiffness", "mass"});
  table.needs({"start", "end", "width", "thickness", "material"});
  Patch patch;
  patch.start = table["start"].number();
  patch.end = table["end"].number();
  if (!(patch.start >= 0.0)) table["start"].bad("must not be negative");
  if (!(patch.end > patch.start)) table["end"].bad("must be beyond the start");
  if (!(patch.end <= length * (1.0 + 1e-12)))
    table["end"].bad("must be at most the beam's length, " + std::to_string(length) + " m");
  const Piezo material = read_piezo(table["material"]);
  const PatchLayer layer = read_layer(table);
  std::optional<double> offset;
  if (table.has("offset")) offset = table["offset"].number();
  Profile profile;
  if (table.has("profile")) profile = read_profile(table["profile"], patch.start, patch.end);
  patch.stiffness = table.truth("stiffness", true);
  patch.mass = table.truth("mass", true);
  const char axis = layer.across == 1 ? 'y' : 'z';
  const auto at = [=](double x) {
    PatchLayer here = layer;
    seat(section.at(x), axis, offset, here);
    here.electrode = profile.share(x);
    return patch_section(material, here);
  };
  const PatchSection first = within(table.where(), [&] { return at(patch.start); });
  for (const std::vector<double>& kinks : {section.x, profile.kinks})
    for (const double x : kinks)
      if (patch.start < x && x < patch.end) patch.breaks.push_back(x);
  std::sort(patch.breaks.begin(), patch.breaks.end());
  patch.breaks.erase(std::unique(patch.breaks.begin(), patch.breaks.end()), patch.breaks.end());
  if (section.x.empty() && !profile.varies)
    patch.at = [first](double) { return first; };
  else
    patch.at = at;
  return patch;
}

}  // namespace flexarm
