"use strict";
// Plays what flexarm/view/page.py tells, in #data. Frames are 16-bit numbers; a cubic spline goes through them,
// as in track.py. drawing.js draws.

class Track extends Frame {
  constructor(data) {
    super();
    Object.assign(this, { t: data.t, body: data.body, title: data.title, error: data.error });
    const steps = new Int16Array(numbers(data.frames));
    const columns = Object.entries(data.columns);
    this.width = columns.reduce((sum, [, c]) => sum + c.count * c.centre.length, 0);
    this.start = {};
    const centre = new Float32Array(this.width), scale = new Float32Array(this.width);
    let k = 0;
    for (const [name, c] of columns) {
      this.start[name] = k;
      for (let i = 0; i < c.count * c.centre.length; i++, k++) {
        centre[k] = c.centre[i % c.centre.length];
        scale[k] = c.scale[i % c.centre.length];
      }
    }
    this.values = new Float32Array(steps.length);
    for (let i = 0; i < steps.length; i++)
      this.values[i] = centre[i % this.width] + scale[i % this.width] * steps[i];
    this.now = new Float32Array(this.width);
    this.solve();
    this.seek(this.t[0]);
  }

  // At one end, into its row of m: the slope of the cubic through four frames.
  end(at, step) {
    const T = this.t, n = this.width, count = Math.min(4, T.length), t = (j) => T[at + j * step];
    for (let j = 0; j < count; j++) {
      let weight = j ? 1 / (t(j) - t(0)) : 0;
      for (let i = 1; i < count; i++)
        if (!j) weight += 1 / (t(0) - t(i));
        else if (i !== j) weight *= (t(0) - t(i)) / (t(j) - t(i));
      for (let k = 0; k < n; k++) this.slopes[at * n + k] += weight * this.values[(at + j * step) * n + k];
    }
  }

  // The spline's slopes at the frames: rows h m- + 2 (h- + h) m + h- m+ = 3 (h d- + h- d), eliminated downwards.
  solve() {
    const T = this.t, x = this.values, n = this.width, last = T.length - 1;
    const m = (this.slopes = new Float32Array(x.length)), factor = new Float64Array(T.length);
    if (last < 1) return;
    const chord = (i, k) => (x[(i + 1) * n + k] - x[i * n + k]) / (T[i + 1] - T[i]);
    this.end(0, 1);
    this.end(last, -1);
    for (let i = 1; i < last; i++) {
      const h = T[i] - T[i - 1], next = T[i + 1] - T[i], pivot = 2 * (h + next) - next * factor[i - 1];
      factor[i] = h / pivot;
      for (let k = 0; k < n; k++) {
        const right = 3 * (next * chord(i - 1, k) + h * chord(i, k));
        m[i * n + k] = (right - next * m[(i - 1) * n + k]) / pivot;
      }
    }
    for (let i = last - 1; i > 0; i--)
      for (let k = 0; k < n; k++) m[i * n + k] -= factor[i] * m[(i + 1) * n + k];
  }

  // All columns at time t, in this.now.
  seek(t) {
    const T = this.t, x = this.values, m = this.slopes, n = this.width, last = T.length - 1;
    if (last < 1) return this.now.set(x);
    t = Math.min(Math.max(t, T[0]), T[last]);
    let low = 0, high = last;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (T[middle] <= t) low = middle; else high = middle;
    }
    const h = T[low + 1] - T[low], s = (t - T[low]) / h;
    const a = (1 + 2 * s) * (1 - s) ** 2, b = s * s * (3 - 2 * s), c = h * s * (1 - s) ** 2, d = -h * s * s * (1 - s);
    for (let i = 0, j = low * n; i < n; i++, j++) this.now[i] = a * x[j] + b * x[j + n] + c * m[j] + d * m[j + n];
  }
}

class PlayedPane extends Pane {
  fill() {
    super.fill();
    this.traces = this.track.body.tips.map((tip) => this.makeTrace(tip)).filter((trace) => trace);
  }

  makeTrace([node, at]) {
    const { t } = this.track, points = [], p = new THREE.Vector3();
    const each = Math.max(1, Math.min(6, Math.floor(4000 / t.length)));
    this.traceTimes = [];
    for (let i = 0; i < t.length; i++)
      for (let k = 0; k < (i + 1 < t.length ? each : 1); k++) {
        const time = k ? t[i] + ((t[i + 1] - t[i]) * k) / each : t[i];
        this.track.seek(time);
        this.track.point(node, at, p);
        points.push(p.x, p.y, p.z);
        this.traceTimes.push(time);
      }
    if (this.traceTimes.length < 2) return null;
    const geometry = new THREE.BufferGeometry().setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    const pale = new THREE.LineBasicMaterial({ color: new THREE.Color(told.colours.trace).lerp(new THREE.Color("#FFFFFF"), 0.55) });
    const colour = { color: told.colours.trace };
    const done = slow
      ? new THREE.Line(geometry.clone(), new THREE.LineBasicMaterial(colour))
      : new THREE.Line2(new THREE.LineGeometry().setPositions(points), new THREE.LineMaterial({ ...colour, linewidth: 2.4 }));
    done.frustumCulled = false;
    this.groups.trace.add(new THREE.Line(geometry, pale), done);
    return done;
  }

  update() {
    this.track.seek(clock);
    super.update();
    let n = 0; // the same of all traces
    while (n < this.traceTimes.length && this.traceTimes[n] <= clock) n++;
    for (const done of this.traces) {
      if (slow) done.geometry.setDrawRange(0, n);
      else done.geometry.instanceCount = Math.max(n - 1, 0);
    }
  }
}

// -- the page --------------------------------------------------------------------------------------------------------

let playing = false, clock = 0;
const first = Math.min(...told.tracks.map((d) => d.t[0])), last = Math.max(...told.tracks.map((d) => d.t[d.t.length - 1]));
const digits = Math.max(0, Math.min(6, 3 - Math.floor(Math.log10(Math.max(last - first, 1e-6)))));

function start() {
  startDrawing();
  told.tracks.forEach((data, i) => panes.push(new PlayedPane(new Track(data), i, told.tracks.length)));
  makeLegend(last > first);
  makeControls();
  resize();
  if (last > first) setPlaying(true);
  requestAnimationFrame(draw);
}

function setPlaying(on) {
  playing = on;
  if (on && clock >= last) clock = first;
  document.getElementById("play").textContent = on ? "Pause" : "Play";
}

function makeControls() {
  const bar = make("div", null, { id: "controls" });
  const play = make("button", bar, { id: "play", textContent: "Play", title: "space" });
  const slider = make("input", bar, { id: "slider", type: "range", min: 0, max: 10000, value: 0 });
  make("span", bar, { id: "clock" });
  const speed = make("select", bar, { id: "speed", title: "speed" });
  const again = make("button", bar, { textContent: "Camera", title: "the camera back to where it was" });
  const choices = new Set([0.001, 0.01, 0.05, 0.1, 0.25, 0.5, 1, 2, 5, told.speed]);
  for (const s of [...choices].sort((a, b) => a - b))
    make("option", speed, { value: s, textContent: `${Number(s.toPrecision(3))} \u00d7 real time`, selected: s === told.speed });
  play.addEventListener("click", () => setPlaying(!playing));
  slider.addEventListener("input", () => { setPlaying(false); clock = first + ((last - first) * slider.value) / 10000; dirty = true; });
  speed.addEventListener("change", () => { told.speed = Number(speed.value); });
  again.addEventListener("click", look);
  window.addEventListener("keydown", (event) => {
    if (event.key === " ") { setPlaying(!playing); event.preventDefault(); }
  });
  if (!(last > first)) for (const e of [play, slider, speed, document.getElementById("clock")]) e.style.visibility = "hidden";
  clock = first;
}

let before = 0;
function draw(now) {
  requestAnimationFrame(draw);
  const passed = Math.min((now - before) / 1000, 0.1);
  before = now;
  if (playing) {
    clock += passed * told.speed;
    if (clock > last) clock = told.cycle ? first + ((clock - first) % (last - first)) : last;
    if (clock >= last && !told.cycle) setPlaying(false);
    dirty = true;
  }
  if (!dirty) return;
  dirty = false;
  drawNow();
}

function drawNow() {
  drawPanes();
  document.getElementById("clock").textContent = `${clock.toFixed(digits)} of ${last.toFixed(digits)} s`;
  document.getElementById("slider").value = last > first ? (10000 * (clock - first)) / (last - first) : 0;
}

try {
  start();
} catch (problem) {
  cannotDraw(problem);
}
