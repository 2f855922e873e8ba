// The recursive solvers over a chain of nodes, in the paper's order: outward positions and velocities (Eq. 82-83),
// inward articulated inertias and biases (Eq. 93-96), outward accelerations (Eq. 92); and inverse dynamics (Eq. 84-87).
// Velocities of origins never occur: accelerations are absolute, and a body's forces know only its angular velocity.
#pragma once

#include "lanes/ball.hpp"
#include "lanes/loads.hpp"

namespace {

constexpr double kSingular = 1e-14;  // parts of an inertia below which what a freedom moves is rounding
constexpr double kSoftEntry = 1e-3;  // rad or m past a stop over which its damping sets in

using flexarm::lanes::Shift;

template <class Sp>
struct State {
  using S = typename Sp::Scalar;
  typename Sp::Rot R;         ///< this frame in the frame before
  typename Sp::Lin r;         ///< and its place
  typename Sp::Ang w;         ///< angular velocity, own axes
  typename Sp::Rot attitude;  ///< in the world, where the layout asks for it
  typename Sp::Lin bias_a;    ///< acceleration beyond what is carried and what its freedom gives, own axes (Eq. 83)
  typename Sp::Ang bias_w;
  typename Sp::Rigid body;  ///< the node's own (Eq. 80)
  S sine, cosine;           ///< of a joint that turns
  typename Sp::Lin body_f;  ///< and its inertial force where nothing accelerates (Eq. 81)
  typename Sp::Ang body_n;
  S resistance, slope_q, slope_v, reflected;  ///< of the joint
  // the tip body
  typename Sp::Ang end_w;
  typename Sp::Rigid tip;
  typename Sp::Lin tip_f;
  typename Sp::Ang tip_n;
  // articulated
  typename Sp::Inertia M;  ///< as the frame before feels it
  typename Sp::Lin f;
  typename Sp::Ang n;
  typename Sp::Lin U_f;
  typename Sp::Ang U_n;
  S over_d, u;
  // accelerations
  typename Sp::Lin a, end_a;
  typename Sp::Ang dw, end_dw;
  Elastic<Sp> elastic;
};

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
      bytes += 3 * ne * (sizeof(Lin) + sizeof(Ang)) + 2 * (pairs + ne) * sizeof(S);
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
      S** const lists[] = {&e.e, &e.y};
      for (Lin** x : linear) *x = reinterpret_cast<Lin*>(take(ne * sizeof(Lin)));
      for (Ang** x : angular) *x = reinterpret_cast<Ang*>(take(ne * sizeof(Ang)));
      for (S** x : triangles) *x = reinterpret_cast<S*>(take(ne * (ne + 1) / 2 * sizeof(S)));
      for (S** x : lists) *x = reinterpret_cast<S*>(take(ne * sizeof(S)));
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
    constexpr std::size_t W = sizeof(P) / sizeof(S);
    std::size_t most = 3 * ((static_cast<std::size_t>(layout.nodes) + W - 1) / W);  // of turn_hinges
    for (int i = 0; i < layout.nodes; ++i)
      if (const std::size_t need = scratch_of(layout.node[i]); need > most) most = need;
    return most * sizeof(P);
  }

  /// Springs, dampers and stops; see Joint::resistance.
  static void resist(const Node& node, const double*& p, const S& q, const S& v, State<Sp>& s) {
    const S stiffness = next<S>(p), rest = next<S>(p), damping = next<S>(p);
    s.reflected = next<S>(p);
    s.resistance = stiffness * (q - rest) + damping * v;
    s.slope_q = stiffness;
    s.slope_v = damping;
    if (!node.stops) return;
    const S lower = next<S>(p), upper = next<S>(p), k = next<S>(p), d = next<S>(p), one = number<S>(1.0), o{};
    for (int side = 0; side < 2; ++side) {
      const S depth = side == 0 ? q - lower : q - upper;
      const auto hit = side == 0 ? depth < 0.0 : depth > 0.0;
      const S size = side == 0 ? -depth : depth, entry = size * (1.0 / kSoftEntry);
      const auto soft = entry < 1.0;
      const S part = Lanes<S>::select(soft, entry, one);
      const S push = k * depth + d * part * v;
      const S by_q = k + Lanes<S>::select(soft, d * v * ((side == 0 ? -1.0 : 1.0) / kSoftEntry), o);
      s.resistance += Lanes<S>::select(hit, push, o);
      s.slope_q += Lanes<S>::select(hit, by_q, o);
      s.slope_v += Lanes<S>::select(hit, d * part, o);
    }
    s.slope_q = Lanes<S>::select(s.slope_q < 0.0, o, s.slope_q);
  }

  /// The same of a ball, into the three nodes that it is.
  static void resist_ball(const Node& node, const double*& p, const S* q, const S* v, State<Sp>* s) {
    const S stiffness = next<S>(p);
    const BallTurn<S> turn(q);
    for (int k = 0; k < 3; ++k) {
      const S damping = next<S>(p);
      s[k].reflected = next<S>(p);
      s[k].resistance = stiffness * turn.vector[k] + damping * v[k];
      s[k].slope_q = stiffness;
      s[k].slope_v = damping;
    }
    if (!node.stops) return;
    const S upper = next<S>(p), stop_stiffness = next<S>(p), stop_damping = next<S>(p), one = number<S>(1.0), o{};
    const S depth = turn.angle - upper, entry = depth * (1.0 / kSoftEntry);
    const auto hit = depth > 0.0;
    const S over = 1.0 / Lanes<S>::select(hit, turn.angle, one);
    const S damping = stop_damping * Lanes<S>::select(entry < 1.0, entry, one);
    const S rate = over * (turn.vector[0] * v[0] + turn.vector[1] * v[1] + turn.vector[2] * v[2]);
    const S push = over * (stop_stiffness * depth + damping * rate);
    for (int k = 0; k < 3; ++k) {
      s[k].resistance += Lanes<S>::select(hit, push * turn.vector[k], o);
      s[k].slope_q += Lanes<S>::select(hit, stop_stiffness, o);
      s[k].slope_v += Lanes<S>::select(hit, damping, o);
    }
  }

  /// A ball's first node, on a frame that turns by w. @param p, q, v  its numbers, quaternion and rates
  void move_ball(const Node& node, const double*& p, const typename Sp::Rot& seat, const S* q, const S* v, const Ang& w,
                 State<Sp>& s) {
    if constexpr (!Sp::planar) {
      if (node.passive) resist_ball(node, p, q, v, &s);
      const typename Sp::Rot R = ball_rotation(q);
      s.R = node.turned ? Sp::times(seat, R) : R;
      const Ang carried = Sp::unrotate_angular(s.R, w), own{v[0], v[1], v[2]};
      s.w = carried + own;
      s.bias_a = Sp::unrotate(s.R, Sp::cross(w, Sp::cross(w, s.r)));
      s.bias_w = Sp::cross(carried, own);
    }
  }

  /// A node in the frame of the one before it.
  static void stay(const Ang& w, State<Sp>& s) {
    s.R = Sp::turn(0, S{}, number<S>(1.0));
    s.r = Sp::zero();
    s.w = w;
    s.bias_a = Sp::zero();
    s.bias_w = Sp::zero_angular();
  }

  static bool is_hinge(const Node& node) { return node.kind == Node::revolute && !node.ball && !node.coincident; }

  /// Sines and cosines of all hinges; of one arm, of several hinges at once.
  void turn_hinges(const S* q) {
    constexpr int W = sizeof(P) / sizeof(S);
    S* angle = reinterpret_cast<S*>(scratch);
    int count = 0;
    for (int i = 0; i < layout.nodes; ++i)
      if (const Node& node = layout.node[i]; is_hinge(node)) angle[count++] = node.sign * q[node.q];
    while (count % W != 0) angle[count++] = S{};
    P *sines = scratch + count / W, *cosines = sines + count / W;
    for (int k = 0; k < count / W; ++k) sine_cosine(scratch[k], sines[k], cosines[k]);
    const S *sine = reinterpret_cast<S*>(sines), *cosine = reinterpret_cast<S*>(cosines);
    for (int i = 0; i < layout.nodes; ++i)
      if (is_hinge(layout.node[i])) {
        state[i].sine = *sine++;
        state[i].cosine = *cosine++;
      }
  }

  /// A hinge, or a slide, or neither, seated on a frame that turns by w.
  template <bool rates>
  static void move_joint(const Node& node, const typename Sp::Rot& seat, const S* q, const S* v, const Ang& w,
                         State<Sp>& s) {
    const S &sn = s.sine, &cs = s.cosine;
    const bool hinge = node.kind == Node::revolute, slide = node.kind == Node::prismatic;
    s.R = !hinge ? seat : node.turned ? Sp::turned(seat, node.axis, sn, cs) : Sp::turn(node.axis, sn, cs);
    if (slide) {
      Lin along = Sp::zero();
      Sp::component(along, node.axis) += node.sign * q[node.q];
      s.r += Sp::rotate(s.R, along);
    }
    if constexpr (rates) {
      const Ang carried = Sp::unrotate_angular(s.R, w);
      s.w = carried;
      s.bias_a = Sp::unrotate(s.R, Sp::cross(w, Sp::cross(w, s.r)));
      s.bias_w = Sp::zero_angular();
      if (hinge) {
        Ang own = Sp::zero_angular();
        Sp::angular_component(own, node.axis) += node.sign * v[node.v];
        s.w += own;
        s.bias_w = Sp::cross(carried, own);
      } else if (slide) {
        Lin rate = Sp::zero();
        Sp::component(rate, node.axis) += 2.0 * (node.sign * v[node.v]);
        s.bias_a += Sp::cross(carried, rate);
      }
    }
  }

  /// Places, velocities, own inertias and bias forces of all nodes; or places and velocities alone. Without rates: of
  /// an arm at rest, whose bias forces are not needed.
  template <bool rates = true, bool forces = true>
  void move(const S* q, const S* v) {
    static const S none[kMostElastic]{};
    turn_hinges(q);
    Ang w = Sp::zero_angular();
    typename Sp::Rot attitude = Sp::turn(0, S{}, number<S>(1.0));
    for (int i = 0; i < layout.nodes; ++i) {
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
        move_ball(node, p, seat, q + node.q, rates ? v + node.v : none, w, s);
      } else {
        move_joint<rates>(node, seat, q, v, w, s);
      }
      if constexpr (!rates) s.w = w;  // none
      w = s.w;
      if (layout.attitudes) attitude = s.attitude = node.coincident ? attitude : Sp::times(attitude, s.R);
      if (node.ne > 0) {
        Elastic<Sp>& e = s.elastic;
        bend_body<forces>(node, p, gravity_in(attitude), q + node.qe, rates ? v + node.ve : none, s);
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
      sampled::sample(Sp{}, node, points, q, dq, scratch);
      sampled::bend(node, constants, points, q, dq, s.w, s.body, s.body_f, s.body_n, e, scratch);
      return;
    }
    move_slice(node, numbers + node.end, q, dq, e.end);
    if constexpr (!forces) return;
    if (node.body == Node::cut)
      bend_cut<Sp>(node, constants, gravity, q, dq, s.w, s.body, s.body_f, s.body_n, e);
    else
      bend(node, constants, points, q, dq, s.w, s.body, s.body_f, s.body_n, e, scratch);
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

  /// Inward: articulated inertias and their factors, or articulated forces, or both.
  /// @return where every pivot is positive; where not, `lost` says why
  template <bool inertia, bool forces, bool biased>
  Mask inward(const S* tau, const S* given, const Shift& shift) {
    Mask good = Lanes<S>::everywhere(true);
    lost = Lanes<S>::everywhere(false);
    typename Sp::Inertia M = Sp::no_inertia();  // of what follows, in the axes of this node's end, about its end
    Lin f = Sp::zero();
    Ang n = Sp::zero_angular();
    for (int i = layout.nodes; i-- > 0;) {
      const Node& node = layout.node[i];
      State<Sp>& s = state[i];
      if (node.ne > 0) {
        if constexpr (inertia)
          if (node.tip) Sp::add(M, s.tip);
        if constexpr (forces && biased)
          if (node.tip || node.loads > 0) {
            f += s.tip_f;
            n += s.tip_n;
          }
        condense<inertia, forces, biased>(node, s, M, f, n, tau, shift, good);
      } else {
        if constexpr (inertia)
          if (node.body) Sp::add(M, s.body);
        if constexpr (forces && biased)
          if (node.body) {
            f += s.body_f;
            n += s.body_n;
          }
      }
      // the joint (Eq. 93-96)
      const bool about = node.kind == Node::revolute;
      if (node.kind != Node::fixed && !node.given) {
        if constexpr (inertia) {
          Sp::column(M, about, node.axis, s.U_f, s.U_n);
          S d = about ? Sp::angular_component(s.U_n, node.axis) : Sp::component(s.U_f, node.axis);
          if (node.passive) d += s.reflected + shift.damping * s.slope_v + shift.stiffness * s.slope_q;
          accept(d, kSingular * Sp::trace(M, about), good);
          s.over_d = 1.0 / d;
          Sp::take(M, s.over_d, s.U_f, s.U_n);
          if (!node.passive)
            Sp::clear(M, about, node.axis);  // M~ H = 0: not even rounding, of which much would be left
        }
        if constexpr (forces) {
          const S applied = node.sign * tau[node.v];
          S u = applied - (about ? Sp::angular_component(n, node.axis) : Sp::component(f, node.axis));
          if constexpr (biased)
            if (node.passive) u -= node.sign * s.resistance;
          s.u = s.over_d * u;
          f += s.u * s.U_f;
          n += s.u * s.U_n;
          if (!node.passive) (about ? Sp::angular_component(n, node.axis) : Sp::component(f, node.axis)) = applied;
        }
      }
      if constexpr (inertia && forces && biased)
        if (!node.coincident || node.given) {
          Lin a = s.bias_a;
          Ang dw = s.bias_w;
          if (node.kind != Node::fixed && node.given)  // what is prescribed is part of the bias
            (about ? Sp::angular_component(dw, node.axis) : Sp::component(a, node.axis)) += node.sign * given[node.v];
          f += Sp::force(M, a, dw);
          n += Sp::torque(M, a, dw);
        }
      if (i == 0) break;
      if (node.coincident) continue;
      if constexpr (inertia)
        M = Sp::shift(
            about && !node.turned && !node.ball ? Sp::rotate(node.axis, s.sine, s.cosine, M) : Sp::rotate(s.R, M), s.r);
      if constexpr (forces) {
        f = Sp::rotate(s.R, f);
        n = Sp::rotate_angular(s.R, n) + Sp::moment(s.r, f);
      }
    }
    return good;
  }

  /// A pivot, which must be above the least.
  void accept(const S& d, const S& least, Mask& good) {
    const Mask above = d > least;
    if (!Lanes<S>::all(above)) lost = lost | (good & Lanes<S>::none_of(above | Lanes<S>::finite(d + least)));
    good = good & above;
  }

  /// The elastic coordinates of a node: its own inertia with what its end carries, then without its coordinates.
  template <bool inertia, bool forces, bool biased>
  void condense(const Node& node, State<Sp>& s, typename Sp::Inertia& M, Lin& f, Ang& n, const S* tau,
                const Shift& shift, Mask& good) {
    Elastic<Sp>& e = s.elastic;
    const int ne = node.ne;
    if constexpr (forces) {
      f = Sp::rotate(e.end.R, f);
      n = Sp::rotate_angular(e.end.R, n);
    }
    if constexpr (inertia) {
      const typename Sp::Inertia carried = Sp::rotate(e.end.R, M);
      M = Sp::shift(carried, e.end.x);
      if constexpr (forces && biased) {
        f += Sp::force(carried, e.end.u_bias, e.end.turn_bias);
        n += Sp::torque(carried, e.end.u_bias, e.end.turn_bias);
      }
      for (int k = 0; k < ne; ++k) {
        const Lin g = Sp::force(carried, e.end.J_linear[k], e.end.J_angular[k]);
        const Ang h = Sp::torque(carried, e.end.J_linear[k], e.end.J_angular[k]);
        for (int j = 0; j <= k; ++j)
          e.L[packed(k, j)] = e.M[packed(k, j)] + (Sp::dot(e.end.J_linear[j], g) + Sp::dot(e.end.J_angular[j], h));
        e.W_linear[k] = e.M_linear[k] + g;
        e.W_angular[k] = e.M_angular[k] + (h + Sp::moment(e.end.x, g));
      }
      Sp::add(M, s.body);
      if (shift.stiffness != 0.0 || shift.damping != 0.0) {
        const double* K = e.constants;
        for (int k = 0; k < ne * (ne + 1) / 2; ++k) e.L[k] += shift.stiffness * next<S>(K);
        if (node.damped)
          for (int k = 0; k < ne * (ne + 1) / 2; ++k) e.L[k] += shift.damping * next<S>(K);
      }
      // M = L D L^T in e.L: below the diagonal L, on it 1/D; W = L^-1 M_er
      for (int k = 0; k < ne; ++k) {
        S d = e.L[packed(k, k)];
        for (int j = 0; j < k; ++j) {
          S l = e.L[packed(k, j)];
          for (int i = 0; i < j; ++i) l -= e.L[packed(k, i)] * e.L[packed(j, i)];
          e.L[packed(k, j)] = l;  // L D still
        }
        Lin wl = e.W_linear[k];
        Ang wa = e.W_angular[k];
        for (int j = 0; j < k; ++j) {
          const S ld = e.L[packed(k, j)], l = ld * e.L[packed(j, j)];
          d -= l * ld;
          e.L[packed(k, j)] = l;
          wl = wl - l * e.W_linear[j];
          wa = wa - l * e.W_angular[j];
        }
        accept(d, S{}, good);
        const S over = 1.0 / d;
        e.L[packed(k, k)] = over;
        e.W_linear[k] = wl;
        e.W_angular[k] = wa;
        Sp::take(M, over, wl, wa);
      }
    }
    if constexpr (forces) {
      for (int k = 0; k < ne; ++k) {
        S y = tau[node.ve + k] - (Sp::dot(e.end.J_linear[k], f) + Sp::dot(e.end.J_angular[k], n));
        if constexpr (biased) y -= e.e[k];
        for (int j = 0; j < k; ++j) y -= e.L[packed(k, j)] * e.y[j];
        e.y[k] = y;
      }
      n += Sp::moment(e.end.x, f);
      if constexpr (biased) {
        f += s.body_f;
        n += s.body_n;
      }
      for (int k = 0; k < ne; ++k) {
        e.y[k] *= e.L[packed(k, k)];
        f += e.y[k] * e.W_linear[k];
        n += e.y[k] * e.W_angular[k];
      }
    }
  }

  /// Outward: accelerations, into x, which holds those that are given. Without biases, of what solve_shifted asks for.
  template <bool biased>
  void outward(const Lin& base, S* x) {
    Lin a = base;  // of the frame before, at its end
    Ang dw = Sp::zero_angular();
    for (int i = 0; i < layout.nodes; ++i) {
      const Node& node = layout.node[i];
      State<Sp>& s = state[i];
      if (!node.coincident) {
        const Lin at = i == 0 ? a : a + Sp::cross(dw, s.r);
        a = Sp::unrotate(s.R, at);
        dw = Sp::unrotate_angular(s.R, dw);
      }
      if constexpr (biased) {
        a += s.bias_a;
        dw += s.bias_w;
      }
      if (node.kind != Node::fixed) {
        if (!node.given) x[node.v] = node.sign * (s.u - s.over_d * (Sp::dot(s.U_f, a) + Sp::dot(s.U_n, dw)));
        const S qdd = node.sign * x[node.v];
        (node.kind == Node::revolute ? Sp::angular_component(dw, node.axis) : Sp::component(a, node.axis)) += qdd;
      }
      if (node.ne == 0) continue;
      Elastic<Sp>& e = s.elastic;
      S* xe = x + node.ve;
      for (int k = node.ne; k-- > 0;) {  // L^T x = y - D^-1 W A
        S value = e.y[k] - e.L[packed(k, k)] * (Sp::dot(e.W_linear[k], a) + Sp::dot(e.W_angular[k], dw));
        for (int j = k + 1; j < node.ne; ++j) value -= e.L[packed(j, k)] * xe[j];
        xe[k] = value;
      }
      if (i + 1 < layout.nodes) carry_end<biased>(node, e, xe, a, dw);
    }
  }

  template <bool biased>
  static void carry_end(const Node& node, const Elastic<Sp>& e, const S* xe, Lin& a, Ang& dw) {
    a += Sp::cross(dw, e.end.x);
    if constexpr (biased) {
      a += e.end.u_bias;
      dw += e.end.turn_bias;
    }
    for (int k = 0; k < node.ne; ++k) {
      a += xe[k] * e.end.J_linear[k];
      dw += xe[k] * e.end.J_angular[k];
    }
    a = Sp::unrotate(e.end.R, a);
    dw = Sp::unrotate_angular(e.end.R, dw);
  }

  /// Accelerations of all frames, of coordinates' accelerations x (Eq. 86); after `move`.
  void accelerate(const Lin& base, const S* x) {
    Lin a = base;
    Ang dw = Sp::zero_angular();
    for (int i = 0; i < layout.nodes; ++i) {
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
      if (node.ne == 0) continue;
      carry_end<true>(node, s.elastic, x + node.ve, a, dw);
      s.end_a = a;
      s.end_dw = dw;
    }
  }

  /// Inverse dynamics after `move`: generalised forces of accelerations x (Eq. 84-87).
  void forces(const Lin& base, const S* x, S* tau) {
    accelerate(base, x);
    Lin f = Sp::zero();
    Ang n = Sp::zero_angular();
    for (int i = layout.nodes; i-- > 0;) {
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
          S sum = e.e[k] + Sp::dot(e.end.J_linear[k], f) + Sp::dot(e.end.J_angular[k], n) +
                  Sp::dot(e.M_linear[k], s.a) + Sp::dot(e.M_angular[k], s.dw);
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
      if (node.kind != Node::fixed) {
        S own = node.kind == Node::revolute ? Sp::angular_component(n, node.axis) : Sp::component(f, node.axis);
        own *= node.sign;
        if (node.passive) own += s.resistance + s.reflected * x[node.v];
        tau[node.v] = own;
      }
      if (i == 0) break;
      if (node.coincident) continue;
      f = Sp::rotate(s.R, f);
      n = Sp::rotate_angular(s.R, n) + Sp::moment(s.r, f);
    }
  }
};

}  // namespace
