// The terms of a ball in the equations of a step, in small changes: the coordinates of its quaternion are no integrals
// of its rates.
#pragma once

#include "places.hpp"
#include "space/ball.hpp"
#include "turning.hpp"

namespace flexarm {
namespace taped {

/// Derivatives of a ball's turn at a place of a step, by the state at the step's beginning and by the accelerations of
/// its stages, less those of an integral of rates (Stages).
struct Turn {
  Index rate;  ///< the ball's first
  Eigen::Matrix3d by_q, by_v, by_a0, by_alpha0;
  std::vector<Eigen::Matrix3d> by_a;

  /// Adds to q (nv rows) the part by the beginning.
  void add_beginning(const MatrixXd& q0, const MatrixXd& v0, const MatrixXd& a0, const MatrixXd& alpha0,
                     MatrixXd& q) const {
    const auto mine = [this](const MatrixXd& x) { return x.middleRows<3>(rate); };
    q.middleRows<3>(rate) += by_q * mine(q0) + by_v * mine(v0) + by_a0 * mine(a0) + by_alpha0 * mine(alpha0);
  }
  /// And the accelerations (stages times nv rows).
  void add_stages(const MatrixXd& a, Index n, MatrixXd& q) const {
    for (std::size_t j = 0; j < by_a.size(); ++j)
      q.middleRows<3>(rate) += by_a[j] * a.middleRows<3>(static_cast<Index>(j) * n + rate);
  }
  /// The same backwards: of a number's derivatives by q there.
  void give_beginning(const VectorXd& q, VectorXd& q0, VectorXd& v0, VectorXd& a0, VectorXd& alpha0) const {
    const Eigen::Vector3d mine = q.segment<3>(rate);
    q0.segment<3>(rate) += by_q.transpose() * mine;
    v0.segment<3>(rate) += by_v.transpose() * mine;
    a0.segment<3>(rate) += by_a0.transpose() * mine;
    alpha0.segment<3>(rate) += by_alpha0.transpose() * mine;
  }
  void give_stages(const VectorXd& q, Index n, MatrixXd& a) const {
    for (std::size_t j = 0; j < by_a.size(); ++j)
      a.middleRows<3>(static_cast<Index>(j) * n + rate) += by_a[j].transpose() * q.segment<3>(rate);
  }
};

/// The balls of an arm, in the steps of a tape.
class Turns {
 public:
  Turns(const Arm& arm, const Tape& tape) : tape_(tape), of_(tape.stages), n_(arm.nv()), nq_(arm.nq()) {
    for (std::size_t k = 0; k < arm.size(); ++k) {
      const Joint& joint = arm.link(k).joint();
      const auto before = static_cast<Index>(joint.motions().size());
      if (joint.has_ball()) balls_.push_back({arm.first_q(k) + before, arm.first(k) + before});
    }
    const Index s = of_.count();
    A_ = of_.v_by_a.topRows(s);
    b_ = of_.v_by_a.row(s).transpose();
  }
  /// Goes to a step.
  void go_to(Index entry) {
    if (balls_.empty()) return;
    entry_ = &tape_.entries[static_cast<std::size_t>(entry)];
    const auto s = static_cast<std::size_t>(of_.count());
    at_.assign(s + 1, {});
    for (const Ball& ball : balls_) {
      if (of_.remembers) {
        at_[s].push_back(exponential(ball, entry));
        at_[0].push_back(at_[s].back());
      } else if (of_.in_turn) {
        in_turn(ball);
      } else {
        for (std::size_t i = 0; i <= s; ++i)
          at_[i].push_back(collocated(ball, of_.c[static_cast<Index>(i)], of_.v_by_a.row(static_cast<Index>(i)),
                                      of_.q_by_a.row(static_cast<Index>(i))));
      }
    }
  }
  /// At stage i of the step, or its end.
  const std::vector<Turn>& at(int i) const { return balls_.empty() ? none_ : at_[static_cast<std::size_t>(i)]; }
  /// At a row within the step.
  std::vector<Turn> at(const Tape::Row& row) const {
    std::vector<Turn> out;
    for (const Ball& ball : balls_)
      out.push_back(collocated(ball, row.c, row.v_by_a.transpose(), row.q_by_a.transpose()));
    return out;
  }

 private:
  struct Ball {
    Index q, v;  ///< where its quaternion and its rates begin
  };
  using Block = Eigen::Matrix<double, 3, Eigen::Dynamic>;

  Eigen::Vector4d quaternion(Index e, const Ball& ball) const {
    return Eigen::Map<const Eigen::Vector4d>(tape_.q.data() + e * nq_ + ball.q);
  }
  Eigen::Vector3d rates(Index i, const Ball& ball) const {
    return Eigen::Map<const Eigen::Vector3d>(tape_.v.data() + (entry_->point + i) * n_ + ball.v);
  }

  /// Turned by exp(u), u being an integral of rates.
  Turn exponential(const Ball& ball, Index entry) const {
    const Eigen::Vector3d u = ball_turn(quaternion(place_before(tape_, entry), ball), quaternion(entry_->point, ball));
    const Eigen::Matrix3d by_u = turn_slopes(u) - Eigen::Matrix3d::Identity();
    const double h = entry_->h;
    return {ball.v,
            turned_back(u) - Eigen::Matrix3d::Identity(),
            h * by_u,
            h * h * of_.q_by_start(0, 0) * by_u,
            h * h * of_.q_by_start(0, 1) * by_u,
            {h * h * of_.q_by_a(0, 0) * by_u}};
  }
  /// A turn by the rates of the stages (3, 3 s), and so by the accelerations; c and q_by_a of an integral of rates.
  Turn by_rates(const Ball& ball, const Eigen::Matrix3d& by_q, const Block& by_v, double c,
                const Eigen::RowVectorXd& q_by_a) const {
    const Eigen::Matrix3d unit = Eigen::Matrix3d::Identity();
    const double h = entry_->h;
    const int s = of_.count();
    Turn out{ball.v, by_q - unit, -h * c * unit, Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Zero(), {}};
    for (int k = 0; k < s; ++k) {
      out.by_v += by_v.middleCols<3>(3 * k);
      out.by_a.push_back(-h * h * q_by_a[k] * unit);
      for (int j = 0; j < s; ++j) out.by_a.back() += h * A_(j, k) * by_v.middleCols<3>(3 * j);
    }
    return out;
  }
  /// By collocation: turned from the middle, see turn_at_points.
  Turn collocated(const Ball& ball, double c, const Eigen::RowVectorXd& weights,
                  const Eigen::RowVectorXd& q_by_a) const {
    const int s = of_.count();
    const double h = entry_->h;
    const MatrixXd from_middle = A_.rowwise() - 0.5 * b_.transpose();
    Eigen::Matrix3Xd w(3, s), u = Eigen::Matrix3Xd::Zero(3, s), du(3, s);
    for (int i = 0; i < s; ++i) w.col(i) = rates(i, ball);
    turn_at_points(h, from_middle, w, u, du);
    MatrixXd by_u = MatrixXd::Zero(3 * s, 3 * s), by_w = by_u, all(3 * s, 3 * s);
    for (int i = 0; i < s; ++i) {
      Eigen::Matrix3d one, other;
      turn_rate_slopes(u.col(i), w.col(i), one, other);
      by_u.block<3, 3>(3 * i, 3 * i) = one;
      by_w.block<3, 3>(3 * i, 3 * i) = other;
      for (int j = 0; j < s; ++j) all.block<3, 3>(3 * i, 3 * j) = h * from_middle(i, j) * Eigen::Matrix3d::Identity();
    }
    const MatrixXd turns = (MatrixXd::Identity(3 * s, 3 * s) - all * by_u).partialPivLu().solve(all * by_w);
    const MatrixXd slopes = by_u * turns + by_w;  // of du, by the rates
    const auto sum = [&](const Eigen::RowVectorXd& of) {
      Block out = Block::Zero(3, 3 * s);
      for (int j = 0; j < s; ++j) out += h * of[j] * slopes.middleRows<3>(3 * j);
      return out;
    };
    const Eigen::RowVectorXd rest = weights - 0.5 * b_.transpose();
    const Eigen::Vector3d half = 0.5 * h * (du * b_), last = h * (du * rest.transpose());
    const Eigen::Matrix3d back = turned_back(last);
    const Block by_v = back * turn_slopes(half) * sum(0.5 * b_.transpose()) + turn_slopes(last) * sum(rest);
    return by_rates(ball, back * turned_back(half), by_v, c, q_by_a);
  }
  /// Runge-Kutta's stages in turn: quaternions that are integrals of their own rates, of any length.
  void in_turn(const Ball& ball) {
    const int s = of_.count();
    const double h = entry_->h;
    using Lines = Eigen::Matrix<double, 4, Eigen::Dynamic>;
    const Eigen::Vector4d p0 = quaternion(entry_->point, ball);
    std::vector<Lines> rate_by;  // of each stage's rate: by the beginning's turn, and the rates of the stages
    std::vector<Eigen::Vector4d> rate;
    for (int i = 0; i <= s; ++i) {
      Lines by = Lines::Zero(4, 3 + 3 * s);
      by.leftCols<3>() = ball_rate_matrix(p0.data());
      Eigen::Vector4d p = p0;
      for (int j = 0; j < s && j < i; ++j) {
        by += h * of_.v_by_a(i, j) * rate_by[static_cast<std::size_t>(j)];
        p += h * of_.v_by_a(i, j) * rate[static_cast<std::size_t>(j)];
      }
      const Eigen::Matrix<double, 4, 3> E = ball_rate_matrix(p.data());
      const Block turn = 4.0 / p.squaredNorm() * E.transpose() * by;
      at_[static_cast<std::size_t>(i)].push_back(
          by_rates(ball, turn.leftCols<3>(), turn.rightCols(3 * s), of_.c[i], of_.q_by_a.row(i)));
      if (i == s) break;
      const Eigen::Vector3d w = rates(i, ball);
      rate_by.push_back(ball_rate_slopes(p, w) * by);
      rate_by.back().middleCols<3>(3 + 3 * i) += E;
      rate.emplace_back();
      ball_rates(p.data(), w.data(), rate.back().data());
    }
  }

  const Tape& tape_;
  const Stages& of_;
  Index n_, nq_;
  std::vector<Ball> balls_;
  MatrixXd A_;
  VectorXd b_;
  const Tape::Entry* entry_ = nullptr;
  std::vector<std::vector<Turn>> at_;  // of each stage and the end, of each ball
  const std::vector<Turn> none_;
};

}  // namespace taped
}  // namespace flexarm
