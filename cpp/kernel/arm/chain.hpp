// A tree of nodes in motion: outward positions and velocities (Eq. 82-83), and inverse dynamics (Eq. 84-87); forward
// dynamics goes on from there (elimination.hpp). Each recursion walks along the list of nodes, outward or inward, and
// carries its values from one to the next. Where a branch begins it takes or leaves them at the parent (forks.hpp).
// Velocities of origins never occur: accelerations are absolute, and a body's forces know only its angular velocity.
#pragma once

#include "arm/by_state.hpp"
#include "arm/forks.hpp"
#include "beam/loads.hpp"
#include "wide/arena.hpp"

namespace {

/// All of one arm (or of one for each lane) in motion: its nodes in their order, of a tree as of a chain.
template <class Sp, class P>
struct Chain {
  using Space = Sp;
  using S = typename Sp::Scalar;
  using Wide = P;  ///< S, or of one arm packs of it
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
  S* kept;           ///< numbers of a body, while others of the pack are found
  Fork<Sp, P>* fork;
  ByState<Chain>* by_state = nullptr;  ///< of an arm that has such forces
  bool stiffened = false;              ///< whether the factors are those of a matrix with slopes of them

  Chain(const Layout& layout_, const double* numbers_, Arena& arena) : layout(layout_), numbers(numbers_) {
    arena.take(most_scratch(layout), scratch);  // first, as the memory is aligned for P
    arena.take(layout.forks, fork);
    P* wide;
    arena.take(ByState<Chain>::scratch(layout), wide);
    for (int k = 0; k < layout.forks; ++k) {
      Slice<Sp> counted;
      arena.take(layout.node[layout.fork[k].place.node].ne, (arena.counts() ? counted : fork[k].slice).J);
    }
    arena.take(layout.nodes, state);
    for (int i = 0; i < layout.nodes; ++i) {
      Elastic<Sp> counted;
      Elastic<Sp>& e = arena.counts() ? counted : state[i].elastic;
      const int ne = layout.node[i].ne;
      arena.take(ne, e.end.J);
      arena.take(ne, e.M_er, e.W);
      arena.take(ne * (ne + 1) / 2, e.M, e.L);
      arena.take(ne, e.e);
    }
    arena.take(1, slice);
    Slice<Sp> counted;
    Slice<Sp>& s = arena.counts() ? counted : *slice;
    arena.take(most_elastic(layout), s.J);
    arena.take_zeros(6 * layout.loads, wrench);
    arena.take(kept_numbers(layout), kept);
    if (!layout.by_state()) return;
    by_state = arena.take_lines<ByState<Chain>>(1);
    arena.take_lines<char>(0);  // the next numbers begin a line, too
    ByState<Chain> none;
    (arena.counts() ? none : *by_state).lay_out(layout, most_elastic(layout), wide, arena);
  }
  Chain(const Layout& layout_, const double* numbers_, Arena&& arena) : Chain(layout_, numbers_, arena) {}
  /// The acceleration of the base that stands for gravity.
  typename Sp::Lin base() const {
    const double* p = numbers;
    return Sp::read(p);
  }
  /// Bytes, aligned for P.
  static std::size_t memory_needed(const Layout& layout) {
    Arena none;
    Chain(layout, nullptr, none);
    return none.bytes();
  }
  static int kept_numbers(const Layout& layout) {
    const int ne = most_elastic(layout), each = 1 + 2 * (Sp::linear + Sp::angular) + (ne + 1) / 2;
    return Lanes<S>::width > 1 ? static_cast<int>(sizeof(State<Sp>) / sizeof(S)) + ne * (each + 1) : 0;
  }
  static int most_elastic(const Layout& layout) {
    int most = 0;
    for (int i = 0; i < layout.nodes; ++i) most = layout.node[i].ne > most ? layout.node[i].ne : most;
    return most;
  }
  static int most_scratch(const Layout& layout) {
    std::size_t most = hinge_scratch<S, P>(layout);
    for (int i = 0; i < layout.nodes; ++i)
      if (const std::size_t need = scratch_of(layout.node[i]); need > most) most = need;
    return static_cast<int>(most);
  }

  /// Places, velocities, own inertias and bias forces of all nodes; or places and velocities alone. Without rates: of
  /// an arm at rest, whose bias forces are not needed.
  template <bool rates = true, bool forces = true>
  void move(const S* q, const S* v) {
    turn_hinges(layout, 0, layout.nodes, q, state, scratch);
    Ang w = Sp::zero_angular();
    typename Sp::Rot attitude = Sp::turn(0, S{}, number<S>(1.0));
    for (int i = 0; i < layout.nodes; ++i) {
      if (layout.node[i].branch) start_branch(i, w, attitude);
      move_node<rates, forces>(
          i, q, v, w, attitude, [&](const Node& node, const double* constants, const Lin& gravity) {
            bend_body<forces>(node, constants, gravity, q + node.qe, rates ? v + node.ve : none(), state[i]);
          });
    }
    if constexpr (rates && forces)
      if (layout.by_state()) push_by_state(q, v);
  }
  void push_by_state(const S* q, const S* v) {
    by_state->find(*this, q, v);
    by_state->act(*this, 1.0);
  }
  /// The seat of node i, where a recursion begins with it: w and attitude there.
  void start_branch(int i, Ang& w, typename Sp::Rot& attitude) const {
    const int parent = layout.node[i].parent;
    w = Sp::zero_angular();
    attitude = Sp::turn(0, S{}, number<S>(1.0));
    if (parent < 0) return;
    const Seat seat = seat_of(layout.node[i]);
    w = seat.w;
    if (!layout.attitudes) return;
    const typename Sp::Rot& link = state[parent].attitude;
    attitude = seat.slice ? Sp::times(link, seat.slice->frame.R) : link;
  }
  /// The seat of a node that does not sit on the world: a slice of its parent's beam, or none; how that turns and
  /// accelerates.
  struct Seat {
    const Slice<Sp>* slice;
    const Ang& w;
    const Motion<Sp>& a;
  };
  Seat seat_of(const Node& node) const {
    const State<Sp>& s = state[node.parent];
    if (const Fork<Sp, P>* f = slice_under(node)) return {&f->slice, f->w, f->a};
    if (layout.node[node.parent].ne > 0) return {&s.elastic.end, s.end_w, s.end_a};
    return {nullptr, s.w, s.a};
  }
  /// The fork on a slice that a node sits on, or null: it sits on an end, or on the world.
  const Fork<Sp, P>* slice_under(const Node& node) const { return layout.on_slice(node) ? fork + node.seat : nullptr; }
  template <class Any>
  static void add(Any& sum, const Any& other) {
    Fork<Sp, P>::add(sum, other);
  }
  /// visit(fork) of those on slices of a node's beam. Recursions call it out of line, so that chains do without.
  template <class Visit>
  void for_slices(const Node& node, const Visit& visit) const {
    for (int k = 0; k < node.slices; ++k) visit(fork[node.slice[k]]);
  }

  /// One node, after its hinge was turned. w and attitude are those of the frame before it, and then of its end.
  /// @param bend  makes the elastic body and its end slice, of (node, constants, gravity)
  template <bool rates, bool forces, class Bend>
  void move_node(int i, const S* q, const S* v, Ang& w, typename Sp::Rot& attitude, const Bend& bend) {
    const double* p = numbers + layout.node[i].numbers;
    move_frame<rates>(i, p, q, v, w, attitude);
    move_body<rates, forces>(i, p, q, v, w, attitude, bend);
  }
  /// The node's frame. @param p  its numbers, and then those of its body
  template <bool rates>
  void move_frame(int i, const double*& p, const S* q, const S* v, Ang& w, typename Sp::Rot& attitude) {
    const Node& node = layout.node[i];
    State<Sp>& s = state[i];
    typename Sp::Rot seat = Sp::turn(0, S{}, number<S>(1.0));
    if (!node.coincident) {
      s.frame.r = Sp::read(p);
      if (node.turned) seat = read<typename Sp::Rot, S>(p);
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
    if (layout.attitudes) attitude = s.attitude = node.coincident ? attitude : Sp::times(attitude, s.frame.R);
  }
  /// Its body, of which `p` are the numbers, and the frame of its end.
  template <bool rates, bool forces, class Bend>
  void move_body(int i, const double* p, const S* q, const S* v, Ang& w, typename Sp::Rot& attitude, const Bend& bend) {
    const Node& node = layout.node[i];
    State<Sp>& s = state[i];
    if (node.ne > 0) {
      Elastic<Sp>& e = s.elastic;
      bend(node, p, gravity_in(attitude));
      if (node.slices > 0) move_slices(node, q + node.qe, rates ? v + node.ve : none(), s.w);
      w = s.end_w = carry(e.end, s.w);
      if (layout.attitudes) attitude = Sp::times(attitude, e.end.frame.R);
      s.tip_force = Force<Sp>::zero();
      if (forces && node.tip) {
        const double* t = numbers + node.tip_body;
        read_body<rates>(t, w, s.tip, s.tip_force);
      }
    } else if (forces && node.body) {
      read_body<rates>(p, s.w, s.body, s.body_force);
    }
    if constexpr (rates && forces)
      if (node.loads > 0)
        subtract_loads(layout, node, wrench, attitude, numbers + node.points, q + node.qe, v + node.ve, s, *slice,
                       scratch);
  }
  /// As `move`, of arms side by side whose elastic bodies are, but for those in `own`, the same in all lanes and for
  /// all that share `shared`, at one state. Such a body is bent there, once, where it turns at the same rate.
  /// @param known  whether it has been; of each node
  void move_beside(const S* q, const S* v, const bool* own, State<Sp>* shared, bool* known) {
    turn_hinges(layout, 0, layout.nodes, q, state, scratch);
    Ang w = Sp::zero_angular();
    typename Sp::Rot attitude = Sp::turn(0, S{}, number<S>(1.0));
    for (int i = 0; i < layout.nodes; ++i) {
      const Node& node = layout.node[i];
      State<Sp>& s = state[i];
      const double* p = numbers + node.numbers;
      if (node.branch) start_branch(i, w, attitude);
      move_frame<true>(i, p, q, v, w, attitude);
      const bool keeps = node.ne > 0 && !own[i] && !known[i];
      if (node.ne > 0 && !own[i] && known[i] && same(s.w, shared[i].w)) {
        s.body = shared[i].body;
        s.body_force = shared[i].body_force;
        s.end_w = w = shared[i].end_w;
        s.tip = shared[i].tip;
        s.tip_force = shared[i].tip_force;
        s.elastic = shared[i].elastic;
        if (layout.attitudes) attitude = Sp::times(attitude, s.elastic.end.frame.R);
        continue;
      }
      if (keeps) s.elastic = shared[i].elastic;  // into its columns
      move_body<true, true>(i, p, q, v, w, attitude, [&](const Node& on, const double* constants, const Lin& gravity) {
        bend_body<true>(on, constants, gravity, q + on.qe, v + on.ve, s);
      });
      if (!keeps) continue;
      shared[i] = s;
      known[i] = true;
    }
    if (layout.by_state()) push_by_state(q, v);
  }
  static bool same(const Ang& a, const Ang& b) {
    const S *x = view<const S>(&a), *y = view<const S>(&b);
    bool all = true;
    for (int k = 0; k < Sp::angular; ++k) all = all && Lanes<S>::all(x[k] == y[k]);
    return all;
  }
  /// Those of a node's beam that branches sit on, after the beam was bent.
  [[gnu::noinline]] void move_slices(const Node& node, const S* q, const S* dq, const Ang& w) {
    for (int k = 0; k < node.slices; ++k) {
      Fork<Sp, P>& f = fork[node.slice[k]];
      const double* p = layout.place_numbers + layout.fork[node.slice[k]].numbers * Lanes<S>::width;
      slice_at(node, p, numbers + node.points, q, dq, scratch, f.slice);
      f.w = carry(f.slice, w);
    }
  }
  /// A node moves with the slice that it sits on (Eq. 45, 46), in a link that turns by w. @return how that turns
  static Ang carry(Slice<Sp>& at, const Ang& w) {
    at.bias = convective(at, w) + at.bias;
    return Sp::unrotate_angular(at.frame.R, w + at.rate.angular);
  }
  /// Rates of elastic coordinates that rest.
  static const S* none() {
    static const S zeros[kMostElastic]{};
    return zeros;
  }

  /// Whether a place moves with the end of a beam.
  static bool on_end(const Layout& layout, const Place& place) {
    return place.on == Place::end && layout.node[place.node].ne > 0;
  }
  /// A place as a slice of its node's frame, or of its beam's end.
  /// @param sampled  whether the beam was sampled, for the place before
  Slice<Sp>& slice_of(const Place& at, const double* place_numbers, const S* q, const S* v, bool sampled = false) {
    const Node& node = layout.node[at.node];
    if (at.on != Place::slice) {
      fixed_slice(place_numbers, *slice);
      return *slice;
    }
    const double* points = numbers + node.points;
    if (node.body == Node::sampled_beam && !sampled)
      ::sampled::sample(Sp{}, node, points, q + node.qe, v + node.ve, scratch);
    slice_at(node, place_numbers, points, q + node.qe, v + node.ve, scratch, *slice);
    return *slice;
  }

  /// Acceleration of a slice in a link that turns by w, beyond the link's and that of coordinates (Eq. 45, 46).
  static Motion<Sp> convective(const Slice<Sp>& at, const Ang& w) {
    return {Sp::cross(w, Sp::cross(w, at.frame.r) + number<S>(2.0) * at.rate.linear), Sp::cross(w, at.rate.angular)};
  }

  /// Gravity in the axes of a frame: the base accelerates against it.
  Lin gravity_in(const typename Sp::Rot& attitude) const { return number<S>(-1.0) * Sp::unrotate(attitude, base()); }
  /// The end slice of an elastic body, its inertia and its forces; or the slice alone.
  template <bool forces>
  void bend_body(const Node& node, const double* constants, const Lin& gravity, const S* q, const S* dq, State<Sp>& s) {
    Elastic<Sp>& e = s.elastic;
    const double* points = numbers + node.points;
    if (node.body == Node::sampled_beam) return bend_sampled<forces>(node, constants, q, dq, s);
    move_slice(node, numbers + node.end, q, dq, e.end);
    if constexpr (!forces) return;
    if (node.body == Node::cut)
      bend_cut<Sp>(node, constants, gravity, q, dq, s.w, s.body, s.body_force, e);
    else
      bend(node, constants, points, q, dq, s.w, s.body, s.body_force, e, scratch);
  }

  /// Where few points are enough.
  Mask is_small(const Node& node, const S* q) const {
    if (!node.sampled.few) return Lanes<S>::everywhere(false);
    const double* p = numbers + node.bounds;
    S sum{};
    for (int k = 0; k < node.ne; ++k) sum += next<S>(p) * Lanes<S>::size(q[k]);
    return sum < 1.0;  // NaN is not
  }
  /// With few points where these are enough. In lanes, each arm by itself: no bit depends on who shares the pack.
  template <bool forces>
  void bend_sampled(const Node& node, const double* constants, const S* q, const S* dq, State<Sp>& s) {
    const Mask small = is_small(node, q);
    const bool all = Lanes<S>::all(small), none = Lanes<S>::all(Lanes<S>::none_of(small));
    for (int round = 0; round < 2; ++round) {
      const bool few = round == 0;
      if (few ? none : all) continue;
      const Node& on = few ? *node.sampled.few : node;
      const double* points = numbers + on.points;
      sampled::sample(Sp{}, on, points, q, dq, scratch);
      if constexpr (forces)
        sampled::bend(on, constants, points, q, dq, s.w, s.body, s.body_force, s.elastic, scratch);
      else
        sampled::move_end(on, points, q, dq, s.elastic.end, scratch);
      if constexpr (Lanes<S>::width > 1)
        if (!all && !none) few ? keep_body(node, s) : put_back(node, small, s);
    }
  }

  /// visit(x, n) for the numbers that `bend_sampled` finds.
  template <class Visit>
  static void body_numbers(const Node& node, State<Sp>& s, const Visit& visit) {
    const auto one = [&](auto& x) { visit(view<S>(&x), sizeof(x) / sizeof(S)); };
    const auto list = [&](auto* x, int n) { visit(view<S>(x), static_cast<std::size_t>(n) * sizeof(*x) / sizeof(S)); };
    Elastic<Sp>& e = s.elastic;
    one(s.body);
    one(s.body_force);
    one(e.end.frame);
    one(e.end.rate);
    one(e.end.bias);
    list(e.end.J, node.ne);
    list(e.M_er, node.ne);
    list(e.M, node.ne * (node.ne + 1) / 2);
    list(e.e, node.ne);
  }
  void keep_body(const Node& node, State<Sp>& s) {
    S* at = kept;
    body_numbers(node, s, [&](S* x, std::size_t n) {
      for (std::size_t i = 0; i < n; ++i) *at++ = x[i];
    });
  }
  void put_back(const Node& node, const Mask& where, State<Sp>& s) {
    const S* at = kept;
    body_numbers(node, s, [&](S* x, std::size_t n) {
      for (std::size_t i = 0; i < n; ++i) x[i] = Lanes<S>::select(where, *at++, x[i]);
    });
  }

  template <bool rates>
  static void read_body(const double*& p, const Ang& w, typename Sp::Rigid& body, Force<Sp>& F) {
    const auto [m, c, J] = read<records::Body<Sp>>(p);
    body = {m, c, J};
    if constexpr (!rates) return;
    F = {Sp::cross(w, Sp::cross(w, c)), Sp::cross(w, Sp::apply(J, w))};
  }

  /// v^T M v (J), after `move`.
  S twice_kinetic(const S* v) const {
    Motion<Sp> u = Motion<Sp>::zero();  // velocity of the frame before, at its end
    S sum{};
    for (int i = 0; i < layout.nodes; ++i) {
      const Node& node = layout.node[i];
      const State<Sp>& s = state[i];
      if (node.branch) u = node.seat < 0 ? Motion<Sp>::zero() : fork[node.seat].template motion<Sp>();
      if (!node.coincident) u.linear = Sp::unrotate(s.frame.R, s.frame.shift(u).linear);
      u.angular = s.w;
      if (node.kind == Node::prismatic) Sp::component(u.linear, node.axis) += node.sign * v[node.v];
      if (node.body) sum += dot(u, s.body * u);
      if (node.passive) sum += s.reflected * v[node.v] * v[node.v];
      if (node.ne > 0) {
        const Elastic<Sp>& e = s.elastic;
        const S* d = v + node.ve;
        for (int k = 0; k < node.ne; ++k) {
          S row = dot(u, e.M_er[k]);
          for (int j = 0; j < k; ++j) row += e.M[packed(k, j)] * d[j];
          sum += d[k] * (2.0 * row + e.M[packed(k, k)] * d[k]);
        }
        const auto of = [&](const Slice<Sp>& at, const Ang& w) -> Motion<Sp> {
          return {Sp::unrotate(at.frame.R, at.frame.shift(u).linear + at.rate.linear), w};
        };
        for_slices(node, [&](Fork<Sp, P>& f) { f.template motion<Sp>() = of(f.slice, f.w); });
        u = of(e.end, s.end_w);
        if (node.tip) sum += dot(u, s.tip * u);
      }
      if (node.fork >= 0) fork[node.fork].template motion<Sp>() = u;
    }
    return sum;
  }

  /// From a node's frame to a slice of its beam, whose coordinates accelerate by xe (Eq. 45, 46).
  template <bool biased, class V>
  static auto to_slice(const Node& node, const Slice<Sp>& at, const V* xe, Motion<typename SpaceOf<Sp, V>::type> a) {
    const auto frame = wide<V>(at.frame);
    a = frame.shift(a);
    if constexpr (biased) a += at.bias;
    for (int k = 0; k < node.ne; ++k) a += xe[k] * wide<V>(at.J[k]);
    return frame.turn(a);
  }

  /// Accelerations of all frames, of coordinates' accelerations x (Eq. 86); after `move`.
  void accelerate(const Lin& base, const S* x) {
    Motion<Sp> a{base, Sp::zero_angular()};
    for (int i = 0; i < layout.nodes; ++i) {
      if (layout.node[i].branch) a = seat_acceleration(i, base);
      accelerate_node(i, x, a);
    }
  }
  /// Of the place where node i sits.
  Motion<Sp> seat_acceleration(int i, const Lin& base) const {
    if (layout.node[i].parent < 0) return {base, Sp::zero_angular()};
    return seat_of(layout.node[i]).a;
  }
  /// a is that of the frame before, at its end, and then of this node's end.
  void accelerate_node(int i, const S* x, Motion<Sp>& a) {
    const Node& node = layout.node[i];
    State<Sp>& s = state[i];
    if (!node.coincident) a = s.frame.to_child(a) + s.bias;
    if (node.kind != Node::fixed) freedom(node, a) += node.sign * x[node.v];
    s.a = a;
    if (node.ne == 0) return;
    if (node.slices > 0) accelerate_slices(node, x + node.ve, a);
    s.end_a = a = to_slice<true>(node, s.elastic.end, x + node.ve, a);
  }

  [[gnu::noinline]] void accelerate_slices(const Node& node, const S* xe, Motion<Sp> a) {
    for_slices(node, [&](Fork<Sp, P>& f) { f.a = to_slice<true>(node, f.slice, xe, a); });
  }

  /// Inverse dynamics after `move`: generalised forces of accelerations x (Eq. 84-87).
  void forces(const Lin& base, const S* x, S* tau) {
    accelerate(base, x);
    Force<Sp> F = Force<Sp>::zero();
    clear_forks();
    for (int i = layout.nodes; i-- > 0;) {
      const Node& node = layout.node[i];
      if (node.fork >= 0) F += fork[node.fork].template force<Sp>();
      force_node(i, x, F, tau);
      if (node.parent >= 0) F = to_parent(i, F);
      if (node.branch) leave_at_fork(node, F);
    }
  }
  /// Before an inward recursion.
  void clear_forks() {
    for (int k = 0; k < layout.forks; ++k) fork[k].clear();
  }
  /// The force of a branch, in the axes of its seat, waits there until the recursion comes by.
  template <class Sv>
  void leave_at_fork(const Node& node, Force<Sv>& F) {
    if (node.seat >= 0) fork[node.seat].template force<Sv>() += F;
    F = Force<Sv>::zero();
  }
  /// Its articulated inertia likewise.
  void leave_at_fork(const Node& node, typename Sp::Inertia& M) {
    if (node.seat >= 0) add(fork[node.seat].M, M);
    M = Sp::no_inertia();
  }
  /// F is carried by the node's end, and then goes through its joint, in its axes.
  void force_node(int i, const S* x, Force<Sp>& F, S* tau) {
    const Node& node = layout.node[i];
    State<Sp>& s = state[i];
    if (node.ne > 0) {
      const Elastic<Sp>& e = s.elastic;
      if (node.tip || node.loads > 0 || node.tied) F += s.tip_force;
      if (node.tip) F += s.tip * s.end_a;
      F = e.end.frame.turn_back(F);
      const S* xe = x + node.ve;
      for (int k = 0; k < node.ne; ++k) {
        S sum = e.e[k] + dot(e.end.J[k], F) + dot(s.a, e.M_er[k]);
        for (int j = 0; j < node.ne; ++j) sum += e.M[j <= k ? packed(k, j) : packed(j, k)] * xe[j];
        tau[node.ve + k] = sum;
      }
      F = e.end.frame.shift_back(F);
      if (node.slices > 0) F += force_slices(node, tau + node.ve);
      for (int k = 0; k < node.ne; ++k) F += xe[k] * e.M_er[k];
    }
    if (node.body) F += s.body_force + s.body * s.a;
    s.force = F;
    if (node.kind == Node::fixed) return;
    S own = freedom(node, F);
    own *= node.sign;
    if (node.passive) own += s.resistance + s.reflected * x[node.v];
    tau[node.v] = own;
  }
  /// The forces at slices, on coordinates and about the link's origin.
  [[gnu::noinline]] Force<Sp> force_slices(const Node& node, S* tau) const {
    Force<Sp> sum = Force<Sp>::zero();
    for_slices(node, [&](Fork<Sp, P>& f) {
      const Force<Sp> on = f.slice.frame.turn_back(f.template force<Sp>());
      for (int k = 0; k < node.ne; ++k) tau[k] += dot(f.slice.J[k], on);
      sum += f.slice.frame.shift_back(on);
    });
    return sum;
  }
  /// From a node's frame to the end of the frame before it.
  Force<Sp> to_parent(int i, const Force<Sp>& F) const {
    return layout.node[i].coincident ? F : state[i].frame.to_parent(F);
  }
  /// An inertia, of anything (composite) or articulated.
  template <class M>
  static M to_parent(const Node& node, const State<Sp>& s, const M& inertia) {
    const bool hinge = node.kind == Node::revolute && !node.turned && !node.ball;
    return Sp::shift(hinge ? Sp::rotate(node.axis, s.sine, s.cosine, inertia) : Sp::rotate(s.frame.R, inertia),
                     s.frame.r);
  }
};

}  // namespace
