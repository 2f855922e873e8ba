"use strict";
// The C++ core in WebAssembly, by its C interface (flexarm.h), and a scene's numbers as functions of sliders (numbers.py).
// Nothing here needs a page: tests/live runs it by node.

const bytesOf = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const doublesOf = (text) => new Float64Array(bytesOf(text).buffer);

async function unpacked(text) {
  const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

class Core {
  // Of the bytes of flexarm.wasm. It has no files, clocks or terminal: what the C++ library would ask for gives nothing.
  static async load(bytes) {
    const module = await WebAssembly.compile(bytes), imports = {};
    const ended = () => { throw new Error("the core has ended"); };
    for (const { module: from, name } of WebAssembly.Module.imports(module))
      (imports[from] = imports[from] || {})[name] = /exit|abort/.test(name) ? ended : () => 0;
    const core = new Core();
    core.c = (await WebAssembly.instantiate(module, imports)).exports;
    core.c._initialize();
    return core;
  }

  text(at) {
    const bytes = new Uint8Array(this.c.memory.buffer);
    return new TextDecoder().decode(bytes.subarray(at, bytes.indexOf(0, at)));
  }

  get version() { return this.text(this.c.flexarm_version()); }
  fail() { throw new Error(this.text(this.c.flexarm_error())); }

  // Memory of the core: its address.
  room(bytes) { return this.c.malloc(bytes) || this.fail(); }
  put(values) {
    const at = this.room(8 * Math.max(values.length, 1));
    new Float64Array(this.c.memory.buffer, at, values.length).set(values);
    return at;
  }
  numbers(at, count) { return new Float64Array(this.c.memory.buffer, at, count); }
}

// A compiled scene in motion, from a state on.
class Run {
  constructor(core, json, { t, q, v }) {
    const { c } = core, text = new TextEncoder().encode(json + "\0"), at = core.room(text.length);
    new Uint8Array(c.memory.buffer, at, text.length).set(text);
    this.core = core;
    this.scene = c.flexarm_parse(at);
    c.free(at);
    if (!this.scene) core.fail();
    this.nq = c.flexarm_nq(this.scene);
    this.nv = c.flexarm_nv(this.scene);
    const [q0, v0] = [q, v].map((x) => core.put(x));
    this.arm = q.length === this.nq && v.length === this.nv ? c.flexarm_start_at(this.scene, 0, t, q0, v0) : -1;
    c.free(q0);
    c.free(v0);
    if (this.arm < 0) throw new Error(`q has ${q.length}, v ${v.length} numbers; must have ${this.nq} and ${this.nv}`);
    if (!this.arm) {
      c.flexarm_free_scene(this.scene);
      core.fail();
    }
    this.seen = core.room(8 * 18); // place, rotation, strains
  }

  done(code) { return code < 0 ? this.core.fail() : code; }
  step() { this.done(this.core.c.flexarm_step(this.arm)); }
  advance(until) { this.done(this.core.c.flexarm_advance(this.arm, until)); }
  get t() { return this.core.c.flexarm_time(this.arm); }
  get q() { return this.core.numbers(this.core.c.flexarm_q(this.arm), this.nq); }
  get v() { return this.core.numbers(this.core.c.flexarm_v(this.arm), this.nv); }

  slice(link, x) { return this.done(this.core.c.flexarm_add_slice(this.arm, link, x)); }

  // Place (3), rotation (9) and strains (6: K1, K2, K3, phi12, phi13, eps) of a slice; valid until the next call.
  atSlice(k) {
    const at = this.seen;
    this.done(this.core.c.flexarm_slice(this.arm, k, at, at + 24, at + 96));
    return this.core.numbers(at, 18);
  }
  // Place and rotation of a link's end.
  atEnd(link) {
    this.done(this.core.c.flexarm_pose(this.arm, link, this.seen, this.seen + 24));
    return this.core.numbers(this.seen, 12);
  }

  push(load, force) {
    this.core.numbers(this.seen, 6).set([...force, 0, 0, 0]);
    this.done(this.core.c.flexarm_set_load(this.arm, load, this.seen));
  }

  free() {
    const { c } = this.core;
    c.flexarm_free_simulation(this.arm);
    c.flexarm_free_scene(this.scene);
    c.free(this.seen);
  }
}

// A scene's compiled document with sliders: what numbers.py has tabulated.
class Numbers {
  constructor(told) {
    this.document = told.document;
    this.sliders = told.sliders; // which of the page's
    this.stops = told.stops;
    this.straight = told.straight;
    this.tables = told.tables.map((table) => ({
      sliders: table.sliders, at: new Uint32Array(bytesOf(table.at).buffer), values: doublesOf(table.values),
    }));
    this.places = [];
    const find = (within) => {
      for (const [key, value] of Object.entries(within))
        if (typeof value === "number") this.places.push([within, key]);
        else if (value !== null && typeof value === "object") find(value);
    };
    find(this.document);
    this.own = this.places.map(([within, key]) => within[key]);
  }

  // How much of each stop of slider k is in a value: of straight ones both ends, of others the nearest.
  shares(k, x) {
    const stops = this.stops[k];
    if (this.straight[k]) {
      const part = (x - stops[0]) / (stops[1] - stops[0]);
      return [1 - part, part];
    }
    let best = 0;
    stops.forEach((stop, j) => { if (Math.abs(stop - x) < Math.abs(stops[best] - x)) best = j; });
    return stops.map((_, j) => (j === best ? 1 : 0));
  }

  // The document at values of the sliders; `own`: those of the scene itself.
  json(values, own) {
    const numbers = this.own.slice();
    for (const { sliders, at, values: rows } of this.tables) {
      if (sliders.every((k) => values[k] === own[k])) continue;
      let weights = [1];
      for (const k of sliders) {
        const shares = this.shares(k, values[k]);
        weights = weights.flatMap((w) => shares.map((s) => w * s));
      }
      for (let i = 0; i < at.length; i++) {
        let sum = 0;
        weights.forEach((w, row) => { if (w !== 0) sum += w * rows[row * at.length + i]; });
        numbers[at[i]] = sum;
      }
    }
    this.places.forEach(([within, key], i) => { within[key] = numbers[i]; });
    return JSON.stringify(this.document);
  }
}

if (typeof module !== "undefined") module.exports = { Core, Run, Numbers, unpacked };
