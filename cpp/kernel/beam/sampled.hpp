// The elastic body at order 3 and "exact". Its motion is that of x' = R (e1 + phi) and R' = R K~ (Eq. 24, 25),
// integrated along the beam at Gauss points; its inertia and forces are sums over slices. `sample` comes first; then
// any slice can be asked for, and `bend`.
#pragma once

#include "beam/sampled_plane.hpp"
#include "beam/sampled_space.hpp"

namespace {
namespace sampled {

/// The points' space, and their series, for the space of the arm and the scalar of points.
template <class Sp, class P>
struct OfPoints;
template <class S, class P>
struct OfPoints<Plane<S>, P> {
  using Space = Plane<P>;
  using Series = PlaneSeries<P>;
};
template <class S, class P>
struct OfPoints<Space<S>, P> {
  using Space = ::Space<P>;
  using Series = SpaceSeries<P>;
};

/// Moves the slices that are not at points, one by one, and puts them where they are summed.
template <class Sp, class P, class Series>
void place_further(const Node& node, const double* numbers, const double* points, const typename Sp::Scalar* q,
                   const typename Sp::Scalar* dq, const Series& s, P* scratch) {
  using S = typename Sp::Scalar;
  if (node.sampled.further == 0) return;
  Motion<Sp> J[kMostElastic];
  Slice<Sp> slice;
  slice.J = J;
  clear_stations(node, points_of(node), stations_of(node), s);
  const int first = points_of(node) * static_cast<int>(sizeof(P) / sizeof(S));
  for (int k = 0; k < node.sampled.further; ++k) {
    move_slice(node, numbers, points, q, dq, scratch, slice);
    put_slice(slice, node.ne, first + k, s);
  }
}

/// The end slice alone, after `sample`.
template <class Sp, class P>
void move_end(const Node& node, const double* points, const typename Sp::Scalar* q, const typename Sp::Scalar* dq,
              Slice<Sp>& out, P* scratch) {
  const typename OfPoints<Sp, P>::Series s(node, scratch);
  const Rows<typename OfPoints<Sp, P>::Space> rows(node, points);
  place_points(node, rows, dq, s, s.end);
  end_slice(node, rows, q, dq, s, out);
}

/// Inertia and forces, and the end slice, after `sample`.
template <class Sp, class P>
void bend(const Node& node, const double* constants, const double* points, const typename Sp::Scalar* q,
          const typename Sp::Scalar* dq, const typename Sp::Ang& w, typename Sp::Rigid& M, Force<Sp>& F,
          Elastic<Sp>& out, P* scratch) {
  using S = typename Sp::Scalar;
  using Pt = typename OfPoints<Sp, P>::Space;
  const typename OfPoints<Sp, P>::Series s(node, scratch);
  const Rows<Pt> rows(node, points);
  P* at = s.end;
  const int size = Sums<Pt>::size(node.ne);
  place_points(node, rows, dq, s, at + size);
  place_further<Sp>(node, rows.further, points, q, dq, s, scratch);
  for (int k = 0; k < size; ++k) at[k] = P{};
  const Sums<Pt> sums(at, node.ne);
  typename Pt::Ang wide;
  for (int c = 0; c < Sp::angular; ++c) view<P>(&wide)[c] = widen(view<const S>(&w)[c], P{});
  sum_slices(node, rows, s, dq, wide, sums, at + size);
  S* total = view<S>(at);
  sum_lanes(at, size, total);
  finish(node, constants, Sums<Sp>(total, node.ne), q, dq, w, M, F, out);
  end_slice(node, rows, q, dq, s, out.end);
}

}  // namespace sampled

/// Numbers P that it needs to work on; in space, where it needs more.
inline std::size_t sampled_scratch(const Node& node) {
  using P = double;
  P* const begin = reinterpret_cast<P*>(sizeof(P));
  const sampled::SpaceSeries<P> space(node, begin);
  const int sums = sampled::Sums<Space<P>>::size(node.ne), work = 2 * kMostColumns * node.passes,
            columns = sampled::columns_size<Space<P>>(node.ne);
  return static_cast<std::size_t>((space.end - begin) + sums + (work > columns ? work : columns));
}

}  // namespace
