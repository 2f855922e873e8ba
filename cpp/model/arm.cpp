#include "flexarm/arm.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <tuple>
#include <utility>

#include "flexarm/check.hpp"

namespace flexarm {

const char this_file_has_other_vector_flags_than_the_flexarm_library::FLEXARM_SAME_VECTORS = 0;
const char this_file_has_other_sanitizers_than_the_flexarm_library::FLEXARM_SAME_MALLOC = 0;

namespace {

constexpr double kBeyond = 10.0;         // lengths of a beam: such bending is meaningless at truncated orders
constexpr double kBeyondExact = 1000.0;  // the same where a beam may wind up
constexpr double kMostTurns = 1e4;       // rad of a section against its base
constexpr double kFastest = 1e12;        // rad/s or m/s of a joint
constexpr double kNear = 1e-3;           // parts of these that count as near

/// Lengths that the elastic coordinates move a section, and radians that they turn it, each by itself and at most.
std::pair<Eigen::VectorXd, Eigen::VectorXd> largest_parts(const Beam& beam) {
  Eigen::VectorXd moved = Eigen::VectorXd::Zero(beam.ne()), turned = moved;
  const auto look = [&](const SliceTable& at) {
    moved = moved.cwiseMax(at.linear.topRows<3>().colwise().norm().transpose() / beam.length());
    turned = turned.cwiseMax(at.linear.bottomRows<3>().colwise().norm().transpose());
  };
  for (const MassSlice& slice : beam.slices()) look(slice.table);
  look(beam.tip());
  return {moved, turned};
}

void check_axes(const std::string& name, const Eigen::Matrix3d& axes) {
  const double off = (axes.transpose() * axes - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(off < 1e-9) || axes.determinant() < 0.0)
    bad_value(name, off, "off a rotation matrix: its columns must be right-handed unit axes");
}

double beyond(const Beam& beam) { return beam.order() == kExact ? kBeyondExact : kBeyond; }

}  // namespace

Arm::Arm(std::vector<Link> links, const Eigen::Vector3d& gravity, std::vector<Seat> seats, std::vector<Strut> struts,
         std::vector<Contact> contacts, std::vector<Loop> loops)
    : links_(std::move(links)),
      gravity_(finite("gravity", gravity)),
      seats_(std::move(seats)),
      struts_(std::move(struts)),
      contacts_(std::move(contacts)),
      loops_(std::move(loops)) {
  if (links_.empty()) bad_value("links", "[]", "an arm needs at least one link");
  if (seats_.empty())
    for (int n = 0; n < static_cast<int>(size()); ++n) seats_.emplace_back(n - 1);
  if (seats_.size() != size())
    bad_value("parents", std::to_string(seats_.size()) + " numbers",
              "must be one for each of " + std::to_string(size()) + " links");
  for (std::size_t n = 0; n < size(); ++n) check_seat(n);
  for (const Link& link : links_) {
    first_.push_back(nv_);
    first_q_.push_back(nq_);
    for (int k = 0; k < link.nj() + link.ne(); ++k) {
      const bool ball = link.joint().has_ball() && k >= link.nj() - 3 && k < link.nj();
      coordinate_of_.push_back(ball ? -1 : nq_ + k + (k < link.nj() ? 0 : link.joint().nq() - link.nj()));
    }
    nv_ += link.nj() + link.ne();
    nq_ += link.joint().nq() + link.ne();
  }
  farthest_ = Eigen::VectorXd::Constant(nq_, std::numeric_limits<double>::max());
  fastest_ = Eigen::VectorXd::Constant(nv_, std::numeric_limits<double>::max());
  for (std::size_t n = 0; n < size(); ++n) {
    if (links_[n].mass() > 0.0) fastest_.segment(first_[n], links_[n].nj()).setConstant(kFastest);
    if (links_[n].ne() == 0) continue;
    const Beam& beam = *links_[n].beam();
    const auto [moved, turned] = largest_parts(beam);
    farthest_.segment(first_q_[n] + links_[n].joint().nq(), links_[n].ne()) =
        (moved / beyond(beam))
            .cwiseMax(turned / kMostTurns)
            .cwiseInverse()
            .cwiseMin(std::numeric_limits<double>::max());
  }
  for (std::size_t k = 0; k < struts_.size(); ++k) check(struts_[k], "struts[" + std::to_string(k) + "]");
  for (std::size_t k = 0; k < contacts_.size(); ++k) check(contacts_[k], "contacts[" + std::to_string(k) + "]");
  for (std::size_t k = 0; k < loops_.size(); ++k) check(loops_[k], "loops[" + std::to_string(k) + "]");
  check_inertia();
}

void Arm::check_seat(std::size_t n) const {
  const int link = parent(n);
  const std::optional<double>& x = at(n);
  const std::string number = "[" + std::to_string(n) + "]";
  if (link < kWorld || link >= static_cast<int>(n))
    bad_value("parents" + number, link, "must be a link before this one, or -1: the world");
  if (!x) return;
  const auto refuse = [&](const std::string& right) { bad_value("at" + number, *x, right); };
  if (link == kWorld) refuse("the world has no beam; a joint's inboard placement tells where it sits there");
  const std::optional<Beam>& beam = links_[static_cast<std::size_t>(link)].beam();
  if (!beam) refuse("the parent has no beam; a joint's inboard placement tells where it sits on a rigid body");
  if (!(*x > 0.0 && *x <= beam->length())) {
    std::ostringstream right;
    right << "must be on the parent's beam, above 0 and up to its length, " << beam->length() << " m";
    refuse(right.str());
  }
}

void Arm::check(const Strut& strut, const std::string& name) const {
  if (strut.points.size() < 2)
    bad_value(name + ".points", std::to_string(strut.points.size()) + " points", "must be two or more");
  non_negative(name + ".stiffness", strut.stiffness);
  non_negative(name + ".damping", strut.damping);
  non_negative(name + ".length", strut.length);
  if (!std::isfinite(strut.force)) bad_value(name + ".force", strut.force, "must be finite");
  for (std::size_t i = 0; i < strut.points.size(); ++i)
    check(strut.points[i], name + ".points[" + std::to_string(i) + "]");
}

void Arm::check(const Strut::Point& point, const std::string& name) const {
  finite(name + ".offset", point.offset);
  if (point.link < kWorld || point.link >= static_cast<int>(size()))
    bad_value(name + ".link", point.link, "there is no such link");
  if (point.link != kWorld && point.on == Strut::Point::slice)
    link(static_cast<std::size_t>(point.link)).slice_at(point.x);
}

void Arm::check(const Contact& contact, const std::string& name) const {
  check(contact.point, name + ".point");
  check(contact.against.at, name + ".against.at");
  if (contact.point.link == kWorld) bad_value(name + ".point.link", kWorld, "must be a link, not the world");
  positive(name + ".stiffness", contact.stiffness);
  for (const auto& [field, value] : {std::pair<const char*, double>{".radius", contact.radius},
                                     {".damping", contact.damping},
                                     {".coulomb", contact.coulomb},
                                     {".tangential_stiffness", contact.tangential_stiffness}})
    non_negative(name + field, value);
  if (contact.exponent != 1.0 && contact.exponent != 1.5)
    bad_value(name + ".exponent", contact.exponent, "must be 1 or 1.5");
  if (contact.coulomb > 0.0) positive(name + ".tangential_stiffness", contact.tangential_stiffness);
  const Surface& on = contact.against;
  finite(name + ".against.size", on.size);
  for (int i = 0; i < (on.kind == Surface::box ? 3 : on.kind == Surface::sphere ? 1 : 0); ++i)
    positive(name + ".against.size[" + std::to_string(i) + "]", on.size[i]);
  check_axes(name + ".against.axes", on.axes);
}

void Arm::check(const Loop& loop, const std::string& name) const {
  check(loop.a.at, name + ".a");
  check(loop.b.at, name + ".b");
  check_axes(name + ".axes_a", loop.a.axes);
  check_axes(name + ".axes_b", loop.b.axes);
  if (loop.a.at.link == loop.b.at.link)
    bad_value(name + ".b.link", loop.b.at.link, "is that of a: a loop closes between two links, or one and the world");
  for (const auto& [field, stiffness, damping] :
       {std::tuple<const char*, double, double>{"", loop.stiffness, loop.damping},
        {"angular_", loop.angular_stiffness, loop.angular_damping}}) {
    if (!(stiffness > 0.0)) bad_value(name + "." + field + "stiffness", stiffness, "must be positive, infinite: rigid");
    non_negative(name + "." + field + "damping", damping);
    if (damping > 0.0 && std::isinf(stiffness))
      bad_value(name + "." + field + "damping", damping, "must be 0 where the stiffness is infinite");
  }
}

bool Arm::has_contact_friction() const {
  return std::any_of(contacts_.begin(), contacts_.end(), [](const Contact& c) { return c.coulomb > 0.0; });
}

bool Arm::is_chain() const {
  for (std::size_t n = 0; n < size(); ++n)
    if (!(seats_[n] == Seat(static_cast<int>(n) - 1))) return false;
  return true;
}

Eigen::VectorXd Arm::zero() const {
  Eigen::VectorXd q = Eigen::VectorXd::Zero(nq_);
  for (std::size_t n = 0; n < size(); ++n) {
    const Eigen::VectorXd joint = links_[n].joint().zero();
    q.segment(first_q_[n], joint.size()) = joint;
  }
  return q;
}

std::vector<std::string> Arm::coordinates() const {
  std::vector<std::string> names;
  for (std::size_t n = 0; n < size(); ++n) {
    const std::string prefix = "link " + std::to_string(n) + " ";
    for (const std::string& c : links_[n].joint().labels()) names.push_back(prefix + c);
    if (!links_[n].beam()) continue;
    for (int s = 0; s < kStrains; ++s)
      for (int i = 0; i < links_[n].beam()->options().modes[s]; ++i)
        names.push_back(prefix + kStrainFields[s].name + " " + std::to_string(i + 1));
  }
  return names;
}

std::string Arm::farthest_out(const Eigen::VectorXd& q, const Eigen::VectorXd& v) const {
  const auto worst = [](const Eigen::VectorXd& x, const Eigen::VectorXd& limit, Eigen::Index& at) {
    return x.cwiseAbs().cwiseQuotient(limit).unaryExpr([](double r) { return r >= 0.0 ? r : 1e300; }).maxCoeff(&at);
  };
  Eigen::Index bent = 0, moved = 0;
  const double by_q = worst(q, farthest_, bent), by_v = worst(v, fastest_, moved);
  std::ostringstream text;
  text.precision(3);
  if (!(std::max(by_q, by_v) > kNear)) return {};
  if (by_v > by_q) {
    text << "'" << coordinates()[static_cast<std::size_t>(moved)] << "' moves at " << v[moved] << " rad/s or m/s";
    return text.str();
  }
  const std::size_t n = static_cast<std::size_t>(
      std::upper_bound(first_q_.begin(), first_q_.end(), static_cast<int>(bent)) - first_q_.begin() - 1);
  const Beam& beam = *links_[n].beam();
  const auto [lengths, turns] = largest_parts(beam);
  const auto qe = q.segment(first_q_[n] + links_[n].joint().nq(), beam.ne()).cwiseAbs();
  text << "the beam of link " << n << " ";
  if (const double most = qe.cwiseProduct(lengths).maxCoeff(); most * kMostTurns > qe.cwiseProduct(turns).maxCoeff())
    text << "is bent by " << most << " times its length";
  else
    text << "turns its sections by " << qe.cwiseProduct(turns).maxCoeff() << " rad";
  return text.str();
}

Eigen::MatrixXd Arm::patch_matrix() const {
  Eigen::Index n = 0, k = 0;
  for (const Link& link : links_) n += link.beam() ? link.beam()->patch_forces().cols() : 0;
  Eigen::MatrixXd B = Eigen::MatrixXd::Zero(nv_, n);
  for (std::size_t i = 0; i < links_.size(); ++i) {
    if (!links_[i].beam()) continue;
    const Eigen::MatrixXd& forces = links_[i].beam()->patch_forces();
    B.block(first_[i] + links_[i].nj(), k, forces.rows(), forces.cols()) = forces;
    k += forces.cols();
  }
  return B;
}

}  // namespace flexarm
