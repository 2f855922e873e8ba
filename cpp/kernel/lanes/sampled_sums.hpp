// The elastic body at order 3 and "exact": its rotation and position at Gauss points, by integrals along the beam, and
// sums over slices. Points lie across the lanes of one arm; or each lane holds an arm. sampled_plane.hpp and
// sampled_space.hpp make the motion of its slices; the sums here are the same for both.
#pragma once

#include "lanes/integral.hpp"

namespace {
namespace sampled {

constexpr int kMostColumns = 8;  // that an Integral takes at once

template <int C>
struct Count {
  static constexpr int value = C;
};

/// What a masked lane says: of an arm in each lane, its own; of one arm, what any of its lanes says.
template <class S, class P>
typename Lanes<P>::Mask of_arm(const typename Lanes<P>::Mask& mask) {
  if constexpr (sizeof(S) == sizeof(P))
    return mask;
  else
    return Lanes<P>::everywhere(Lanes<P>::any(mask));
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

/// Such a function with what an elastic motion does to it: its value, the convective part of its second rate, and its
/// derivative by each elastic coordinate.
template <class Sp>
struct Jet {
  Field<Sp> value, bias, first;
  Field<Sp> by(int k) const { return {first.at + k * Sp::linear * first.stride, first.stride}; }
};

/// One point's value, point i in lane i of the column.
template <class To, class Sp>
void put_lane(Sp, const Field<To>& f, int i, const typename Sp::Lin& x) {
  for (int c = 0; c < Sp::linear; ++c) reinterpret_cast<typename Sp::Scalar*>(f.column(c))[i] = Sp::component(x, c);
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

/// Of a node: P of points, and of all stations that carry mass; which of these do.
inline int points_of(const Node& node) { return 2 * node.passes; }
inline int stations_of(const Node& node) { return points_of(node) + node.further_passes; }
inline int first_station(const Node& node) { return node.points_have_mass ? 0 : points_of(node); }

/// The numbers of a node's points.
template <class Sp>
struct Rows {
  using P = typename Sp::Scalar;
  static constexpr int width = Lanes<P>::width;
  int points, stations;
  P length;
  typename Sp::Lin origin;  ///< of the beam, in the link
  const double *strain, *turn, *mass, *root, *gyro, *further;

  Rows(const Node& node, const double* p) : points(points_of(node)), stations(stations_of(node)) {
    length = next<P>(p);
    origin = Sp::read(p);
    const auto rows = [&](int count, int length_of) {
      const double* here = p;
      p += count * length_of * width;
      return here;
    };
    strain = rows(node.ne, points);
    turn = rows(Sp::planar ? 0 : node.ne, points);
    mass = rows(1, stations);
    root = rows(node.rotary ? 3 : 0, stations);
    gyro = rows(node.rotary ? 3 : 0, stations);
    further = p;
  }
  /// Of coordinate k: its strain at point i times the beam's length (in the plane, of bending: the turn it gives).
  P shape(int k, int i) const { return Lanes<P>::load(strain + (k * points + i) * width); }
  P turned(int k, int i) const { return Lanes<P>::load(turn + (k * points + i) * width); }
  /// The root of a station's mass; of its moments of inertia; and their differences over their roots.
  P root_mass(int i) const { return Lanes<P>::load(mass + i * width); }
  typename Sp::Lin of_axes(const double* p, int i) const {
    typename Sp::Lin x = Sp::zero();
    for (int c = 0; c < Sp::linear; ++c) Sp::component(x, c) = Lanes<P>::load(p + (c * stations + i) * width);
    return x;
  }
};

/// What is summed over the slices: of one body, and of each coordinate.
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

  Sums(T* at, int ne) : body(reinterpret_cast<Body*>(at)) {
    e = reinterpret_cast<T*>(body + 1);
    M_linear = reinterpret_cast<typename Sp::Lin*>(e + ne);
    M_angular = reinterpret_cast<typename Sp::Ang*>(M_linear + ne);
    M = reinterpret_cast<T*>(M_angular + ne);
  }
};

/// Adds F^T F (lower triangle) of n columns, so far apart, of so many rows.
template <class P>
void add_products(const P* F, int n, int apart, int rows, P* out) {
  const auto some = [&](auto count, const P* a, const P* b) {
    constexpr int C = decltype(count)::value;
    P sum[C] = {};
    for (int r = 0; r < rows; ++r)
#pragma GCC unroll 4
      for (int c = 0; c < C; ++c) sum[c] += a[r] * b[c * apart + r];
    for (int c = 0; c < C; ++c) *out++ += sum[c];
  };
  for (int i = 0; i < n; ++i) {
    const P* a = F + i * apart;
    int j = 0;
    for (; j + 4 <= i + 1; j += 4) some(Count<4>{}, a, F + j * apart);
    if (i + 1 - j == 3) some(Count<3>{}, a, F + j * apart);
    if (i + 1 - j == 2) some(Count<2>{}, a, F + j * apart);
    if (i + 1 - j == 1) some(Count<1>{}, a, F + j * apart);
  }
}

/// A slice as the sums need it, times the root of its mass or inertia.
template <class Sp>
struct Station {
  typename Sp::Scalar root_mass;
  typename Sp::Lin x, a;    ///< place; acceleration by velocities
  typename Sp::Rot B;       ///< in space: R diag(root)
  typename Sp::Lin torque;  ///< and what it takes to turn it so
};

constexpr int kTogether = 4;  // stations whose rows are multiplied together

/// Of so many stations' rows, all coordinates.
template <class Sp>
int rows_size(int ne) {
  return ne * kTogether * 2 * Sp::linear;
}

/// A section's own inertia: what turns it, in its own axes.
template <class P, class Motion>
void add_turning(const Rows<Space<P>>& rows, const Motion& m, const typename Space<P>::Lin& w,
                 const typename Space<P>::Lin& spin, int i, Station<Space<P>>& s, typename Sums<Space<P>>::Body& body) {
  using Sp = Space<P>;
  const auto root = rows.of_axes(rows.root, i), gyro = rows.of_axes(rows.gyro, i);
  const auto x = m.R[0](i), y = m.R[1](i), z = m.R[2](i);
  const typename Sp::Rot R{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z};
  const auto carried = Sp::unrotate(R, w), own = Sp::unrotate(R, spin), W = carried + own;
  const auto W_dot = Sp::cross(carried, own) + Sp::unrotate(R, m.turned.bias(i));  // Eq. 46
  s.torque = {root.x * W_dot.x + gyro.x * (W.y * W.z), root.y * W_dot.y + gyro.y * (W.z * W.x),
              root.z * W_dot.z + gyro.z * (W.x * W.y)};
  s.B = {R.xx * root.x, R.xy * root.y, R.xz * root.z, R.yx * root.x, R.yy * root.y,
         R.yz * root.z, R.zx * root.x, R.zy * root.y, R.zz * root.z};
  const typename Sp::Rot J = Sp::times_transposed(s.B, s.B);
  Sp::add(body.J, typename Sp::Sym{J.xx, J.yy, J.zz, J.xy, J.xz, J.yz});
  body.n += Sp::rotate(s.B, s.torque);
}

template <class P>
void add_second_moment(const typename Space<P>::Lin& x, typename Space<P>::Sym& J) {
  const P xx = x.x * x.x, yy = x.y * x.y, zz = x.z * x.z;
  J.xx += yy + zz;
  J.yy += xx + zz;
  J.zz += xx + yy;
  J.xy -= x.x * x.y;
  J.xz -= x.x * x.z;
  J.yz -= x.y * x.z;
}
template <class P>
void add_second_moment(const typename Plane<P>::Lin& x, typename Plane<P>::Sym& J) {
  J.zz += x.x * x.x + x.y * x.y;
}

/// Mass matrix and bias force of all slices (Eq. 80, 81), in a link that turns at w and does not accelerate.
template <class Sp, class S, class Motion>
void sum_slices(const Node& node, const Rows<Sp>& rows, const Motion& m, const S* dq, const typename Sp::Ang& w,
                Sums<Sp>& sums, typename Sp::Scalar* F) {
  using P = typename Sp::Scalar;
  using Lin = typename Sp::Lin;
  using Ang = typename Sp::Ang;
  const bool turning = !Sp::planar && node.rotary;
  const int ne = node.ne, each = turning ? 2 * Sp::linear : Sp::linear, apart = kTogether * each;
  for (int from = first_station(node); from < rows.stations; from += kTogether) {
    const int count = rows.stations - from < kTogether ? rows.stations - from : kTogether;
    Station<Sp> station[kTogether];
    for (int a = 0; a < count; ++a) {
      const int i = from + a;
      Station<Sp>& s = station[a];
      Lin u_dot = Sp::zero();
      for (int k = 0; k < ne; ++k) u_dot += widen(dq[k], P{}) * m.place.by(k)(i);
      const Lin x = m.place.value(i);
      s.root_mass = rows.root_mass(i);
      s.x = s.root_mass * x;
      s.a = s.root_mass * (Sp::cross(w, Sp::cross(w, x) + number<P>(2.0) * u_dot) + m.place.bias(i));  // Eq. 45
      sums.body->c += s.root_mass * s.x;
      sums.body->f += s.root_mass * s.a;
      sums.body->n += Sp::moment(s.x, s.a);
      add_second_moment<P>(s.x, sums.body->J);
      if constexpr (!Sp::planar)
        if (turning) {
          Lin spin = Sp::zero();
          for (int k = 0; k < node.turning; ++k) spin += widen(dq[k], P{}) * m.turned.by(k)(i);
          add_turning<P>(rows, m, w, spin, i, s, *sums.body);
        }
    }
    for (int k = 0; k < ne; ++k) {
      P* row = F + k * apart;
      P e{};
      Lin f = Sp::zero();
      Ang n = Sp::zero_angular();
      for (int a = 0; a < count; ++a) {
        const Station<Sp>& s = station[a];
        const Lin J = s.root_mass * m.place.by(k)(from + a);
        e += Sp::dot(J, s.a);
        f += s.root_mass * J;
        n += Sp::moment(s.x, J);
        for (int c = 0; c < Sp::linear; ++c) *row++ = Sp::component(J, c);
        if constexpr (!Sp::planar)
          if (turning) {
            const Lin J_turn = Sp::unrotate(s.B, m.turned.by(k)(from + a));
            e += Sp::dot(J_turn, s.torque);
            n += Sp::rotate(s.B, J_turn);
            for (int c = 0; c < Sp::linear; ++c) *row++ = Sp::component(J_turn, c);
          }
      }
      sums.e[k] += e;
      sums.M_linear[k] += f;
      sums.M_angular[k] += n;
    }
    add_products(F, ne, apart, count * each, sums.M);
  }
}

/// The sums, with the hub's part and the elastic forces, into what the dynamics asks for.
template <class Sp, class S>
void finish(const Node& node, const double* p, const Sums<Sp>& sums, const S* q, const S* dq, const typename Sp::Ang& w,
            typename Sp::Rigid& M, typename Sp::Lin& f, typename Sp::Ang& n, Elastic<Sp>& out) {
  const int ne = node.ne, pairs = ne * (ne + 1) / 2;
  const S m = next<S>(p);  // all of it
  const typename Sp::Lin c = Sp::read(p);
  const typename Sp::Sym J = Sp::read_symmetric(p);
  M = {m, c + sums.body->c, J};
  Sp::add(M.J, sums.body->J);
  f = sums.body->f + Sp::cross(w, Sp::cross(w, c));
  n = sums.body->n + Sp::cross(w, Sp::apply(J, w));
  for (int k = 0; k < ne; ++k) {
    out.e[k] = sums.e[k];
    out.M_linear[k] = sums.M_linear[k];
    out.M_angular[k] = sums.M_angular[k];
    if constexpr (Sp::planar) out.M_angular[k].z += next<S>(p);  // sections turn by what is linear in q
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
