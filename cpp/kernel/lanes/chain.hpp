// A chain of nodes in motion: outward positions and velocities (Eq. 82-83), and inverse dynamics (Eq. 84-87); forward
// dynamics goes on from there (elimination.hpp). Velocities of origins never occur: accelerations are absolute, and a
// body's forces know only its angular velocity.
#pragma once

#include "lanes/joints.hpp"
#include "lanes/loads.hpp"

namespace {

/// All of one arm (or of one for each lane) in motion.
template <class Sp, class P>
struct Chain {
  using Space = Sp;
  using S = typename Sp::Scalar;
  using Lin = typename Sp::Lin;
  using Ang = typename Sp::Ang;
  using Mask = typename Lanes<S>::Mask;

  const Layout& layout;
  const double* numbers;  ///< of all nodes, in order
  State<Sp>* state;
  P* scratch;
  Mask lost;         ///< where the first pivot that was not positive was not a number, or infinite
  S* wrench;         ///< of each load, six numbers [f; m]
  Slice<Sp>* slice;  ///< that a load acts on, or that is asked for

  static std::size_t memory_needed(const Layout& layout) {
    std::size_t bytes = sizeof(State<Sp>) * static_cast<std::size_t>(layout.nodes) + scratch_bytes(layout);
    for (int i = 0; i < layout.nodes; ++i) {
      const std::size_t ne = static_cast<std::size_t>(layout.node[i].ne), pairs = ne * (ne + 1) / 2;
      bytes += 3 * ne * (sizeof(Lin) + sizeof(Ang)) + (2 * pairs + ne) * sizeof(S);
    }
    return bytes + sizeof(Slice<Sp>) + most_elastic(layout) * (sizeof(Lin) + sizeof(Ang)) +
           6 * static_cast<std::size_t>(layout.loads) * sizeof(S);
  }

  /// In memory, aligned for P, as large as `memory_needed` says.
  Chain(const Layout& layout_, const double* numbers_, void* memory) : layout(layout_), numbers(numbers_) {
    char* at = static_cast<char*>(memory);
    const auto take = [&](std::size_t bytes) {
      char* here = at;
      at += bytes;
      return here;
    };
    scratch = reinterpret_cast<P*>(take(scratch_bytes(layout)));
    state = reinterpret_cast<State<Sp>*>(take(sizeof(State<Sp>) * static_cast<std::size_t>(layout.nodes)));
    for (int i = 0; i < layout.nodes; ++i) {
      Elastic<Sp>& e = state[i].elastic;
      const std::size_t ne = static_cast<std::size_t>(layout.node[i].ne);
      Lin** const linear[] = {&e.end.J_linear, &e.M_linear, &e.W_linear};
      Ang** const angular[] = {&e.end.J_angular, &e.M_angular, &e.W_angular};
      S** const triangles[] = {&e.M, &e.L};
      for (Lin** x : linear) *x = reinterpret_cast<Lin*>(take(ne * sizeof(Lin)));
      for (Ang** x : angular) *x = reinterpret_cast<Ang*>(take(ne * sizeof(Ang)));
      for (S** x : triangles) *x = reinterpret_cast<S*>(take(ne * (ne + 1) / 2 * sizeof(S)));
      e.e = reinterpret_cast<S*>(take(ne * sizeof(S)));
    }
    slice = reinterpret_cast<Slice<Sp>*>(take(sizeof(Slice<Sp>)));
    slice->J_linear = reinterpret_cast<Lin*>(take(most_elastic(layout) * sizeof(Lin)));
    slice->J_angular = reinterpret_cast<Ang*>(take(most_elastic(layout) * sizeof(Ang)));
    wrench = reinterpret_cast<S*>(take(6 * static_cast<std::size_t>(layout.loads) * sizeof(S)));
    for (int i = 0; i < 6 * layout.loads; ++i) wrench[i] = S{};
  }
  static std::size_t most_elastic(const Layout& layout) {
    int most = 0;
    for (int i = 0; i < layout.nodes; ++i) most = layout.node[i].ne > most ? layout.node[i].ne : most;
    return static_cast<std::size_t>(most);
  }
  static std::size_t scratch_bytes(const Layout& layout) {
    std::size_t most = hinge_scratch<S, P>(layout);
    for (int i = 0; i < layout.nodes; ++i)
      if (const std::size_t need = scratch_of(layout.node[i]); need > most) most = need;
    return most * sizeof(P);
  }

  /// Places, velocities, own inertias and bias forces of all nodes; or places and velocities alone. Without rates: of
  /// an arm at rest, whose bias forces are not needed.
  template <bool rates = true, bool forces = true>
  void move(const S* q, const S* v) {
    turn_hinges(layout, 0, layout.nodes, q, state, scratch);
    Ang w = Sp::zero_angular();
    typename Sp::Rot attitude = Sp::turn(0, S{}, number<S>(1.0));
    for (int i = 0; i < layout.nodes; ++i)
      move_node<rates, forces>(
          i, q, v, w, attitude, [&](const Node& node, const double* constants, const Lin& gravity) {
            bend_body<forces>(node, constants, gravity, q + node.qe, rates ? v + node.ve : none(), state[i]);
          });
  }

  /// One node, after its hinge was turned. w and attitude are those of the frame before it, and then of its end.
  /// @param bend  makes the elastic body and its end slice, of (node, constants, gravity)
  template <bool rates, bool forces, class Bend>
  void move_node(int i, const S* q, const S* v, Ang& w, typename Sp::Rot& attitude, const Bend& bend) {
    const Node& node = layout.node[i];
    State<Sp>& s = state[i];
    const double* p = numbers + node.numbers;
    typename Sp::Rot seat = Sp::turn(0, S{}, number<S>(1.0));
    if (!node.coincident) {
      s.r = Sp::read(p);
      if (node.turned) seat = Sp::read_rotation(p);
      if (node.passive && !node.ball) resist(node, p, q[node.q], rates ? v[node.v] : S{}, s);
    }
    if (node.coincident) {
      stay(w, s);
    } else if (node.ball) {
      move_ball(node, p, seat, q + node.q, rates ? v + node.v : none(), w, s);
    } else {
      move_joint<rates>(node, seat, q, v, w, s);
    }
    if constexpr (!rates) s.w = w;  // none
    w = s.w;
    if (layout.attitudes) attitude = s.attitude = node.coincident ? attitude : Sp::times(attitude, s.R);
    if (node.ne > 0) {
      Elastic<Sp>& e = s.elastic;
      bend(node, p, gravity_in(attitude));
      // what is carried by the end moves with the slice there (Eq. 45, 46)
      s.end_w = Sp::unrotate_angular(e.end.R, s.w + e.end.turning);
      const Lin sweep = Sp::cross(s.w, e.end.x) + number<S>(2.0) * e.end.u_dot;
      e.end.u_bias = Sp::cross(s.w, sweep) + e.end.u_bias;
      e.end.turn_bias = Sp::cross(s.w, e.end.turning) + e.end.turn_bias;
      w = s.end_w;
      if (layout.attitudes) attitude = Sp::times(attitude, e.end.R);
      s.tip_f = Sp::zero();
      s.tip_n = Sp::zero_angular();
      if (forces && node.tip) {
        const double* t = numbers + node.tip_body;
        read_body<rates>(t, w, s.tip, s.tip_f, s.tip_n);
      }
    } else if (forces && node.body) {
      read_body<rates>(p, s.w, s.body, s.body_f, s.body_n);
    }
    if constexpr (rates && forces)
      if (node.loads > 0)
        subtract_loads(layout, node, wrench, attitude, numbers + node.points, q + node.qe, v + node.ve, s, *slice,
                       scratch);
  }
  /// Rates of elastic coordinates that rest.
  static const S* none() {
    static const S zeros[kMostElastic]{};
    return zeros;
  }

  /// Gravity in the axes of a frame: the base accelerates against it.
  Lin gravity_in(const typename Sp::Rot& attitude) const {
    const double* p = numbers;
    return number<S>(-1.0) * Sp::unrotate(attitude, Sp::read(p));
  }
  /// The end slice of an elastic body, its inertia and its forces; or the slice alone.
  template <bool forces>
  void bend_body(const Node& node, const double* constants, const Lin& gravity, const S* q, const S* dq, State<Sp>& s) {
    Elastic<Sp>& e = s.elastic;
    const double* points = numbers + node.points;
    if (node.body == Node::sampled) {
      sampled::sample<false>(Sp{}, node, points, q, dq, scratch);
      sampled::bend<false>(node, constants, points, q, dq, s.w, s.body, s.body_f, s.body_n, e, scratch);
      return;
    }
    move_slice(node, numbers + node.end, q, dq, e.end);
    if constexpr (!forces) return;
    if (node.body == Node::cut)
      bend_cut<Sp>(node, constants, gravity, q, dq, s.w, s.body, s.body_f, s.body_n, e);
    else
      bend(node, constants, points, q, dq, s.w, s.body, s.body_f, s.body_n, e, scratch);
  }

  /// Of other rates, after `bend_body` of this node's points: forces without the elastic ones and, of a sampled body,
  /// how its end moves.
  void bend_again(const Node& node, const double* constants, const S* q, const S* dq, const Ang& w, Lin& f, Ang& n,
                  Elastic<Sp>& e) {
    const double* points = numbers + node.points;
    typename Sp::Rigid body;
    if (node.body == Node::sampled) {
      sampled::sample<true>(Sp{}, node, points, q, dq, scratch);
      sampled::bend<true>(node, constants, points, q, dq, w, body, f, n, e, scratch);
    } else {
      bend<true>(node, constants, points, q, dq, w, body, f, n, e, scratch);
    }
  }

  template <bool rates>
  static void read_body(const double*& p, const Ang& w, typename Sp::Rigid& body, Lin& f, Ang& n) {
    const S m = next<S>(p);
    const Lin c = Sp::read(p);
    const typename Sp::Sym J = Sp::read_symmetric(p);
    body = {m, c, J};
    if constexpr (!rates) return;
    f = Sp::cross(w, Sp::cross(w, c));
    n = Sp::cross(w, Sp::apply(J, w));
  }

  /// v^T M v (J), after `move`.
  S twice_kinetic(const S* v) const {
    Lin u = Sp::zero();  // velocity of the frame before, at its end
    Ang w = Sp::zero_angular();
    S sum{};
    const auto add = [&](const typename Sp::Rigid& M, const Lin& a, const Ang& b) {
      sum += Sp::dot(a, Sp::force(M, a, b)) + Sp::dot(b, Sp::torque(M, a, b));
    };
    for (int i = 0; i < layout.nodes; ++i) {
      const Node& node = layout.node[i];
      const State<Sp>& s = state[i];
      if (!node.coincident) u = Sp::unrotate(s.R, u + Sp::cross(w, s.r));
      w = s.w;
      if (node.kind == Node::prismatic) Sp::component(u, node.axis) += node.sign * v[node.v];
      if (node.body) add(s.body, u, w);
      if (node.passive) sum += s.reflected * v[node.v] * v[node.v];
      if (node.ne == 0) continue;
      const Elastic<Sp>& e = s.elastic;
      const S* d = v + node.ve;
      for (int k = 0; k < node.ne; ++k) {
        S row = Sp::dot(e.M_linear[k], u) + Sp::dot(e.M_angular[k], w);
        for (int j = 0; j < k; ++j) row += e.M[packed(k, j)] * d[j];
        sum += d[k] * (2.0 * row + e.M[packed(k, k)] * d[k]);
      }
      u = Sp::unrotate(e.end.R, u + Sp::cross(w, e.end.x) + e.end.u_dot);
      w = s.end_w;
      if (node.tip) add(s.tip, u, w);
    }
    return sum;
  }

  template <bool biased, class V>
  static void carry_end(const Node& node, const Elastic<Sp>& e, const V* xe, typename SpaceOf<Sp, V>::type::Lin& a,
                        typename SpaceOf<Sp, V>::type::Ang& dw) {
    using Vs = typename SpaceOf<Sp, V>::type;
    a += Vs::cross(dw, widen_linear<Sp, V>(e.end.x));
    if constexpr (biased) {
      a += e.end.u_bias;
      dw += e.end.turn_bias;
    }
    for (int k = 0; k < node.ne; ++k) {
      a += xe[k] * widen_linear<Sp, V>(e.end.J_linear[k]);
      dw += xe[k] * widen_angular<Sp, V>(e.end.J_angular[k]);
    }
    const typename Vs::Rot R = widen_rotation<Sp, V>(e.end.R);
    a = Vs::unrotate(R, a);
    dw = Vs::unrotate_angular(R, dw);
  }

  /// Accelerations of all frames, of coordinates' accelerations x (Eq. 86); after `move`.
  void accelerate(const Lin& base, const S* x) {
    Lin a = base;
    Ang dw = Sp::zero_angular();
    for (int i = 0; i < layout.nodes; ++i) accelerate_node(i, x, a, dw);
  }
  /// a and dw are those of the frame before, at its end, and then of this node's end.
  void accelerate_node(int i, const S* x, Lin& a, Ang& dw) {
    const Node& node = layout.node[i];
    State<Sp>& s = state[i];
    if (!node.coincident) {
      a = Sp::unrotate(s.R, i == 0 ? a : a + Sp::cross(dw, s.r)) + s.bias_a;
      dw = Sp::unrotate_angular(s.R, dw) + s.bias_w;
    }
    if (node.kind == Node::revolute) Sp::angular_component(dw, node.axis) += node.sign * x[node.v];
    if (node.kind == Node::prismatic) Sp::component(a, node.axis) += node.sign * x[node.v];
    s.a = a;
    s.dw = dw;
    if (node.ne == 0) return;
    carry_end<true>(node, s.elastic, x + node.ve, a, dw);
    s.end_a = a;
    s.end_dw = dw;
  }

  /// Inverse dynamics after `move`: generalised forces of accelerations x (Eq. 84-87).
  void forces(const Lin& base, const S* x, S* tau) {
    accelerate(base, x);
    Lin f = Sp::zero();
    Ang n = Sp::zero_angular();
    for (int i = layout.nodes; i-- > 0;) {
      force_node(i, x, f, n, tau);
      if (i > 0) carry_inward(i, f, n);
    }
  }
  /// f and n are what the node's end carries, and then what goes through its joint, in its axes.
  void force_node(int i, const S* x, Lin& f, Ang& n, S* tau) {
    const Node& node = layout.node[i];
    State<Sp>& s = state[i];
    if (node.ne > 0) {
      const Elastic<Sp>& e = s.elastic;
      if (node.tip || node.loads > 0) {
        f += s.tip_f;
        n += s.tip_n;
      }
      if (node.tip) {
        f += Sp::force(s.tip, s.end_a, s.end_dw);
        n += Sp::torque(s.tip, s.end_a, s.end_dw);
      }
      f = Sp::rotate(e.end.R, f);
      n = Sp::rotate_angular(e.end.R, n);
      const S* xe = x + node.ve;
      for (int k = 0; k < node.ne; ++k) {
        S sum = e.e[k] + Sp::dot(e.end.J_linear[k], f) + Sp::dot(e.end.J_angular[k], n) + Sp::dot(e.M_linear[k], s.a) +
                Sp::dot(e.M_angular[k], s.dw);
        for (int j = 0; j < node.ne; ++j) sum += e.M[j <= k ? packed(k, j) : packed(j, k)] * xe[j];
        tau[node.ve + k] = sum;
      }
      n += Sp::moment(e.end.x, f);
      for (int k = 0; k < node.ne; ++k) {
        f += xe[k] * e.M_linear[k];
        n += xe[k] * e.M_angular[k];
      }
    }
    if (node.body) {
      f += s.body_f + Sp::force(s.body, s.a, s.dw);
      n += s.body_n + Sp::torque(s.body, s.a, s.dw);
    }
    s.f = f;  // what goes through the joint (Eq. 84)
    s.n = n;
    if (node.kind == Node::fixed) return;
    S own = node.kind == Node::revolute ? Sp::angular_component(n, node.axis) : Sp::component(f, node.axis);
    own *= node.sign;
    if (node.passive) own += s.resistance + s.reflected * x[node.v];
    tau[node.v] = own;
  }
  /// From a node's frame to the end of the frame before it.
  void carry_inward(int i, Lin& f, Ang& n) const {
    const State<Sp>& s = state[i];
    if (layout.node[i].coincident) return;
    f = Sp::rotate(s.R, f);
    n = Sp::rotate_angular(s.R, n) + Sp::moment(s.r, f);
  }
};

}  // namespace
