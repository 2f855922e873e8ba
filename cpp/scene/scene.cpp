// Gravity, links, joints and bodies of a scene. Keys and checks are those of the Python reader.
#include <algorithm>
#include <iterator>

#include "flexarm/spatial.hpp"
#include "scene_arm.hpp"
#include "scene_parts.hpp"

namespace flexarm {

namespace {

const Names kForces{"stiffness",       "rest",          "damping", "lower",    "upper",
                    "limit_stiffness", "limit_damping", "coulomb", "stiction", "reflected_inertia",
                    "torque_limit"};
Eigen::Vector3d unit(char axis) { return Eigen::Vector3d::Unit(axis - 'x'); }

Eigen::Vector3d read_axis(const At& joint, char otherwise) {
  if (!joint.has("axis")) return unit(otherwise);
  const At axis = joint["axis"];
  if (!axis.is(Value::Kind::text)) return axis.vector();
  const std::string& name = axis.value().text;
  if (name != "x" && name != "y" && name != "z") axis.bad("must be \"x\", \"y\", \"z\" or three numbers");
  return unit(name[0]);
}

/// A kind of joint: its elementary motions, and whether a ball ends them. A further kind is a row of kKinds.
struct Kind {
  static constexpr char own = 0;  ///< the axis that the joint's table gives
  static constexpr bool turn = true, slide = false;
  struct Motion {
    const char* name;
    bool rotation;
    char axis;
  };
  const char* type;
  std::vector<Motion> motions = {};
  bool ball = false;
  char axis = 0;  ///< its own, where the table gives none; 0: it has none of its own
};
const Kind kKinds[] = {
    {"fixed"},
    {"revolute", {{"", Kind::turn, Kind::own}}, false, 'z'},
    {"prismatic", {{"", Kind::slide, Kind::own}}, false, 'x'},
    {"cylindrical", {{"translation", Kind::slide, Kind::own}, {"rotation", Kind::turn, Kind::own}}, false, 'z'},
    {"universal", {{"x", Kind::turn, 'x'}, {"y", Kind::turn, 'y'}}},
    {"planar", {{"x", Kind::slide, 'x'}, {"y", Kind::slide, 'y'}, {"rotation", Kind::turn, 'z'}}},
    {"spherical", {}, true},
    {"free", {{"x", Kind::slide, 'x'}, {"y", Kind::slide, 'y'}, {"z", Kind::slide, 'z'}}, true},
    {"axes"},  // of the motions that its table lists
};

/// The freedoms of a joint before its ball, and their names.
struct Freedoms {
  std::vector<ElementaryMotion> motions;
  Names names;

  void add(const std::string& name, bool rotation, const Eigen::Vector3d& axis) {
    motions.push_back({rotation, axis});
    names.push_back(name);
  }
};

void read_axes(const At& list, Freedoms& f) {
  std::vector<At> names;
  if (list.is(Value::Kind::text))
    names.push_back(list);
  else
    names = list.list("tx, ty, tz, rx, ry, rz");
  for (const At& at : names) {
    const std::string name = at.choice({"tx", "ty", "tz", "rx", "ry", "rz"});
    f.add(name, name[0] == 'r', unit(name[1]));
  }
}

Freedoms read_freedoms(const At& joint, const Kind& kind) {
  Freedoms f;
  const Eigen::Vector3d own = kind.axis ? read_axis(joint, kind.axis) : Eigen::Vector3d::Zero();
  for (const Kind::Motion& m : kind.motions) f.add(m.name, m.rotation, m.axis == Kind::own ? own : unit(m.axis));
  if (joint.has("axes")) read_axes(joint["axes"], f);
  return f;
}

std::vector<JointForce> read_forces(const At& joint, std::size_t n) {
  bool any = false;
  for (const std::string& name : kForces) any = any || joint.has(name);
  std::vector<JointForce> forces(any ? n : 0);
  if (!any) return forces;
  const auto read = [&](const std::string& name, double JointForce::* field) {
    if (!joint.has(name)) return;
    const At at = joint[name];
    const std::vector<double> values = at.is(Value::Kind::list) ? at.numbers(n) : std::vector<double>(n, at.number());
    for (std::size_t k = 0; k < n; ++k) forces[k].*field = values[k];
  };
  read("stiffness", &JointForce::stiffness);
  read("rest", &JointForce::rest);
  read("damping", &JointForce::damping);
  read("lower", &JointForce::lower);
  read("upper", &JointForce::upper);
  read("limit_stiffness", &JointForce::limit_stiffness);
  read("limit_damping", &JointForce::limit_damping);
  read("coulomb", &JointForce::coulomb);
  read("stiction", &JointForce::stiction);
  for (const JointForce& f : forces)
    if (joint.has("stiction") && std::isnan(f.stiction)) joint["stiction"].bad("must be finite, and at least coulomb");
  read("reflected_inertia", &JointForce::reflected_inertia);
  read("torque_limit", &JointForce::torque_limit);
  return forces;
}

Placement read_placement(const At& joint, const std::string& side) {
  Placement place;
  if (!joint.has(side)) return place;
  const At table = joint[side];
  table.known_keys({"position", "rotation"});
  place.position = table.vector("position");
  if (!table.has("rotation")) return place;
  const At at = table["rotation"];
  if (const auto matrix = at.square()) {
    place.rotation = *matrix;
    return place;
  }
  if (!at.is(Value::Kind::list) || at.size() != 3) at.bad("must be a rotation vector (rad) or a 3 x 3 matrix");
  const Eigen::Vector3d turn = at.vector();
  place.rotation = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
  return place;
}

Joint read_joint(const At& joint) {
  Names kinds;
  std::string all;
  for (const Kind& k : kKinds) {
    kinds.push_back(k.type);
    all += (all.empty() ? "" : ", ") + kinds.back();
  }
  if (!joint.is(Value::Kind::table) || !joint.has("type")) joint.bad("must be a table with a type: " + all);
  const std::string type = joint["type"].choice(kinds);
  const Kind& kind = *std::find_if(std::begin(kKinds), std::end(kKinds), [&](const Kind& k) { return k.type == type; });
  Names known = kForces;
  known.insert(known.end(), {"type", "inboard", "outboard", "name"});
  if (kind.axis) known.push_back("axis");
  if (type == "axes") known.push_back("axes");
  joint.known_keys(known);

  const Freedoms f = read_freedoms(joint, kind);
  Names labels;
  for (const std::string& name : f.names) labels.push_back(name.empty() ? type : type + " " + name);
  if (kind.ball)
    for (const char* w : {" wx", " wy", " wz"}) labels.push_back(type + w);
  const std::vector<JointForce> forces = read_forces(joint, labels.size());
  const Placement inboard = read_placement(joint, "inboard"), outboard = read_placement(joint, "outboard");
  return within(joint.where(), [&] { return Joint(f.motions, kind.ball, labels, forces, inboard, outboard); });
}

/// What a link looks like, which Python draws: its keys are checked, nothing is kept.
void pass_look(const At& look) {
  look.known_keys({"shape", "size", "file", "at", "on", "colour"});
  read_placement(look, "at");
}

Link read_link(const At& table) {
  table.known_keys({"joint", "hub", "beam", "tip", "name", "looks"});
  if (table.has("looks"))
    for (const At& look : table["looks"].list("tables")) pass_look(look);
  table.needs({"joint"});
  const Joint joint = read_joint(table["joint"]);
  std::optional<RigidBody> hub, tip;
  std::optional<Beam> beam;
  if (table.has("hub")) hub = read_body(table["hub"]);
  if (table.has("beam")) beam = read_beam(table["beam"]);
  if (table.has("tip")) tip = read_body(table["tip"]);
  return within(table.where(), [&] { return Link(joint, hub, beam, tip); });
}

}  // namespace

RigidBody read_body(const At& table) {
  table.known_keys({"mass", "com", "inertia", "end"});
  RigidBody body;
  body.mass = table.number("mass", 0.0);
  body.com = table.vector("com");
  body.end = table.vector("end");
  if (table.has("inertia")) {
    const At at = table["inertia"];
    const char* right = "must be 3 numbers, 6 (xx yy zz xy xz yz) or a 3 x 3 matrix";
    if (const auto matrix = at.square()) {
      body.inertia = *matrix;
    } else {
      if (!at.is(Value::Kind::list) || (at.size() != 3 && at.size() != 6)) at.bad(right);
      const std::vector<double> i = at.numbers();
      body.inertia = Eigen::Vector3d(i[0], i[1], i[2]).asDiagonal();
      if (i.size() == 6) body.inertia << i[0], i[3], i[4], i[3], i[1], i[5], i[4], i[5], i[2];
    }
  }
  within(table.where(), [&] {
    body.check();
    return 0;
  });
  return body;
}

Arm read_arm(const Value& value) {
  const At scene(value, "");
  At(value, "scene").known_keys({"title", "gravity", "link", "drive", "load", "control", "sensor", "simulation"});
  if (!scene.has("link") || !scene["link"].is(Value::Kind::list) || scene["link"].size() == 0)
    throw std::invalid_argument("link: must be a list of at least one table, [[link]]");
  std::vector<Link> links;
  for (const At& table : scene["link"].list("tables")) links.push_back(read_link(table));
  return Arm(std::move(links), scene.vector("gravity"));
}

}  // namespace flexarm
