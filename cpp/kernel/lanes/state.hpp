// A node of a chain in motion: what the recursions keep of it between one pass and the next.
#pragma once

#include "lanes/elastic.hpp"

namespace {

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
  typename Sp::Lin f;
  typename Sp::Ang n;
  typename Sp::Lin U_f;
  typename Sp::Ang U_n;
  S over_d;
  // accelerations
  typename Sp::Lin a, end_a;
  typename Sp::Ang dw, end_dw;
  Elastic<Sp> elastic;
};

}  // namespace
