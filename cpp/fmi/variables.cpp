#include "variables.hpp"

#include <cmath>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>

#include "flexarm/check.hpp"
#include "flexarm/computed_torque.hpp"

namespace flexarm {

namespace {

using Json = nlohmann::json;

constexpr const char* kKinds[] = {"time",
                                  "q",
                                  "v",
                                  "a",
                                  "dq",
                                  "tau",
                                  "friction",
                                  "place",
                                  "rotation",
                                  "reading",
                                  "indicator",
                                  "add_tau",
                                  "add_drive",
                                  "add_load",
                                  "add_reference",
                                  "add_sampled",
                                  "stiffness",
                                  "damping",
                                  "coulomb",
                                  "payload",
                                  "gravity",
                                  "beam_stiffness",
                                  "beam_damping",
                                  "law_gain",
                                  "law_kp",
                                  "law_kv",
                                  "sampled_gain",
                                  "sampled_kp",
                                  "sampled_kv",
                                  "step"};  // in the order of Variable::Kind

Eigen::VectorXd vector(const Json& from, Eigen::Index size) {
  const auto numbers = from.get<std::vector<double>>();
  if (static_cast<Eigen::Index>(numbers.size()) != size) bad_value("a row", numbers.size(), "numbers");
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(), size);
}

Variable variable(const Json& from, const Arm& arm) {
  Variable out;
  const auto kind = from.at("kind").get<std::string>();
  const auto* found = std::find(std::begin(kKinds), std::end(kKinds), kind);
  if (found == std::end(kKinds)) bad_value("kind", kind, "is not known");
  out.kind = static_cast<Variable::Kind>(found - std::begin(kKinds));
  out.name = from.at("name").get<std::string>();
  out.i = from.value("i", 0);
  out.j = from.value("j", 0);
  out.start = from.value("start", 0.0);
  if (out.kind != Variable::reading) return out;
  out.of.by_q = vector(from.at("by_q"), arm.nq());
  out.of.by_v = vector(from.at("by_v"), arm.nv());
  out.of.offset = from.at("offset").get<double>();
  if (from.contains("along")) {
    out.of.along = vector(from.at("along"), 3);
    std::optional<double> x;
    if (!from.at("x").is_null()) x = from.at("x").get<double>();
    out.of.at.emplace(arm, static_cast<std::size_t>(out.i), x);
  }
  return out;
}

/// The body with a point mass at its end.
RigidBody carrying(const RigidBody& body, double mass) {
  RigidBody out = body;
  out.mass = body.mass + mass;
  if (!(out.mass > 0.0)) bad_value("mass", out.mass, "must be positive");
  out.com = (body.mass * body.com + mass * body.end) / out.mass;
  const auto moved = [](double m, const Eigen::Vector3d& r) -> Eigen::Matrix3d {
    return m * (r.squaredNorm() * Eigen::Matrix3d::Identity() - r * r.transpose());
  };
  out.inertia += moved(body.mass, body.com - out.com) + moved(mass, body.end - out.com);
  return out;
}

/// The arm's parts with changed numbers.
struct Parts {
  std::vector<Link> links;
  Eigen::Vector3d gravity;

  explicit Parts(const Arm& arm) : links(arm.links()), gravity(arm.gravity()) {}
  Arm arm(const Arm& of) const { return Arm(links, gravity, of.seats(), of.struts(), of.contacts(), of.loops()); }

  template <class Change>
  void joint(const Arm& arm, int rate, const Change& change) {
    std::size_t n = arm.size() - 1;
    while (arm.first(n) > rate) --n;
    const Joint& old = links[n].joint();
    std::vector<JointForce> forces = old.forces();
    forces.resize(static_cast<std::size_t>(old.nv()));
    change(forces.at(static_cast<std::size_t>(rate - arm.first(n))));
    links[n] = Link(Joint(old.motions(), old.has_ball(), old.labels(), forces, old.inboard(), old.outboard()),
                    links[n].hub(), links[n].beam(), links[n].tip());
  }
  template <class Change>
  void beam(int link, const Change& change) {
    Link& old = links.at(static_cast<std::size_t>(link));
    BeamNumbers numbers = old.beam().value().numbers();
    change(numbers);
    old = Link(old.joint(), old.hub(), Beam(numbers), old.tip());
  }
  void carry(int link, double mass) {
    Link& old = links.at(static_cast<std::size_t>(link));
    if (!(mass >= 0.0)) bad_value("mass", mass, "must not be negative");
    old = Link(old.joint(), old.hub(), old.beam(), carrying(old.tip(), mass));
  }
};

/// A law of time, times a factor.
void scale(std::function<double(double)>& law, double factor) {
  if (law) law = [own = law, factor](double t) { return factor * own(t); };
}

void change_law(Problem& p, const Variable& x, double value) {
  if (x.kind == Variable::law_gain || x.kind == Variable::law_kp || x.kind == Variable::law_kv) {
    Feedback& law = p.feedback.at(static_cast<std::size_t>(x.i));
    const double factor = value / x.start;
    if (x.kind != Variable::law_kv) {
      law.by_q *= factor;
      scale(law.reference, factor);
    }
    if (x.kind != Variable::law_kp) law.by_v *= factor;
    return;
  }
  auto& function = p.samplers.at(static_cast<std::size_t>(x.i)).law;
  if (LinearLaw* law = function.target<LinearLaw>()) {
    law->C *= value;
    law->D *= value;
  } else if (TorqueLaw* torque = function.target<TorqueLaw>()) {
    auto axes = torque->of.axes();
    (x.kind == Variable::sampled_kp ? axes.at(static_cast<std::size_t>(x.j)).kp
                                    : axes.at(static_cast<std::size_t>(x.j)).kv) = value;
    function = TorqueLaw(torque->arm, axes, torque->of.sags(), torque->places, torque->rates);
  }
}

void change(Scene& scene, Parts& parts, const Variable& x, double value) {
  const Arm& arm = *scene.problem.arm;
  const auto to = [value](double& number) { number = value; };
  switch (x.kind) {
    case Variable::stiffness:
      return parts.joint(arm, x.i, [&](JointForce& f) { to(f.stiffness); });
    case Variable::damping:
      return parts.joint(arm, x.i, [&](JointForce& f) { to(f.damping); });
    case Variable::coulomb:
      if (!(value > 0.0)) bad_value("friction", value, "must be positive, as it was exported");
      return parts.joint(arm, x.i, [&](JointForce& f) {
        if (!std::isnan(f.stiction)) f.stiction *= value / f.coulomb;
        to(f.coulomb);
      });
    case Variable::payload:
      return parts.carry(x.i, value);
    case Variable::gravity:
      return to(parts.gravity[x.i]);
    case Variable::beam_stiffness:
      return parts.beam(x.i, [&](BeamNumbers& n) { n.stiffness *= positive("factor", value); });
    case Variable::beam_damping:
      return parts.beam(x.i, [&](BeamNumbers& n) { n.damping *= non_negative("factor", value); });
    case Variable::step:
      scene.step = positive("step", value);
      return;
    default:
      change_law(scene.problem, x, value);
  }
}

/// The problem's laws, to which the inputs are added.
void add(Problem& p, const Inputs& in) {
  p.tau += in.tau;
  for (std::size_t k = 0; k < p.drives.size(); ++k)
    if (auto& f = p.drives[k].force) f = [&more = in.drive[k], own = f](double t) { return own(t) + more; };
  for (std::size_t k = 0; k < p.feedback.size(); ++k) {
    auto& f = p.feedback[k].reference;
    f = [&more = in.reference[k], own = f](double t) { return (own ? own(t) : 0.0) + more; };
  }
  for (std::size_t k = 0; k < p.loads.size(); ++k) {
    auto& f = p.loads[k].wrench;
    f = [&more = in.load[k], own = f](double t) -> Vec6<double> { return own(t) + more; };
  }
  for (std::size_t k = 0; k < p.samplers.size(); ++k) {
    auto& function = p.samplers[k].law;
    const Eigen::VectorXd& more = in.sampled[k];
    if (LinearLaw* law = function.target<LinearLaw>()) {
      law->reference = [&more, own = law->reference](double t, Eigen::VectorXd& r) {
        own(t, r);
        r += more;
      };
    } else if (TorqueLaw* torque = function.target<TorqueLaw>()) {
      auto axes = torque->of.axes();
      for (std::size_t i = 0; i < axes.size(); ++i)
        axes[i].reference = [&x = more[static_cast<Eigen::Index>(i)], own = axes[i].reference](double t) {
          const MotionValue now = own(t);
          return MotionValue{now.q + x, now.v, now.a};
        };
      function = TorqueLaw(torque->arm, axes, torque->of.sags(), torque->places, torque->rates);
    }
  }
}

Json file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  if (!(text << in.rdbuf())) throw std::invalid_argument("'" + path + "': cannot be read");
  return Json::parse(text.str());
}

}  // namespace

Resources Resources::load(const std::string& folder) {
  const std::string base = folder.empty() || folder.back() == '/' ? folder : folder + "/";
  Resources out{"", load_scene(base + "scene.json"), {}};
  try {
    const Json list = file(base + "variables.json");
    out.token = list.at("token").get<std::string>();
    for (const Json& one : list.at("variables")) out.variables.push_back(variable(one, *out.scene.problem.arm));
  } catch (const Json::exception& e) {
    throw std::invalid_argument("'" + base + "variables.json': " + e.what());
  }
  return out;
}

Inputs Resources::inputs() const {
  const Problem& p = scene.problem;
  Inputs out;
  out.tau = Eigen::VectorXd::Zero(p.arm->nv());
  out.drive.assign(p.drives.size(), 0.0);
  out.reference.assign(p.feedback.size(), 0.0);
  out.load.assign(p.loads.size(), Vec6<double>::Zero());
  for (const Sampler& s : p.samplers) {
    const LinearLaw* law = s.law.target<LinearLaw>();
    const auto count = law ? law->B.cols() : static_cast<Eigen::Index>(s.law.target<TorqueLaw>()->of.axes().size());
    out.sampled.emplace_back(Eigen::VectorXd::Zero(count));
  }
  return out;
}

Scene Resources::with(const std::vector<double>& values, const Inputs& in) const {
  Scene out = scene;
  Parts parts(*scene.problem.arm);
  bool changed = false;
  for (std::size_t k = 0; k < variables.size(); ++k) {
    const Variable& x = variables[k];
    if (!x.parameter() || values[k] == x.start) continue;
    changed = changed || x.kind <= Variable::beam_damping;
    try {
      change(out, parts, x, values[k]);
    } catch (const std::invalid_argument& e) {
      throw std::invalid_argument(x.name + ": " + e.what());
    }
  }
  if (changed) out.problem.arm = std::make_shared<const Arm>(parts.arm(*scene.problem.arm));
  add(out.problem, in);
  return out;
}

}  // namespace flexarm
