#include "flexarm/series.hpp"

#include <limits>
#include <type_traits>

#include "flexarm/dual.hpp"
#include "strain_physics.hpp"

namespace flexarm {

namespace {

/// out += factor a b (product rule in every column)
template <class S>
void add_product(const Jet<S>& a, const Jet<S>& b, double factor, Jet<S>& out) {
  for (Eigen::Index j = 0; j < out.rows(); ++j) {
    const S fa = factor * a(j, value_column), fb = factor * b(j, value_column);
    out(j, value_column) += fa * b(j, value_column);
    out(j, rate_column) += fa * b(j, rate_column) + fb * a(j, rate_column);
    out(j, bias_column) +=
        fa * b(j, bias_column) + fb * a(j, bias_column) + (2.0 * factor) * (a(j, rate_column) * b(j, rate_column));
    for (Eigen::Index k = first_derivative_column; k < out.cols(); ++k) out(j, k) += fa * b(j, k) + fb * a(j, k);
  }
}

/// out += factor a x b
template <class S>
void add_cross(const JetVector<S>& a, const JetVector<S>& b, double factor, JetVector<S>& out) {
  for (std::size_t c = 0; c < 3; ++c) {
    const std::size_t d = (c + 1) % 3, e = (c + 2) % 3;
    add_product(a[d], b[e], factor, out[c]);
    add_product(a[e], b[d], -factor, out[c]);
  }
}

template <class S>
void set_zero(JetVector<S>& v) {
  for (auto& c : v) c.setZero();
}

/// to = A from, column by column.
template <class S>
void sum_up(const Eigen::MatrixXd& A, const S* from, S* to) {
  const Eigen::Index n = A.rows();
  for (Eigen::Index i = 0; i < n; ++i) to[i] = S(0);
  for (Eigen::Index j = 0; j < n; ++j) {
    const double* column = A.data() + j * n;
    const S f = from[j];
    for (Eigen::Index i = 0; i < n; ++i) to[i] += column[i] * f;
  }
}

/// out = integral from 0 to X_i of f
template <class S>
void integrate(const Eigen::MatrixXd& cumulative, const Jet<S>& f, Jet<S>& out) {
  for (Eigen::Index k = 0; k < f.cols(); ++k) sum_up(cumulative, f.col(k).data(), out.col(k).data());
}
template <class S>
void integrate(const Eigen::MatrixXd& cumulative, const JetVector<S>& f, JetVector<S>& out) {
  for (std::size_t c = 0; c < 3; ++c) integrate(cumulative, f[c], out[c]);
}

/// Strains are linear in q: value B q, rate B dq, derivatives B.
template <class S>
void set_strains(const SeriesTables& tables, const S* q, const S* dq, Series<S>& s) {
  for (const StrainField& f : kStrainFields) {
    Jet<S>& out =
        f.is_curvature() ? s.K[static_cast<std::size_t>(f.rotation)] : s.phi[static_cast<std::size_t>(f.position)];
    const Eigen::Index row = f.strain;
    for (Eigen::Index j = 0; j < out.rows(); ++j) {
      const auto& B = tables.strains[j];
      S value(0), rate(0);
      for (Eigen::Index k = 0; k < B.cols(); ++k) {
        value += B(row, k) * q[k];
        rate += B(row, k) * dq[k];
        out(j, first_derivative_column + k) = S(B(row, k));
      }
      out(j, value_column) = value;
      out(j, rate_column) = rate;
    }
  }
}

/// x' = [f, g] of slope b and shear p, and its slopes.
template <class S>
struct PlanarTangent {
  S f, g, f_b, g_b, f_p, g_p, f_bb, g_bb, f_bp, g_bp;

  PlanarTangent(int order, const S& b, const S& p) {
    if (order == kExact) {
      using std::cos;
      using std::sin;
      const S c = cos(b), s = sin(b);
      f = c - p * s;
      g = s + p * c;
      f_p = -s;
      g_p = c;
      f_b = -g;
      g_b = f;
      f_bb = -f;
      g_bb = -g;
      f_bp = -c;
      g_bp = -s;
      return;
    }
    const S half = 1.0 - 0.5 * (b * b);  // to third order in all (Eq. 24-27)
    f = half - p * b;
    g = b * (1.0 - (b * b) / 6.0) + p * half;
    f_p = -b;
    g_p = half;
    f_b = -b - p;
    g_b = f;
    f_bb = S(-1.0);
    g_bb = f_b;
    f_bp = S(-1.0);
    g_bp = -b;
  }
};

template <class S>
void series_planar(const SeriesTables& tables, const S* q, const S* dq, Series<S>& s) {
  const Eigen::Index n = tables.slope.rows(), ne = tables.slope.cols(), up = first_derivative_column + ne;
  for (Eigen::Index j = 0; j < n; ++j) {
    S b(0), p(0), b_dot(0), p_dot(0);
    for (Eigen::Index k = 0; k < ne; ++k) {
      b += tables.slope(j, k) * q[k];
      p += tables.shear(j, k) * q[k];
      b_dot += tables.slope(j, k) * dq[k];
      p_dot += tables.shear(j, k) * dq[k];
    }
    const PlanarTangent<S> t(tables.order, b, p);
    s.plane(j, value_column) = t.f;
    s.plane(j, up + value_column) = t.g;
    s.plane(j, rate_column) = t.f_b * b_dot + t.f_p * p_dot;
    s.plane(j, up + rate_column) = t.g_b * b_dot + t.g_p * p_dot;
    s.plane(j, bias_column) = (t.f_bb * b_dot + 2.0 * (t.f_bp * p_dot)) * b_dot;
    s.plane(j, up + bias_column) = (t.g_bb * b_dot + 2.0 * (t.g_bp * p_dot)) * b_dot;
    for (Eigen::Index k = 0; k < ne; ++k) {
      s.plane(j, first_derivative_column + k) = t.f_b * tables.slope(j, k) + t.f_p * tables.shear(j, k);
      s.plane(j, up + first_derivative_column + k) = t.g_b * tables.slope(j, k) + t.g_p * tables.shear(j, k);
    }
  }
}

template <class S>
void series_order_3(const SeriesTables& tables, const S* q, const S* dq, Series<S>& s) {
  set_strains(tables, q, dq, s);
  const Eigen::MatrixXd& A = tables.cumulative;
  // A row r of R obeys r' = r x K; so R_1, R_2 row by row, and of R_3 the part that meets e1 (Eq. 27).
  for (std::size_t m = 0; m < 3; ++m) {
    JetVector<S>&unit = s.scratch[0], &slope = s.scratch[1], &r1 = s.scratch[2], &r2 = s.scratch[3], &r3 = s.scratch[4];
    set_zero(unit);
    unit[m].col(value_column).setConstant(S(1));
    set_zero(slope);
    add_cross(unit, s.K, 1.0, slope);
    integrate(A, slope, r1);
    set_zero(slope);
    add_cross(r1, s.K, 1.0, slope);
    integrate(A, slope, r2);
    set_zero(slope);
    add_cross(r2, s.K, 1.0, slope);
    integrate(A, slope[0], r3[0]);
    // x' = R [1, phi12, phi13]^T, to third order in all (Eq. 22-24)
    Jet<S>& x = s.x[m];
    x = unit[0] + r1[0] + r2[0] + r3[0];
    for (const StrainField& f : kStrainFields) {
      if (f.is_curvature()) continue;
      const std::size_t c = static_cast<std::size_t>(f.position);
      add_product(unit[c], s.phi[c], 1.0, x);
      add_product(r1[c], s.phi[c], 1.0, x);
      add_product(r2[c], s.phi[c], 1.0, x);
    }
  }
  // theta' = K + theta_1 x K / 2 + theta_2 x K / 2 + theta_1 x (theta_1 x K) / 12
  JetVector<S>&theta_1 = s.scratch[0], &theta_2 = s.scratch[1], &twist = s.scratch[2];
  integrate(A, s.K, theta_1);
  set_zero(twist);
  add_cross(theta_1, s.K, 1.0, twist);
  for (std::size_t c = 0; c < 3; ++c) s.turn[c] = 0.5 * twist[c];
  integrate(A, s.turn, theta_2);
  for (std::size_t c = 0; c < 3; ++c) s.turn[c] += s.K[c];
  add_cross(theta_2, s.K, 0.5, s.turn);
  add_cross(theta_1, twist, 1.0 / 12.0, s.turn);
}

template <class S>
void series_exact(const SeriesTables& tables, const S* q, const S* dq, Series<S>& s) {
  set_strains(tables, q, dq, s);
  const Eigen::MatrixXd& A = tables.cumulative;
  const Eigen::Index n = A.rows();
  const auto at = [](const JetVector<S>& f, Eigen::Index j, Eigen::Index column) {
    return Vec3<S>(f[0](j, column), f[1](j, column), f[2](j, column));
  };
  const auto put = [](const Vec3<S>& v, Eigen::Index j, Eigen::Index column, JetVector<S>& f) {
    for (std::size_t c = 0; c < 3; ++c) f[c](j, column) = v[c];
  };

  // R as a unit quaternion, p' = p (0, K) / 2: its series of repeated integrals converges like (|theta|/2)^i / i!
  // Terms of both signs grow as large as exp(|theta|/2) on the way, and leave no digit beyond some 60 rad.
  MatX<S>&P = s.scratch[3][0], &T = s.scratch[3][1], &D = s.spin;  // columns w x y z of sum, term, slope
  const auto slope = [&](const MatX<S>& Q) {
    for (Eigen::Index j = 0; j < n; ++j) {
      const Vec3<S> v(Q(j, 1), Q(j, 2), Q(j, 3)), K = 0.5 * at(s.K, j, value_column);
      const Vec3<S> rate = Q(j, 0) * K + v.cross(K);
      D(j, 0) = -v.dot(K);
      for (Eigen::Index c = 0; c < 3; ++c) D(j, 1 + c) = rate[c];
    }
  };
  T.setZero();
  T.col(0).setConstant(S(1));
  P = T;
  int still = 0;
  constexpr double kLost = 1e12;                             // a term of which the sum, of size 1, keeps four digits
  constexpr int kStill = std::is_same_v<S, double> ? 1 : 3;  // derivatives converge a little later
  for (int i = 1; i < 400 && still < kStill; ++i) {
    slope(T);
    bool small = true, lost = false;
    for (Eigen::Index c = 0; c < 4; ++c) {
      sum_up(A, D.col(c).data(), T.col(c).data());
      for (Eigen::Index j = 0; j < n; ++j) {
        P(j, c) += T(j, c);
        small = small && T(j, c) < 1e-17 && -T(j, c) < 1e-17;
        lost = lost || !(T(j, c) < kLost && -T(j, c) < kLost);
      }
    }
    if (lost) {
      P.setConstant(S(std::numeric_limits<double>::quiet_NaN()));
      break;
    }
    still = small ? still + 1 : 0;
  }
  slope(P);  // what a slice at any X sums

  JetVector<S>& Omega = s.turned;
  for (Eigen::Index j = 0; j < n; ++j) {
    const Mat3<S>& R = s.R[j] = rotation_of(P(j, 0), Vec3<S>(P(j, 1), P(j, 2), P(j, 3)));
    // Omega' = R dK, and J_R' = R dK/dq
    put(R * at(s.K, j, rate_column), j, rate_column, s.turn);
    for (Eigen::Index k = first_derivative_column; k < s.K[0].cols(); ++k) put(R * at(s.K, j, k), j, k, s.turn);
  }
  for (std::size_t c = 0; c < 3; ++c)
    for (Eigen::Index k = rate_column; k < s.turn[c].cols(); ++k)
      if (k != bias_column) sum_up(A, s.turn[c].col(k).data(), Omega[c].col(k).data());
  for (Eigen::Index j = 0; j < n; ++j)  // the convective part: (dR/dt) dK = Omega x R dK
    put(at(Omega, j, rate_column).cross(at(s.turn, j, rate_column)), j, bias_column, s.turn);
  for (std::size_t c = 0; c < 3; ++c) sum_up(A, s.turn[c].col(bias_column).data(), Omega[c].col(bias_column).data());
  // x' = R e, e = [1, phi12, phi13]^T
  for (Eigen::Index j = 0; j < n; ++j) {
    const Mat3<S>& R = s.R[j];
    Vec3<S> e = at(s.phi, j, value_column);
    e[0] += S(1);
    const Vec3<S> t = R * e, t_strain = R * at(s.phi, j, rate_column), w = at(Omega, j, rate_column);
    const Vec3<S> swing = w.cross(t);
    put(t, j, value_column, s.x);
    put(swing + t_strain, j, rate_column, s.x);
    put(at(Omega, j, bias_column).cross(t) + w.cross(Vec3<S>(swing + 2.0 * t_strain)), j, bias_column, s.x);
    for (Eigen::Index k = first_derivative_column; k < s.x[0].cols(); ++k)
      put(at(Omega, j, k).cross(t) + R * at(s.phi, j, k), j, k, s.x);
  }
  integrate(A, s.x, s.place);
}

}  // namespace

SeriesTables::SeriesTables(int order_, Plane plane_, const std::vector<SliceTable>& at)
    : order(order_), points(static_cast<int>(at.size())), plane(plane_) {
  const Eigen::Index n = static_cast<Eigen::Index>(at.size()), ne = at.front().linear.cols();
  if (plane == Plane::none) {
    cumulative.resize(n, n);
    for (Eigen::Index g = 0; g < n; ++g) cumulative.row(g) = at[static_cast<std::size_t>(g)].weights;
    for (const SliceTable& slice : at) strains.push_back(slice.strains);
    return;
  }
  slope.resize(n, ne);
  shear.resize(n, ne);
  const StrainField& bending = kStrainFields[strains_in(plane).bending];
  for (Eigen::Index g = 0; g < n; ++g) {
    const SliceTable& slice = at[static_cast<std::size_t>(g)];
    slope.row(g) = bending.sign * slice.linear.row(3 + bending.rotation);
    shear.row(g) = slice.strains.row(kStrainFields[strains_in(plane).shear].strain);
  }
}

template <class S>
void fill_series(const SeriesTables& tables, const S* q, const S* dq, Series<S>& s) {
  if (tables.plane != Plane::none)
    series_planar(tables, q, dq, s);
  else if (tables.order == 3)
    series_order_3(tables, q, dq, s);
  else
    series_exact(tables, q, dq, s);
}
template void fill_series<double>(const SeriesTables&, const double*, const double*, Series<double>&);
template void fill_series<Tangent>(const SeriesTables&, const Tangent*, const Tangent*, Series<Tangent>&);

}  // namespace flexarm
