// Forces that follow from how several parts of an arm move: struts, contacts, and loads by their state. They act after
// the outward pass: G f, a column of G for each strut's length, or for each direction in which a contact, or the place
// of a load, moves.
// In the matrix of an implicit step, M + shift, they are G B G^T, B of their slopes, by Woodbury's formula.
#pragma once

#include "arm/contacts.hpp"
#include "arm/loops.hpp"
#include "arm/struts.hpp"
#include "wide/small.hpp"

namespace {

using flexarm::lanes::TiedPoint;

template <class C>
struct ByState {
  using Sp = typename C::Space;
  using S = typename C::S;
  using Lin = typename Sp::Lin;
  static constexpr int W = Lanes<S>::width, kWays = Sp::linear + Sp::angular;

  using Pull = ::Pull<Sp>;  ///< of a column
  struct Touched {
    ContactState<S> state;
    bool idle;                           ///< nowhere pressed: its columns are not made
    S weights[Sp::linear * Sp::linear];  ///< its part of B
  };
  struct Loaded {
    int load;
    S asked[kAsked + 1];       ///< the arguments of its law, and the time
    S weights[kWays * kWays];  ///< its part of B
  };

  Places<Sp> places;
  StrutState<S>* strut;
  StrutPoint<Sp>* point;  ///< of all struts, in order
  Touched* touched;
  ContactMemory<S>* memory;  ///< of contacts
  double by_end;             ///< of contacts, see ContactState::share; negative: at an instant
  Loaded* loaded;
  Pull* pull;    ///< of each point of a strut, and of each direction of both sides of a contact, and of a load
  S *force, *G;  ///< f; G, by columns of nv
  S* weight;     ///< of each strut: its part of B
  S* solved;     ///< (M + shift without these forces)^-1 G
  S* matrix;     ///< 1 + B G^T solved, factored
  typename C::Wide* turn;  ///< scratch: G^T x
  Loops<C> loops;

  static int columns(const Layout& layout) {
    return layout.struts + Sp::linear * layout.contacts + kWays * layout.state_loads;
  }
  /// Numbers of scratch, as wide as right-hand sides.
  static int scratch(const Layout& layout) { return columns(layout) + Loops<C>::scratch(layout); }
  static int pulls(const Layout& layout) {
    return layout.strut_points + 2 * Sp::linear * layout.contacts + kWays * layout.state_loads;
  }

  /// @param wide  scratch
  void lay_out(const Layout& layout, int most_elastic, typename C::Wide* wide, Arena& arena) {
    const int n = columns(layout);
    turn = wide;
    places.lay_out(layout, arena);
    arena.take(layout.struts, strut);
    arena.take(layout.strut_points, point);
    arena.take(layout.contacts, touched);
    arena.take_zeros(layout.contacts, memory);
    by_end = -1.0;
    arena.take(layout.state_loads, loaded);
    arena.take(pulls(layout), pull);
    arena.take(n, force, weight);
    arena.take(n * layout.nv, G, solved);
    arena.take(n * n, matrix);
    for (int k = 0; k < layout.strut_points; ++k) {
      Lin* none;
      arena.take(most_elastic, arena.counts() ? none : point[k].J);
    }
    for (int k = 0; k < pulls(layout); ++k) {
      S* none;
      arena.take(most_elastic, arena.counts() ? none : pull[k].on_beam);
    }
    loops.lay_out(layout, most_elastic, wide + n, arena);
    if (arena.counts()) return;
    for (int i = 0, k = 0; i < layout.loads; ++i)
      if (layout.load[i].by_state.ask) loaded[k++].load = i;
  }

  /// visit(column, place, pull) of all.
  template <class Visit>
  void for_pulls(const Layout& layout, const Visit& visit) const {
    const Pull* p = pull;
    const TiedPoint* at = layout.tied;
    for (int k = 0; k < layout.struts; ++k)
      for (int i = 0; i < layout.strut[k].points; ++i, ++at, ++p)
        if (at->place.node >= 0) visit(k, at->place, *p);
    int column = layout.struts;
    for (int k = 0; k < layout.contacts; ++k, column += Sp::linear)
      for (int side = 0; side < 2; ++side, ++at, p += Sp::linear)
        for (int way = 0; way < Sp::linear && !touched[k].idle && at->place.node >= 0; ++way)
          visit(column + way, at->place, p[way]);
    at += 2 * layout.loops;
    for (int k = 0; k < layout.state_loads; ++k, ++at)
      for (int way = 0; way < kWays; ++way, ++p) visit(column++, at->place, *p);
  }

  /// All forces, where the chain has moved to q and v.
  /// @param driven_by  of each strut: its force from outside, beside those of loads
  void find(C& chain, const S* q, const S* v, const S* driven_by = nullptr) {
    const Layout& layout = chain.layout;
    places.find(chain, v);
    const TiedPoint* at = layout.tied;
    StrutPoint<Sp>* points = point;
    Pull* p = pull;
    for (int k = 0; k < layout.struts; ++k) {
      stretch(chain, k, at, q, v, points, p);
      S driven = driven_by ? driven_by[k] : S{};
      for (int i = 0; i < layout.loads; ++i)
        if (layout.load[i].strut == k) driven += chain.wrench[6 * i];
      const double* numbers = layout.tied_numbers + layout.strut[k].numbers * W;
      push_of(layout.strut[k].tension_only, read<records::StrutLaw<S>>(numbers), driven, strut[k]);
      force[k] = strut[k].force;
      at += layout.strut[k].points;
      points += layout.strut[k].points;
      p += layout.strut[k].points;
    }
    S* f = force + layout.struts;
    for (int k = 0; k < layout.contacts; ++k, at += 2, p += 2 * Sp::linear, f += Sp::linear)
      touch(chain, k, at, q, v, p, f);
    loops.find(chain, places, q, v);
    at += 2 * layout.loops;
    for (int k = 0; k < layout.state_loads; ++k, p += kWays, f += kWays) ask(chain, loaded[k], at[k], q, v, p, f);
  }
  /// Contacts go on from where they were found.
  template <class Mask>
  void remember(const Layout& layout, const Mask& where) {
    for (int k = 0; k < layout.contacts; ++k) {
      S* to = view<S>(&memory[k]);
      const S* from = view<const S>(&touched[k].state.now);
      for (int i = 0; i < flexarm::lanes::kRemembered; ++i) to[i] = Lanes<S>::select(where, from[i], to[i]);
    }
  }
  /// Where any contact has touched or let go since the remembered state, in a step.
  typename Lanes<S>::Mask met(const Layout& layout) const {
    auto found = Lanes<S>::everywhere(false);
    for (int k = 0; k < layout.contacts; ++k) found = found | touched[k].state.met;
    return found;
  }
  /// Of one arm: the memory that it would have.
  void put_now(const Layout& layout, double* out) const {
    for (int k = 0; k < layout.contacts; ++k, out += flexarm::lanes::kRemembered)
      __builtin_memcpy(out, &touched[k].state.now, sizeof(memory[k]));
  }
  void recall(const Layout& layout, const double* remembered) {
    S* to = view<S>(memory);
    for (int i = 0; i < layout.contacts * flexarm::lanes::kRemembered; ++i) to[i] = number<S>(remembered[i]);
  }
  /// By three numbers each: on the arm, in the world.
  template <class T>
  void put_contact_forces(const Layout& layout, T* out) const {
    for (int k = 0; k < layout.contacts; ++k) {
      const auto f = touched[k].state.force();
      for (const S& x : {f.x, f.y, f.z}) *out++ = x;
    }
  }

  /// Whether any of them does more than watch a gap.
  bool acts(const Layout& layout) const {
    bool found = layout.struts > 0 || layout.state_loads > 0;
    for (int k = 0; k < layout.contacts; ++k) found = found || !touched[k].idle;
    return found;
  }
  /// Adds `part` of them to the forces that bodies need.
  void act(C& chain, double part) const {
    for_pulls(chain.layout,
              [&](int column, const Place& place, const Pull& p) { add_pull(chain, place, p, -part * force[column]); });
    loops.act(chain, part);
  }

  /// G, where the forces were found: inward.
  void gather(const C& chain) {
    const Layout& layout = chain.layout;
    for (int i = 0; i < columns(layout) * layout.nv; ++i) G[i] = S{};
    for_pulls(layout, [&](int column, const Place& place, const Pull& p) {
      gather_pull(chain, place, p, G + column * layout.nv);
    });
  }

  /// Of M + shift; solve(r, x) is without these forces.
  template <class Solve>
  void factor(const C& chain, const flexarm::lanes::Shift& shift, const Solve& solve) {
    const Layout& layout = chain.layout;
    const int n = columns(layout), nv = layout.nv;
    gather(chain);
    for (int k = 0; k < n; ++k) {
      if (!idle(layout, k)) solve(G + k * nv, solved + k * nv);
      for (int i = 0; i < nv && idle(layout, k); ++i) solved[k * nv + i] = S{};
    }
    for (int k = 0; k < layout.struts; ++k)
      weight[k] = shift.stiffness * strut[k].by_length + shift.damping * strut[k].by_rate;
    for (int k = 0; k < layout.contacts; ++k)
      weigh(layout, shift.stiffness, shift.damping, touched[k].state, touched[k].weights);
    for (int k = 0; k < layout.state_loads; ++k) weigh(layout, shift, loaded[k]);
    for (int j = 0; j < n; ++j) {
      S* column = view<S>(turn);
      times_columns(G, nv, n, solved + j * nv, column);
      times_B(layout, column);
      for (int i = 0; i < n; ++i) matrix[i * n + j] = column[i] + (i == j ? 1.0 : 0.0);
    }
    factor_small(matrix, n);
  }
  /// Adds G times the changes of the forces of struts and contacts where the coordinates change by x.
  void add_stiffness(const Layout& layout, const S* x, S* out) const {
    const int n = layout.struts + Sp::linear * layout.contacts, nv = layout.nv;
    S* y = view<S>(turn);
    times_columns(G, nv, n, x, y);
    for (int k = 0; k < layout.struts; ++k) y[k] *= strut[k].by_length;
    S weights[Sp::linear * Sp::linear];
    for (int k = 0; k < layout.contacts; ++k) {
      weigh(layout, 1.0, 0.0, touched[k].state, weights);
      times_block<Sp::linear>(weights, y + layout.struts + k * Sp::linear);
    }
    for (int k = 0; k < n; ++k)
      for (int i = 0; i < nv; ++i) out[i] += G[k * nv + i] * y[k];
  }
  /// x = (M + shift)^-1 r, of one without these forces.
  template <class V>
  void correct(const Layout& layout, V* x) const {
    const int n = columns(layout), nv = layout.nv;
    V* y = view<V>(turn);
    times_columns(G, nv, n, x, y);
    times_B(layout, y);
    solve_small(matrix, n, y);
    for (int k = 0; k < n; ++k)
      for (int i = 0; i < nv; ++i) x[i] -= solved[k * nv + i] * y[k];
  }

 private:
  bool idle(const Layout& layout, int column) const {
    const int k = (column - layout.struts) / Sp::linear;
    return column >= layout.struts && k < layout.contacts && touched[k].idle;
  }
  /// Length, rate and directions of strut k.
  void stretch(C& chain, int k, const TiedPoint* tied, const S* q, const S* v, StrutPoint<Sp>* points, Pull* found) {
    const Layout& layout = chain.layout;
    const int count = layout.strut[k].points;
    for (int i = 0; i < count; ++i)
      find_point(chain, tied[i], q, v, i > 0 && same_beam(tied[i - 1], tied[i]), points[i]);
    const double* across = layout.tied_numbers + (layout.strut[k].numbers + records::kStrutLaw) * W;
    StrutState<S>& s = strut[k];
    s.length = s.rate = S{};
    for (int i = 1; i < count; ++i) {
      StrutPoint<Sp>&a = points[i - 1], &b = points[i];
      const Lin d = b.at - a.at;
      const S length = Lanes<S>::root(Sp::dot(d, d) + next<S>(across));
      const Lin along = (1.0 / length) * d;
      s.length += length;
      s.rate += Sp::dot(along, b.rate - a.rate);
      a.along = a.along - along;
      b.along += along;
    }
    for (int i = 0; i < count; ++i) {
      const Place& place = tied[i].place;
      if (place.node < 0) continue;
      const Lin f = Sp::unrotate(moving(places, place).at.R, points[i].along);
      found[i].on_frame = {f, Sp::moment(points[i].in, f)};
      if (place.on != Place::slice) continue;
      for (int j = 0; j < layout.node[place.node].ne; ++j) found[i].on_beam[j] = Sp::dot(points[i].J[j], f);
    }
  }
  static bool same_beam(const TiedPoint& a, const TiedPoint& b) {
    return a.place.on == Place::slice && b.place.on == Place::slice && a.place.node == b.place.node;
  }
  void find_point(C& chain, const TiedPoint& tied, const S* q, const S* v, bool sampled, StrutPoint<Sp>& out) {
    const double* p = chain.layout.tied_numbers + tied.numbers * W;
    const Lin offset = Sp::read(p);
    out.along = Sp::zero();
    if (tied.place.node < 0) {
      out.at = offset;
      out.rate = Sp::zero();
      return;
    }
    const Slice<Sp>& slice = chain.slice_of(tied.place, p, q, v, sampled);
    const Moving<Sp>& on = moving(places, tied.place);
    const Lin across = Sp::rotate(slice.frame.R, offset);
    out.in = slice.frame.r + across;
    const Lin rate =
        on.u.linear + Sp::cross(on.u.angular, out.in) + slice.rate.linear + Sp::cross(slice.rate.angular, across);
    out.at = on.at.r + Sp::rotate(on.at.R, out.in);
    out.rate = Sp::rotate(on.at.R, rate);
    if (tied.place.on != Place::slice) return;
    for (int k = 0; k < chain.layout.node[tied.place.node].ne; ++k)
      out.J[k] = slice.J[k].linear + Sp::cross(slice.J[k].angular, across);
  }

  /// Contact k of two sides. @param f  its force on the arm, in the directions of the world
  void touch(C& chain, int k, const TiedPoint* sides, const S* q, const S* v, Pull* found, S* f) {
    const Layout& layout = chain.layout;
    const double* law = layout.tied_numbers + layout.contact[k].numbers * W;
    const double *p = layout.tied_numbers + sides[0].numbers * W, *r = layout.tied_numbers + sides[1].numbers * W;
    const S height = next<S>(p), across = next<S>(r);
    const auto sphere = read<records::ContactSphere<Space<S>>>(p);
    const auto surface = read<records::ContactSurface<Space<S>>>(r);
    const Stand<S> on = sides[1].place.node < 0 ? Stand<S>::world()
                                                : stand_of(layout, moving(places, sides[1].place),
                                                           chain.slice_of(sides[1].place, r, q, v), across);
    const Slice<Sp>& slice = chain.slice_of(sides[0].place, p, q, v);
    const Stand<S> arm = stand_of(layout, moving(places, sides[0].place), slice, height);
    ContactState<S>& state = touched[k].state;
    state.find(layout.contact[k], read<records::ContactLaw<S>>(law), sphere, surface, arm.frame, arm.u, on.frame, on.u,
               memory[k], by_end);
    touched[k].idle = Lanes<S>::all(Lanes<S>::none_of((state.push > 0.0) | (state.push < 0.0)));
    const auto pushed = state.force();
    const S all[3] = {pushed.x, pushed.y, pushed.z};
    for (int way = 0; way < Sp::linear; ++way) f[way] = all[world_axis(layout, way)];
    if (touched[k].idle) return;
    pull_at(layout, sides[0].place, slice, state.at - arm.frame.r, 1.0, found);
    if (sides[1].place.node >= 0)
      pull_at(layout, sides[1].place, chain.slice_of(sides[1].place, r, q, v), state.at - on.frame.r, -1.0,
              found + Sp::linear);
  }
  /// Unit forces along the world's axes on a point that a slice carries. @param arm  from the slice to it, in the world
  void pull_at(const Layout& layout, const Place& place, const Slice<Sp>& slice, const typename Space<S>::Lin& arm,
               double sign, Pull* found) const {
    const S lever[6] = {arm.x, arm.y, arm.z};
    const Lin r = read_wrench(Sp{}, layout, lever).force;
    for (int way = 0; way < Sp::linear; ++way) {
      Force<Sp> world = unit_force(layout, way, sign);
      world.moment = Sp::moment(r, world.force);
      pull_slice(layout, places, place, slice, world, found[way]);
    }
  }
  static Force<Sp> unit_force(const Layout& layout, int way, double size = 1.0) {
    S unit[6]{};
    unit[world_axis(layout, way)] = number<S>(size);
    return read_wrench(Sp{}, layout, unit);
  }
  /// The world's axis of a direction of a load: 0 to 2 along, 3 to 5 about.
  static int world_axis(const Layout& layout, int way) {
    return !Sp::planar ? way : way < 2 ? layout.along[way] : 3 + layout.about;
  }
  /// Asks a load's law. @param f  the answer, in these directions
  void ask(C& chain, Loaded& one, const TiedPoint& tied, const S* q, const S* v, Pull* found, S* f) {
    const Layout& layout = chain.layout;
    const double* p = layout.tied_numbers + tied.numbers * W;
    const S height = next<S>(p);
    const Slice<Sp>& slice = chain.slice_of(tied.place, p, q, v);
    const Moving<Sp>& on = moving(places, tied.place);
    put_world(layout, on.at * slice.frame, on.in_world(slice.frame.shift(on.u) + slice.rate), height, one.asked);
    one.asked[kAsked] = chain.wrench[6 * one.load];
    S wrench[6];
    StateAnswers<S>::values(layout.load[one.load].by_state, one.asked, wrench);
    for (int way = 0; way < kWays; ++way) {
      f[way] = wrench[world_axis(layout, way)];
      pull_slice(layout, places, tied.place, slice, unit_force(layout, way), found[way]);
    }
  }
  /// The part of B of a contact, where its place moves by s x, at d x.
  static void weigh(const Layout& layout, double s, double d, const ContactState<S>& state, S* weights) {
    for (int j = 0; j < Sp::linear; ++j) {
      S unit[3]{};
      unit[world_axis(layout, j)] = number<S>(1.0);
      const auto fall = state.fall(s, d, {unit[0], unit[1], unit[2]});
      const S all[3] = {fall.x, fall.y, fall.z};
      for (int i = 0; i < Sp::linear; ++i) weights[i * Sp::linear + j] = all[world_axis(layout, i)];
    }
  }
  /// A load's part of B.
  void weigh(const Layout& layout, const flexarm::lanes::Shift& shift, Loaded& one) const {
    S slopes[6 * kDirectionsOfState];
    StateAnswers<S>::slopes(layout.load[one.load].by_state, one.asked, slopes);
    for (int i = 0; i < kWays; ++i)
      for (int j = 0; j < kWays; ++j) {
        const S* row = slopes + world_axis(layout, i) * kDirectionsOfState;
        const int by = world_axis(layout, j);
        one.weights[i * kWays + j] = -(shift.stiffness * row[by] + shift.damping * row[6 + by]);
      }
  }

  /// y = B y
  template <class V>
  void times_B(const Layout& layout, V* y) const {
    for (int k = 0; k < layout.struts; ++k) y[k] = weight[k] * y[k];
    y += layout.struts;
    for (int k = 0; k < layout.contacts; ++k, y += Sp::linear) times_block<Sp::linear>(touched[k].weights, y);
    for (int k = 0; k < layout.state_loads; ++k, y += kWays) times_block<kWays>(loaded[k].weights, y);
  }
  template <int n, class V>
  static void times_block(const S* weights, V* y) {
    V x[n];
    for (int i = 0; i < n; ++i) x[i] = y[i];
    for (int i = 0; i < n; ++i) {
      y[i] = V{};
      for (int j = 0; j < n; ++j) y[i] += weights[i * n + j] * x[j];
    }
  }
};

}  // namespace
