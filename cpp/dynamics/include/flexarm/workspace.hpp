// Workspaces hold every number that changes, and all memory; arms are constant. One workspace per thread.
#pragma once

#include <Eigen/Cholesky>
#include <memory>
#include <vector>

#include "flexarm/arm.hpp"
#include "flexarm/control.hpp"
#include "flexarm/load.hpp"

namespace flexarm {

namespace lanes {
class Single;
class SingleFrames;
}  // namespace lanes

/// A member that is copied with its owner, of a type that the owner's header does not include.
template <class T>
class Held {
 public:
  Held() = default;
  explicit Held(T* thing) : thing_(thing, [](T* t) { delete t; }), copy_([](const T& t) { return Held(new T(t)); }) {}
  Held(const Held& other) : Held(other.thing_ ? other.copy_(*other.thing_) : Held()) {}
  Held(Held&&) noexcept = default;
  Held& operator=(Held&&) noexcept = default;
  T& operator*() const { return *thing_; }
  T* operator->() const { return thing_.get(); }

 private:
  std::unique_ptr<T, void (*)(T*)> thing_{nullptr, [](T*) {}};
  Held (*copy_)(const T&) = nullptr;
};

/// The constructor allocates all memory of O(N); for that of CI, O(N^2), see below.
class Workspace {
 public:
  /// @param prescribed velocity coordinates whose acceleration is given (in `a`) and whose force is a result: one
  ///                   entry for each rate, or none
  /// @throws std::invalid_argument naming the field and the value
  explicit Workspace(const Arm& arm, const std::vector<bool>& prescribed = {}, const std::vector<Load>& loads = {});

  Eigen::VectorXd tau;                    ///< result of inverse_dynamics
  Eigen::VectorXd a;                      ///< result of forward_dynamics; input where prescribed
  std::vector<AppliedLoad> loads;         ///< set their wrenches before an evaluation
  std::vector<AppliedFeedback> feedback;  ///< set their offsets before an evaluation
  /// Rates with a limit, empty by default: the functions of this workspace limit their forces and laws. OneStep and the
  /// integrators set those of the arm.
  std::vector<AppliedLimit> limits;
  std::vector<bool> prescribed;     ///< per velocity coordinate
  std::vector<int> free;            ///< coordinates that are not prescribed
  double twice_kinetic = 0.0;       ///< v^T M v (J), set by factor_shifted
  std::vector<double> remembered;   ///< the memory of contacts in a run; empty: no run
  std::vector<double> loop_forces;  ///< forces of the rigid rows of loops, in their order, as given; empty: none
  std::vector<double> note;         ///< the same at the end of a step, if `noted`, before it counts
  bool noted = false;

  /// Laws without memory that every evaluation includes from now on; they must outlive the workspace.
  /// @throws std::invalid_argument where their lengths are not those of the arm
  void feed_back(const std::vector<Feedback>& laws);
  void feed_back(const std::vector<Feedback>&& laws) = delete;  ///< they would be gone

  /// Sets the forces of drives and loop_forces laws (nv) for the limits.
  void give(const double* forces) {
    for (AppliedLimit& l : limits) l.given = forces[l.rate];
  }

  // Of the CI method; the matrices of nv^2 are empty until `take_composite` (ci.hpp) or CI's first call.
  Eigen::MatrixXd M;       ///< result of composite_mass_matrix
  Eigen::MatrixXd M_free;  ///< Eq. 90 on the free coordinates
  Eigen::LLT<Eigen::MatrixXd> factor;
  Eigen::VectorXd rhs;

  // Data of the functions that take a workspace.
  int nq() const { return nq_; }
  lanes::Single& chain();          ///< the arm's recursions, with the present values of the loads
  lanes::Single& chain_to_move();  ///< for a caller that moves it
  lanes::Single& placed_chain();   ///< at the state of the last place or move
  void place(const Eigen::VectorXd& q, const Eigen::VectorXd& v);
  Held<lanes::SingleFrames> frames;  ///< its frames, in space
  Eigen::VectorXd total;             ///< forces with those of feedback
  Eigen::VectorXd rest, spare;       ///< of `take_loop_forces`
  Eigen::VectorXd feedback_numbers;  ///< of the laws and of factor_shifted, see step/feedback.hpp

 private:
  int nq_;
  Held<lanes::Single> chain_;
  Eigen::VectorXd q_, v_;         ///< of `place`
  bool placed_ = true;            ///< whether the chain is at q_, v_: else `placed_chain` moves it
  std::vector<double> wrenches_;  ///< of all loads, in a row
};

/// singular: a coordinate has no inertia. not_converged: an implicit step found no solution. not_finite: nan or inf, or
/// a step beyond the arm's reach (Arm::within_reach).
enum class Status { ok, singular, not_converged, not_finite };

}  // namespace flexarm
