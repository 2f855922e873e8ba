#include "flexarm/derivatives.hpp"

#include <algorithm>
#include <memory>

#include "lanes/frame_kernels.hpp"
#include "lanes/kernel_arm.hpp"
#include "lanes/kernels.hpp"

namespace flexarm {

TangentState::TangentState(const Arm& arm) : q(arm.nq()), v(arm.nv()), a(arm.nv()) {}

void TangentState::set(const Eigen::VectorXd& q_value, const Eigen::VectorXd& v_value, const Eigen::VectorXd& a_value) {
  for (Eigen::Index i = 0; i < q.size(); ++i) q[i] = q_value[i];
  for (Eigen::Index i = 0; i < v.size(); ++i) {
    v[i] = v_value[i];
    a[i] = a_value[i];
  }
}

template <class Evaluate, class Store>
void TangentState::sweep(const Evaluate& evaluate, const Store& store, bool by_v) {
  constexpr Eigen::Index W = std::tuple_size<decltype(Tangent::d)>::value;
  const Eigen::Index nq = q.size(), all = by_v ? nq + v.size() : nq;
  for (Eigen::Index first = 0; first < all; first += W) {
    const Eigen::Index last = std::min(first + W, all);
    const auto seed = [&](double value) {
      for (Eigen::Index k = first; k < last; ++k)
        (k < nq ? q[k] : v[k - nq]).d[static_cast<std::size_t>(k - first)] = value;
    };
    seed(1.0);
    evaluate();
    seed(0.0);
    for (Eigen::Index k = first; k < last; ++k) store(k, static_cast<std::size_t>(k - first));
  }
}

namespace {

constexpr std::size_t kAligned = 64;  // bytes, as the kernels want their memory

/// Memory within, as the kernels want it.
void* aligned(std::vector<double>& memory) {
  void* at = memory.data();
  std::size_t space = memory.size() * sizeof(double);
  return std::align(kAligned, space - kAligned, at, space);
}

/// Writes direction k of `values` into the columns of dq, then of dv.
void put(const VecX<Tangent>& values, Eigen::Index k, std::size_t lane, Eigen::MatrixXd& dq, Eigen::MatrixXd& dv) {
  for (Eigen::Index i = 0; i < values.size(); ++i)
    (k < dq.cols() ? dq(i, k) : dv(i, k - dq.cols())) = values[i].d[lane];
}

}  // namespace

InverseDerivatives::InverseDerivatives(const Arm& arm, const std::vector<Load>& loads)
    : dq(Eigen::MatrixXd::Zero(arm.nv(), arm.nq())), dv(Eigen::MatrixXd::Zero(arm.nv(), arm.nv())) {
  if (const lanes::KernelArm* fast = lanes::KernelArm::of(arm)) {
    fast_ = std::make_shared<const lanes::KernelArm>(loads.empty() ? *fast : fast->loaded(arm, loads));
    wrenches_.resize(6 * loads.size());
    memory_.resize((kAligned + lanes::best_kernels().slopes_memory(fast_->layout())) / sizeof(double) + 1);
    return;
  }
  ws_.emplace(arm, loads);
  state_.emplace(arm);
}

void InverseDerivatives::set_wrench(std::size_t load, const Vec6<double>& wrench) {
  if (fast_)
    Eigen::Map<Vec6<double>>(wrenches_.data() + 6 * load) = wrench;
  else
    ws_->loads[load].wrench = wrench;
}

void InverseDerivatives::operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                    const Eigen::VectorXd& a, bool by_v) {
  if (fast_) {
    lanes::best_kernels().slopes(fast_->layout(), fast_->numbers().data(), wrenches_.data(), aligned(memory_), q.data(),
                                 v.data(), a.data(), dq.data(), dv.data());
    return;
  }
  state_->set(q, v, a);
  state_->sweep([&] { inverse_dynamics(arm, *ws_, state_->q, state_->v, state_->a); },
                [&](Eigen::Index k, std::size_t lane) { put(ws_->tau, k, lane, dq, dv); }, by_v);
}

MotionDerivatives::MotionDerivatives(const Arm& arm, std::size_t link, std::optional<double> x)
    : dq(Eigen::MatrixXd::Zero(12, arm.nq())), dv(Eigen::MatrixXd::Zero(12, arm.nv())), at_(arm, link, x) {
  if (const lanes::KernelArm* fast = lanes::KernelArm::in_space(arm)) {
    kept_ = arm.kept();
    fast_ = fast;
    memory_.resize((kAligned + lanes::best_frames().slopes_memory(fast->layout())) / sizeof(double) + 1);
    return;
  }
  slice_ = Slice<Tangent>(arm.link(link).ne());
  ws_.emplace(arm);
  state_.emplace(arm);
}

const Slice<Tangent>& MotionDerivatives::slice(const Arm& arm) {
  if (!at_.table()) return ws_->links[at_.link()].end;
  arm.link(at_.link()).move_slice(*at_.table(), ws_->links[at_.link()], true, slice_);
  return slice_;
}

void MotionDerivatives::operator()(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v,
                                   const Eigen::VectorXd& a) {
  if (fast_) {
    lanes::best_frames().slopes(fast_->layout(), fast_->numbers().data(), aligned(memory_), at_.place(), at_.numbers(),
                                q.data(), v.data(), a.data(), dq.data(), dv.data());
    return;
  }
  VecX<Tangent> motion(12);
  state_->set(q, v, a);
  state_->sweep(
      [&] {
        move_arm(arm, *ws_, state_->q, state_->v);
        accelerate_arm(arm, *ws_, state_->a, Eigen::Vector3d::Zero());
        const SliceMotion<Tangent> m = slice_motion(arm, *ws_, at_.link(), slice(arm), state_->a);
        motion << m.velocity, m.acceleration;
      },
      [&](Eigen::Index k, std::size_t lane) { put(motion, k, lane, dq, dv); });
}

Mat6X<double> MotionDerivatives::jacobian_rate(const Arm& arm, const Eigen::VectorXd& q, const Eigen::VectorXd& v) {
  Eigen::VectorXd rate(arm.nq());
  coordinate_rates(arm, q, v, rate);
  if (fast_) {
    Mat6X<double> J(6, arm.nv());
    lanes::best_frames().jacobian_rate(fast_->layout(), fast_->numbers().data(), aligned(memory_), at_.place(),
                                       at_.numbers(), q.data(), rate.data(), J.data());
    return J;
  }
  state_->set(q, v, v);
  for (Eigen::Index i = 0; i < rate.size(); ++i) state_->q[i].d[0] = rate[i];
  move_arm(arm, *ws_, state_->q, state_->v);
  const Mat6X<Tangent> J = slice_jacobian(arm, *ws_, at_.link(), slice(arm));
  for (Eigen::Index i = 0; i < rate.size(); ++i) state_->q[i].d[0] = 0.0;
  return J.unaryExpr([](const Tangent& x) { return x.d[0]; });
}

}  // namespace flexarm
