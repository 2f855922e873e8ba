// Spatial vectors and Phi (Eq. 14, 68) in space and in the plane, under the same names: the algorithm is written once
// for both. An inertia M = [A B; B^T D] takes a motion to a force.
#pragma once

namespace {

/// A velocity, an acceleration, or a column of a Jacobian: of a frame's origin, and of its turning.
template <class Sp>
struct Motion {
  typename Sp::Lin linear;
  typename Sp::Ang angular;
  static Motion zero() { return {Sp::zero(), Sp::zero_angular()}; }
  friend Motion operator+(const Motion& a, const Motion& b) { return {a.linear + b.linear, a.angular + b.angular}; }
  friend Motion operator*(const typename Sp::Scalar& k, const Motion& a) { return {k * a.linear, k * a.angular}; }
  Motion& operator+=(const Motion& b) { return *this = *this + b; }
};

/// A force, and its moment about a frame's origin.
template <class Sp>
struct Force {
  typename Sp::Lin force;
  typename Sp::Ang moment;
  static Force zero() { return {Sp::zero(), Sp::zero_angular()}; }
  friend Force operator+(const Force& a, const Force& b) { return {a.force + b.force, a.moment + b.moment}; }
  friend Force operator-(const Force& a, const Force& b) { return {a.force - b.force, a.moment - b.moment}; }
  friend Force operator*(const typename Sp::Scalar& k, const Force& a) { return {k * a.force, k * a.moment}; }
  Force& operator+=(const Force& b) { return *this = *this + b; }
};

/// Power.
template <class Sp>
typename Sp::Scalar dot(const Motion<Sp>& m, const Force<Sp>& f) {
  return Sp::dot(m.linear, f.force) + Sp::dot(m.angular, f.moment);
}

/// A frame in another one, its parent: the operator Phi between the two (Eq. 14, 68). It takes motions outward and, as
/// Phi^T, forces and inertias inward: each by a shift between the origins, in the parent's axes, and a turn of the
/// axes.
template <class Sp>
struct Frame {
  typename Sp::Rot R;  ///< its axes
  typename Sp::Lin r;  ///< its origin

  Motion<Sp> shift(const Motion<Sp>& m) const { return {m.linear + Sp::cross(m.angular, r), m.angular}; }
  Motion<Sp> turn(const Motion<Sp>& m) const { return {Sp::unrotate(R, m.linear), Sp::unrotate_angular(R, m.angular)}; }
  Motion<Sp> to_child(const Motion<Sp>& m) const { return turn(shift(m)); }

  Force<Sp> turn_back(const Force<Sp>& f) const { return {Sp::rotate(R, f.force), Sp::rotate_angular(R, f.moment)}; }
  Force<Sp> shift_back(const Force<Sp>& f) const { return {f.force, f.moment + Sp::moment(r, f.force)}; }
  Force<Sp> to_parent(const Force<Sp>& f) const { return shift_back(turn_back(f)); }

  /// Of the child, as the motion of a body on which both are: at the parent's origin.
  Motion<Sp> to_parent(const Motion<Sp>& m) const {
    const typename Sp::Ang w = Sp::rotate_angular(R, m.angular);
    return {Sp::rotate(R, m.linear) - Sp::cross(w, r), w};
  }
};

/// A frame seen from the parent of its parent.
template <class Sp>
Frame<Sp> operator*(const Frame<Sp>& a, const Frame<Sp>& b) {
  return {Sp::times(a.R, b.R), a.r + Sp::rotate(a.R, b.r)};
}

}  // namespace
