// Functions along a sampled body in space: strains, rotation, places and their Jacobians.
#pragma once

#include "beam/rotations.hpp"

namespace {
namespace sampled {

/// Fields over the points, in scratch; those of the motion also over further stations.
template <class P>
struct SpaceSeries {
  using Sp = Space<P>;
  Field<Sp> K, K_rate, theta;       ///< strain and its rate; its integral
  Field<Sp> shear, shear_rate;      ///< L phi and its rate
  Quaternions<P> p, term, factor;   ///< exact: the rotation, and room for its making
  Jet<Sp> theta_2, third;           ///< order 3: of the rotation vector; R_3 e1
  Field<Sp> R[3];                   ///< R e1, R e2, R e3
  Field<Sp> spin, spin_bias_slope;  ///< exact: Omega = J_R dq; the slope of (dJ_R/dt) dq
  Jet<Sp> tangent, twist;           ///< x'; order 3: theta' (exact: tangent's value and bias alone)
  Jet<Sp> place, turned;            ///< x; J_R and (dJ_R/dt) dq
  P* end;

  SpaceSeries(const Node& node, P* at) {
    Columns<Sp> columns{at, stride_of(node)};
    Field<Sp>* const fields[] = {&K,    &K_rate, &theta, &shear, &shear_rate,
                                 &R[0], &R[1],   &R[2],  &spin,  &spin_bias_slope};
    for (Field<Sp>* f : fields) *f = columns.field();
    const int ne = node.sampled.exact ? 0 : node.ne;
    if (node.sampled.exact) {
      p = {columns.take(4), columns.stride};
      term = {columns.take(4), columns.stride};
      factor = {columns.take(4), columns.stride};
    } else {
      theta_2 = columns.jet(ne);
      third = columns.jet(ne);
      twist = columns.jet(ne);
    }
    tangent = columns.jet(ne);
    place = columns.jet(node.ne);
    turned = columns.jet(node.ne);
    end = columns.at;
  }
};

/// The strains of all coordinates, and their integrals.
template <class S, class P>
void add_strains(const Node& node, const Rows<Space<P>>& rows, const S* q, const S* dq, const SpaceSeries<P>& s) {
  P* all = s.K.at;  // five fields, one after the other
  for (int k = 0; k < 15 * s.K.stride; ++k) all[k] = P{};
  for (int first = 0, end = 0; first < node.ne; first = end) {  // of one component
    const bool turns = first < node.sampled.turning;
    const int axis = node.about[first];
    while (end < node.ne && node.about[end] == axis && (end < node.sampled.turning) == turns) ++end;
    P *value = (turns ? s.K : s.shear).column(axis), *rate = (turns ? s.K_rate : s.shear_rate).column(axis);
    P* theta = s.theta.column(axis);
    for (int i = 0; i < rows.points; ++i) {
      P x{}, d{}, t{};
      for (int k = first; k < end; ++k) {
        const P shape = rows.shape(k, i), qk = widen(q[k], P{});
        x += shape * qk;
        d += shape * widen(dq[k], P{});
        if (turns) t += rows.turned(k, i) * qk;
      }
      value[i] = x;
      rate[i] = d;
      if (turns) theta[i] = t;
    }
  }
}

}  // namespace sampled
}  // namespace
