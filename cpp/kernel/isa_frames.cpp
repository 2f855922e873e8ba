// Compiled once for each instruction set, as isa.cpp.
#include "wide/pack.hpp"  // before the others
// clang-format: keep
#include "arm/frames.hpp"
#include "isa.hpp"
#include "slopes/tangent.hpp"

namespace {

using One = Frames<double>;

constexpr std::size_t kHead = 192;

One& of(void* self) { return *static_cast<One*>(self); }

std::size_t memory(const Layout& layout) { return kHead + One::memory(layout); }

void begin(const Layout& layout, const double* numbers, void* memory) {
  static_assert(sizeof(One) <= kHead, "the head");
  char* at = static_cast<char*>(memory);
  Arena arena(at + kHead);
  const One frames(layout, numbers, arena);
  __builtin_memcpy(at, &frames, sizeof(frames));
}

void set(One& f, const double* q, const double* v) {
  for (int i = 0; i < f.chain.layout.nq; ++i) f.q[i] = q[i];
  for (int i = 0; i < f.chain.layout.nv; ++i) f.v[i] = v[i];
}

void place(void* self, const double* q, const double* v) {
  One& f = of(self);
  set(f, q, v);
  f.place();
}

void accelerate(void* self, const double* base, const double* a) {
  One& f = of(self);
  for (int i = 0; i < f.chain.layout.nv; ++i) f.a[i] = a[i];
  f.chain.accelerate(One::Sp::read(base), f.a);
}

void put(const One::Lin& x, double* out) {
  out[0] = x.x;
  out[1] = x.y;
  out[2] = x.z;
}

void put(const Motion<One::Sp>& m, double* out) {
  put(m.linear, out);
  put(m.angular, out + 3);
}

void pose(void* self, const Place& place, const double* numbers, bool in_world, double* p, double* R) {
  One& f = of(self);
  const One::Spot at = f.spot(place, numbers);
  const Frame<One::Sp> frame = in_world ? at.in_world() : at.slice.frame;
  put(frame.r, p);
  __builtin_memcpy(R, &frame.R, sizeof(frame.R));
}

void jacobian(void* self, const Place& place, const double* numbers, double* J) {
  One& f = of(self);
  for (int i = 0; i < 6 * f.chain.layout.nv; ++i) J[i] = 0.0;
  f.jacobian(place, numbers, [&](int rate, const Motion<One::Sp>& m) { put(m, J + 6 * rate); });
}

void motion(void* self, const Place& place, const double* numbers, double* velocity, double* acceleration) {
  One& f = of(self);
  const One::Spot at = f.spot(place, numbers);
  put(f.velocity(at), velocity);
  put(f.acceleration(at), acceleration);
}

void reaction(void* self, const Place& link, const double* numbers, const double* base, const double* wrenches,
              const double* q, const double* v, const double* a, double* out) {
  One& f = of(self);
  set(f, q, v);
  for (int i = 0; i < 6 * f.chain.layout.loads; ++i) f.chain.wrench[i] = wrenches[i];
  f.place<true>();
  f.chain.forces(One::Sp::read(base), a, f.a);  // which has room for the forces
  const One::Spot at = f.spot(link, numbers);
  const Force<One::Sp>& through = at.state.force;
  const Frame<One::Sp>& frame = at.slice.frame;
  put(One::Sp::unrotate(frame.R, through.force), out);
  put(One::Sp::unrotate(frame.R, through.moment - One::Sp::cross(frame.r, through.force)), out + 3);
}

void sums(void* self, const double* q, const double* v, Sums& out) {
  One& f = of(self);
  set(f, q, v);
  f.place<true>();
  const One::Whole whole = f.whole();
  out.kinetic = 0.5 * whole.twice_kinetic;
  out.mass = whole.mass;
  put(whole.moment, out.moment);
  put(whole.linear, out.momentum);
  put(whole.angular, out.momentum + 3);
}

void contacts(void* self, const double* q, const double* v, double* motion) {
  One& f = of(self);
  set(f, q, v);
  f.place();
  ByState<One::C>& found = *f.chain.by_state;
  found.find(f.chain, f.q, f.v);
  for (int k = 0; k < f.chain.layout.contacts; ++k) {
    const auto& c = found.touched[k].state;
    for (const double x : {c.gap, c.rate, c.push}) *motion++ = x;
  }
}

void loops(void* self, const double* q, const double* v, double* motion) {
  One& f = of(self);
  set(f, q, v);
  f.place();
  ByState<One::C>& found = *f.chain.by_state;
  found.find(f.chain, f.q, f.v);
  for (int k = 0; k < f.chain.layout.loop_rows; ++k)
    for (const double x : {found.loops.row[k].g, found.loops.row[k].rate}) *motion++ = x;
}

void struts(void* self, const double* q, const double* v, const double* driven, double* motion, double* by_q) {
  One& f = of(self);
  set(f, q, v);
  f.place();
  ByState<One::C>& lines = *f.chain.by_state;
  const int nv = f.chain.layout.nv;
  lines.find(f.chain, f.q, f.v, driven);
  lines.gather(f.chain);
  for (int k = 0; k < f.chain.layout.struts; ++k) {
    for (const double x : {lines.strut[k].length, lines.strut[k].rate, lines.force[k]}) *motion++ = x;
    for (int i = 0; i < nv; ++i) by_q[k * nv + i] = lines.G[k * nv + i];
  }
}

// --- Derivatives, by dual numbers. ---

using Tangent = Frames<LaneDual>;

std::size_t slopes_memory(const Layout& layout) { return Tangent::memory(layout); }

void set(const double* from, int n, LaneDual* to) {
  for (int i = 0; i < n; ++i) to[i] = LaneDual{} + from[i];
}

void put_slope(const Motion<Tangent::Sp>& m, int direction, double*& out) {
  const LaneDual* x = view<const LaneDual>(&m);
  for (int i = 0; i < 6; ++i) *out++ = slope_of(x[i], direction);
}

void slopes(const Layout& layout, const double* arm, void* memory, const Place& place, const double* numbers,
            const double* q, const double* v, const double* a, double* by_q, double* by_v) {
  Arena arena(memory);
  Tangent f(layout, arm, arena);
  set(q, layout.nq, f.q);
  set(v, layout.nv, f.v);
  set(a, layout.nv, f.a);
  for_directions(f.q, layout.nq + layout.nv, [&](int first, int count) {  // q and v lie in one row
    f.place();
    f.chain.accelerate(Tangent::Sp::zero(), f.a);
    const Tangent::Spot at = f.spot(place, numbers);
    const Motion<Tangent::Sp> velocity = f.velocity(at), acceleration = f.acceleration(at);
    for (int k = 0; k < count; ++k) {
      const int direction = first + k;
      double* column = direction < layout.nq ? by_q + 12 * direction : by_v + 12 * (direction - layout.nq);
      put_slope(velocity, k, column);
      put_slope(acceleration, k, column);
    }
  });
}

void jacobian_rate(const Layout& layout, const double* arm, void* memory, const Place& place, const double* numbers,
                   const double* q, const double* rate, double* J) {
  Arena arena(memory);
  Tangent f(layout, arm, arena);
  set(q, layout.nq, f.q);
  for (int i = 0; i < layout.nq; ++i) f.q[i].d[0][0] = rate[i];
  f.place();
  for (int i = 0; i < 6 * layout.nv; ++i) J[i] = 0.0;
  f.jacobian(place, numbers, [&](int i, const Motion<Tangent::Sp>& m) {
    double* column = J + 6 * i;
    put_slope(m, 0, column);
  });
}

}  // namespace

namespace flexarm {
namespace lanes {

extern const FrameKernels FLEXARM_JOIN(frames_, FLEXARM_ISA);
const FrameKernels FLEXARM_JOIN(frames_, FLEXARM_ISA){memory,   begin,  place,         accelerate, pose,
                                                      jacobian, motion, reaction,      sums,       contacts,
                                                      loops,    struts, slopes_memory, slopes,     jacobian_rate};

}  // namespace lanes
}  // namespace flexarm
