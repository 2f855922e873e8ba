// Motions, forces and inertias in the plane; those in space have the same names (algebra.hpp).
#pragma once

#include "space/algebra.hpp"
#include "wide/functions.hpp"

namespace {

template <class S>
struct Plane {
  using Scalar = S;
  static constexpr bool planar = true;
  static constexpr int linear = 2, angular = 1;

  struct Lin {
    S x, y;
    friend Lin operator+(const Lin& a, const Lin& b) { return {a.x + b.x, a.y + b.y}; }
    friend Lin operator-(const Lin& a, const Lin& b) { return {a.x - b.x, a.y - b.y}; }
    friend Lin operator*(const S& k, const Lin& a) { return {k * a.x, k * a.y}; }
    Lin& operator+=(const Lin& b) { return *this = *this + b; }
  };
  struct Ang {
    S z;
    friend Ang operator+(const Ang& a, const Ang& b) { return {a.z + b.z}; }
    friend Ang operator-(const Ang& a, const Ang& b) { return {a.z - b.z}; }
    friend Ang operator*(const S& k, const Ang& a) { return {k * a.z}; }
    Ang& operator+=(const Ang& b) { return *this = *this + b; }
  };
  struct Rot {
    S c, s;
  };
  struct Sym {
    S zz;
  };
  struct Inertia {
    struct {
      S xx, yy, xy;
    } A;
    Lin B;
    Sym D;
    friend Force<Plane> operator*(const Inertia& M, const Motion<Plane>& m) {
      const Lin& a = m.linear;
      const S& w = m.angular.z;
      return {{M.A.xx * a.x + M.A.xy * a.y + M.B.x * w, M.A.xy * a.x + M.A.yy * a.y + M.B.y * w},
              {M.B.x * a.x + M.B.y * a.y + M.D.zz * w}};
    }
  };

  static Lin zero() { return {S{}, S{}}; }
  static Ang zero_angular() { return {S{}}; }
  static Lin read(const double*& p) {
    constexpr int w = Lanes<S>::width;
    Lin r{Lanes<S>::load(p), Lanes<S>::load(p + w)};
    p += 2 * w;
    return r;
  }
  static Lin cross(const Ang& w, const Lin& r) { return {-w.z * r.y, w.z * r.x}; }
  static Ang cross(const Ang&, const Ang&) { return {S{}}; }
  static Ang moment(const Lin& r, const Lin& f) { return {r.x * f.y - r.y * f.x}; }
  static S dot(const Lin& a, const Lin& b) { return a.x * b.x + a.y * b.y; }
  static S dot(const Ang& a, const Ang& b) { return a.z * b.z; }
  static Lin rotate(const Rot& R, const Lin& a) { return {R.c * a.x - R.s * a.y, R.s * a.x + R.c * a.y}; }
  static Lin unrotate(const Rot& R, const Lin& a) { return {R.c * a.x + R.s * a.y, R.c * a.y - R.s * a.x}; }
  static Ang rotate_angular(const Rot&, const Ang& a) { return a; }
  static Ang unrotate_angular(const Rot&, const Ang& a) { return a; }
  static Ang apply(const Sym& J, const Ang& a) { return {J.zz * a.z}; }
  static Rot turned(const Rot& R, int, const S& s, const S& c) { return {R.c * c - R.s * s, R.s * c + R.c * s}; }
  static Rot turn(int, const S& s, const S& c) { return {c, s}; }
  static Rot times(const Rot& a, const Rot& b) { return turned(a, 2, b.s, b.c); }
  static Lin axis(const Rot& R, int i) { return i == 0 ? Lin{R.c, R.s} : Lin{-R.s, R.c}; }
  static Ang angular_axis(const Rot&, int) { return {number<S>(1.0)}; }
  static S& component(Lin& a, int axis) { return axis == 0 ? a.x : a.y; }
  static S component(const Lin& a, int axis) { return axis == 0 ? a.x : a.y; }
  static S& angular_component(Ang& a, int) { return a.z; }

  static Inertia no_inertia() {
    const S o{};
    return {{o, o, o}, {o, o}, {o}};
  }
  struct Rigid {
    S m;
    Lin c;
    Sym J;
    friend Force<Plane> operator*(const Rigid& b, const Motion<Plane>& m) {
      return {b.m * m.linear + cross(m.angular, b.c), moment(b.c, m.linear) + apply(b.J, m.angular)};
    }
  };
  static void add(Inertia& M, const Rigid& b) {
    M.A.xx += b.m;
    M.A.yy += b.m;
    M.B.x -= b.c.y;
    M.B.y += b.c.x;
    M.D.zz += b.J.zz;
  }
  static Rigid no_body() { return {S{}, zero(), {S{}}}; }
  static void add(Rigid& a, const Rigid& b) {
    a.m += b.m;
    a.c += b.c;
    a.J.zz += b.J.zz;
  }
  static Force<Plane> column(const Rigid& b, bool about, int axis) {
    const S o{};
    if (about) return {{-b.c.y, b.c.x}, {b.J.zz}};
    return axis == 0 ? Force<Plane>{{b.m, o}, {-b.c.y}} : Force<Plane>{{o, b.m}, {b.c.x}};
  }
  static Rigid rotate(const Rot& R, const Rigid& b) { return {b.m, rotate(R, b.c), b.J}; }
  static Rigid rotate(int, const S& s, const S& c, const Rigid& b) { return rotate(Rot{c, s}, b); }
  static Rigid shift(const Rigid& b, const Lin& r) {
    const Lin mr = b.m * r;
    return {b.m, b.c + mr, {b.J.zz + dot(r, number<S>(2.0) * b.c + mr)}};
  }
  static Inertia rotate(int, const S& s, const S& c, const Inertia& M) { return rotate(Rot{c, s}, M); }
  static Sym scaled(const S& k, const Sym& a) { return {k * a.zz}; }
  static void add(Sym& a, const Sym& b) { a.zz += b.zz; }
  static Force<Plane> column(const Inertia& M, bool about, int axis) {
    if (about) return {M.B, {M.D.zz}};
    return axis == 0 ? Force<Plane>{{M.A.xx, M.A.xy}, {M.B.x}} : Force<Plane>{{M.A.xy, M.A.yy}, {M.B.y}};
  }
  static S trace(const Inertia& M, bool about) { return about ? M.D.zz : M.A.xx + M.A.yy; }
  static void take(Inertia& M, const S& k, const Force<Plane>& F) {
    const Lin& f = F.force;
    const Ang& n = F.moment;
    const S x = k * f.x, y = k * f.y;
    M.A.xx -= x * f.x;
    M.A.yy -= y * f.y;
    M.A.xy -= x * f.y;
    M.B.x -= x * n.z;
    M.B.y -= y * n.z;
    M.D.zz -= k * n.z * n.z;
  }
  static void clear(Inertia& M, bool about, int axis) {
    const S o{};
    if (about) {
      M.B = {o, o};
      M.D.zz = o;
    } else {
      (axis == 0 ? M.A.xx : M.A.yy) = M.A.xy = o;
      (axis == 0 ? M.B.x : M.B.y) = o;
    }
  }
  static Inertia rotate(const Rot& R, const Inertia& M) {
    const S cc = R.c * R.c, ss = R.s * R.s, cs = R.c * R.s, d = 2.0 * cs * M.A.xy;
    return {{cc * M.A.xx - d + ss * M.A.yy, ss * M.A.xx + d + cc * M.A.yy, cs * (M.A.xx - M.A.yy) + (cc - ss) * M.A.xy},
            rotate(R, M.B),
            M.D};
  }
  static Inertia shift(const Inertia& M, const Lin& r) {
    // a at r under an angular acceleration w: w (-r.y, r.x)
    const Lin C{M.B.x - M.A.xx * r.y + M.A.xy * r.x, M.B.y - M.A.xy * r.y + M.A.yy * r.x};
    return {M.A, C, {M.D.zz + (r.x * C.y - r.y * C.x) + (r.x * M.B.y - r.y * M.B.x)}};
  }
};

}  // namespace
