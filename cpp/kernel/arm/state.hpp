// A node of a chain in motion: the values that recursions keep between two passes.
#pragma once

#include "beam/elastic.hpp"

namespace {

template <class Sp>
struct State {
  using S = typename Sp::Scalar;
  Frame<Sp> frame;            ///< in the frame before
  typename Sp::Ang w;         ///< angular velocity, own axes
  typename Sp::Rot attitude;  ///< in the world, where the layout asks for it
  Motion<Sp> bias;            ///< acceleration beyond the carried one and that of its freedom, own axes (Eq. 83)
  typename Sp::Rigid body;    ///< the node's own inertia (Eq. 80)
  S sine, cosine;             ///< of a joint that turns
  Force<Sp> body_force;       ///< inertial force of the body where nothing accelerates (Eq. 81), without loads
  S resistance, slope_q, slope_v, reflected;  ///< of the joint
  // the tip body
  typename Sp::Ang end_w;
  typename Sp::Rigid tip;
  Force<Sp> tip_force;
  // articulated (Eq. 93-96)
  Force<Sp> U;  ///< M H
  S over_d;     ///< 1 / (H^T M H)
  // inverse dynamics
  Force<Sp> force;      ///< through the joint (Eq. 84)
  Motion<Sp> a, end_a;  ///< accelerations (Eq. 86)
  Elastic<Sp> elastic;
};

}  // namespace
