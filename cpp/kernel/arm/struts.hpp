// Struts and tendons of an arm: each a line of length l(q) with a force f that pushes its ends apart, so that the
// generalised forces are f (dl/dq)^T.
#pragma once

#include "arm/places.hpp"
#include "arm/resistance.hpp"
#include "beam/loads.hpp"

namespace {

/// A point of a strut where the arm is.
template <class Sp>
struct StrutPoint {
  using Lin = typename Sp::Lin;
  Lin at, rate;  ///< in the world
  Lin in;        ///< in the axes of its frame
  Lin* J;        ///< how far it moves in these axes for each coordinate of its beam (ne)
  Lin along;     ///< in the world: sum of the directions of the pieces that push on it
};

template <class S>
struct StrutState {
  S length, rate, force;
  S by_length, by_rate;  ///< by which the force falls: of the spring and the damper
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

}  // namespace
