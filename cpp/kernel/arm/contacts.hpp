// Contacts of spheres on an arm with surfaces (see Contact): always in space, though the arm may move in a plane.
#pragma once

#include "arm/state_loads.hpp"
#include "door/records.hpp"

namespace {

using flexarm::lanes::ContactPair;

constexpr double kNoLength = 1e-60;  // added to the square of a length, so that it has a direction where it is zero

/// The memory of a contact from the last step that counts on: its bristles, how far they are bent, in the axes of the
/// surface; the frame on the arm, as the surface saw it; gap and normal force. Without a run it is not `known`: then
/// bristles are unbent.
template <class S>
struct ContactMemory {
  using Sp = Space<S>;
  S known;
  typename Sp::Lin bent;
  Frame<Sp> frame;
  S gap, push;
};
static_assert(sizeof(ContactMemory<double>) == flexarm::lanes::kRemembered * sizeof(double), "what runs remember");

/// Without derivatives, if these are dual numbers (slopes/tangent.hpp).
template <class S>
S constant(const S& x) {
  return x;
}

/// A contact where the arm is. Vectors are in the axes of the surface, but for those of the world.
template <class S>
struct ContactState {
  using L = Lanes<S>;
  using Sp = Space<S>;
  using Lin = typename Sp::Lin;
  using Rot = typename Sp::Rot;

  bool rubs;          ///< whether there is friction
  Rot axes;           ///< of the surface, in the world
  Lin at;             ///< where it touches, in the world
  S gap, rate, push;  ///< m, m/s; the normal force (N)
  S by_gap, by_rate;  ///< by which the push falls
  Lin normal, slip;   ///< away from the surface; velocity along it
  Lin drag;           ///< friction, less its sign
  ContactMemory<S> now;
  S coulomb, stiffness, damping;  ///< of friction
  S damping_by_push, bend_by_push;
  S bends, drags;              ///< parts of a change that are left across the directions below, where
  S bent_most, drag_most;      ///< the spring, or the whole, is at its limit (1, else 0)
  Lin bent_along, drag_along;  ///< in which spring and drag have their limits
  typename L::Mask met;        ///< touched or let go in a step

  /// @param arm, on  the places of the sphere and of the surface in the world, and velocities of their origins
  /// @param memory   of a run, where it is known
  /// @param by_end   see `share`; negative: at an instant
  void find(const ContactPair& pair, const records::ContactLaw<S>& law, const records::ContactSphere<Sp>& sphere,
            const records::ContactSurface<Sp>& surface, const Frame<Sp>& arm, const Motion<Sp>& arm_u,
            const Frame<Sp>& on, const Motion<Sp>& on_u, const ContactMemory<S>& memory, double by_end) {
    rubs = pair.rubs;
    axes = Sp::times(on.R, surface.axes);
    const Lin origin = on.r + Sp::rotate(on.R, surface.at);
    now.frame = {Sp::times(transposed(axes), arm.R), Sp::unrotate(axes, arm.r - origin)};
    const Lin centre = now.frame.r + Sp::rotate(now.frame.R, sphere.offset);
    look(pair.kind, surface.half, law.radius, centre);
    const Lin touch = centre - law.radius * normal;
    at = origin + Sp::rotate(axes, touch);
    const Lin u =
        arm_u.linear + Sp::cross(arm_u.angular, at - arm.r) - on_u.linear - Sp::cross(on_u.angular, at - on.r);
    slip = Sp::unrotate(axes, u);
    rate = Sp::dot(normal, slip);
    slip = across(slip);
    press(pair.hertz, law);
    now.known = number<S>(1.0);
    now.bent = Sp::zero();
    now.gap = gap;
    now.push = push;
    drag = Sp::zero();
    met = L::everywhere(false);
    if (by_end >= 0.0) share(memory, pair.hertz ? 0.4 : 0.5, by_end);
    if (!pair.rubs) return;
    const ContactMemory<S> before = begin(memory);
    const Lin moved = centre - before.frame.r - Sp::rotate(before.frame.R, sphere.offset);
    const Lin turned = rotation_vector(Sp::times(now.frame.R, transposed(before.frame.R)));
    rub(law, before.bent + moved - law.radius * Sp::cross(turned, normal));
  }

  /// On the arm, in the world.
  Lin force() const { return Sp::rotate(axes, push * normal - drag); }

  /// By which it falls where the arm's point moves by s x, at d x; in the world.
  Lin fall(double s, double d, const Lin& world) const {
    const Lin x = Sp::unrotate(axes, world), along = across(x);
    const S more = -(s * by_gap + d * by_rate) * Sp::dot(normal, x);  // push
    if (!rubs) return Sp::rotate(axes, -more * normal);
    const Lin bent = (s * bends) * (along - (bent_most * Sp::dot(bent_along, along)) * bent_along) +
                     (bent_most * bend_by_push * more) * bent_along;
    const Lin free = stiffness * bent + (d * damping) * along + (damping_by_push * more) * slip;
    const Lin held = drags * (free - (drag_most * Sp::dot(drag_along, free)) * drag_along) +
                     (drag_most * coulomb * more) * drag_along;
    return Sp::rotate(axes, held - more * normal);
  }

 private:
  static Rot transposed(const Rot& R) { return {R.xx, R.yx, R.zx, R.xy, R.yy, R.zy, R.xz, R.yz, R.zz}; }
  Lin across(const Lin& x) const { return x - Sp::dot(normal, x) * normal; }
  /// Of a turn of less than pi.
  static Lin rotation_vector(const Rot& R) {
    const Lin axis{0.5 * (R.zy - R.yz), 0.5 * (R.xz - R.zx), 0.5 * (R.yx - R.xy)};
    const S sine = length(axis), angle = L::atan2(sine, 0.5 * (R.xx + R.yy + R.zz - 1.0));
    return (angle / sine) * axis;
  }
  static S length(const Lin& x) { return L::root(Sp::dot(x, x) + kNoLength); }

  /// Gap and normal of a sphere whose centre is at y.
  void look(ContactPair::Kind kind, const Lin& half, const S& radius, const Lin& y) {
    const S one = number<S>(1.0), o{};
    if (kind == ContactPair::plane) {
      gap = y.z - radius;
      normal = {o, o, one};
      return;
    }
    if (kind == ContactPair::sphere) {
      const S far = length(y);
      gap = far - half.x - radius;
      normal = (1.0 / far) * y;
      return;
    }
    const auto side = [&](const S& x) { return L::select(x < 0.0, -one, one); };
    const Lin beyond{L::size(y.x) - half.x, L::size(y.y) - half.y, L::size(y.z) - half.z};
    const Lin out{side(y.x) * L::larger(beyond.x, o), side(y.y) * L::larger(beyond.y, o),
                  side(y.z) * L::larger(beyond.z, o)};
    const S far = length(out), near = L::larger(beyond.x, L::larger(beyond.y, beyond.z));
    const auto inside = L::none_of(near > 0.0);  // then the nearest face
    const auto by_x = (beyond.x > beyond.y) & (beyond.x > beyond.z), by_y = L::none_of(by_x) & (beyond.y > beyond.z);
    const auto by_z = L::none_of(by_x | by_y);
    gap = L::select(inside, near, far) - radius;
    const Lin away = (1.0 / far) * out;
    normal = {L::select(inside, L::select(by_x, side(y.x), o), away.x),
              L::select(inside, L::select(by_y, side(y.y), o), away.y),
              L::select(inside, L::select(by_z, side(y.z), o), away.z)};
  }

  /// The normal force.
  void press(bool hertz, const records::ContactLaw<S>& law) {
    const S o{}, depth = L::larger(-gap, o), root = hertz ? L::root(depth + kNoLength) : number<S>(1.0);
    const S spring = law.stiffness * depth * root, damped = 1.0 - law.damping * rate;
    push = spring * damped;
    const auto acts = push > 0.0;
    push = L::select(acts, push, o);
    by_gap = L::select(acts, ((hertz ? 1.5 : 1.0) * law.stiffness) * root * damped, o);
    by_rate = L::select(acts, spring * law.damping, o);
  }

  /// At the end of a step in which it touches or lets go: the force that, in the mean with that of its beginning, does
  /// the work that the spring has taken, its potential's difference over that of the gap (Gonzalez 1996, Laursen & Love
  /// 2002). So steps too long for an impact do not add energy.
  /// @param work    that of the spring, in parts of its force times its depth
  /// @param by_end  weight of the force at the end, in that mean
  void share(const ContactMemory<S>& before, double work, double by_end) {
    const S over = 1.0 / (L::size(gap) + L::size(before.gap) + kNoLength);
    const auto known = before.known > 0.5;
    const auto touches = known & (before.gap > 0.0) & (push > 0.0);
    const auto leaves = known & (before.push > 0.0) & L::none_of(gap < 0.0);
    const S part = L::select(touches, -gap, -before.gap) * over;  // of the step, in touch
    const S end = (work / by_end) * part, begin = end - (1.0 - by_end) / by_end;
    by_gap = L::select(touches, by_gap * end + ((work / by_end) * push) * before.gap * over * over, by_gap);
    by_gap = L::select(leaves, before.push * end * over, by_gap);
    by_rate = L::select(touches, by_rate * end, by_rate);
    push = L::select(touches, push * end, L::select(leaves, before.push * begin, push));
    met = touches | leaves;
  }

  /// Of a run, its memory.
  ContactMemory<S> begin(const ContactMemory<S>& memory) const {
    ContactMemory<S> out = now;
    S* x = view<S>(&out);
    const S* kept = view<const S>(&memory);
    const auto known = memory.known > 0.5;
    for (int i = 0; i < flexarm::lanes::kRemembered; ++i) x[i] = L::select(known, kept[i], constant(x[i]));
    return out;
  }

  /// Friction. @param bent  the spring, if it did not give way
  void rub(const records::ContactLaw<S>& law, const Lin& bent) {
    const S one = number<S>(1.0), o{};
    coulomb = law.coulomb;
    stiffness = law.tangential;
    damping_by_push = law.damping;
    damping = damping_by_push * L::larger(push, o);
    bend_by_push = coulomb / law.tangential;
    const auto limit = [&](const Lin& x, const S& most, S& left, S& limited, Lin& along) {
      const S size = length(x);
      const auto beyond = size > most;
      left = L::select(beyond, most / size, one);
      limited = L::select(beyond, one, o);
      along = (1.0 / size) * x;
    };
    const S pressed = L::larger(push, o);
    now.bent = across(bent);
    limit(now.bent, bend_by_push * pressed, bends, bent_most, bent_along);
    now.bent = bends * now.bent;
    drag = stiffness * now.bent + damping * slip;
    limit(drag, coulomb * pressed, drags, drag_most, drag_along);
    drag = drags * drag;
  }
};

}  // namespace
