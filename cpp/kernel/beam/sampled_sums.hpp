// The elastic body at order 3 and "exact": its rotation and position at Gauss points, by integrals along the beam, and
// sums over slices. Points lie across the lanes of one arm; or each lane holds an arm. sampled_plane.hpp and
// sampled_space.hpp make the motion of its slices; the sums here are the same for both.
#pragma once

#include "beam/integral.hpp"

namespace {
namespace sampled {

/// The answer of a mask: of an arm in each lane, its own; of one arm, whether any lane is set.
template <class S, class P>
typename Lanes<P>::Mask of_arm(const typename Lanes<P>::Mask& mask) {
  if constexpr (sizeof(S) == sizeof(P))
    return mask;
  else
    return Lanes<P>::everywhere(Lanes<P>::any(mask));
}

/// A column's number at point i, which is in lane i.
template <class S, class P>
S lane_of(const P* column, int i) {
  return view<const S>(column)[i];
}

/// The most that an arm has: of one arm, in any lane.
template <class S, class P>
P most_of_arm(const P& x) {
  if constexpr (sizeof(S) == sizeof(P)) {
    return x;
  } else {
    S most = lane_of<S>(&x, 0);
    for (int i = 1; i < Lanes<P>::width; ++i) most = Lanes<S>::larger(most, lane_of<S>(&x, i));
    return widen(most, P{});
  }
}

/// A vector as a function of X: a column for each component, of its values at the points and then at further stations.
template <class Sp>
struct Field {
  using P = typename Sp::Scalar;
  using Lin = typename Sp::Lin;
  P* at;
  int stride;

  Lin operator()(int i) const {
    Lin x = Sp::zero();
    for (int c = 0; c < Sp::linear; ++c) Sp::component(x, c) = at[c * stride + i];
    return x;
  }
  void set(int i, const Lin& x) const {
    for (int c = 0; c < Sp::linear; ++c) at[c * stride + i] = Sp::component(x, c);
  }
  P* column(int c) const { return at + c * stride; }
  void clear(int from, int to) const {
    for (int c = 0; c < Sp::linear; ++c)
      for (int i = from; i < to; ++i) at[c * stride + i] = P{};
  }
};

/// Such a function in an elastic motion: its value, the convective part of its second rate, and its
/// derivative by each elastic coordinate.
template <class Sp>
struct Jet {
  Field<Sp> value, bias, first;
  Field<Sp> by(int k) const { return {first.at + k * Sp::linear * first.stride, first.stride}; }
};

/// Columns one after the other, from this field's on, as an Integral takes them.
template <class Sp>
auto columns_of(const Field<Sp>& f) {
  return columns_at(f.at, f.stride);
}

template <class S, class P>
void put_lane(P* column, int i, const S& x) {
  view<S>(column)[i] = x;
}
/// One point's value.
template <class To, class Sp>
void put_lane(Sp, const Field<To>& f, int i, const typename Sp::Lin& x) {
  for (int c = 0; c < Sp::linear; ++c) put_lane(f.column(c), i, Sp::component(x, c));
}

template <class Sp, class From>
typename Sp::Lin get_lane(Sp, const Field<From>& f, int i) {
  typename Sp::Lin x = Sp::zero();
  for (int c = 0; c < Sp::linear; ++c) Sp::component(x, c) = lane_of<typename Sp::Scalar>(f.column(c), i);
  return x;
}

template <class Sp>
void clear_stations(const Jet<Sp>& jet, int ne, int from, int to) {
  jet.value.clear(from, to);
  jet.bias.clear(from, to);
  for (int k = 0; k < ne; ++k) jet.by(k).clear(from, to);
}

/// Hands out columns one after the other.
template <class Sp>
struct Columns {
  using P = typename Sp::Scalar;
  P* at;
  int stride;
  P* take(int columns) {
    P* here = at;
    at += columns * stride;
    return here;
  }
  Field<Sp> field() { return {take(Sp::linear), stride}; }
  Jet<Sp> jet(int ne) {
    Jet<Sp> out{field(), field(), {nullptr, stride}};
    out.first.at = take(ne * Sp::linear);
    return out;
  }
};

/// The beam's end, among points that may lie in lanes.
template <class S, class P>
int end_point(const Node& node) {
  return node.passes * static_cast<int>(sizeof(P) / sizeof(S)) + node.sampled.half;
}
/// Of a node: P of points, and of all stations that carry mass; which of these do.
inline int points_of(const Node& node) { return 2 * node.passes; }
inline int stations_of(const Node& node) { return points_of(node) + node.sampled.further_passes; }
/// Between the columns of long fields, so that one place in all of them does not share a few lines of the cache.
inline int stride_of(const Node& node) { return stations_of(node) < 16 ? stations_of(node) : stations_of(node) | 1; }
inline int first_station(const Node& node) { return node.sampled.points_have_mass ? 0 : points_of(node); }

/// The numbers of a node's points.
template <class Sp>
struct Rows {
  using P = typename Sp::Scalar;
  static constexpr int width = Lanes<P>::width;
  int points, stations;
  records::Span<Sp> span;
  const double *strain, *turn, *rest, *mass, *inertia, *further;

  Rows(const Node& node, const double* p) : points(points_of(node)), stations(stations_of(node)) {
    span = read<records::Span<Sp>>(p);
    const auto rows = [&](int count, int length_of) {
      const double* here = p;
      p += count * length_of * width;
      return here;
    };
    strain = rows(node.ne, points);
    turn = rows(Sp::planar ? 0 : node.ne, points);
    rest = rows(node.sampled.curved ? (Sp::planar || node.sampled.uniaxial ? 1 : 7) : 0, points);
    mass = rows(1, stations);
    inertia = rows(node.rotary, stations);
    further = p;
  }
  /// Of coordinate k: its strain at point i times the beam's length (in the plane, of bending: the turn it gives).
  P shape(int k, int i) const { return Lanes<P>::load(strain + (k * points + i) * width); }
  template <class S>
  S shape_in_lane(int k, int i) const {
    return Lanes<S>::load(strain + k * points * width + i * Lanes<S>::width);
  }
  P turned(int k, int i) const { return Lanes<P>::load(turn + (k * points + i) * width); }
  /// Of a beam that is curved at rest: of how far it is turned about its axis, or rows of its K times the length, and
  /// of its quaternion less 1, w x y z.
  P at_rest(int row, int i) const { return Lanes<P>::load(rest + (row * points + i) * width); }
  template <class S>
  S rest_in_lane(int i) const {
    return Lanes<S>::load(rest + i * Lanes<S>::width);
  }
  /// Of station i: its mass, and of its inertia about its centre of mass: the moments, the products xy, xz, yz, and
  /// where that centre lies from the axis; all in its own axes.
  P mass_of(int i) const { return Lanes<P>::load(mass + i * width); }
  P inertia_of(int row, int i) const { return Lanes<P>::load(inertia + (row * stations + i) * width); }
};

/// Sums over the slices: of one body, and of each coordinate.
template <class Sp>
struct Sums {
  using T = typename Sp::Scalar;
  struct Body {
    typename Sp::Lin c, f;  ///< first moment; force
    typename Sp::Ang n;     ///< and moment of the accelerations that velocities give (Eq. 81)
    typename Sp::Sym J;     ///< second moment
  };
  static int size(int ne) {
    return static_cast<int>(sizeof(Body) / sizeof(T)) + ne * (1 + Sp::linear + Sp::angular) + ne * (ne + 1) / 2;
  }
  Body* body;
  T* e;
  typename Sp::Lin* M_linear;
  typename Sp::Ang* M_angular;
  T* M;

  Sums(T* at, int ne) : body(view<Body>(at)) {
    e = view<T>(body + 1);
    M_linear = view<typename Sp::Lin>(e + ne);
    M_angular = view<typename Sp::Ang>(M_linear + ne);
    M = view<T>(M_angular + ne);
  }
};

/// A slice as the sums need it.
template <class Sp>
struct Station {
  typename Sp::Scalar mass;
  typename Sp::Lin x, force;  ///< place; the force of accelerations by velocities alone
  typename Sp::Sym J;         ///< in space: its inertia about its place, in the link's axes
  typename Sp::Lin torque;    ///< and the torque of these
  typename Sp::Lin arm;       ///< from its place to its centre of mass, where these differ
};

constexpr int kTogether = 4;  // stations that are summed together

/// Numbers P of the columns of so many stations: J_T and in space J_R of all coordinates, and mass and inertia times
/// these.
template <class Sp>
int columns_size(int ne) {
  return 2 * ne * kTogether * 2 * Sp::linear;
}

template <class P>
void add_second_moment(const P& m, const typename Space<P>::Lin& x, typename Space<P>::Sym& J) {
  const typename Space<P>::Lin mx = m * x;
  const P xx = mx.x * x.x, yy = mx.y * x.y, zz = mx.z * x.z;
  J.xx += yy + zz;
  J.yy += xx + zz;
  J.zz += xx + yy;
  J.xy -= mx.x * x.y;
  J.xz -= mx.x * x.z;
  J.yz -= mx.y * x.z;
}
template <class P>
void add_second_moment(const P& m, const typename Plane<P>::Lin& x, typename Plane<P>::Sym& J) {
  J.zz += m * (x.x * x.x + x.y * x.y);
}

/// A section's own inertia: the torque that turns it.
template <class P, class Series>
void add_turning(const Rows<Space<P>>& rows, const Series& m, const typename Space<P>::Lin& w, int i, bool off_axis,
                 Station<Space<P>>& s, typename Sums<Space<P>>::Body& body) {
  using Sp = Space<P>;
  using Lin = typename Sp::Lin;
  const auto I = [&](int row) { return rows.inertia_of(row, i); };
  const Lin x = m.R[0](i), y = m.R[1](i), z = m.R[2](i);
  Lin Ix = I(0) * x, Iy = I(1) * y, Iz = I(2) * z;
  if (off_axis) {
    Ix += I(3) * y + I(4) * z;
    Iy += I(3) * x + I(5) * z;
    Iz += I(4) * x + I(5) * y;
  }
  s.J = {Ix.x * x.x + Iy.x * y.x + Iz.x * z.x, Ix.y * x.y + Iy.y * y.y + Iz.y * z.y,
         Ix.z * x.z + Iy.z * y.z + Iz.z * z.z, Ix.x * x.y + Iy.x * y.y + Iz.x * z.y,
         Ix.x * x.z + Iy.x * y.z + Iz.x * z.z, Ix.y * x.z + Iy.y * y.z + Iz.y * z.z};
  const Lin spin = m.spin(i), W = w + spin, W_dot = Sp::cross(w, spin) + m.turned.bias(i);  // Eq. 46
  s.torque = Sp::apply(s.J, W_dot) + Sp::cross(W, Sp::apply(s.J, W));
  Sp::add(body.J, s.J);
  if (off_axis) {  // about the section's place, of the centre of mass, which it carries
    s.arm = I(6) * x + I(7) * y + I(8) * z;
    const Lin swing = s.mass * (Sp::cross(W_dot, s.arm) + Sp::cross(W, Sp::cross(W, s.arm)));
    s.force += swing;
    body.c += s.mass * s.arm;
    body.f += swing;
    body.n += Sp::moment(s.x, swing);
    s.torque += Sp::cross(s.arm, s.force);
    add_second_moment<P>(s.mass, s.arm, s.J);
    add_second_moment<P>(s.mass, s.x + s.arm, body.J);
    add_second_moment<P>(-s.mass, s.x, body.J);
  }
  body.n += s.torque;
}

/// Of station i: its part of the body's inertia and force.
template <class Sp, class S, class Series>
Station<Sp> add_station(const Node& node, const Rows<Sp>& rows, const Series& m, const S* dq, const typename Sp::Ang& w,
                        int i, typename Sums<Sp>::Body& body) {
  using P = typename Sp::Scalar;
  using Lin = typename Sp::Lin;
  Station<Sp> s;
  Lin u_dot = Sp::zero();
  for (int k = 0; k < node.ne; ++k) u_dot += widen(dq[k], P{}) * m.place.by(k)(i);
  s.mass = rows.mass_of(i);
  s.x = m.place.value(i);
  const Lin sweep = Sp::cross(w, s.x) + number<P>(2.0) * u_dot;
  s.force = s.mass * (Sp::cross(w, sweep) + m.place.bias(i));  // Eq. 45
  body.c += s.mass * s.x;
  body.f += s.force;
  body.n += Sp::moment(s.x, s.force);
  add_second_moment<P>(s.mass, s.x, body.J);
  if constexpr (!Sp::planar)
    if (node.rotary) add_turning<P>(rows, m, w, i, node.rotary > 3, s, body);
  return s;
}

/// Of N stations.
template <int N, class Sp, class S, class Series>
void sum_stations(const Node& node, const Rows<Sp>& rows, const Series& m, const S* dq, const typename Sp::Ang& w,
                  int from, const Sums<Sp>& sums, typename Sp::Scalar* products) {
  using P = typename Sp::Scalar;
  using Lin = typename Sp::Lin;
  const bool turning = !Sp::planar && node.rotary;
  const int each = N * (turning ? 2 : 1) * Sp::linear;
  P* const slopes = products + node.ne * each;
  Station<Sp> station[N];
  for (int a = 0; a < N; ++a) station[a] = add_station(node, rows, m, dq, w, from + a, *sums.body);
  for (int k = 0; k < node.ne; ++k) {
    P e{}, *row = products + k * each, *slope = slopes + k * each;
    Lin f = Sp::zero();
    typename Sp::Ang n = Sp::zero_angular();
    const Field<Sp> J_T = m.place.by(k);
#pragma GCC unroll 4
    for (int a = 0; a < N; ++a) {
      const Station<Sp>& s = station[a];
      const Lin J = J_T(from + a), mJ = s.mass * J;
      e += Sp::dot(J, s.force);
      f += mJ;
      n += Sp::moment(s.x, mJ);
      for (int c = 0; c < Sp::linear; ++c) {
        slope[c * N + a] = Sp::component(J, c);
        row[c * N + a] = Sp::component(mJ, c);
      }
    }
    if constexpr (!Sp::planar)
      if (turning) {
        const Field<Sp> J_R = m.turned.by(k);
#pragma GCC unroll 4
        for (int a = 0; a < N; ++a) {
          const Station<Sp>& s = station[a];
          const Lin J = J_R(from + a), IJ = Sp::apply(s.J, J);
          e += Sp::dot(J, s.torque);
          n += IJ;
          for (int c = 0; c < Sp::linear; ++c) {
            slope[(Sp::linear + c) * N + a] = Sp::component(J, c);
            row[(Sp::linear + c) * N + a] = Sp::component(IJ, c);
          }
        }
        for (int a = 0; a < N && node.rotary > 3; ++a) {  // momenta by centres of mass off the axis
          const Station<Sp>& s = station[a];
          const Lin p = s.mass * Sp::cross(J_R(from + a), s.arm), h = Sp::cross(s.arm, s.mass * J_T(from + a));
          f += p;
          n += Sp::moment(s.x, p) + h;
          for (int c = 0; c < Sp::linear; ++c) {
            row[c * N + a] += Sp::component(p, c);
            row[(Sp::linear + c) * N + a] += Sp::component(h, c);
          }
        }
      }
    sums.e[k] += e;
    sums.M_linear[k] += f;
    sums.M_angular[k] += n;
  }
  add_products<Sp::linear>(products, slopes, node.ne, each, sums.M);
}

/// Mass matrix and bias force of all slices (Eq. 80, 81), in a link that turns at w and does not accelerate.
template <class Sp, class S, class Series>
void sum_slices(const Node& node, const Rows<Sp>& rows, const Series& m, const S* dq, const typename Sp::Ang& w,
                const Sums<Sp>& sums, typename Sp::Scalar* products) {
  int from = first_station(node);
  for (; from + kTogether <= rows.stations; from += kTogether)
    sum_stations<kTogether>(node, rows, m, dq, w, from, sums, products);
  for (; from < rows.stations; ++from) sum_stations<1>(node, rows, m, dq, w, from, sums, products);
}

/// The sums, with the hub's part and the elastic forces, into the elastic body.
template <class Sp, class S>
void finish(const Node& node, const double* p, const Sums<Sp>& sums, const S* q, const S* dq, const typename Sp::Ang& w,
            typename Sp::Rigid& M, Force<Sp>& F, Elastic<Sp>& out) {
  const int ne = node.ne, pairs = ne * (ne + 1) / 2;
  const auto [m, c, J] = read<records::Body<Sp>>(p);  // m is all of it
  M = {m, c + sums.body->c, J};
  Sp::add(M.J, sums.body->J);
  F.force = sums.body->f + Sp::cross(w, Sp::cross(w, c));
  F.moment = sums.body->n + Sp::cross(w, Sp::apply(J, w));
  for (int k = 0; k < ne; ++k) {
    out.e[k] = sums.e[k];
    out.M_er[k].force = sums.M_linear[k];
    out.M_er[k].moment = sums.M_angular[k];
    if constexpr (Sp::planar) out.M_er[k].moment.z += next<S>(p);  // sections turn by an angle linear in q
  }
  for (int k = 0; k < pairs; ++k) {
    out.M[k] = sums.M[k];
    if constexpr (Sp::planar) out.M[k] += next<S>(p);
  }
  out.constants = p;
  add_elastic_forces(node, p, q, dq, out.e);
}

}  // namespace sampled
}  // namespace
