// Loads that follow from the pose and the velocity of their place: a function of the user's, whose slopes, for
// implicit steps and derivatives, are central differences.
#pragma once

#include "beam/loads.hpp"

namespace {

using flexarm::lanes::StateLaw;

/// The arguments of a law: place p (3) and axes R (9, by rows) in the world, velocity (6); and its directions: a
/// displacement and a small turn in the world's axes, and a change of the velocity.
constexpr int kAsked = 18, kDirectionsOfState = 12;

/// `in` moved a little along a direction.
inline void move_asked(const double* in, int direction, double by, double* out) {
  for (int i = 0; i < kAsked; ++i) out[i] = in[i];
  if (direction >= 6) {
    out[12 + direction - 6] += by;
  } else if (direction < 3) {
    out[direction] += by;
  } else {
    const int a = (direction - 2) % 3, b = (direction - 1) % 3;  // rows that turn into each other
    const double c = 1.0 - 0.5 * by * by;
    for (int k = 0; k < 3; ++k) {
      out[3 + 3 * a + k] = c * in[3 + 3 * a + k] - by * in[3 + 3 * b + k];
      out[3 + 3 * b + k] = c * in[3 + 3 * b + k] + by * in[3 + 3 * a + k];
    }
  }
}
/// A law's answer, in the world's axes: of a state that is lost, none.
inline void ask(const StateLaw& law, const double* in, double t, double* wrench) {
  double lost = 0.0;
  for (int i = 0; i < kAsked; ++i) lost += in[i] - in[i];
  if (lost != 0.0) {
    for (int i = 0; i < 6; ++i) wrench[i] = lost;
    return;
  }
  law.ask(law.law, t, in, wrench);
  if (law.world) return;
  for (double* w = wrench; w < wrench + 6; w += 3) {
    const double x = w[0], y = w[1], z = w[2], *R = in + 3;
    for (int i = 0; i < 3; ++i) w[i] = R[3 * i] * x + R[3 * i + 1] * y + R[3 * i + 2] * z;
  }
}
/// Its slopes by the directions: 6 rows of 12.
inline void ask_slopes(const StateLaw& law, const double* in, double t, double* slopes) {
  constexpr double kPose = 1e-6, kVelocity = 1e-5;  // m and rad, m/s and rad/s
  for (int d = 0; d < kDirectionsOfState; ++d) {
    const double h = d < 6 ? kPose : kVelocity;
    double moved[kAsked], ahead[6], behind[6];
    move_asked(in, d, h, moved);
    ask(law, moved, t, ahead);
    move_asked(in, d, -h, moved);
    ask(law, moved, t, behind);
    for (int i = 0; i < 6; ++i) slopes[i * kDirectionsOfState + d] = (ahead[i] - behind[i]) * (0.5 / h);
  }
}

/// A law's answers to numbers S: one by one of the lanes. (Dual numbers: slopes/tangent.hpp)
template <class S>
struct StateAnswers {
  static constexpr int W = Lanes<S>::width;

  /// f(asked, time, found) in each lane. @param in  the arguments of a law, and the time
  template <class F>
  static void each(const S* in, S* out, int count, const F& f) {
    const double* x = view<const double>(in);
    double* y = view<double>(out);
    for (int l = 0; l < W; ++l) {
      double one[kAsked + 1], found[6 * kDirectionsOfState];
      for (int i = 0; i <= kAsked; ++i) one[i] = x[i * W + l];
      f(one, one[kAsked], found);
      for (int i = 0; i < count; ++i) y[i * W + l] = found[i];
    }
  }
  static void values(const StateLaw& law, const S* in, S* out) {
    each(in, out, 6, [&](const double* x, double t, double* y) { ask(law, x, t, y); });
  }
  static void slopes(const StateLaw& law, const S* in, S* out) {
    each(in, out, 6 * kDirectionsOfState, [&](const double* x, double t, double* y) { ask_slopes(law, x, t, y); });
  }
};

/// Pose and velocity of a place as a law is asked with them. @param height  across the plane
template <class S>
void put_world(const Layout&, const Frame<Space<S>>& at, const Motion<Space<S>>& u, const S&, S* out) {
  const S all[kAsked] = {at.r.x,     at.r.y,     at.r.z,     at.R.xx,     at.R.xy,     at.R.xz,
                         at.R.yx,    at.R.yy,    at.R.yz,    at.R.zx,     at.R.zy,     at.R.zz,
                         u.linear.x, u.linear.y, u.linear.z, u.angular.x, u.angular.y, u.angular.z};
  for (int i = 0; i < kAsked; ++i) out[i] = all[i];
}
template <class S>
void put_world(const Layout& layout, const Frame<Plane<S>>& at, const Motion<Plane<S>>& u, const S& height, S* out) {
  const int x = layout.along[0], y = layout.along[1], z = layout.about;
  for (int i = 0; i < kAsked; ++i) out[i] = S{};
  out[x] = at.r.x;
  out[y] = at.r.y;
  out[z] = height;
  S* R = out + 3;
  R[3 * x + x] = R[3 * y + y] = at.R.c;
  R[3 * y + x] = at.R.s;
  R[3 * x + y] = -at.R.s;
  R[3 * z + z] = number<S>(1.0);
  out[12 + x] = u.linear.x;
  out[12 + y] = u.linear.y;
  out[15 + z] = layout.turning * u.angular.z;
}

}  // namespace
