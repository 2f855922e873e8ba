// Motions, forces and inertias in space; those in the plane have the same names (algebra.hpp).
#pragma once

#include "space/algebra.hpp"
#include "wide/functions.hpp"

namespace {

template <class S>
struct Space {
  using Scalar = S;
  static constexpr bool planar = false;
  static constexpr int linear = 3, angular = 3;

  struct Lin {
    S x, y, z;
    friend Lin operator+(const Lin& a, const Lin& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
    friend Lin operator-(const Lin& a, const Lin& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
    friend Lin operator*(const S& k, const Lin& a) { return {k * a.x, k * a.y, k * a.z}; }
    Lin& operator+=(const Lin& b) { return *this = *this + b; }
  };
  using Ang = Lin;
  struct Rot {
    S xx, xy, xz, yx, yy, yz, zx, zy, zz;
  };
  struct Sym {
    S xx, yy, zz, xy, xz, yz;
  };
  struct Inertia {
    Sym A;
    Rot B;
    Sym D;
    friend Force<Space> operator*(const Inertia& M, const Motion<Space>& m) {
      return {apply(M.A, m.linear) + rotate(M.B, m.angular), unrotate(M.B, m.linear) + apply(M.D, m.angular)};
    }
  };

  static Lin zero() { return {S{}, S{}, S{}}; }
  static Ang zero_angular() { return zero(); }
  static Sym none() { return {S{}, S{}, S{}, S{}, S{}, S{}}; }
  static Lin read(const double*& p) {
    constexpr int w = Lanes<S>::width;
    Lin r{Lanes<S>::load(p), Lanes<S>::load(p + w), Lanes<S>::load(p + 2 * w)};
    p += 3 * w;
    return r;
  }
  static Lin cross(const Lin& a, const Lin& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  }
  static Ang moment(const Lin& r, const Lin& f) { return cross(r, f); }
  static S dot(const Lin& a, const Lin& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
  static Lin rotate(const Rot& R, const Lin& a) {
    return {R.xx * a.x + R.xy * a.y + R.xz * a.z, R.yx * a.x + R.yy * a.y + R.yz * a.z,
            R.zx * a.x + R.zy * a.y + R.zz * a.z};
  }
  static Lin unrotate(const Rot& R, const Lin& a) {
    return {R.xx * a.x + R.yx * a.y + R.zx * a.z, R.xy * a.x + R.yy * a.y + R.zy * a.z,
            R.xz * a.x + R.yz * a.y + R.zz * a.z};
  }
  static Ang rotate_angular(const Rot& R, const Ang& a) { return rotate(R, a); }
  static Ang unrotate_angular(const Rot& R, const Ang& a) { return unrotate(R, a); }
  static Lin apply(const Sym& J, const Lin& a) {
    return {J.xx * a.x + J.xy * a.y + J.xz * a.z, J.xy * a.x + J.yy * a.y + J.yz * a.z,
            J.xz * a.x + J.yz * a.y + J.zz * a.z};
  }
  /// R times a turn about one axis.
  static Rot turned(const Rot& R, int axis, const S& s, const S& c) {
    if (axis == 2)
      return {R.xx * c + R.xy * s, R.xy * c - R.xx * s, R.xz, R.yx * c + R.yy * s, R.yy * c - R.yx * s, R.yz,
              R.zx * c + R.zy * s, R.zy * c - R.zx * s, R.zz};
    if (axis == 1)
      return {R.xx * c - R.xz * s, R.xy, R.xz * c + R.xx * s, R.yx * c - R.yz * s, R.yy, R.yz * c + R.yx * s,
              R.zx * c - R.zz * s, R.zy, R.zz * c + R.zx * s};
    return {R.xx, R.xy * c + R.xz * s, R.xz * c - R.xy * s, R.yx, R.yy * c + R.yz * s, R.yz * c - R.yy * s,
            R.zx, R.zy * c + R.zz * s, R.zz * c - R.zy * s};
  }
  static Rot turn(int axis, const S& s, const S& c) {
    const S o{}, i = number<S>(1.0);
    if (axis == 2) return {c, -s, o, s, c, o, o, o, i};
    if (axis == 1) return {c, o, s, o, i, o, -s, o, c};
    return {i, o, o, o, c, -s, o, s, c};
  }
  /// The axes of a frame, in those in which it is turned by R.
  static Lin axis(const Rot& R, int i) {
    return i == 0 ? Lin{R.xx, R.yx, R.zx} : i == 1 ? Lin{R.xy, R.yy, R.zy} : Lin{R.xz, R.yz, R.zz};
  }
  static Ang angular_axis(const Rot& R, int i) { return axis(R, i); }
  static S& component(Lin& a, int axis) { return axis == 0 ? a.x : axis == 1 ? a.y : a.z; }
  static S component(const Lin& a, int axis) { return axis == 0 ? a.x : axis == 1 ? a.y : a.z; }
  static S& angular_component(Ang& a, int axis) { return component(a, axis); }
  static Lin unit(int axis) {
    Lin u = zero();
    component(u, axis) += 1.0;
    return u;
  }

  /// A rigid body: mass, first moment, second moment about the origin. As an inertia: A = m, B = -c~, D = J.
  struct Rigid {
    S m;
    Lin c;
    Sym J;
    friend Force<Space> operator*(const Rigid& b, const Motion<Space>& m) {
      return {b.m * m.linear + cross(m.angular, b.c), cross(b.c, m.linear) + apply(b.J, m.angular)};
    }
  };
  static void add(Inertia& M, const Rigid& b) {
    M.A.xx += b.m;
    M.A.yy += b.m;
    M.A.zz += b.m;
    M.B.xy += b.c.z;
    M.B.xz -= b.c.y;
    M.B.yx -= b.c.z;
    M.B.yz += b.c.x;
    M.B.zx += b.c.y;
    M.B.zy -= b.c.x;
    add(M.D, b.J);
  }
  static Rigid no_body() { return {S{}, zero(), none()}; }
  static void add(Rigid& a, const Rigid& b) {
    a.m += b.m;
    a.c += b.c;
    add(a.J, b.J);
  }
  static Force<Space> column(const Rigid& b, bool about, int axis) {
    const S o{};
    if (!about)
      return axis == 0   ? Force<Space>{{b.m, o, o}, {o, b.c.z, -b.c.y}}
             : axis == 1 ? Force<Space>{{o, b.m, o}, {-b.c.z, o, b.c.x}}
                         : Force<Space>{{o, o, b.m}, {b.c.y, -b.c.x, o}};
    return axis == 0   ? Force<Space>{{o, -b.c.z, b.c.y}, {b.J.xx, b.J.xy, b.J.xz}}
           : axis == 1 ? Force<Space>{{b.c.z, o, -b.c.x}, {b.J.xy, b.J.yy, b.J.yz}}
                       : Force<Space>{{-b.c.y, b.c.x, o}, {b.J.xz, b.J.yz, b.J.zz}};
  }
  static Rigid rotate(const Rot& R, const Rigid& b) { return {b.m, rotate(R, b.c), rotate(R, b.J)}; }
  static Rigid rotate(int axis, const S& s, const S& c, const Rigid& b) {
    return axis == 2   ? Rigid{b.m, {c * b.c.x - s * b.c.y, s * b.c.x + c * b.c.y, b.c.z}, rotate<2>(s, c, b.J)}
           : axis == 1 ? Rigid{b.m, {c * b.c.x + s * b.c.z, b.c.y, c * b.c.z - s * b.c.x}, rotate<1>(s, c, b.J)}
                       : Rigid{b.m, {b.c.x, c * b.c.y - s * b.c.z, s * b.c.y + c * b.c.z}, rotate<0>(s, c, b.J)};
  }
  /// Seen from the origin of a frame in which the body's own is at r.
  static Rigid shift(const Rigid& b, const Lin& r) {
    const Lin mr = b.m * r, d = b.c + number<S>(0.5) * mr;  // J + 2 r.d - r d^T - d r^T
    const S xx = 2.0 * r.x * d.x, yy = 2.0 * r.y * d.y, zz = 2.0 * r.z * d.z;
    return {b.m,
            b.c + mr,
            {b.J.xx + (yy + zz), b.J.yy + (xx + zz), b.J.zz + (xx + yy), b.J.xy - (r.x * d.y + r.y * d.x),
             b.J.xz - (r.x * d.z + r.z * d.x), b.J.yz - (r.y * d.z + r.z * d.y)}};
  }

  static Inertia no_inertia() {
    const S o{};
    return {none(), {o, o, o, o, o, o, o, o, o}, none()};
  }
  static Sym scaled(const S& k, const Sym& a) { return {k * a.xx, k * a.yy, k * a.zz, k * a.xy, k * a.xz, k * a.yz}; }
  static void add(Sym& a, const Sym& b) {
    a.xx += b.xx;
    a.yy += b.yy;
    a.zz += b.zz;
    a.xy += b.xy;
    a.xz += b.xz;
    a.yz += b.yz;
  }
  /// Column of a freedom along, or about, an axis.
  static Force<Space> column(const Inertia& M, bool about, int axis) {
    if (!about) return {apply(M.A, unit(axis)), unrotate(M.B, unit(axis))};
    return axis == 0   ? Force<Space>{{M.B.xx, M.B.yx, M.B.zx}, {M.D.xx, M.D.xy, M.D.xz}}
           : axis == 1 ? Force<Space>{{M.B.xy, M.B.yy, M.B.zy}, {M.D.xy, M.D.yy, M.D.yz}}
                       : Force<Space>{{M.B.xz, M.B.yz, M.B.zz}, {M.D.xz, M.D.yz, M.D.zz}};
  }
  /// Of the inertia against turning, or against moving along.
  static S trace(const Inertia& M, bool about) { return about ? M.D.xx + M.D.yy + M.D.zz : M.A.xx + M.A.yy + M.A.zz; }
  /// M -= k F F^T
  static void take(Inertia& M, const S& k, const Force<Space>& F) {
    const Lin &f = F.force, &n = F.moment, g = k * f, h = k * n;
    M.A.xx -= g.x * f.x;
    M.A.yy -= g.y * f.y;
    M.A.zz -= g.z * f.z;
    M.A.xy -= g.x * f.y;
    M.A.xz -= g.x * f.z;
    M.A.yz -= g.y * f.z;
    M.B.xx -= g.x * n.x;
    M.B.xy -= g.x * n.y;
    M.B.xz -= g.x * n.z;
    M.B.yx -= g.y * n.x;
    M.B.yy -= g.y * n.y;
    M.B.yz -= g.y * n.z;
    M.B.zx -= g.z * n.x;
    M.B.zy -= g.z * n.y;
    M.B.zz -= g.z * n.z;
    M.D.xx -= h.x * n.x;
    M.D.yy -= h.y * n.y;
    M.D.zz -= h.z * n.z;
    M.D.xy -= h.x * n.y;
    M.D.xz -= h.x * n.z;
    M.D.yz -= h.y * n.z;
  }
  /// Nothing along, or about, an axis.
  static void clear(Inertia& M, bool about, int axis) {
    const S o{};
    if (about) {
      (axis == 0 ? M.B.xx : axis == 1 ? M.B.xy : M.B.xz) = o;
      (axis == 0 ? M.B.yx : axis == 1 ? M.B.yy : M.B.yz) = o;
      (axis == 0 ? M.B.zx : axis == 1 ? M.B.zy : M.B.zz) = o;
      (axis == 0 ? M.D.xx : axis == 1 ? M.D.yy : M.D.zz) = o;
      (axis == 0 ? M.D.xy : axis == 1 ? M.D.xy : M.D.xz) = o;
      (axis == 0 ? M.D.xz : M.D.yz) = o;
    } else {
      (axis == 0 ? M.B.xx : axis == 1 ? M.B.yx : M.B.zx) = o;
      (axis == 0 ? M.B.xy : axis == 1 ? M.B.yy : M.B.zy) = o;
      (axis == 0 ? M.B.xz : axis == 1 ? M.B.yz : M.B.zz) = o;
      (axis == 0 ? M.A.xx : axis == 1 ? M.A.yy : M.A.zz) = o;
      (axis == 0 ? M.A.xy : axis == 1 ? M.A.xy : M.A.xz) = o;
      (axis == 0 ? M.A.xz : M.A.yz) = o;
    }
  }
  static Rot times(const Rot& a, const Rot& b) {
    return {a.xx * b.xx + a.xy * b.yx + a.xz * b.zx, a.xx * b.xy + a.xy * b.yy + a.xz * b.zy,
            a.xx * b.xz + a.xy * b.yz + a.xz * b.zz, a.yx * b.xx + a.yy * b.yx + a.yz * b.zx,
            a.yx * b.xy + a.yy * b.yy + a.yz * b.zy, a.yx * b.xz + a.yy * b.yz + a.yz * b.zz,
            a.zx * b.xx + a.zy * b.yx + a.zz * b.zx, a.zx * b.xy + a.zy * b.yy + a.zz * b.zy,
            a.zx * b.xz + a.zy * b.yz + a.zz * b.zz};
  }
  static Rot times_transposed(const Rot& a, const Rot& b) {
    return {a.xx * b.xx + a.xy * b.xy + a.xz * b.xz, a.xx * b.yx + a.xy * b.yy + a.xz * b.yz,
            a.xx * b.zx + a.xy * b.zy + a.xz * b.zz, a.yx * b.xx + a.yy * b.xy + a.yz * b.xz,
            a.yx * b.yx + a.yy * b.yy + a.yz * b.yz, a.yx * b.zx + a.yy * b.zy + a.yz * b.zz,
            a.zx * b.xx + a.zy * b.xy + a.zz * b.xz, a.zx * b.yx + a.zy * b.yy + a.zz * b.yz,
            a.zx * b.zx + a.zy * b.zy + a.zz * b.zz};
  }
  static Sym rotate(const Rot& R, const Sym& J) {
    const Rot full{J.xx, J.xy, J.xz, J.xy, J.yy, J.yz, J.xz, J.yz, J.zz}, h = times(R, full);
    return {h.xx * R.xx + h.xy * R.xy + h.xz * R.xz, h.yx * R.yx + h.yy * R.yy + h.yz * R.yz,
            h.zx * R.zx + h.zy * R.zy + h.zz * R.zz, h.xx * R.yx + h.xy * R.yy + h.xz * R.yz,
            h.xx * R.zx + h.xy * R.zy + h.xz * R.zz, h.yx * R.zx + h.yy * R.zy + h.yz * R.zz};
  }
  static Inertia rotate(const Rot& R, const Inertia& M) {
    return {rotate(R, M.A), times_transposed(times(R, M.B), R), rotate(R, M.D)};
  }
  /// The same for a turn about one axis.
  template <int axis>
  static Sym rotate(const S& s, const S& c, const Sym& J) {
    constexpr int i = (axis + 1) % 3, j = (axis + 2) % 3;
    constexpr int beside[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};  // where a Sym keeps its entries
    const S cc = c * c, ss = s * s, cs = c * s;
    Sym out = J;
    const S* x = &J.xx;
    S* y = &out.xx;
    const S ii = x[i], jj = x[j], ij = x[beside[i][j]], ki = x[beside[axis][i]], kj = x[beside[axis][j]];
    const S cross_term = 2.0 * cs * ij;
    y[i] = cc * ii - cross_term + ss * jj;
    y[j] = ss * ii + cross_term + cc * jj;
    y[beside[i][j]] = cs * (ii - jj) + (cc - ss) * ij;
    y[beside[axis][i]] = c * ki - s * kj;
    y[beside[axis][j]] = s * ki + c * kj;
    return out;
  }
  template <int axis>
  static Inertia rotate(const S& s, const S& c, const Inertia& M) {
    constexpr int i = (axis + 1) % 3, j = (axis + 2) % 3;
    Inertia out{rotate<axis>(s, c, M.A), M.B, rotate<axis>(s, c, M.D)};
    S* B = &out.B.xx;
    for (int k = 0; k < 3; ++k) {  // rows
      const S x = B[3 * i + k], y = B[3 * j + k];
      B[3 * i + k] = c * x - s * y;
      B[3 * j + k] = s * x + c * y;
    }
    for (int k = 0; k < 3; ++k) {  // columns
      const S x = B[3 * k + i], y = B[3 * k + j];
      B[3 * k + i] = c * x - s * y;
      B[3 * k + j] = s * x + c * y;
    }
    return out;
  }
  static Inertia rotate(int axis, const S& s, const S& c, const Inertia& M) {
    return axis == 2 ? rotate<2>(s, c, M) : axis == 1 ? rotate<1>(s, c, M) : rotate<0>(s, c, M);
  }
  /// Seen from the origin of a frame in which the inertia's own origin is at r: with X = [1 -r~; 0 1], X^T M X.
  static Inertia shift(const Inertia& M, const Lin& r) {
    // P = A r~ (columns: A e_i crossed), B' = B - P, D' = D + r~ B + (r~ B)^T - r~ P
    const Rot P{M.A.xy * r.z - M.A.xz * r.y, M.A.xz * r.x - M.A.xx * r.z, M.A.xx * r.y - M.A.xy * r.x,
                M.A.yy * r.z - M.A.yz * r.y, M.A.yz * r.x - M.A.xy * r.z, M.A.xy * r.y - M.A.yy * r.x,
                M.A.yz * r.z - M.A.zz * r.y, M.A.zz * r.x - M.A.xz * r.z, M.A.xz * r.y - M.A.yz * r.x};
    const Rot C{M.B.xx - P.xx, M.B.xy - P.xy, M.B.xz - P.xz, M.B.yx - P.yx, M.B.yy - P.yy,
                M.B.yz - P.yz, M.B.zx - P.zx, M.B.zy - P.zy, M.B.zz - P.zz};
    // r~ B and r~ C
    const auto tilde = [&](const Rot& X) -> Rot {
      return {r.y * X.zx - r.z * X.yx, r.y * X.zy - r.z * X.yy, r.y * X.zz - r.z * X.yz,
              r.z * X.xx - r.x * X.zx, r.z * X.xy - r.x * X.zy, r.z * X.xz - r.x * X.zz,
              r.x * X.yx - r.y * X.xx, r.x * X.yy - r.y * X.xy, r.x * X.yz - r.y * X.xz};
    };
    const Rot a = tilde(C), b = tilde(M.B);  // D' = D + r~ C + (r~ B)^T
    return {M.A,
            C,
            {M.D.xx + a.xx + b.xx, M.D.yy + a.yy + b.yy, M.D.zz + a.zz + b.zz, M.D.xy + a.xy + b.yx,
             M.D.xz + a.xz + b.zx, M.D.yz + a.yz + b.zy}};
  }
};

}  // namespace
