// Workspaces hold every number that changes, and all memory; arms are constant. One workspace per thread.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <memory>
#include <vector>

#include "flexarm/arm.hpp"
#include "flexarm/articulated.hpp"
#include "flexarm/control.hpp"
#include "flexarm/dual.hpp"
#include "flexarm/load.hpp"

namespace flexarm {

/// What the sweeps of positions, velocities and inverse dynamics need, for any scalar.
template <class S>
struct SweepWorkspace {
  std::vector<LinkState<S>> links;
  VecX<S> tau;                            ///< result of inverse_dynamics
  std::vector<AppliedLoad<S>> loads;      ///< set their wrenches before an evaluation
  std::vector<AppliedFeedback> feedback;  ///< set their offsets before an evaluation; of doubles only

  explicit SweepWorkspace(const Arm& arm, const std::vector<Load>& applied = {}) : tau(VecX<S>::Zero(arm.nv())) {
    for (const Load& load : applied) loads.emplace_back(load, arm.link(load.link).ne());
    links.reserve(arm.size());
    for (std::size_t n = 0; n < arm.size(); ++n) {
      const Link& link = arm.link(n);
      const int ne_below = n == 0 ? 0 : arm.link(n - 1).ne();
      links.emplace_back(link.nj(), link.beam() ? &*link.beam() : nullptr, ne_below);
    }
  }
};

/// What the AB elimination keeps of one link (Eq. 92-96).
struct ArticulatedLink : ArticulatedInertia {
  using ArticulatedInertia::ArticulatedInertia;
  Eigen::VectorXd T;     ///< Eq. 93, then D^-1 T, then ddq
  Eigen::VectorXd turn;  ///< D^-1 U^T Phi A-
  Vec6<double> N;        ///< articulated bias (Eq. 95), M times the bias acceleration included
  Eigen::VectorXd Ne;
  double applied = 0.0;  ///< where `lone`: the force on its one coordinate
};

namespace lanes {
class Single;
class SingleFrames;
}  // namespace lanes

/// A thing of its own, copied with its owner, that the owner's header need not know; or none.
template <class T>
class Held {
 public:
  Held() = default;
  explicit Held(T* thing) : thing_(thing, [](T* t) { delete t; }), copy_([](const T& t) { return Held(new T(t)); }) {}
  Held(const Held& other) : Held(other ? other.copy_(*other.thing_) : Held()) {}
  Held(Held&&) noexcept = default;
  Held& operator=(Held&&) noexcept = default;
  explicit operator bool() const { return thing_ != nullptr; }
  T& operator*() const { return *thing_; }
  T* operator->() const { return thing_.get(); }

 private:
  std::unique_ptr<T, void (*)(T*)> thing_{nullptr, [](T*) {}};
  Held (*copy_)(const T&) = nullptr;
};

/// The arm on the fast kernels of this processor, where they know it; else empty.
class FastPath {
 public:
  FastPath();
  explicit FastPath(lanes::Single* arm);  ///< takes it over
  FastPath(const FastPath& other);
  FastPath(FastPath&& other) noexcept;
  FastPath& operator=(FastPath&& other) noexcept;
  ~FastPath();
  explicit operator bool() const { return arm_ != nullptr; }
  lanes::Single* operator->() const { return arm_.get(); }

 private:
  std::unique_ptr<lanes::Single> arm_;
};

/// All memory of what costs O(N) is taken by the constructor; of CI, which takes O(N^2), see below.
class Workspace : public SweepWorkspace<double> {
 public:
  /// @param prescribed velocity coordinates whose acceleration is given (in `a`) and whose force is asked for: one
  ///                   entry for each rate, or none
  /// @throws std::invalid_argument naming the field and the value
  explicit Workspace(const Arm& arm, const std::vector<bool>& prescribed = {}, const std::vector<Load>& loads = {});

  Eigen::VectorXd a;             ///< result of forward_dynamics; input where prescribed
  std::vector<bool> prescribed;  ///< per velocity coordinate
  std::vector<int> free;         ///< coordinates that are not prescribed
  std::vector<ArticulatedLink> articulated;
  double twice_kinetic = 0.0;  ///< v^T M v (J), set by factor_shifted
  FastPath fast;
  Eigen::VectorXd placed_a;          ///< of accelerate_arm, for Eigen's path
  Held<lanes::SingleFrames> frames;  ///< of the arm in space; empty where the kernels do not know it
  /// The fast kernels with the present values of the loads.
  lanes::Single& kernels();

  // Of the CI method; the matrices of nv^2 are empty until `take_composite` (ci.hpp) or CI's first call.
  Eigen::MatrixXd M;       ///< result of composite_mass_matrix
  Eigen::MatrixXd M_free;  ///< Eq. 90 on the free coordinates
  Eigen::LLT<Eigen::MatrixXd> factor;
  Eigen::VectorXd rhs;
  /// Laws without memory that every evaluation takes into account from now on; they must outlive the workspace.
  /// @throws std::invalid_argument where their lengths are not those of the arm
  void feed_back(const std::vector<Feedback>& laws);
  void feed_back(const std::vector<Feedback>&& laws) = delete;  ///< they would be gone
  Eigen::VectorXd feedback_numbers;  ///< of the laws and of factor_shifted, see lanes/feedback.hpp
  Eigen::VectorXd rhs_all;           ///< scratch (nv)
  Eigen::VectorXd total;             ///< forces with those of feedback
  Eigen::MatrixXd columns;           ///< 6 x n scratch

 private:
  int nq_;
  std::vector<double> wrenches_;  ///< of all loads, in a row
};

/// singular: a coordinate has no inertia. not_converged: an implicit step found no solution. not_finite: nan or inf, or
/// a step that has left any reach the arm has (Arm::within_reach).
enum class Status { ok, singular, not_converged, not_finite };

}  // namespace flexarm
