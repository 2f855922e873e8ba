// The numbers of an arm as records: set-up writes the types that the kernels read, so that neither side has a number
// that the other does not know. T is one number, in the kernels of every arm of a pack; Sp has the vectors and matrices
// in space or in the plane. Behind some records stand lists: rows of matrices, and the numbers of the points of a beam.
#pragma once

namespace flexarm {
namespace lanes {
namespace records {

/// Passive forces of a joint's freedom (JointForce), and those of its stops.
template <class T>
struct Spring {
  using Number = T;
  T stiffness, rest, damping, reflected;
};
template <class T>
struct Stops {
  using Number = T;
  T lower, upper, stiffness, damping;
};

/// The same of a ball.
template <class T>
struct BallSpring {
  using Number = T;
  struct Axis {
    T damping, reflected;
  };
  T stiffness;
  Axis x, y, z;
};
template <class T>
struct BallStop {
  using Number = T;
  T upper, stiffness, damping;
};

/// Of a strut (see Strut): behind it, of each of its pieces, the square of its length across the plane.
template <class T>
struct StrutLaw {
  using Number = T;
  T stiffness, length, damping, force;
};
constexpr int kStrutLaw = 4;  ///< its numbers

/// Of a contact (see Contact), and its two sides: the sphere's centre on the arm; where the surface is, its axes, and
/// half its size.
template <class T>
struct ContactLaw {
  using Number = T;
  T stiffness, damping, coulomb, tangential, radius;
};
template <class Sp>
struct ContactSphere {
  using Number = typename Sp::Scalar;
  typename Sp::Lin offset;
};
template <class Sp>
struct ContactSurface {
  using Number = typename Sp::Scalar;
  typename Sp::Lin at;
  typename Sp::Rot axes;
  typename Sp::Lin half;
};

/// Of a joint that closes a loop (see Loop), with the arm's size (m). Its frame on a place is a Seat.
template <class T>
struct LoopLaw {
  using Number = T;
  T stiffness, damping, angular_stiffness, angular_damping, size;
};

/// Where something sits on a frame, and how it is turned there.
template <class Sp>
struct Seat {
  using Number = typename Sp::Scalar;
  typename Sp::Lin r;
  typename Sp::Rot R;
};

/// A rigid body: its mass, first and second moment about its frame's origin.
template <class Sp>
struct Body {
  using Number = typename Sp::Scalar;
  Number m;
  typename Sp::Lin c;
  typename Sp::Sym J;
};

/// Order 0 (beam/cut.hpp), after the body: the tip body, its mass, its centre on the end and, at rest, in the link;
/// then of each coordinate momenta per rate, the change of J, and how it moves the tip body's centre, times that mass.
template <class Sp>
struct CutTip {
  using Number = typename Sp::Scalar;
  Number mass;
  typename Sp::Lin on_end, at_rest;
};
template <class Sp>
struct CutCoordinate {
  using Number = typename Sp::Scalar;
  typename Sp::Lin L;
  typename Sp::Ang C;
  typename Sp::Sym dJ;
  typename Sp::Lin tip;
};

/// Order 1 and 2 (beam/quadratic.hpp), of each coordinate: integrals of its displacement l, of l times the place at
/// rest, and in the plane of its turn times the sections' inertia; before a row of integrals of l times all others.
template <class T>
struct PlaneCoordinate {
  using Number = T;
  T l, xl, yl, rotary;
};
template <class Sp>
struct SpaceCoordinate {
  using Number = typename Sp::Scalar;
  Number l;
  typename Sp::Lin xl;
};
/// Displacement across and turn of a slice in the plane, by each coordinate.
template <class T>
struct PlaneSlope {
  using Number = T;
  T l, turn;
};

/// Order 3 and exact (beam/sampled.hpp), before the points: the beam's length, and where it begins in the link.
template <class Sp>
struct Span {
  using Number = typename Sp::Scalar;
  Number length;
  typename Sp::Lin origin;
};

}  // namespace records
}  // namespace lanes
}  // namespace flexarm
