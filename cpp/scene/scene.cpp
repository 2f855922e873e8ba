#include "flexarm/scene.hpp"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <set>
#include <sstream>
#include <tuple>

#include "flexarm/check.hpp"
#include "flexarm/computed_torque.hpp"
#include "node.hpp"

namespace flexarm {

// Every class of a file has its fields here, once: `fields` writes or reads them, as the node does.

namespace {

constexpr const char* kFormat = "flexarm scene";
constexpr int kVersion = 6;
constexpr const char* kBases[] = {"clamped-free", "legendre", "loaded"};  // in the order of Basis
constexpr const char* kSurfaces[] = {"plane", "sphere", "box"};           // in the order of Surface::Kind
constexpr const char* kPlaces[] = {"origin", "end", "slice"};             // in the order of Strut::Point::On

}  // namespace

void fields(Node& a, Placement& x) {
  a("position", x.position);
  a("rotation", x.rotation);
}

void fields(Node& a, ElementaryMotion& x) {
  a("rotation", x.rotation);
  a("axis", x.axis);
}

void fields(Node& a, JointForce& x) {
  a("stiffness", x.stiffness);
  a("rest", x.rest);
  a("damping", x.damping);
  a.limit("lower", x.lower);
  a.limit("upper", x.upper);
  a("limit_stiffness", x.limit_stiffness);
  a("limit_damping", x.limit_damping);
  a("coulomb", x.coulomb);
  a("stiction", x.stiction);
  a("reflected_inertia", x.reflected_inertia);
  a.limit("torque_limit", x.torque_limit);
}

void fields(Node& a, std::optional<Joint>& x) {
  auto all =
      x ? std::tuple(x->motions(), x->has_ball(), x->labels(), x->forces(), x->inboard(), x->outboard())
        : decltype(std::tuple(x->motions(), x->has_ball(), x->labels(), x->forces(), x->inboard(), x->outboard()))();
  auto& [motions, ball, labels, forces, inboard, outboard] = all;
  a("motions", motions);
  a("ball", ball);
  a("labels", labels);
  a("forces", forces);
  a("inboard", inboard);
  a("outboard", outboard);
  a.make(x, [&] { return std::make_from_tuple<Joint>(all); });
}

void fields(Node& a, RigidBody& x) {
  a("mass", x.mass);
  a("com", x.com);
  a("inertia", x.inertia);
  a("end", x.end);
}

void fields(Node& a, MassSlice& x) {
  a("mass", x.mass);
  a("com", x.com);
  a("inertia", x.inertia);
}

namespace {

/// A value for each strain, by name.
template <class T>
struct ByStrain {
  std::array<T, kStrains>& of;
};

template <class T>
void fields(Node& a, ByStrain<T>& x) {
  for (int s = 0; s < kStrains; ++s) a(kStrainFields[s].name, x.of[static_cast<std::size_t>(s)]);
}

}  // namespace

void fields(Node& a, std::optional<Beam>& x) {
  BeamNumbers n;
  if (x) n = x->numbers();
  BeamOptions& o = n.options;
  std::string basis = kBases[static_cast<int>(o.basis)];
  ByStrain<int> modes{o.modes};
  ByStrain<Eigen::MatrixXd> shapes{o.shapes}, loaded{n.loaded};
  a("length", n.length);
  a("modes", modes);
  a("basis", basis);
  a("shapes", shapes);
  a("loaded", loaded);
  a("curvature", o.curvature);
  a("order", o.order);
  a("rotary_inertia", o.rotary_inertia);
  a("gauss_points", o.gauss_points);
  a("uniform", n.uniform);
  a("planar", n.planar);
  a("points", n.points);
  a("places", n.places);
  a("slices", n.slices);
  a("stiffness", n.stiffness);
  a("damping", n.damping);
  a("patch_capacitances", n.patch_capacitances);
  Eigen::Index ne = 0;
  for (const int count : o.modes) ne += count;
  a.sized("patch_forces", n.patch_forces, ne, n.patch_capacitances.size());
  a.make(x, [&] {
    o.basis = basis_from_name(basis);
    return Beam(n);
  });
}

void fields(Node& a, std::optional<Link>& x) {
  std::optional<Joint> joint;
  RigidBody hub, tip;
  std::optional<Beam> beam;
  if (x) {
    joint = x->joint();
    hub = x->hub();
    tip = x->tip();
    beam = x->beam();
  }
  a.made("joint", joint);
  a("hub", hub);
  a("beam", beam);
  a("tip", tip);
  a.make(x, [&] { return Link(*joint, hub, beam, tip); });
}

void fields(Node& a, Strut::Point& x) {
  std::string on = kPlaces[x.on];
  a("link", x.link);
  a("on", on);
  a("x", x.x);
  a("offset", x.offset);
  const auto* found = std::find(std::begin(kPlaces), std::end(kPlaces), on);
  if (found == std::end(kPlaces)) a.wrong("on", on, "must be \"origin\", \"end\" or \"slice\"");
  x.on = static_cast<Strut::Point::On>(found - std::begin(kPlaces));
}

void fields(Node& a, Strut& x) {
  a("points", x.points);
  a("stiffness", x.stiffness);
  a("damping", x.damping);
  a("length", x.length);
  a("force", x.force);
  a("tension_only", x.tension_only);
}

void fields(Node& a, Contact& x) {
  std::string kind = kSurfaces[x.against.kind];
  a("point", x.point);
  a("radius", x.radius);
  a("kind", kind);
  a("at", x.against.at);
  a("axes", x.against.axes);
  a("size", x.against.size);
  a("stiffness", x.stiffness);
  a("exponent", x.exponent);
  a("damping", x.damping);
  a("coulomb", x.coulomb);
  a("tangential_stiffness", x.tangential_stiffness);
  const auto* found = std::find(std::begin(kSurfaces), std::end(kSurfaces), kind);
  if (found == std::end(kSurfaces)) a.wrong("kind", kind, "must be \"plane\", \"sphere\" or \"box\"");
  x.against.kind = static_cast<Surface::Kind>(found - std::begin(kSurfaces));
}

void fields(Node& a, Loop& x) {
  std::string kind = Loop::name(x.kind);
  a("a", x.a.at);
  a("axes_a", x.a.axes);
  a("b", x.b.at);
  a("axes_b", x.b.axes);
  a("kind", kind);
  a.limit("stiffness", x.stiffness);
  a("damping", x.damping);
  a.limit("angular_stiffness", x.angular_stiffness);
  a("angular_damping", x.angular_damping);
  const std::optional<Loop::Kind> found = Loop::named(kind);
  if (!found) a.wrong("kind", kind, "closes no loop");
  x.kind = *found;
}

void fields(Node& a, std::optional<Arm>& x) {
  Eigen::Vector3d gravity = x ? x->gravity() : Eigen::Vector3d::Zero();
  std::vector<Link> links;
  std::vector<int> parents;
  std::vector<std::optional<double>> at;
  std::vector<Strut> struts;
  std::vector<Contact> contacts;
  std::vector<Loop> loops;
  if (x) {
    links = x->links();
    struts = x->struts();
    contacts = x->contacts();
    loops = x->loops();
    for (const Arm::Seat& seat : x->seats()) {
      parents.push_back(seat.link);
      at.push_back(seat.at);
    }
  }
  a("gravity", gravity);
  a("links", links);
  a("parents", parents);
  a("at", at);
  if (at.size() != parents.size())
    a.wrong("at", std::to_string(at.size()) + " places", "must be one for each of the parents, or null");
  a("struts", struts);
  a("contacts", contacts);
  a("loops", loops);
  a.make(x, [&] {
    std::vector<Arm::Seat> seats;
    for (std::size_t n = 0; n < parents.size(); ++n) seats.emplace_back(parents[n], at[n]);
    return Arm(std::move(links), gravity, std::move(seats), std::move(struts), std::move(contacts), std::move(loops));
  });
}

void fields(Node& a, std::optional<PiecewisePolynomial>& x) {
  Eigen::VectorXd breaks;
  Eigen::MatrixXd coefficients;
  if (x) {
    breaks = x->breaks();
    coefficients = x->coefficients();
  }
  a("breaks", breaks);
  a("coefficients", coefficients);
  a.make(x, [&] { return PiecewisePolynomial(breaks, coefficients); });
}

namespace {

PiecewisePolynomial& numbers_of(PiecewisePolynomial& law) { return law; }
template <class Law>
auto& numbers_of(Law& law) {
  return law.of;
}

/// A law of time: polynomials, or none.
template <class Law, class Function>
void law_of_time(Node& a, const char* key, Function& f) {
  using Numbers = std::decay_t<decltype(numbers_of(std::declval<Law&>()))>;
  Law* law = f.template target<Law>();
  if (!a.reads() && f && !law)
    a.wrong(key, "a function", "a file holds numbers: give samples, or a piecewise polynomial");
  std::optional<Numbers> numbers;
  if (law) numbers = numbers_of(*law);
  a(key, numbers);
  if (a.reads() && numbers) f = Law{*numbers};
}

}  // namespace

void fields(Node& a, Drive& x) {
  a("rate", x.coordinate);
  law_of_time<PiecewisePolynomial>(a, "motion", x.motion);
  law_of_time<PolynomialValue>(a, "force", x.force);
  a("breaks", x.breaks);
  a("column", x.column);
}

void fields(Node& a, Load::Point& x) {  // only the place of the slice
  a("x", x.slice.X);
  a("weight", x.weight);
}

void fields(Node& a, LoadDrive& x) {
  if (x.load.by_state) a.wrong("load", "a function of the state", "cannot be written");
  int link = static_cast<int>(x.load.link);
  a("link", link);
  a("world_axes", x.load.world_axes);
  a("points", x.load.points);
  a("strut", x.load.strut);
  law_of_time<PolynomialWrench>(a, "wrench", x.wrench);
  a("breaks", x.breaks);
  x.load.link = static_cast<std::size_t>(link);
}

void fields(Node& a, Feedback& x) {
  a("column", x.column);
  a("by_q", x.by_q);
  a("by_v", x.by_v);
  law_of_time<PolynomialValue>(a, "reference", x.reference);
  a("breaks", x.breaks);
  a.limit("limit", x.limit);
}

void fields(Node& a, LinearLaw& x) {
  if (x.read) a.wrong("read", "a function", "a file holds numbers: give what is measured by by_q and by_v");
  a("A", x.A);
  a.limits("limit", x.limit);
  law_of_time<PolynomialValues>(a, "reference", x.reference);
  if (!x.reference) a.wrong("reference", "null", "must be a list of polynomials, one for each number that is measured");
  x.reference(0.0, x.e);
  const Eigen::Index nx = x.A.rows(), nu = x.limit.size(), ny = x.e.size();
  a.sized("B", x.B, nx, ny);
  a.sized("C", x.C, nu, nx);
  a.sized("D", x.D, nu, ny);
  a("columns", x.columns);
  a("by_q", x.by_q);
  a("by_v", x.by_v);
  a.sized("u0", x.u0, nu);
  a.sized("windup", x.windup, nx, nu);
  a.limits("reach", x.reach);
  a("offset", x.offset);
  a("resolution", x.resolution);
  a("start", x.start);
  a.limit("first", x.first);
  a.sized("x", x.x, nx);
}

void fields(Node& a, ComputedTorque::Axis& x) {
  a("rate", x.rate);
  law_of_time<PiecewisePolynomial>(a, "reference", x.reference);
  a("kp", x.kp);
  a("kv", x.kv);
  a.limit("limit", x.limit);
}

void fields(Node& a, TorqueLaw::Place& x) {
  a("q", x.q);
  a("v", x.v);
}

void fields(Node& a, std::optional<TorqueLaw>& x) {
  std::optional<Arm> arm;
  std::vector<ComputedTorque::Axis> axes;
  std::vector<TorqueLaw::Place> places;
  bool sags = true;
  int rates = 0;
  if (x) {
    arm = *x->arm;
    axes = x->of.axes();
    places = x->places;
    sags = x->of.sags();
    rates = x->rates;
  }
  a.made("arm", arm);
  a("axes", axes);
  a("sags", sags);
  a("places", places);
  a("rates", rates);
  a.make(x, [&] { return TorqueLaw(std::make_shared<const Arm>(*arm), axes, sags, places, rates); });
}

void fields(Node& a, Sampler& x) {
  a("first", x.first);
  a("period", x.period);
  a("delay", x.delay);
  std::optional<LinearLaw> linear;
  std::optional<TorqueLaw> torque;
  if (const LinearLaw* law = x.law.target<LinearLaw>()) linear = *law;
  if (const TorqueLaw* law = x.law.target<TorqueLaw>()) torque = *law;
  if (!a.reads() && !linear && !torque)
    a.wrong("law", "a function", "a file holds numbers: give a LinearLaw or a TorqueLaw");
  a("linear", linear);
  a("computed_torque", torque);
  if (!linear == !torque) a.wrong("linear", linear ? "a law" : "null", "give it or computed_torque");
  if (linear) x.law = *linear;
  if (torque) x.law = *torque;
}

void fields(Node& a, Scene& x) {
  Problem& p = x.problem;
  a("q0", p.q0);
  a("v0", p.v0);
  a("tau", p.tau);
  a("drives", p.drives);
  a("loads", p.loads);
  a("feedback", p.feedback);
  a("samplers", p.samplers);
  if (!p.events.empty()) a.wrong("events", "functions", "a file holds numbers alone: leave events out");
  a("t", x.t);
  a("integrator", x.method.name);
  a("rtol", x.method.name == "ida" ? x.ida.rtol : x.method.rtol);
  if (x.method.name == "ida") {
    constexpr const char* kSolvers[] = {"auto", "dense", "chain"};  // in the order of LinearSolver
    std::string solver = kSolvers[static_cast<int>(x.ida.linear_solver)];
    a("atol", x.ida.atol);
    a("max_order", x.ida.max_order);
    a("linear_solver", solver);
    const auto* found = std::find(std::begin(kSolvers), std::end(kSolvers), solver);
    if (found == std::end(kSolvers)) a.wrong("linear_solver", solver, "must be \"auto\", \"dense\" or \"chain\"");
    x.ida.linear_solver = static_cast<LinearSolver>(found - std::begin(kSolvers));
    return;
  }
  a("step", x.step);
  a("spectral_radius", x.method.spectral_radius);
  a("stages", x.method.stages);
  a("tolerance", x.method.tolerance);
}

namespace {

/// The parts of a file, in order.
struct File {
  std::string format = kFormat;
  int version = kVersion;
  std::optional<Arm> arm;
  std::optional<Scene> scene;
};

void check_size(const std::string& name, Eigen::Index size, int right) {
  if (size != right)
    throw std::invalid_argument(name + " has " + std::to_string(size) + " numbers: must be " + std::to_string(right));
}

/// The parts of a scene that depend on its arm.
void complete(Node& a, Scene& scene) {
  Problem& p = scene.problem;
  const Arm& arm = *p.arm;
  const auto each = [&](const char* name, auto& all, const auto& check) {
    for (std::size_t k = 0; k < all.size(); ++k)
      a.guard(std::string(name) + "[" + std::to_string(k) + "]", [&] { check(all[k]); });
  };
  each("loads", p.loads, [&](LoadDrive& x) {
    if (x.load.link >= arm.size()) throw std::invalid_argument("link: there is no such link");
    if (x.load.strut < -1 || x.load.strut >= static_cast<int>(arm.struts().size()))
      throw std::invalid_argument("strut: there is no such strut; -1 is none");
    if (!x.wrench) throw std::invalid_argument("wrench = null: must be a list of six polynomials");
    check_size("wrench", static_cast<Eigen::Index>(x.wrench.target<PolynomialWrench>()->of.size()), 6);
    for (Load::Point& point : x.load.points) point.slice = arm.link(x.load.link).slice_at(point.slice.X);
  });
  each("samplers", p.samplers, [&](const Sampler& x) {
    if (const TorqueLaw* law = x.law.target<TorqueLaw>()) {
      check_size("computed_torque, whose rates,", law->rates, arm.nv());
      for (const TorqueLaw::Place& place : law->places)
        if (place.q >= arm.nq()) bad_value("computed_torque.places: q", place.q, "must be a coordinate of the arm");
      return;
    }
    const LinearLaw& law = *x.law.target<LinearLaw>();
    check_size("linear.columns", law.columns.rows(), arm.nv());
    check_size("linear.columns[0]", law.columns.cols(), static_cast<int>(law.limit.size()));
    if (law.offset.size() > 0) check_size("linear.offset", law.offset.size(), static_cast<int>(law.B.cols()));
    for (const double step : law.resolution) non_negative("linear.resolution", step);
    if (law.resolution.size() > 0)
      check_size("linear.resolution", law.resolution.size(), static_cast<int>(law.B.cols()));
    if (law.start.size() > 0) {
      check_size("linear.start", law.start.rows(), static_cast<int>(law.A.rows()));
      check_size("linear.start[0]", law.start.cols(), static_cast<int>(law.B.cols()));
    }
    for (const Eigen::MatrixXd* m : {&law.by_q, &law.by_v}) {
      check_size(m == &law.by_q ? "linear.by_q" : "linear.by_v", m->rows(), static_cast<int>(law.B.cols()));
      check_size(m == &law.by_q ? "linear.by_q[0]" : "linear.by_v[0]", m->cols(), m == &law.by_q ? arm.nq() : arm.nv());
    }
  });
  each("feedback", p.feedback, [&](const Feedback& x) {
    check_size("column", x.column.size(), arm.nv());
    check_size("by_q", x.by_q.size(), arm.nq());
    check_size("by_v", x.by_v.size(), arm.nv());
  });
  a.guard("", [&] {
    p.check();
    p.control();
    check_times(scene.t);
    if (scene.method.name != "ida")
      scene.method.on(arm, scene.method.tolerance > 0.0 ? 1.0 : positive("step", scene.step));
  });
}

}  // namespace

void fields(Node& a, File& x) {
  a("format", x.format);
  a("version", x.version);
  if (x.format != kFormat) a.wrong("format", "\"" + x.format + "\"", std::string("must be \"") + kFormat + "\"");
  if (x.version != kVersion)
    a.wrong("version", std::to_string(x.version),
            "this flexarm reads " + std::to_string(kVersion) +
                "; compile the scene again, by a flexarm of the same version");
  a.made("arm", x.arm);
  if (a.reads()) x.scene.emplace(Scene{Problem(*x.arm)});
  fields(a, *x.scene);
  if (a.reads()) complete(a, *x.scene);
}

namespace {

/// The file's content; a duplicate key is an error.
Json parsed(const std::string& text) {
  std::vector<std::set<std::string>> keys;
  const auto look = [&](int, Json::parse_event_t event, Json& what) {
    if (event == Json::parse_event_t::object_start) keys.emplace_back();
    if (event == Json::parse_event_t::object_end) keys.pop_back();
    if (event == Json::parse_event_t::key && !keys.back().insert(what.get<std::string>()).second)
      throw std::invalid_argument("the key '" + what.get<std::string>() + "' is there twice in one object");
    return true;
  };
  try {
    return Json::parse(text, look);
  } catch (const Json::exception& e) {
    const std::string what = e.what();
    throw std::invalid_argument("is no JSON: " + what.substr(std::min(what.size(), what.find("] ") + 2)));
  }
}

}  // namespace

Scene parse_scene(const std::string& json) {
  Json root = parsed(json);
  File file;
  Node(root, true, "").value(file);
  return std::move(*file.scene);
}

Scene load_scene(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  const std::string where = "scene '" + path + "': ";
  if (!(text << in.rdbuf())) throw std::invalid_argument(where + "cannot be read");
  const bool toml = path.size() > 5 && path.compare(path.size() - 5, 5, ".toml") == 0;
  if (toml) throw std::invalid_argument(where + "is a scene file: compile it, by 'flexarm compile " + path + "'");
  try {
    return parse_scene(text.str());
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(where + e.what());
  } catch (const std::bad_alloc&) {
    throw std::invalid_argument(where + "needs more memory than there is");
  }
}

std::string scene_text(const Scene& scene) {
  Json root;
  File file;
  file.arm = *scene.problem.arm;
  file.scene = scene;
  Node(root, false, "").value(file);
  return root.dump() + "\n";
}

}  // namespace flexarm
