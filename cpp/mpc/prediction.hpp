// Predictions over the horizon: the arm's motion under a plan, and its exact derivatives by the plan.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "flexarm/mpc.hpp"
#include "held_laws.hpp"
#include "predictive_step.hpp"

namespace flexarm {

/// Stages of growing length, and the blocks of stages over which an input is held.
struct Grid {
  /// @throws std::invalid_argument naming the field and the value
  explicit Grid(const MpcOptions& options);
  Eigen::Index stages() const { return lengths.size(); }
  Eigen::Index blocks() const { return shift.rows(); }

  Eigen::VectorXd lengths, times;     ///< of stages (s); when they begin, and the end of the last
  std::vector<Eigen::Index> block;    ///< of each stage
  Eigen::VectorXd begins, durations;  ///< of blocks (s)
  /// A plan a period later, from one now, as weights of its blocks (blocks x blocks): the mean over each new block of
  /// the inputs planned for its time. The last goes on.
  Eigen::MatrixXd shift;
};

/// One row of the predictions at the end of each stage: an output, or its rate.
struct MpcRow {
  std::size_t output;
  bool rate;
  double weight, lower, upper;
  bool limited() const { return lower > -std::numeric_limits<double>::infinity() || upper < -lower; }
};

/// A state of a prediction.
struct MpcState {
  Eigen::VectorXd q, v;  ///< (nq), (nv)
  Eigen::VectorXd z;     ///< memory of sampled laws (HeldLaws)
};

class Prediction {
 public:
  using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  Prediction(const Problem& problem, const Grid& grid, const std::vector<MpcOutput>& outputs,
             const std::vector<MpcRow>& rows, const MpcOptions& options);
  /// At rest in the arm's zero, nothing remembered.
  MpcState zero() const;
  /// Predicts from a state at time t under a plan (nu x blocks), with all derivatives.
  Status operator()(double t, const MpcState& from, const Eigen::MatrixXd& plan);
  /// To the state a period later, under u (nu).
  Status step(double t, MpcState& state, const Eigen::VectorXd& u);
  /// The inputs (nu) that hold the arm where it is at time t against all that acts then.
  void hold(double t, const MpcState& at, Eigen::Ref<Eigen::VectorXd> u);
  /// The change (2 nv + z) from one state to another: of q the displacement.
  void difference(const MpcState& from, const MpcState& to, Eigen::VectorXd& change);
  /// Adds the effect of a change of the first state on the rows.
  void add_free(const Eigen::VectorXd& change, Eigen::VectorXd& rows);

  Eigen::MatrixXd states;  ///< [q; v] (nq + nv x stages + 1)
  Eigen::MatrixXd held;    ///< by `hold`, at each stage's beginning (nu x stages)
  Eigen::VectorXd values;  ///< of rows, those of a stage together
  RowMatrix by_plan;       ///< of rows, by the plan, inputs of a block together

 private:
  /// A slice that is asked for its place, and how fast it moves.
  struct Spot {
    std::size_t link;
    std::optional<double> x;
    PlacedSlice at;
    MotionDerivatives motion;
    Eigen::Vector3d p;
  };
  Status advance(std::size_t which, double t, double h, const Eigen::Ref<const Eigen::VectorXd>& u, Eigen::MatrixXd* A);
  void observe(Eigen::Index stage);

  const Arm& arm_;
  const Grid& grid_;
  const std::vector<MpcOutput>& outputs_;
  const std::vector<MpcRow>& rows_;
  double period_;
  const int carried_;
  HeldLaws laws_;
  const Eigen::Index nu_;
  PredictiveStep step_;  ///< those of the stages, and one more
  Eigen::MatrixXd to_inputs_;
  std::vector<Spot> spots_;
  std::vector<int> spot_of_;           ///< of each output, or -1
  std::vector<Eigen::VectorXd> by_q_;  ///< of each output, by coordinates
  std::vector<Eigen::MatrixXd> A_, C_;
  MpcState at_;
  Eigen::MatrixXd B_, S_, S_next_, A_step_, B_step_, A_next_, E_, E_by_q_;
  Eigen::VectorXd a_, tau_, change_, next_, inputs_, forces_, still_, none_;
};

}  // namespace flexarm
