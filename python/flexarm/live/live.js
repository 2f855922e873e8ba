"use strict";
// A page that computes: the arm of core.js, drawn by drawing.js, with sliders, a hand at its tip, and its deflection.

const live = told.live;
const PIECE = 4e-3; // s, between two looks at the hand and two points of the plot
const SHOWN = 6; // s, of the plot
const TRAIL = 400; // pieces of the tip's path
const BUDGET = 25; // ms of a picture that steps may take; what is left over, the arm is slower than its clock
const shades = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00"];

// -- the arm -----------------------------------------------------------------------------------------------------------

class LiveArm extends Frame {
  constructor(core) {
    super();
    const n = live.nodes.length;
    Object.assign(this, { core, body: live.body, title: live.title, run: null });
    this.start = { position: 0, quaternion: 3 * n, strain: 7 * n };
    this.now = new Float64Array(10 * n);
    this.variants = live.variants.map((told) => new Numbers(told));
    this.own = live.sliders.map((slider) => slider.value);
    this.values = this.own.slice();
    this.choice = 0;
    this.turned = new THREE.Matrix4();
    this.restart();
  }

  get scene() { return this.variants[this.choice]; }
  get begin() { return this.scene.document.t[0]; }
  get end() { return this.scene.document.t[1]; }

  // The scene at the sliders' values, from a state on. Where that cannot be, what was goes on.
  beginAt(t, q, v) {
    const of = this.scene, at = (x) => of.sliders.map((k) => x[k]);
    const run = new Run(this.core, of.json(at(this.values), at(this.own)), { t, q, v });
    if (this.run) this.run.free();
    this.run = run;
    this.links = of.document.arm.links;
    this.slices = live.nodes.map(([link, part]) => (link < 0 || part === null ? -1 : run.slice(link, part * this.lengthOf(link))));
    this.tips = live.bent.map(({ link }) => ["clamp", "tip"].map((end) => run.slice(link, end === "tip" ? this.lengthOf(link) : 0)));
    this.look();
  }

  lengthOf(link) { return this.links[link].beam.length; }

  restart() {
    const { q0, v0 } = this.scene.document;
    this.beginAt(this.begin, q0, v0);
    this.clock = 0; // goes on where the scene begins again
  }

  // From its state now, at other values or with another controller, whose memory is new.
  carryOn(t) {
    const { q0, v0 } = this.scene.document, mine = (x, count, more) => [...x.slice(0, count), ...more.slice(count)];
    const wanted = t === undefined ? this.run.t : t, span = this.end - this.begin;
    const within = wanted < this.end ? wanted : this.begin + ((wanted - this.begin) % span);
    this.beginAt(within, mine(this.run.q, live.nq, q0), mine(this.run.v, live.nv, v0));
  }

  advance(piece) {
    const to = this.run.t + piece;
    this.run.advance(Math.min(to, this.end));
    this.clock += piece;
    if (to < this.end) return;
    if (live.variants[this.choice].returns) this.carryOn(this.begin); // its command begins again
    else this.beginAt(this.begin, this.scene.document.q0, this.scene.document.v0);
  }

  // Where the nodes are.
  look() {
    const { now, start } = this, at = new THREE.Vector3(), quaternion = new THREE.Quaternion();
    live.nodes.forEach(([link, , offset], i) => {
      const p = 3 * i, r = start.quaternion + 4 * i;
      if (link < 0) return now.set([0, 0, 0, 1], r);
      const seen = this.slices[i] < 0 ? this.run.atEnd(link) : this.run.atSlice(this.slices[i]);
      const R = this.turned.set(seen[3], seen[4], seen[5], seen[0], seen[6], seen[7], seen[8], seen[1], seen[9], seen[10], seen[11], seen[2], 0, 0, 0, 1);
      at.fromArray(offset).applyMatrix4(R).toArray(now, p);
      quaternion.setFromRotationMatrix(R).toArray(now, r);
      if (this.slices[i] >= 0) now.set([seen[17], seen[13], seen[14]], start.strain + p);
    });
  }

  // Displacements of the beams' ends in the axes of their clamps (m), one for each line of the plot.
  deflections() {
    return live.bent.flatMap(({ link, axes, rest }, i) => {
      const [clamp, tip] = this.tips[i], c = Array.from(this.run.atSlice(clamp)), e = this.run.atSlice(tip);
      const d = [0, 1, 2].map((k) => e[k] - c[k]);
      return axes.map((axis) => d[0] * c[3 + axis] + d[1] * c[6 + axis] + d[2] * c[9 + axis] - rest[axis] * this.lengthOf(link));
    });
  }
}

// -- the hand: a spring between the mouse and an end of the arm -----------------------------------------------------

class Hand {
  constructor(pane, arm) {
    Object.assign(this, { arm, tip: -1, force: 0, at: new THREE.Vector3(), plane: new THREE.Plane(), ray: new THREE.Raycaster() });
    const geometry = new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(new Float32Array(6), 3));
    this.line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: told.colours.force }));
    this.line.frustumCulled = false;
    this.ball = new THREE.Mesh(new THREE.SphereGeometry(0.8 * symbol, 16, 12), matte(told.colours.force));
    pane.scene.add(this.line, this.ball);
    this.text = make("div", stage, { className: "label" });
    const canvas = renderer.domElement;
    canvas.style.touchAction = "none";
    canvas.addEventListener("pointerdown", (e) => this.take(e), true);
    canvas.addEventListener("pointermove", (e) => this.move(e), true);
    for (const over of ["pointerup", "pointercancel"]) canvas.addEventListener(over, () => this.release(), true);
    this.show();
  }

  // The pointer in the picture, -1 to 1, and in pixels.
  pointer(event) {
    const box = renderer.domElement.getBoundingClientRect();
    const x = event.clientX - box.left, y = event.clientY - box.top;
    return { x, y, in: new THREE.Vector2((2 * x) / box.width - 1, 1 - (2 * y) / box.height), box };
  }

  end(i) {
    const [node, at] = this.arm.body.tips[i];
    return this.arm.point(node, at, new THREE.Vector3());
  }

  take(event) {
    const { x, y, box } = this.pointer(event);
    const far = this.arm.body.tips.map((_, i) => {
      const p = this.end(i).project(camera);
      return Math.hypot(((p.x + 1) / 2) * box.width - x, ((1 - p.y) / 2) * box.height - y);
    });
    const nearest = far.indexOf(Math.min(...far));
    if (!(far[nearest] < 36)) return;
    event.stopImmediatePropagation(); // the camera stays
    renderer.domElement.setPointerCapture(event.pointerId);
    this.tip = nearest;
    camera.getWorldDirection(this.plane.normal);
    this.plane.setFromNormalAndCoplanarPoint(this.plane.normal, this.end(nearest));
    this.move(event);
  }

  move(event) {
    if (this.tip < 0) {
      const { x, y, box } = this.pointer(event), p = this.end(0).project(camera);
      const near = Math.hypot(((p.x + 1) / 2) * box.width - x, ((1 - p.y) / 2) * box.height - y) < 36;
      renderer.domElement.style.cursor = near ? "grab" : "";
      return;
    }
    event.stopImmediatePropagation();
    this.ray.setFromCamera(this.pointer(event).in, camera);
    this.ray.ray.intersectPlane(this.plane, this.at);
    dirty = true;
  }

  release() {
    if (this.tip >= 0) this.arm.run.push(live.loads[this.tip], [0, 0, 0]);
    this.tip = -1;
    dirty = true;
  }

  // Pulls, before a piece of time; the arm's nodes are up to date.
  pull() {
    if (this.tip < 0) return;
    const pulled = this.at.clone().sub(this.end(this.tip)).multiplyScalar(live.stiffness);
    this.force = pulled.length();
    this.arm.run.push(live.loads[this.tip], pulled.toArray());
  }

  show() {
    const on = this.tip >= 0;
    this.line.visible = this.ball.visible = on;
    this.text.style.display = on ? "" : "none";
    if (!on) return;
    const { position } = this.line.geometry.attributes;
    this.end(this.tip).toArray(position.array, 0);
    this.at.toArray(position.array, 3);
    position.needsUpdate = true;
    this.ball.position.copy(this.at);
    const p = this.at.clone().project(camera);
    this.text.textContent = `${this.force.toPrecision(3)} N`;
    this.text.style.transform = `translate(${((p.x + 1) / 2) * stage.clientWidth + 12}px, ${((1 - p.y) / 2) * stage.clientHeight - 8}px)`;
  }
}

// -- the picture and the plot ------------------------------------------------------------------------------------------

class LivePane extends Pane {
  fill() {
    super.fill();
    this.path = [];
    const geometry = new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * TRAIL), 3));
    this.trail = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: told.colours.trace }));
    this.trail.frustumCulled = false;
    this.groups.trace.add(this.trail);
  }

  remember() {
    this.path.push(Array.from(this.track.run.atEnd(live.ends[live.ends.length - 1]).slice(0, 3)));
    if (this.path.length > TRAIL) this.path.shift();
  }

  update() {
    super.update();
    const { position } = this.trail.geometry.attributes;
    this.path.forEach((p, i) => position.array.set(p, 3 * i));
    position.needsUpdate = true;
    this.trail.geometry.setDrawRange(0, this.path.length);
  }
}

// Deflections over the last seconds.
class Plot {
  constructor(parent, labels) {
    this.canvas = make("canvas", parent, { id: "plot" });
    this.labels = labels;
    this.times = [];
    this.rows = labels.map(() => []);
    this.most = 0;
  }

  clear() {
    this.times.length = 0;
    this.rows.forEach((row) => { row.length = 0; });
  }

  add(t, values) {
    this.times.push(t);
    values.forEach((value, i) => this.rows[i].push(value));
    const old = this.times.findIndex((x) => x >= t - SHOWN);
    if (old > 200) {
      this.times.splice(0, old);
      this.rows.forEach((row) => row.splice(0, old));
    }
  }

  // 1, 2 or 5 times a power of ten, so that about `count` of them are the span.
  static step(span, count) {
    const power = 10 ** Math.floor(Math.log10(span / count));
    return [1, 2, 5, 10].map((f) => f * power).find((s) => span / s <= count);
  }

  draw() {
    const ratio = Math.min(window.devicePixelRatio, 2), box = this.canvas.getBoundingClientRect();
    const [wide, high] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (this.canvas.width !== wide || this.canvas.height !== high) Object.assign(this.canvas, { width: wide, height: high });
    const g = this.canvas.getContext("2d", { willReadFrequently: slow }), left = 52, right = box.width - 10, top = 22, bottom = box.height - 20;
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, box.width, box.height);
    g.font = "12px system-ui, sans-serif";
    const last = this.times.length ? this.times[this.times.length - 1] : 0, begin = Math.max(last - SHOWN, 0);
    let most = 1e-6;
    for (const row of this.rows) for (const x of row) if (Math.abs(x) > most) most = Math.abs(x);
    this.most = most > this.most || most < 0.4 * this.most ? 1.15 * most : this.most;
    const milli = this.most < 0.5, unit = milli ? 1000 : 1, tick = Plot.step(2 * this.most * unit, 5);
    const px = (t) => left + ((t - begin) / SHOWN) * (right - left), py = (y) => (top + bottom) / 2 - (y / this.most) * ((bottom - top) / 2);
    g.fillStyle = "#555";
    g.strokeStyle = "#E4E4E4";
    g.lineWidth = 1;
    g.beginPath();
    g.textAlign = "right";
    g.textBaseline = "middle";
    for (let k = -Math.floor((this.most * unit) / tick); k * tick <= this.most * unit; k++) {
      const y = py((k * tick) / unit);
      g.moveTo(left, y);
      g.lineTo(right, y);
      g.fillText(Number((k * tick).toPrecision(6)).toString().replace("-", "\u2212"), left - 6, y);
    }
    g.textAlign = "center";
    g.textBaseline = "top";
    for (let t = Math.ceil(begin); t <= begin + SHOWN; t++) {
      g.moveTo(px(t), top);
      g.lineTo(px(t), bottom);
      if (px(t) < right - 30) g.fillText(t, px(t), bottom + 4);
    }
    g.stroke();
    g.fillText("s", right - 6, bottom + 4);
    g.textAlign = "left";
    g.fillText(`deflection (${milli ? "mm" : "m"})`, 6, 4);
    let x = left + 82;
    this.labels.forEach((label, i) => {
      g.fillStyle = shades[i % shades.length];
      g.fillText(label, x, 4);
      x += g.measureText(label).width + 16;
    });
    g.save();
    g.beginPath();
    g.rect(left, top - 1, right - left, bottom - top + 2);
    g.clip();
    g.lineWidth = 1.6;
    this.rows.forEach((row, i) => {
      g.strokeStyle = shades[i % shades.length];
      g.beginPath();
      for (let k = 0; k < row.length; k++) g.lineTo(px(this.times[k]), py(row[k]));
      g.stroke();
    });
    g.restore();
  }
}

// -- the page --------------------------------------------------------------------------------------------------------

let arm, hand, plot, pane, playing = true, speed = 1, before = 0, owed = 0, pieces = 0, real = 1, beside = false;
const pictures = []; // times of the last ones (ms)

// A step, a start or a slider that could not be: it is told, and the arm waits.
function tell(problem) {
  const box = document.getElementById("told");
  box.textContent = problem ? problem.message : "";
  box.style.display = problem ? "" : "none";
}
function attempt(work) {
  try {
    work();
    tell(null);
    return true;
  } catch (problem) {
    tell(problem);
    return false;
  }
}

function shownNumber(x) { return Number(x.toPrecision(3)).toString(); }

function makeSliders(parent) {
  live.sliders.forEach((slider, k) => {
    const label = make("label", parent, { className: "slider", title: slider.title });
    make("span", label, { textContent: slider.label });
    const value = make("b", label);
    const stops = slider.stops, index = (x) => stops.findIndex((stop) => stop === x);
    const input = make("input", label, stops
      ? { type: "range", min: 0, max: stops.length - 1, step: 1, value: index(slider.value) }
      : { type: "range", min: slider.low, max: slider.high, step: "any", value: slider.value });
    const say = () => { value.textContent = `${shownNumber(arm.values[k])} ${slider.unit}`; };
    const set = (x) => {
      const old = arm.values[k];
      arm.values[k] = x;
      if (!attempt(() => arm.carryOn())) arm.values[k] = old;
      say();
      dirty = true;
    };
    input.addEventListener("input", () => set(stops ? stops[input.value] : Number(input.value)));
    slider.reset = () => {
      input.value = stops ? index(slider.value) : slider.value;
      arm.values[k] = slider.value;
      say();
    };
    slider.show = () => { input.disabled = !arm.scene.sliders.includes(k); };
    say();
  });
}

function choose(k) {
  const old = arm.choice;
  arm.choice = k;
  if (!attempt(() => arm.carryOn())) arm.choice = old;
  Array.from(document.querySelectorAll("#choice button"), (button, i) => button.classList.toggle("on", i === arm.choice));
  live.sliders.forEach((slider) => slider.show());
  dirty = true;
}

function setPlaying(on) {
  playing = on;
  document.getElementById("play").textContent = on ? "Pause" : "Play";
}

function makePanel() {
  const panel = document.getElementById("legend"), inputs = make("div", null, { id: "inputs" });
  panel.prepend(inputs);
  if (live.variants.length > 1) {
    const row = make("div", inputs, { id: "choice" });
    live.variants.forEach(({ name }, k) => make("button", row, { textContent: name }).addEventListener("click", () => choose(k)));
  }
  makeSliders(inputs);
  const bar = make("div", null, { id: "controls" });
  make("button", bar, { id: "play", textContent: "Pause", title: "space" }).addEventListener("click", () => setPlaying(!playing));
  make("button", bar, { id: "reset", textContent: "Reset", title: "the scene's own values, from its start" }).addEventListener("click", () => {
    live.sliders.forEach((slider) => slider.reset());
    attempt(() => arm.restart());
    plot.clear();
    pane.path.length = 0;
    setPlaying(true);
    dirty = true;
  });
  make("button", bar, { id: "again", textContent: "Camera", title: "the camera back to where it was" }).addEventListener("click", look);
  const choice = make("select", bar, { id: "speed", title: "speed" });
  for (const s of [0.02, 0.1, 0.25, 0.5, 1, 2])
    make("option", choice, { value: s, textContent: `${s} \u00d7 real time`, selected: s === 1 });
  choice.addEventListener("change", () => { speed = Number(choice.value); });
  make("span", bar, { id: "clock" });
  window.addEventListener("keydown", (event) => {
    if (event.key !== " " || event.target.tagName === "BUTTON") return;
    setPlaying(!playing);
    event.preventDefault();
  });
}

// Steps that the passed time is worth.
function compute(passed) {
  owed = Math.min(owed + passed * speed, 0.1);
  const wanted = owed, begun = performance.now();
  const went = attempt(() => {
    while (owed >= PIECE && performance.now() - begun < BUDGET) {
      hand.pull();
      arm.advance(PIECE);
      owed -= PIECE;
      if (++pieces % 2 === 0) plot.add(arm.clock, arm.deflections());
      pane.remember();
      if (hand.tip >= 0) arm.look();
    }
    arm.look();
  });
  if (!went) setPlaying(false);
  if (wanted >= PIECE) real += 0.05 * ((wanted - (owed >= PIECE ? owed : 0)) / wanted - real);
}

function draw(now) {
  requestAnimationFrame(draw);
  const passed = Math.min((now - before) / 1000, 0.1);
  before = now;
  if (playing) {
    compute(passed);
    dirty = true;
  }
  if (!dirty) return;
  dirty = false;
  hand.show();
  drawPanes();
  pictures.push(now);
  if (pictures.length > 61) pictures.shift();
  beside = playing && !beside;
  if (beside) return;  // the plot and the clock beside the arm: at every other picture of one that moves
  plot.draw();
  const rate = (1000 * (pictures.length - 1)) / (now - pictures[0] || 1);
  const slower = real < 0.95 ? `, ${real.toFixed(2)} of real time` : "";
  document.getElementById("clock").textContent = `${arm.clock.toFixed(2)} s${slower} \u00b7 ${rate.toFixed(0)} pictures/s`;
}

async function start() {
  const box = make("div", null, { id: "told" });
  box.style.display = "none";
  const core = await Core.load(await unpacked(live.core));
  arm = new LiveArm(core);
  startDrawing();
  panes.push((pane = new LivePane(arm, 0, 1)));
  makeLegend(true);
  plot = new Plot(make("div", null, { id: "graph" }), live.bent.flatMap(({ labels }) => labels));
  makePanel();
  hand = new Hand(pane, arm);
  choose(0);
  resize();
  setPlaying(true);
  document.body.classList.add("ready");
  requestAnimationFrame((now) => { before = now; draw(now); });
}

start().catch(cannotDraw);
