// Compiled once for each instruction set, with FLEXARM_ISA its name and FLEXARM_WIDTH its doubles. Everything but the
// table is in an unnamed namespace, so that no function of one set can end up in another's path.
#include "wide/pack.hpp"  // before the others
// clang-format: keep
#include "arm/composite.hpp"
#include "arm/elimination.hpp"
#include "isa.hpp"
#include "slopes/slopes.hpp"

namespace {

template <class Sp>
using Single = Chain<Sp, Pack>;

/// The beginning of the memory.
struct Head {
  const Layout* layout;
  void* composite;  ///< the memory of Composite
  alignas(64) char chain[128];
};

template <class F>
decltype(auto) on(void* self, const F& f) {
  Head& head = *static_cast<Head*>(self);
  if (head.layout->planar) return f(*view<Single<Plane<double>>>(head.chain));
  return f(*view<Single<Space<double>>>(head.chain));
}

/// @return bytes that are taken behind the head
template <class Sp>
std::size_t lay_out(const Layout& layout, const double* numbers, Head* head) {
  static_assert(sizeof(Single<Sp>) <= sizeof(head->chain), "the chain's head");
  Arena arena = head ? Arena(head + 1) : Arena();
  const Single<Sp> chain(layout, numbers, arena);
  if (head) {
    __builtin_memcpy(head->chain, &chain, sizeof(chain));
    head->composite = view<char>(head + 1) + arena.bytes();
  }
  Composite<Sp>(layout, arena);
  return arena.bytes();
}
std::size_t lay_out(const Layout& layout, const double* numbers, Head* head) {
  return layout.planar ? lay_out<Plane<double>>(layout, numbers, head) : lay_out<Space<double>>(layout, numbers, head);
}

std::size_t memory(const Layout& layout) { return sizeof(Head) + lay_out(layout, nullptr, nullptr); }

void begin(const Layout& layout, const double* numbers, void* memory) {
  Head* head = static_cast<Head*>(memory);
  head->layout = &layout;
  lay_out(layout, numbers, head);
}

void load(void* self, const double* wrenches) {
  on(self, [&](auto& chain) {
    for (int i = 0; i < 6 * chain.layout.loads; ++i) chain.wrench[i] = wrenches[i];
  });
}

Outcome forward(void* self, const double* q, const double* v, const double* tau, double* a) {
  return on(self, [&](auto& chain) {
    chain.move(q, v);
    return outcome(chain, ::forward(chain, chain.base(), tau, a));
  });
}

void inverse(void* self, const double* q, const double* v, const double* a, double* tau) {
  on(self, [&](auto& chain) {
    chain.move(q, v);
    chain.forces(chain.base(), a, tau);
    accelerate_loops(chain, chain.base(), a);
  });
}

void move(void* self, const double* q, const double* v) {
  on(self, [&](auto& chain) { v ? chain.move(q, v) : chain.template move<false>(q, v); });
}

void forces(void* self, const double* a, double* tau) {
  on(self, [&](auto& chain) { chain.forces(chain.base(), a, tau); });
}

template <class C>
void fill(C& chain, void* memory, double* M) {
  Composite<typename C::Space>(chain.layout, Arena(memory)).run(chain, M);
}

void mass_matrix(void* self, double* M) {
  on(self, [&](auto& chain) { fill(chain, static_cast<Head*>(self)->composite, M); });
}

void contacts(void* self, double* remembered, double* force) {
  on(self, [&](auto& chain) {
    if (chain.layout.contacts == 0) return;
    if (remembered) chain.by_state->put_now(chain.layout, remembered);
    if (force) chain.by_state->put_contact_forces(chain.layout, force);
  });
}

void recall(void* self, const double* remembered) {
  on(self, [&](auto& chain) {
    if (chain.layout.contacts > 0) chain.by_state->recall(chain.layout, remembered);
  });
}

void step_contacts(void* self, double by_end) {
  on(self, [&](auto& chain) {
    if (chain.layout.contacts > 0) chain.by_state->by_end = by_end;
  });
}

bool met(void* self) {
  return on(self, [&](auto& chain) { return chain.layout.contacts > 0 && chain.by_state->met(chain.layout); });
}

Outcome factor(void* self, const Shift& shift, const double* v, double* twice_kinetic) {
  return on(self, [&](auto& chain) {
    *twice_kinetic = chain.twice_kinetic(v);
    return outcome(chain, ::factor(chain, shift));
  });
}

void solve(void* self, const double* r, double* x) {
  on(self, [&](auto& chain) { ::solve(chain, r, x); });
}

void correct(void* self, double* r, double* x) {
  on(self, [&](auto& chain) { solve_step(chain, r, x); });
}

void close_accelerations(void* self, double* x) {
  on(self, [&](auto& chain) { chain.by_state->loops.close_accelerations(chain.layout, x); });
}

double close_places(void* self, const Shift& shift, double* w) {
  return on(self, [&](auto& chain) { return chain.by_state->loops.close_places(chain.layout, w, shift.stiffness); });
}

double close_rates(void* self, const Shift& shift, double* z) {
  return on(self, [&](auto& chain) { return chain.by_state->loops.close_rates(chain.layout, z, shift.damping); });
}

void hold_change(void* self) {
  on(self, [&](auto& chain) { chain.by_state->loops.hold_change(chain.layout, true); });
}

void let_go(void* self) {
  on(self, [&](auto& chain) { chain.by_state->loops.let_go(chain.layout); });
}

bool closed(void* self) {
  return on(self, [&](auto& chain) { return chain.by_state->loops.closed(chain.layout); });
}

void project(void* self, const Shift& shift, double* q, double* v, double* scratch) {
  on(self, [&](auto& chain) {
    if (chain.layout.rigid_rows > 0) ::project(chain, shift, q, v, scratch);
  });
}

void shut(void* self, double* q, double* v, double* scratch) {
  on(self, [&](auto& chain) { ::shut(chain, q, v, scratch); });
}

void react(void* self, double* r, double* scratch, double* forces) {
  on(self, [&](auto& chain) {
    ::react(chain, r, scratch);
    chain.by_state->loops.put_forces(chain.layout, forces);
  });
}

void loop_rows(void* self, double* rows, double* G) {
  on(self, [&](auto& chain) {
    if (chain.layout.loops == 0) return;
    auto& loops = chain.by_state->loops;
    if (G) loops.gather(chain);
    for (int k = 0; k < chain.layout.loop_rows; ++k) {
      if (loops.row[k].soft) continue;
      for (const double x : {loops.row[k].g, loops.row[k].rate, loops.row[k].second}) *rows++ = x;
      for (int i = 0; i < chain.layout.nv && G; ++i) *G++ = loops.G[k * chain.layout.nv + i];
    }
  });
}

void hold(void* self, const double* reactions) {
  on(self, [&](auto& chain) {
    if (chain.layout.loops > 0) chain.by_state->loops.hold(chain.layout, [&](int k) { return reactions[k]; });
  });
}

void stiffness_times(void* self, const double* x, double* out) {
  on(self, [&](auto& chain) {
    for (int i = 0; i < chain.layout.nodes; ++i) {
      const Node& node = chain.layout.node[i];
      const auto& s = chain.state[i];
      if (node.kind != Node::fixed) out[node.v] = node.passive ? s.slope_q * x[node.v] : 0.0;
      for (int k = 0; k < node.ne; ++k) {
        out[node.ve + k] = 0.0;
        for (int j = 0; j < node.ne; ++j)
          out[node.ve + k] += s.elastic.constants[j <= k ? packed(k, j) : packed(j, k)] * x[node.ve + j];
      }
    }
    if (chain.stiffened) chain.by_state->add_stiffness(chain.layout, x, out);
    if (chain.layout.loops > 0) chain.by_state->loops.add_stiffness(chain.layout, x, out);
  });
}

/// f of the arm's Slopes.
template <class F>
decltype(auto) with_slopes(const SlopesOf& of, const F& f) {
  return of.layout.planar ? f(Type<Slopes<Plane<LaneDual>>>{}) : f(Type<Slopes<Space<LaneDual>>>{});
}

std::size_t slopes_memory(const SlopesOf& of) {
  return with_slopes(of, [&](auto t) { return decltype(t)::type::memory(of); });
}

void inverse_slopes(const SlopesOf& of, void* memory, const double* wrenches, const double* q, const double* v,
                    const double* a, double* by_q, double* by_v, double* loops) {
  with_slopes(of, [&](auto t) {
    typename decltype(t)::type(of, memory, by_v != nullptr).inverse(wrenches, q, v, a, by_q, by_v, loops);
  });
}

Outcome forward_slopes(const SlopesOf& of, void* memory, const double* wrenches, const double* q, const double* v,
                       const double* tau, double* a, double* by_q, double* by_v, double* by_tau) {
  return with_slopes(of, [&](auto t) {
    return typename decltype(t)::type(of, memory, true).forward(wrenches, q, v, tau, a, by_q, by_v, by_tau);
  });
}

}  // namespace

namespace flexarm {
namespace lanes {

extern const Kernels FLEXARM_JOIN(kernels_, FLEXARM_ISA);
const Kernels FLEXARM_JOIN(kernels_, FLEXARM_ISA){FLEXARM_TEXT(FLEXARM_ISA),
                                                  FLEXARM_WIDTH,
                                                  memory,
                                                  begin,
                                                  load,
                                                  forward,
                                                  inverse,
                                                  move,
                                                  forces,
                                                  mass_matrix,
                                                  contacts,
                                                  recall,
                                                  step_contacts,
                                                  met,
                                                  factor,
                                                  solve,
                                                  correct,
                                                  close_accelerations,
                                                  close_places,
                                                  close_rates,
                                                  hold_change,
                                                  let_go,
                                                  closed,
                                                  project,
                                                  shut,
                                                  react,
                                                  loop_rows,
                                                  hold,
                                                  stiffness_times,
                                                  slopes_memory,
                                                  inverse_slopes,
                                                  forward_slopes};

}  // namespace lanes
}  // namespace flexarm
