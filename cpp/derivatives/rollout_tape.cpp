#include "flexarm/rollout_tape.hpp"

#include "flexarm/dry_friction.hpp"
#include "system.hpp"

namespace flexarm {

using Eigen::Index;
using Eigen::VectorXd;

TapedRollout roll_on_tape(const std::string& method, const Arm& arm, double h, const ImplicitOptions& options,
                          const VectorXd& q0, const VectorXd& v0, const Trajectory::Rows& tau) {
  refuse_contact_friction(arm, "a rollout with derivatives");
  refuse_balls(arm, "derivatives of a rollout");
  OneStep step(method, arm, h, options);
  const Index count = tau.rows();
  TapedRollout out{Tape(step.stages()), {count + 1, q0.size()}, {count + 1, v0.size()}, {}};
  Tape& tape = out.tape;
  Workspace ws(arm);
  VectorXd q = q0, v = v0;
  const auto row = [&](Index k) {
    tape.rows.push_back({static_cast<Index>(tape.entries.size()) - 1, 1.0, {}, {}, -1});
    out.q.row(k) = q;
    out.v.row(k) = v;
  };
  row(0);
  step.record(&tape);
  for (Index k = 0; k < count; ++k) {
    tape.now = static_cast<double>(k) * h;
    tape.tau = tau.row(k);
    out.first.push_back(tape.points());
    if (k == 0)
      out.status = step.start(ws, q, v, tape.tau);
    else if (tau.row(k) != tau.row(k - 1))
      out.status = step.jump(ws, q, v, tape.tau);
    if (out.status == Status::ok) out.status = step.advance(h, ws, q, v, tape.tau, {});
    if (out.status != Status::ok) {
      out.failed = k;
      return out;
    }
    for (Index e = out.first.back(); !arm.loops().empty() && e < tape.points(); ++e)
      tape.beside.insert(tape.beside.end(), tape.tau.begin(), tape.tau.end());
    row(k + 1);
  }
  out.first.push_back(tape.points());
  return out;
}

}  // namespace flexarm
