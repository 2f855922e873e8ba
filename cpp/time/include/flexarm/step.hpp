// One step in time: methods that advance an arm from t to t + h. After construction and `start` nothing is allocated or
// thrown.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "flexarm/ab.hpp"
#include "flexarm/dry_friction.hpp"
#include "flexarm/tape.hpp"

namespace flexarm {

class OneStep;

/// A fixed-step method. It has a memory from one step to the next: one object per arm in motion.
class Step {
 public:
  /// Sets in place, at the time t + c h of the step (0 <= c <= 1): the prescribed entries of q, v and
  /// ws.a, the forces tau, the loads of the workspace.
  using Given = std::function<void(double c)>;
  struct Counts {
    long evaluations = 0;     ///< of inverse or forward dynamics
    long factorisations = 0;  ///< of iteration matrices
    long iterations = 0;      ///< linear solves
    long divided = 0;         ///< steps whose equations were not solved, taken in parts
    double doubt = 0.0;       ///< the largest error that one of these may have, in parts of the arm's speed
    long switches = 0;        ///< steps in which dry friction came to hold a joint, let it go, or turned
  };

  virtual ~Step() = default;
  /// Begins at a state, and forgets the steps before.
  virtual Status start(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                       const Eigen::VectorXd& tau) = 0;
  /// Goes on from here under other forces than a moment ago: remembered accelerations no longer hold.
  virtual Status jump(Workspace&, const Eigen::VectorXd&, const Eigen::VectorXd&, const Eigen::VectorXd&) {
    return Status::ok;
  }
  /// Advances q (nq) and v (nv) by h seconds.
  /// @param tau    generalised forces (nv)
  /// @param given  or empty, when tau and loads are constant, and the prescribed entries of q, v and ws.a are already
  ///               those of the step's end
  /// @return when not ok, q and v are those of the step's beginning
  virtual Status advance(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                         const Given& given) = 0;
  /// Of an arm whose joints have dry friction, the method that determines it at an instant; else null.
  virtual OneStep* rubbing() { return nullptr; }
  /// Whether friction may hold, let go or turn a joint within a step. Where not, a step must end there, and `jump`.
  virtual bool switches_within() const { return false; }
  /// Whether `inside` knows the state within the last step; if not, steps must end where it is asked for.
  virtual bool interpolates() const { return false; }
  /// The state c h after the last step's beginning, 0 <= c <= 1, except for prescribed coordinates.
  virtual void inside(double, Eigen::VectorXd&, Eigen::VectorXd&) const {}
  /// Of a method that interpolates: weights of the stages' accelerations (s) in the rates, and, times h, in the
  /// coordinates there, in parts of h.
  virtual void weights(double, Eigen::VectorXd&, Eigen::VectorXd&) const {}
  /// Whether its steps may be chosen by their errors.
  virtual bool chooses() const { return false; }
  /// Of the last step: its error, in parts of the one allowed.
  virtual double error() const { return 0.0; }
  /// The power of a step's length that this error is proportional to.
  virtual double error_order() const { return 1.0; }
  /// Takes the last step back, from where `jump` or a step before had led.
  virtual void undo(Eigen::VectorXd&, Eigen::VectorXd&) {}
  /// Numbers that it remembers from step to step, which `visit` reads or writes, in an order of their own.
  virtual void memory(const std::function<void(double&)>& visit) = 0;
  /// To be called when `memory` has been written.
  virtual void recalled() {}
  /// The coefficients of its derivatives.
  virtual Stages stages() const = 0;
  /// Writes every beginning and step from now on; null: no more.
  void record(Tape* tape) { tape_ = tape; }
  const Counts& counts() const { return counts_; }
  /// A step that takes long calls `look` now and then; its exceptions leave the step. Empty: nothing is called.
  void look_with(std::function<void()> look) { look_ = std::move(look); }
  /// The remedy where the motion ran away, as the end of a sentence.
  virtual const char* remedy() const { return "take a smaller step, or look for what drives it"; }

 protected:
  Tape* tape_ = nullptr;
  Counts counts_;
  std::function<void()> look_;
};

struct ImplicitOptions {
  /// The factor by which one step reduces a mode too fast for it: 1 keeps the energy of every mode (trapezoidal rule),
  /// below 1 fast modes die out and slow ones hardly do; 0 to 1.
  double spectral_radius = 1.0;
  /// Of the iteration: error of the velocities, as a part of those of the motion, both in the norm of kinetic energy.
  /// This error is the drift of a free arm's energy.
  double rtol = 1e-10;
  int max_iterations = 20;  ///< of a step, and of each part of one that is divided
};

/// A method of the kernel's table, which batches take as well (step/methods.hpp), on an arm's workspace.
class OneStep : public Step {
 public:
  /// The properties of a method.
  struct Traits {
    std::string name;
    bool rubs;      ///< dry friction of joints is in its equations
    bool iterates;  ///< it reads ImplicitOptions::rtol
    bool damps;     ///< it reads ImplicitOptions::spectral_radius
    double limit;   ///< of its step times the highest frequency; 0: none
  };
  static const std::vector<Traits>& methods();

  /// @param method  its name
  /// @param h       step of operator() (s)
  /// @throws std::invalid_argument naming the field and the value; for joints with dry friction, where it has none
  OneStep(const std::string& method, const Arm& arm, double h, const ImplicitOptions& options = {},
          DryFriction friction = DryFriction::refused);
  OneStep(const std::string& method, const Arm&& arm, double h, const ImplicitOptions& options = {},
          DryFriction friction = DryFriction::refused) = delete;  ///< the arm must outlive it
  ~OneStep() override;

  /// Advances by the step of the constructor; `start`s by itself the first time. tau, and prescribed values, are those
  /// of the step's end.
  Status operator()(Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau) {
    return advance(h_, ws, q, v, tau, {});
  }
  Status start(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau) override;
  Status jump(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau) override;
  Status advance(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                 const Given& given) override;
  const char* remedy() const override { return remedy_.c_str(); }
  void memory(const std::function<void(double&)>& visit) override;
  Stages stages() const override;
  OneStep* rubbing() override;
  bool switches_within() const override;
  /// Accelerations into ws.a, which holds the prescribed ones, and the forces of dry friction (nv): a joint at rest
  /// sticks up to its stiction; or, `between` two switches, a joint that stuck when the method last began is held by
  /// any force that this needs, and one that slid slides on.
  Status accelerate(Workspace& ws, const Eigen::VectorXd& q, const Eigen::VectorXd& v, const Eigen::VectorXd& tau,
                    Eigen::VectorXd& friction, bool between = false);
  /// Forces of dry friction behind the last step (nv; N, N m): they oppose sliding, or hold joints that stick.
  const Eigen::VectorXd& friction() const { return friction_; }
  /// The ways of free rates with dry friction at the last step's end, or where `accelerate` was asked (nv of
  /// Tape::Way).
  void ways(const Eigen::VectorXd& v, bool instant, signed char* out) const;
  /// Takes the step of a switch again, into q and v. @return whether it was solved
  bool repeat(const Tape::Switch& from, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v,
              const Eigen::VectorXd& tau, const Given& given);
  /// The branch of the last step's friction: the joints it held, let go or turned, and in how many rounds. Where that
  /// is the same, a step's end is a smooth function of its beginning.
  std::vector<double> way() const;
  /// Iterations of the last step.
  int iterations() const;

 private:
  struct Run;
  template <class Row>
  struct RunOf;
  void report(const Eigen::VectorXd& v, const double* force, Eigen::VectorXd& friction) const;
  void write(double h, Workspace& ws, Eigen::VectorXd& q, Eigen::VectorXd& v, const Eigen::VectorXd& tau,
             const Given& given);
  const Arm* arm_;
  double h_;
  std::string remedy_;
  bool started_ = false;
  Eigen::VectorXd friction_;
  std::unique_ptr<Run> run_;
};

/// Generalised-alpha method (Chung & Hulbert 1993; with the rotations of balls by exponentials, Bruels & Cardona 2010,
/// Arnold & Bruels 2007): second order, unconditionally stable on linear vibration, O(N). Its equations
///   residual of inverse dynamics at t + h = 0
/// are solved by Newton's iteration with the matrix of factor_shifted, which leaves out gyroscopic and geometric terms:
/// it contracts by a factor of order h. Modes too fast for the step may be quiet or ring softly; where they are loud,
/// with (h omega)^2 times their share of the bending not small, the iteration fails. Such a step, as one at whose
/// beginning a force leaps on a joint with hardly any inertia, is divided (GeneralisedAlpha::divide), within a bounded
/// count: its vibration is damped. Where that fails, too, a smaller step is needed.
/// Joints with dry friction stick and slide: one that sticks is still to the last bit. Where a joint comes to rest,
/// turns or is torn loose within a step, the mean force over it is that of the law, so that the order stays two.
class ImplicitStep final : public OneStep {
 public:
  ImplicitStep(const Arm& arm, double h, const ImplicitOptions& options = {}) : OneStep("implicit", arm, h, options) {}
  ImplicitStep(const Arm&& arm, double h, const ImplicitOptions& options = {}) = delete;
};

/// The classical Runge-Kutta method: fourth order, four forward dynamics (AB) per step; stable only while h times the
/// highest frequency is below 2.83.
class Rk4Step final : public OneStep {
 public:
  Rk4Step(const Arm& arm, double h, DryFriction friction = DryFriction::refused)
      : OneStep("rk4", arm, h, {}, friction) {}
  Rk4Step(const Arm&& arm, double h, DryFriction friction = DryFriction::refused) = delete;
};

}  // namespace flexarm
