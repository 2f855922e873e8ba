// Struts and tendons of an arm: each a line of length l(q) with a force f that pushes its ends apart, so that the
// generalised forces are f (dl/dq)^T. They act after the outward pass; in the matrix of an implicit step, M + shift,
// their springs and dampers are terms of rank one, by Woodbury's formula.
#pragma once

#include "arm/places.hpp"
#include "arm/resistance.hpp"
#include "beam/loads.hpp"
#include "wide/small.hpp"

namespace {

/// A point of a strut where the arm is.
template <class Sp>
struct StrutPoint {
  using Lin = typename Sp::Lin;
  Lin at, rate;     ///< in the world
  Lin in;           ///< in the axes of its frame: where it is, and how far it moves for each coordinate of its beam
  Lin* J;           ///< (ne)
  Lin along;        ///< in the world: sum of the directions of the pieces that push on it
  Force<Sp> push;   ///< of a strut that pushes by 1 N: on the frame, own axes,
  typename Sp::Scalar* e;  ///< and on the beam's coordinates (ne)
};

template <class S>
struct StrutState {
  S length, rate, force;
  S by_length, by_rate;  ///< by which the force falls: of the spring and the damper
  S weight;              ///< of the term in M + shift
  S *g, *solved;         ///< dl/dq; (M + shift)^-1 g without struts (nv)
};

/// The strut's force (see Strut), where `driven` pushes beside its own.
template <class S>
inline void push_of(bool tension_only, const records::StrutLaw<S>& law, const S& driven, StrutState<S>& s) {
  using L = Lanes<S>;
  const S one = number<S>(1.0), o{}, depth = s.length - law.length;
  s.by_length = law.stiffness;
  s.by_rate = law.damping;
  s.force = law.force + driven;
  if (!tension_only) {
    s.force -= law.stiffness * depth + law.damping * s.rate;
    return;
  }
  const S entry = depth * (1.0 / kSoftEntry);
  const auto soft = entry < 1.0, taut = depth > 0.0;
  s.by_rate = law.damping * L::select(soft, entry, one);
  s.by_length += L::select(soft, law.damping * s.rate * (1.0 / kSoftEntry), o);
  s.force -= L::select(taut, law.stiffness * depth + s.by_rate * s.rate, o);
  const auto acts = taut & (s.force < 0.0);
  s.by_length = L::select(acts & (s.by_length > 0.0), s.by_length, o);
  s.by_rate = L::select(acts, s.by_rate, o);
  s.force = L::select(s.force < 0.0, s.force, o);
}

/// All struts of a chain C.
template <class C>
struct alignas(64) Struts {
  using Sp = typename C::Space;
  using S = typename C::S;
  using Lin = typename Sp::Lin;
  static constexpr int W = Lanes<S>::width;

  Places<Sp> places;
  StrutState<S>* strut;
  StrutPoint<Sp>* point;  ///< of all, in order
  S* matrix;              ///< 1 + weights g^T solved, factored
  typename C::Wide* turn;  ///< scratch

  void lay_out(const Layout& layout, int most_elastic, typename C::Wide* turns, Arena& arena) {
    turn = turns;
    places.lay_out(layout.nodes, arena);
    arena.take(layout.struts, strut);
    arena.take(layout.strut_points, point);
    arena.take(layout.struts * layout.struts, matrix);
    StrutState<S> no_strut;
    StrutPoint<Sp> no_point;
    for (int k = 0; k < layout.struts; ++k) {
      StrutState<S>& s = arena.counts() ? no_strut : strut[k];
      arena.take_zeros(layout.nv, s.g, s.solved);
    }
    for (int k = 0; k < layout.strut_points; ++k) {
      StrutPoint<Sp>& p = arena.counts() ? no_point : point[k];
      arena.take(most_elastic, p.J);
      arena.take(most_elastic, p.e);
    }
  }

  /// visit(strut, its points, its numbers) of each.
  template <class Visit>
  void each(const Layout& layout, const Visit& visit) {
    StrutPoint<Sp>* first = point;
    for (int k = 0; k < layout.struts; ++k) {
      visit(k, first, layout.strut_numbers + layout.strut[k].numbers * W);
      first += layout.strut[k].points;
    }
  }

  /// Lengths, rates, forces and directions, after the chain has moved to q and v.
  void stretch(C& chain, const S* q, const S* v) {
    const Layout& layout = chain.layout;
    places.find(layout, chain.state, v);
    each(layout, [&](int k, StrutPoint<Sp>* points, const double* p) {
      const flexarm::lanes::StrutLine& line = layout.strut[k];
      StrutState<S>& s = strut[k];
      const auto law = read<records::StrutLaw<S>>(p);
      for (int i = 0; i < line.points; ++i) find_point(chain, line.point[i], q, v, points[i]);
      s.length = s.rate = S{};
      for (int i = 1; i < line.points; ++i) {
        StrutPoint<Sp>&a = points[i - 1], &b = points[i];
        const Lin d = b.at - a.at;
        const S length = Lanes<S>::root(Sp::dot(d, d) + next<S>(p));
        const Lin along = (1.0 / length) * d;
        s.length += length;
        s.rate += Sp::dot(along, b.rate - a.rate);
        a.along = a.along - along;
        b.along += along;
      }
      S driven{};
      for (int i = 0; i < layout.loads; ++i)
        if (layout.load[i].strut == k) driven += chain.wrench[6 * i];
      push_of(line.tension_only, law, driven, s);
      for (int i = 0; i < line.points; ++i) find_push(chain, line.point[i], points[i]);
    });
  }

  /// Adds `part` of the struts' forces to those of the bodies.
  void act(C& chain, double part) const {
    const StrutPoint<Sp>* p = point;
    for (int k = 0; k < chain.layout.struts; ++k)
      for (int i = 0; i < chain.layout.strut[k].points; ++i, ++p) {
        const Place& place = chain.layout.strut[k].point[i].place;
        if (place.node < 0) continue;
        const S taken = -part * strut[k].force;  // bodies' forces are those that they need
        State<Sp>& s = chain.state[place.node];
        const bool on_end = C::on_end(chain.layout, place);
        (on_end ? s.tip_force : s.body_force) += taken * p->push;
        if (place.on != Place::slice) continue;
        for (int j = 0; j < chain.layout.node[place.node].ne; ++j) s.elastic.e[j] += taken * p->e[j];
      }
  }

  /// dl/dq of strut k (nv), where the chain is: of a push of 1 N, inward.
  void gather(const C& chain, int k, S* g) const {
    const Layout& layout = chain.layout;
    const StrutPoint<Sp>* points = point;
    for (int i = 0; i < k; ++i) points += layout.strut[i].points;
    for (int i = 0; i < layout.nv; ++i) g[i] = S{};
    for (int j = 0; j < layout.strut[k].points; ++j) {
      const Place& place = layout.strut[k].point[j].place;
      Force<Sp> F = points[j].push;
      const bool on_end = place.node >= 0 && C::on_end(layout, place);
      for (int i = place.node; i >= 0; i = layout.node[i].parent) {
        const Node& node = layout.node[i];
        const State<Sp>& s = chain.state[i];
        if (node.ne > 0 && (i != place.node || on_end)) {
          F = s.elastic.end.frame.turn_back(F);
          for (int n = 0; n < node.ne; ++n) g[node.ve + n] += dot(s.elastic.end.J[n], F);
          F = s.elastic.end.frame.shift_back(F);
        } else if (place.on == Place::slice && i == place.node) {
          for (int n = 0; n < node.ne; ++n) g[node.ve + n] += points[j].e[n];
        }
        if (node.kind != Node::fixed) g[node.v] += node.sign * freedom(node, F);
        F = chain.to_parent(i, F);
      }
    }
  }

  /// Of M + shift; solve(r, x) is without struts.
  template <class Solve>
  void factor(const C& chain, const flexarm::lanes::Shift& shift, const Solve& solve) {
    const int n = chain.layout.struts, nv = chain.layout.nv;
    for (int k = 0; k < n; ++k) {
      strut[k].weight = shift.stiffness * strut[k].by_length + shift.damping * strut[k].by_rate;
      gather(chain, k, strut[k].g);
      solve(strut[k].g, strut[k].solved);
    }
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) {
        S sum{};
        for (int k = 0; k < nv; ++k) sum += strut[i].g[k] * strut[j].solved[k];
        matrix[i * n + j] = strut[i].weight * sum + (i == j ? 1.0 : 0.0);
      }
    factor_small(matrix, n);
  }
  /// x = (M + shift)^-1 r, of one without struts.
  template <class V>
  void correct(const Layout& layout, V* x) const {
    V* turn_of = view<V>(turn);
    for (int k = 0; k < layout.struts; ++k) {
      turn_of[k] = V{};
      for (int i = 0; i < layout.nv; ++i) turn_of[k] += strut[k].g[i] * x[i];
      turn_of[k] = strut[k].weight * turn_of[k];
    }
    solve_small(matrix, layout.struts, turn_of);
    for (int k = 0; k < layout.struts; ++k)
      for (int i = 0; i < layout.nv; ++i) x[i] -= strut[k].solved[i] * turn_of[k];
  }

 private:
  void find_point(C& chain, const flexarm::lanes::TiedPoint& tied, const S* q, const S* v, StrutPoint<Sp>& out) {
    const double* p = chain.layout.strut_numbers + tied.numbers * W;
    const Lin offset = Sp::read(p);
    out.along = Sp::zero();
    if (tied.place.node < 0) {
      out.at = offset;
      out.rate = Sp::zero();
      return;
    }
    const Slice<Sp>& slice = chain.slice_of(tied.place, p, q, v);
    const Moving<Sp>& on = (tied.place.on == Place::end ? places.end : places.frame)[tied.place.node];
    const Lin across = Sp::rotate(slice.frame.R, offset);
    out.in = slice.frame.r + across;
    const Lin rate = on.u.linear + Sp::cross(on.u.angular, out.in) + slice.rate.linear +
                     Sp::cross(slice.rate.angular, across);
    out.at = on.at.r + Sp::rotate(on.at.R, out.in);
    out.rate = Sp::rotate(on.at.R, rate);
    if (tied.place.on != Place::slice) return;
    for (int k = 0; k < chain.layout.node[tied.place.node].ne; ++k)
      out.J[k] = slice.J[k].linear + Sp::cross(slice.J[k].angular, across);
  }
  void find_push(const C& chain, const flexarm::lanes::TiedPoint& tied, StrutPoint<Sp>& p) const {
    if (tied.place.node < 0) return;
    const Moving<Sp>& on = (tied.place.on == Place::end ? places.end : places.frame)[tied.place.node];
    const Lin f = Sp::unrotate(on.at.R, p.along);
    p.push = {f, Sp::moment(p.in, f)};
    if (tied.place.on != Place::slice) return;
    for (int k = 0; k < chain.layout.node[tied.place.node].ne; ++k) p.e[k] = Sp::dot(p.J[k], f);
  }
};

}  // namespace
