#include <doctest/doctest.h>

#include "flexarm/dual.hpp"
#include "flexarm/spatial.hpp"

using namespace flexarm;

TEST_CASE("Phi takes velocities outward and forces inward with the same power (Eq. 68)") {
  Phi<double> phi;
  const Vec3<double> t(0.3, -0.5, 0.7);
  phi.R = rotation(t, RotationCoefficients<double>(t.squaredNorm()));
  phi.r = {0.2, 0.1, -0.4};
  Vec6<double> V, F;
  V << 1, 2, 3, 4, 5, 6;
  F << -1, 0.5, 2, 3, -2, 1;
  CHECK(F.dot(phi.outward(V)) == doctest::Approx(phi.inward(F).dot(V)).epsilon(1e-14));

  Mat6<double> matrix = Mat6<double>::Zero();
  matrix.topLeftCorner<3, 3>() = phi.R.transpose();
  matrix.topRightCorner<3, 3>() = -phi.R.transpose() * tilde(phi.r);
  matrix.bottomRightCorner<3, 3>() = phi.R.transpose();
  CHECK((phi.outward(V) - matrix * V).norm() < 1e-14);
  const Mat6<double> M = F * F.transpose() + Mat6<double>::Identity();
  CHECK((phi.inward_inertia(M) - matrix.transpose() * M * matrix).norm() < 1e-13);
}

TEST_CASE("rotation coefficients are smooth through the series' end and right at its start") {
  for (double s : {0.0, 1e-12, 0.3, 1.0 - 1e-12, 1.0 + 1e-12, 4.0, 30.0}) {
    const RotationCoefficients<double> k(s);
    const long double t = std::sqrt(static_cast<long double>(s));
    if (s > 0.1) {
      CHECK(k.a == doctest::Approx(static_cast<double>(std::sin(t) / t)).epsilon(1e-15));
      CHECK(k.b == doctest::Approx(static_cast<double>((1 - std::cos(t)) / (t * t))).epsilon(1e-14));
      CHECK(k.c == doctest::Approx(static_cast<double>((t - std::sin(t)) / (t * t * t))).epsilon(1e-14));
    } else {
      CHECK(k.a == doctest::Approx(1.0 - s / 6));
      CHECK(k.b == doctest::Approx(0.5 - s / 24));
      CHECK(k.c == doctest::Approx(1.0 / 6 - s / 120));
    }
    Dual<1> x(s);
    x.d[0] = 1.0;
    const RotationCoefficients<Dual<1>> d(x);  // db/ds and dc/ds are the derivatives of b and c
    CHECK(k.db == doctest::Approx(d.b.d[0]).epsilon(1e-11));
    CHECK(k.dc == doctest::Approx(d.c.d[0]).epsilon(1e-11));
  }
}

TEST_CASE("rotations are rotations") {
  for (double size : {1e-9, 0.2, 1.1, 3.0}) {
    const Vec3<double> t = size * Vec3<double>(0.48, -0.6, 0.64);
    const Mat3<double> R = rotation(t, RotationCoefficients<double>(t.squaredNorm()));
    CHECK((R * R.transpose() - Mat3<double>::Identity()).norm() < 1e-15 * 10);
    CHECK((R * t - t).norm() < 1e-14);
    CHECK(R.determinant() == doctest::Approx(1.0));
  }
}

TEST_CASE("dual numbers carry exact derivatives") {
  Dual<2> x(0.7), y(-1.3);
  x.d[0] = 1.0;
  y.d[1] = 1.0;
  const Dual<2> f = sin(x * y) / (2.0 + cos(y)) - sqrt(x) * 3.0 + (1.0 - y) * x;
  const double c = std::cos(0.7 * -1.3), s = std::sin(0.7 * -1.3), d = 2.0 + std::cos(-1.3);
  CHECK(f.value == doctest::Approx(s / d - std::sqrt(0.7) * 3 + 2.3 * 0.7));
  CHECK(f.d[0] == doctest::Approx(-1.3 * c / d - 1.5 / std::sqrt(0.7) + 2.3));
  CHECK(f.d[1] == doctest::Approx(0.7 * c / d + s * std::sin(-1.3) / (d * d) - 0.7));
}
