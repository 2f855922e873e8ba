// Beams of a scene: sections, materials, modes.
#include <algorithm>
#include <cmath>
#include <limits>

#include "flexarm/check.hpp"
#include "scene_parts.hpp"

namespace flexarm {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();  // what is left out
using Sizes = const double*;
using Shear = std::optional<ShearCorrection>;

}  // namespace

/// A kind of section: its numbers, then those that are one number or two, along y and along z.
struct SectionKind {
  const char* name;
  Names needed;
  std::vector<std::pair<std::string, double>> more;  ///< with what they are if left out
  Names pairs;
  double shear_correction;  ///< the last pair, if left out; kNone: the shape's own
  Section (*make)(Sizes, const Shear&);
};

namespace {

const std::vector<SectionKind> kSections{
    {"rectangle",
     {"y", "z"},
     {},
     {},
     5.0 / 6.0,
     [](Sizes s, const Shear& k) { return Section::rectangle(s[0], s[1], *k); }},
    {"circle",
     {"radius"},
     {{"inner_radius", 0.0}},
     {},
     9.0 / 10.0,
     [](Sizes s, const Shear& k) { return Section::circle(s[0], s[1], *k); }},
    {"tube",
     {"radius", "thickness"},
     {},
     {},
     kNone,
     [](Sizes s, const Shear& k) { return Section::tube(s[0], s[1], k); }},
    {"ellipse", {"y", "z"}, {}, {}, kNone, [](Sizes s, const Shear& k) { return Section::ellipse(s[0], s[1], k); }},
    {"box",
     {"y", "z"},
     {},
     {"thickness"},
     kNone,
     [](Sizes s, const Shear& k) { return Section::box(s[0], s[1], s[2], s[3], k); }},
    {"i_beam",
     {"y", "z", "flange", "web"},
     {},
     {},
     kNone,
     [](Sizes s, const Shear& k) { return Section::i_beam(s[0], s[1], s[2], s[3], k); }},
    {"general",
     {"area", "second_moment_y", "second_moment_z", "torsion_constant"},
     {},
     {},
     5.0 / 6.0,
     [](Sizes s, const Shear& k) { return Section(s[0], s[1], s[2], s[3], *k); }},
};

const SectionKind& section_kind(const std::string& name) {
  return *std::find_if(kSections.begin(), kSections.end(), [&](const auto& kind) { return kind.name == name; });
}

Names section_kinds() {
  Names names;
  for (const SectionKind& kind : kSections) names.emplace_back(kind.name);
  names.emplace_back("matrix");
  return names;
}

/// One number for both axes, or two, along y and along z.
void read_pair(const At& at, std::vector<double>& out) {
  if (!at.is(Value::Kind::list)) {
    out.insert(out.end(), 2, at.number());
    return;
  }
  const std::vector<double> two = at.numbers();
  if (two.size() != 2) at.bad("must be one number, or two, along y and along z");
  out.insert(out.end(), two.begin(), two.end());
}

std::vector<double> read_sizes(const At& table, const SectionKind& kind) {
  Names known = kind.needed, needed = kind.needed;
  known.insert(known.end(), {"type", "shear_correction"});
  for (const auto& [name, value] : kind.more) known.push_back(name);
  for (const std::string& name : kind.pairs) known.push_back(name), needed.push_back(name);
  table.known_keys(known);
  table.needs(needed);
  std::vector<double> out;
  for (const std::string& name : kind.needed) out.push_back(table[name].number());
  for (const auto& [name, value] : kind.more) out.push_back(table.number(name, value));
  for (const std::string& name : kind.pairs) read_pair(table[name], out);
  if (table.has("shear_correction"))
    read_pair(table["shear_correction"], out);
  else
    out.insert(out.end(), 2, kind.shear_correction);
  return out;
}

std::string read_type(const At& table, const Names& kinds) {
  if (!table.is(Value::Kind::table) || !table.has("type")) {
    std::string all;
    for (const std::string& k : kinds) all += (all.empty() ? "" : ", ") + k;
    table.bad("must be a table with a type: " + all);
  }
  return table["type"].choice(kinds);
}

SectionSpec read_section_matrix(const At& table) {
  table.known_keys({"type", "stiffness", "inertia"});
  table.needs({"stiffness", "inertia"});
  SectionSpec spec{nullptr, {}};
  for (const char* name : {"stiffness", "inertia"}) {
    const std::vector<At> rows = table[name].list("rows");
    if (rows.size() != 6) table[name].bad("must be 6 rows of 6 numbers");
    for (const At& row : rows) {
      const std::vector<double> numbers = row.numbers(6);
      spec.sizes.insert(spec.sizes.end(), numbers.begin(), numbers.end());
    }
  }
  within(table.where(), [&] { return spec.matrix(); });
  return spec;
}

SectionSpec read_section(const At& table) {
  const std::string type = read_type(table, section_kinds());
  if (type == "matrix") return read_section_matrix(table);
  const SectionKind& kind = section_kind(type);
  SectionSpec spec{&kind, read_sizes(table, kind)};
  within(table.where(), [&] { return spec.section(); });
  return spec;
}

SectionSpec general(const SectionSpec& spec) {
  const Section s = spec.section();
  return {
      &section_kind("general"),
      {s.area, s.second_moment_y, s.second_moment_z, s.torsion_constant, s.shear_correction.y, s.shear_correction.z}};
}

/// Where one section of a taper has a shear correction, all have: the others their shapes'.
void agree(std::vector<SectionSpec>& parts) {
  const auto left_out = [](const SectionSpec& p) { return std::isnan(p.sizes.back()); };
  if (std::all_of(parts.begin(), parts.end(), left_out)) return;
  for (SectionSpec& p : parts) {
    const ShearCorrection k = p.section().shear_correction;
    p.sizes.end()[-2] = k.y;
    p.sizes.end()[-1] = k.z;
  }
}

SectionAlong read_taper(const At& table, double length) {
  table.known_keys({"type", "x", "sections"});
  table.needs({"x", "sections"});
  const At x = table["x"];
  SectionAlong out;
  out.x = x.numbers();
  if (out.x.size() < 2 || out.x[0] != 0.0 || !std::is_sorted(out.x.begin(), out.x.end(), std::less_equal<>()))
    x.bad("must be two or more places, increasing from 0");
  if (!(std::abs(out.x.back() - length) <= 1e-9 * length))
    x.bad("must end at the beam's length, " + std::to_string(length) + " m");
  for (const At& part : table["sections"].list("sections")) out.parts.push_back(read_section(part));
  if (out.parts.size() != out.x.size()) table["sections"].bad("must be one section for each of the places of x");
  const SectionKind* kind = out.parts[0].kind;
  const bool alike = std::all_of(out.parts.begin(), out.parts.end(), [&](const auto& p) { return p.kind == kind; });
  if (!alike && std::any_of(out.parts.begin(), out.parts.end(), [](const auto& p) { return !p.kind; }))
    table["sections"].bad("must all be of type 'matrix' where one is");
  if (!alike) std::transform(out.parts.begin(), out.parts.end(), out.parts.begin(), general);
  if (kind) agree(out.parts);
  return out;
}

Material read_material(const At& table) {
  table.known_keys({"density", "youngs_modulus", "poisson_ratio", "shear_modulus"});
  table.needs({"density", "youngs_modulus"});
  std::optional<double> poisson, shear;
  if (table.has("poisson_ratio")) poisson = table["poisson_ratio"].number();
  if (table.has("shear_modulus")) shear = table["shear_modulus"].number();
  const double density = table["density"].number(), youngs = table["youngs_modulus"].number();
  return within(table.where(), [&] { return Material(density, youngs, poisson, shear); });
}

/// The strain shapes of a list, one column each, as coefficients of Legendre polynomials.
Eigen::MatrixXd read_shapes(const At& list) {
  std::vector<std::vector<double>> columns;
  std::size_t rows = 0;
  for (const At& shape : list.list("shapes")) {
    if (!shape.is(Value::Kind::table) || !shape.has("legendre"))
      shape.bad(
          "must be {legendre = [...]}; samples of a shape are fitted by the Python package alone, whose "
          "fa.load(scene).arm.to_dict() has the coefficients");
    shape.known_keys({"legendre"});
    columns.push_back(shape["legendre"].numbers());
    if (columns.back().empty() || columns.back().size() > kTerms) shape["legendre"].bad("must be 1 to 60 numbers");
    rows = std::max(rows, columns.back().size());
  }
  Eigen::MatrixXd out =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(columns.size()));
  for (std::size_t k = 0; k < columns.size(); ++k)
    out.col(static_cast<Eigen::Index>(k)).head(static_cast<Eigen::Index>(columns[k].size())) =
        Eigen::Map<const Eigen::VectorXd>(columns[k].data(), static_cast<Eigen::Index>(columns[k].size()));
  return out;
}

Names strain_names() {
  Names names;
  for (const StrainField& f : kStrainFields) names.push_back(f.name);
  return names;
}

void read_modes(const At& modes, BeamOptions& o) {
  const Names known = strain_names();
  modes.known_keys(known);
  for (std::size_t s = 0; s < known.size(); ++s) {
    if (!modes.has(known[s])) continue;
    const At at = modes[known[s]];
    if (at.is(Value::Kind::list)) {
      o.shapes[s] = read_shapes(at);
      o.modes[s] = static_cast<int>(o.shapes[s].cols());
    } else {
      o.modes[s] = at.whole();
    }
  }
}

void read_order(const At& at, BeamOptions& o) {
  const char* right = "must be 0, 1, 2, 3 or \"exact\"";
  if (at.is(Value::Kind::text)) {
    if (at.value().text != "exact") at.bad(right);
    o.order = kExact;
    return;
  }
  o.order = at.whole();
  if (o.order < 0 || o.order > 3) at.bad(right);
}

void read_kelvin_voigt(const At& at, BeamOptions& o) {
  if (!at.is(Value::Kind::table)) {
    o.kelvin_voigt.fill(at.number());
    return;
  }
  at.known_keys(strain_names());
  for (std::size_t s = 0; s < kStrains; ++s) o.kelvin_voigt[s] = at.number(kStrainFields[s].name, 0.0);
}

Eigen::MatrixXd read_matrix(const At& at) {
  const std::vector<At> rows = at.list("rows");
  Eigen::MatrixXd out(rows.size(), rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const std::vector<double> row = rows[i].numbers(rows.size());
    out.row(static_cast<Eigen::Index>(i)) = Eigen::Map<const Eigen::RowVectorXd>(row.data(), out.cols());
  }
  return out;
}

/// Twist and curvatures at rest: three numbers, or {legendre = [[...], [...], [...]]}.
Eigen::MatrixXd read_curvature(const At& at) {
  const bool along = at.is(Value::Kind::table);
  if (along && !at.has("legendre"))
    at.bad(
        "must be three numbers or {legendre = [...]}; samples are fitted by the Python package alone, whose "
        "fa.load(scene).arm.to_dict() has the coefficients");
  if (along) at.known_keys({"legendre"});
  std::vector<std::vector<double>> rows;
  if (along)
    for (const At& row : at["legendre"].list("numbers")) rows.push_back(row.numbers());
  else
    for (const double x : at.numbers()) rows.push_back({x});
  if (rows.size() != 3) at.bad("must have K1, K2 and K3");
  std::size_t terms = 1;
  for (const std::vector<double>& row : rows) terms = std::max(terms, row.size());
  if (terms > kTerms) at.bad("must have at most 60 coefficients");
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(terms), 3);
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t k = 0; k < rows[c].size(); ++k)
      out(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(c)) = rows[c][k];
  return out.isZero(0.0) ? Eigen::MatrixXd() : out;
}

BeamOptions read_options(const At& table) {
  BeamOptions o;
  read_modes(table["modes"], o);
  if (table.has("curvature")) o.curvature = read_curvature(table["curvature"]);
  if (table.has("basis")) o.basis = basis_from_name(table["basis"].choice({"clamped-free", "legendre", "loaded"}));
  if (table.has("order")) read_order(table["order"], o);
  o.rotary_inertia = table.truth("rotary_inertia", true);
  o.damping_ratio = table.number("damping_ratio", 0.0);
  if (table.has("kelvin_voigt")) read_kelvin_voigt(table["kelvin_voigt"], o);
  if (table.has("damping")) o.damping = read_matrix(table["damping"]);
  if (table.has("gauss_points")) {
    o.gauss_points = table["gauss_points"].whole();
    if (o.gauss_points < 1) table["gauss_points"].bad("must be from 1 to 400, or left out");
  }
  if (table.has("basis_tip")) {
    const RigidBody tip = read_body(table["basis_tip"]);
    if (o.basis != Basis::loaded) table["basis_tip"].bad("goes with basis = 'loaded'");
    o.tip = {tip.mass, tip.com[0], tip.inertia.diagonal()};
  }
  return o;
}

}  // namespace

double interpolated(double at, const std::vector<double>& x, const std::vector<double>& y) {
  const auto above = std::upper_bound(x.begin(), x.end(), at);
  if (above == x.begin()) return y.front();
  if (above == x.end()) return y.back();
  const auto k = static_cast<std::size_t>(above - x.begin());
  return y[k - 1] + (y[k] - y[k - 1]) * (at - x[k - 1]) / (x[k] - x[k - 1]);
}

Section SectionSpec::section() const {
  const ShearCorrection k(sizes.end()[-2], sizes.end()[-1]);
  return kind->make(sizes.data(), std::isnan(k.y) ? Shear() : k);
}

SectionMatrix SectionSpec::matrix() const {
  using Rows = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
  return {Eigen::Map<const Rows>(sizes.data()), Eigen::Map<const Rows>(sizes.data() + 36)};
}

SectionSpec SectionAlong::at(double place) const {
  SectionSpec out = parts[0];
  if (x.empty()) return out;
  std::vector<double> column(x.size());
  for (std::size_t i = 0; i < out.sizes.size(); ++i) {
    for (std::size_t k = 0; k < x.size(); ++k) column[k] = parts[k].sizes[i];
    out.sizes[i] = interpolated(place, x, column);
  }
  return out;
}

Beam read_beam(const At& table) {
  table.known_keys({"length", "section", "material", "modes", "basis", "order", "rotary_inertia", "damping_ratio",
                    "kelvin_voigt", "damping", "gauss_points", "basis_tip", "patches", "curvature"});
  table.needs({"length", "section", "modes"});
  const double length = table["length"].number();
  Names kinds = section_kinds();
  kinds.push_back("taper");
  SectionAlong along;
  if (read_type(table["section"], kinds) == "taper")
    along = read_taper(table["section"], length);
  else
    along.parts = {read_section(table["section"])};
  const bool matrices = along.parts[0].kind == nullptr;
  if (matrices && table.has("material"))
    table["material"].bad("must be left out: a section of type 'matrix' has its own");
  if (!matrices) table.needs({"material"});
  std::optional<Material> material;
  if (!matrices) material = read_material(table["material"]);
  const BeamOptions options = read_options(table);
  std::vector<Patch> patches;
  if (table.has("patches"))
    for (const At& patch : table["patches"].list("tables")) patches.push_back(read_patch(patch, along, length));
  const bool uniform = along.x.empty();
  const std::vector<double> breaks(uniform ? along.x.end() : along.x.begin() + 1, along.x.end() - (uniform ? 0 : 1));
  return within(table.where(), [&] {
    if (matrices && uniform) return Beam(length, along.parts[0].matrix(), options, patches);
    if (matrices)
      return Beam(length, SectionMatrixProfile{[along](double x) { return along.at(x).matrix(); }, breaks}, options,
                  patches);
    if (uniform) return Beam(length, along.parts[0].section(), *material, options, patches);
    const SectionProfile profile{[along](double x) { return along.at(x).section(); }, breaks};
    return Beam(length, profile, *material, options, patches);
  });
}

}  // namespace flexarm
