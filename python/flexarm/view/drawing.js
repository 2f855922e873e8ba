"use strict";
// The arm in 3-D, as pages draw it that play or compute: the told content of #data, nodes, parts, panes, camera, legend.

const told = JSON.parse(document.getElementById("data").textContent);

function make(tag, parent, attributes) {
  const made = Object.assign(document.createElement(tag), attributes || {});
  (parent || document.body).appendChild(made);
  return made;
}

// -- frames ----------------------------------------------------------------------------------------------------------

// Where the nodes are now: the columns in `now`, each from its `start`.
class Frame {
  vector(name, i, out) {
    const k = this.start[name] + 3 * i;
    return out.set(this.now[k], this.now[k + 1], this.now[k + 2]);
  }

  turn(i, out) {
    const k = this.start.quaternion + 4 * i;
    return out.set(this.now[k], this.now[k + 1], this.now[k + 2], this.now[k + 3]).normalize();
  }

  // A point that moves with a node.
  point(node, at, out) {
    return out.fromArray(at).applyQuaternion(this.turn(node, spare)).add(this.vector("position", node, spot));
  }
}

const spare = new THREE.Quaternion(), spot = new THREE.Vector3();

// -- what is drawn ---------------------------------------------------------------------------------------------------

const view = told.camera;
const up = new THREE.Vector3().fromArray(view.up);
const symbol = 0.016 * view.radius; // half the width of arrows
const matte = (colour, flat) => new THREE.MeshPhongMaterial({ color: colour, flatShading: !!flat, shininess: 8 });

function arrow(length, radius, colour) {
  const made = new THREE.Group(), head = Math.min(5 * radius, 0.5 * length), material = matte(colour);
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(radius / 2, radius / 2, length - head, 10), material);
  const tip = new THREE.Mesh(new THREE.ConeGeometry(1.6 * radius, head, 14), material);
  shaft.position.y = (length - head) / 2;
  tip.position.y = length - head / 2;
  made.add(shaft, tip);
  return made;
}

function pointed(object, direction) {
  object.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), direction.clone().normalize());
  return object;
}

const AXES = { x: "#D55E00", y: "#009E73", z: "#0072B2" };

function triad(length) {
  const made = new THREE.Group();
  for (const [axis, colour] of Object.entries(AXES)) {
    const direction = new THREE.Vector3();
    direction[axis] = 1;
    made.add(pointed(arrow(length, 0.03 * length, colour), direction));
  }
  return made;
}

const numbers = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;

// Triangles of a file's mesh, corners as 16-bit numbers.
function meshOf(data) {
  const steps = new Int16Array(numbers(data.vertices)), places = new Float32Array(steps.length);
  for (let i = 0; i < steps.length; i++) places[i] = data.centre[i % 3] + data.scale[i % 3] * steps[i];
  const faces = numbers(data.faces), geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
  geometry.setIndex(new THREE.BufferAttribute(data.wide ? new Uint32Array(faces) : new Uint16Array(faces), 1));
  const material = matte(data.colour, true);
  material.side = THREE.DoubleSide;
  return new THREE.Mesh(geometry, material);
}

function solid(part) {
  const [a, b, c] = part.size, colour = part.colour || told.colours[part.part];
  let geometry;
  if (part.kind === "box") geometry = new THREE.BoxGeometry(a, b, c);
  else if (part.kind === "ball") geometry = new THREE.SphereGeometry(a, 24, 16);
  else geometry = new THREE.CylinderGeometry(b, b, a, 24).rotateZ(-Math.PI / 2);
  const [x, y, z] = part.axes;
  const made = new THREE.Mesh(geometry, matte(colour, part.kind === "box"));
  const place = new THREE.Matrix4().set(...x, part.at[0], ...y, part.at[1], ...z, part.at[2], 0, 0, 0, 1);
  made.applyMatrix4(place);
  return made;
}

function strainColour(e, out, k) {
  const stops = told.strain.colours, most = told.strain.most;
  const u = shown.strain && most ? (Math.min(Math.max(e / most, -1), 1) + 1) * 0.5 * (stops.length - 1) : 2;
  const i = Math.min(Math.floor(u), stops.length - 2), s = u - i;
  for (let c = 0; c < 3; c++) out[k + c] = (1 - s) * stops[i][c] + s * stops[i + 1][c];
}

class BeamMesh {
  constructor(beam) {
    Object.assign(this, beam);
    const m = this.outlines[0].length, n = this.count, index = [];
    this.corners = m;
    for (let j = 0; j + 1 < n; j++)
      for (let i = 0; i < m; i++) {
        const a = j * m + i, b = j * m + ((i + 1) % m);
        index.push(a, b, a + m, b, b + m, a + m);
      }
    const cap = THREE.ShapeUtils.triangulateShape(this.outlines[0].map(([y, z]) => new THREE.Vector2(y, z)), []);
    for (const [a, b, c] of cap) index.push(a, c, b, a + (n - 1) * m, b + (n - 1) * m, c + (n - 1) * m);
    const geometry = new THREE.BufferGeometry();
    geometry.setIndex(index);
    for (const name of ["position", "color"])
      geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * m * n), 3));
    const material = new THREE.MeshPhongMaterial({ vertexColors: true, flatShading: true, side: THREE.DoubleSide, shininess: 12 });
    this.plain = this.part === "beam" ? null : new THREE.Color(told.colours[this.part]);
    this.mesh = new THREE.Mesh(geometry, material);
    this.mesh.frustumCulled = false;
  }

  update(track) {
    const { position, color } = this.mesh.geometry.attributes, m = this.corners;
    const p = new THREE.Vector3(), strain = new THREE.Vector3();
    for (let j = 0; j < this.count; j++) {
      track.vector("strain", this.first + j, strain);
      for (let i = 0; i < m; i++) {
        const [y, z] = this.outlines[j][i], k = j * m + i;
        track.point(this.first + j, [0, y, z], p);
        p.toArray(position.array, 3 * k);
        if (this.plain) this.plain.toArray(color.array, 3 * k);
        else strainColour(strain.x - y * strain.z + z * strain.y, color.array, 3 * k);
      }
    }
    position.needsUpdate = color.needsUpdate = true;
  }
}

function floor() {
  const made = new THREE.Group(), step = view.grid, lines = [], reach = Math.ceil((1.3 * view.radius) / step) * step;
  const right = new THREE.Vector3(...[0, 1, 2].map((i) => Math.abs(view.up[(i + 2) % 3])));
  const ahead = new THREE.Vector3().crossVectors(up, right);
  const centre = new THREE.Vector3().fromArray(view.centre);
  const snap = (axis) => Math.round(centre.dot(axis) / step) * step;
  const base = up.clone().multiplyScalar(view.floor).addScaledVector(right, snap(right)).addScaledVector(ahead, snap(ahead));
  for (let s = -reach; s <= reach * (1 + 1e-9); s += step)
    for (const [along, across] of [[right, ahead], [ahead, right]])
      for (const end of [-reach, reach])
        lines.push(base.clone().addScaledVector(across, s).addScaledVector(along, end));
  const geometry = new THREE.BufferGeometry().setFromPoints(lines);
  made.add(new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: "#DDDDDD" })));
  return made;
}

class Pane {
  constructor(track, number, count) {
    Object.assign(this, { track, number });
    this.scene = new THREE.Scene();
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x999999, 0.75));
    this.sun = new THREE.DirectionalLight(0xffffff, 0.45);
    this.scene.add(this.sun);
    this.groups = { floor: floor(), axes: new THREE.Group(), frames: new THREE.Group(), loads: new THREE.Group(), trace: new THREE.Group(), looks: new THREE.Group(), under: new THREE.Group() };
    this.scene.add(...Object.values(this.groups));
    this.moving = []; // [node, object]
    this.beams = track.body.beams.map((beam) => new BeamMesh(beam));
    for (const beam of this.beams) this.scene.add(beam.mesh);
    this.fill();
    this.title = make("div", stage, { className: "title" });
    this.title.append(track.title);
    this.title.style.left = `${(100 * number) / count}%`;
    if (number) make("div", stage, { className: "divider" }).style.left = `${(100 * number) / count}%`;
    this.labels = track.body.labels.map((l) => [l, make("div", stage, { className: "label", textContent: l.text })]);
  }

  hold(node, object, parent) {
    const holder = new THREE.Group();
    holder.add(object);
    (parent || this.scene).add(holder);
    this.moving.push([node, holder]);
  }

  fill() {
    const { body } = this.track;
    for (const part of body.solids) this.hold(part.node, solid(part), part.under ? this.groups.under : part.part === "look" ? this.groups.looks : null);
    for (const mesh of body.meshes) this.hold(mesh.node, meshOf(mesh), this.groups.looks);
    for (const axis of body.axes) {
      const object = new THREE.Group(), direction = new THREE.Vector3().fromArray(axis.direction);
      object.add(pointed(arrow(axis.length, 0.45 * symbol, told.colours.axis), direction));
      object.position.fromArray(axis.at);
      this.hold(axis.node, object, this.groups.axes);
    }
    for (const node of body.frames) this.hold(node, triad(14 * symbol), this.groups.frames);
    for (const [node, at] of body.tips) {
      const end = triad(14 * symbol);
      end.position.fromArray(at);
      this.hold(node, end, this.groups.frames);
    }
    this.bars = body.bars.map(({ ends, part }) => {
      const radius = told.widths[part] * symbol;
      const mesh = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, 1, 10), matte(told.colours[part]));
      this.scene.add(mesh);
      return [ends, mesh];
    });
    this.loads = body.loads.map((node, i) => ["force", "moment"].map((kind) => {
      const made = arrow(1, 0.03, told.colours[kind]);
      this.groups.loads.add(made);
      return [node, i, kind, made];
    })).flat();
  }

  update() {
    const track = this.track, p = new THREE.Vector3(), q = new THREE.Vector3(), y = new THREE.Vector3(0, 1, 0);
    for (const [node, object] of this.moving) {
      track.vector("position", node, object.position);
      track.turn(node, object.quaternion);
    }
    for (const beam of this.beams) {
      beam.mesh.visible = beam.part === "beam" || shown.patches;
      if (beam.mesh.visible) beam.update(track);
    }
    for (const [[a, b], mesh] of this.bars) {
      track.point(a[0], a[1], p);
      track.point(b[0], b[1], q);
      const length = p.distanceTo(q);
      mesh.visible = length > 1e-9;
      mesh.position.addVectors(p, q).multiplyScalar(0.5);
      if (mesh.visible) mesh.quaternion.setFromUnitVectors(y, q.sub(p).normalize());
      mesh.scale.y = Math.max(length, 1e-9);
    }
    for (const [node, i, kind, object] of this.loads) {
      track.vector(kind, i, q);
      const share = told.largest[kind] ? q.length() / told.largest[kind] : 0;
      object.visible = share > 1e-3;
      if (!object.visible) continue;
      track.vector("position", node, object.position);
      pointed(object, q);
      object.scale.setScalar(0.5 * view.radius * share);
      if (kind === "force") object.position.addScaledVector(q.normalize(), -object.scale.y); // its head pushes
    }
    for (const [name, group] of Object.entries(this.groups)) group.visible = name === "under" ? !shown.looks : shown[name];
  }

  place(x, width, height) {
    const p = new THREE.Vector3();
    const seen = [];
    for (const [label, box] of this.labels) {
      this.track.point(label.node, label.at, p).project(camera);
      const left = x + ((p.x + 1) / 2) * width + 12, top = ((1 - p.y) / 2) * height - 30;
      const free = !seen.some(([a, b]) => Math.abs(a - left) < 60 && Math.abs(b - top) < 15);
      box.style.display = shown.labels && free && p.z < 1 ? "" : "none";
      if (free) seen.push([left, top]);
      box.style.transform = `translate(${left}px, ${top}px)`;
    }
  }
}

// -- the page --------------------------------------------------------------------------------------------------------

const stage = make("div", null, { id: "stage" });
const shown = { strain: true, patches: true, trace: true, axes: true, labels: true, loads: true, looks: true, frames: false, floor: true };
const panes = [], slow = drawsInSoftware();
let camera, controls, renderer, dirty = true, moved = false;

function startDrawing() {
  renderer = new THREE.WebGLRenderer({ antialias: !slow });
  renderer.setClearColor(0xffffff);
  renderer.setScissorTest(true);
  stage.appendChild(renderer.domElement);
  camera = new THREE.PerspectiveCamera(view.field, 1, 0.01 * view.radius, 100 * view.radius);
  camera.up.copy(up);
  controls = new THREE.OrbitControls(camera, renderer.domElement);
  controls.target.fromArray(view.centre);
  controls.addEventListener("change", () => { dirty = true; });
  controls.addEventListener("start", () => { moved = true; });
  window.addEventListener("resize", resize);
}

function resize() {
  renderer.setPixelRatio(slow ? 1 : Math.min(window.devicePixelRatio, 2));
  renderer.setSize(stage.clientWidth, stage.clientHeight);
  camera.aspect = stage.clientWidth / panes.length / stage.clientHeight;
  camera.updateProjectionMatrix();
  dirty = true;
  if (!moved) look();
}

// Whether there is no graphics card: smooth edges and thick lines then take most of the time.
function drawsInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl"), about = gl && gl.getExtension("WEBGL_debug_renderer_info");
  return !!about && /swiftshader|llvmpipe|softpipe|software|basic render/i.test(gl.getParameter(about.UNMASKED_RENDERER_WEBGL));
}

// The camera where it was at first.
function look() {
  const [wide, high, deep] = view.half, most = 1.1 * Math.max(high, wide / camera.aspect);
  const distance = most / Math.tan((view.field * Math.PI) / 360) + deep;
  const eye = new THREE.Vector3().fromArray(view.axes[2]).multiplyScalar(distance);
  camera.position.copy(controls.target.fromArray(view.centre)).add(eye);
  controls.update();
  dirty = true;
}

// Boxes that choose what is drawn; `traced`: whether there is a path of the tip.
function makeLegend(traced) {
  const legend = make("div", null, { id: "legend" }), bodies = panes.map((p) => p.track.body);
  const names = {
    strain: [`strain`, null, told.strain.most > 0],
    trace: ["path of the tip", told.colours.trace, traced],
    axes: ["joints' axes", told.colours.axis, bodies.some((b) => b.axes.length)],
    labels: ["joints' names", null, bodies.some((b) => b.labels.length)],
    loads: ["forces, moments", told.colours.force, bodies.some((b) => b.loads.length)],
    looks: ["looks of the links", null, bodies.some((b) => b.meshes.length || b.solids.some((s) => s.part === "look"))],
    patches: ["piezo patches", told.colours.patch, bodies.some((b) => b.beams.some((beam) => beam.part === "patch"))],
    frames: ["frames: ", null, true],
    floor: [`floor, lines each ${Number(view.grid.toPrecision(3))} m`, null, true],
  };
  for (const [name, [text, colour, there]] of Object.entries(names)) {
    if (!there) continue;
    const label = make("label", legend), box = make("input", label, { type: "checkbox", checked: shown[name] });
    box.addEventListener("change", () => { shown[name] = box.checked; dirty = true; });
    if (colour) make("span", label, { className: "swatch" }).style.background = colour;
    label.append(" " + text);
    if (name === "frames") for (const [axis, shade] of Object.entries(AXES)) make("b", label, { textContent: axis + " " }).style.color = shade;
  }
  if (told.strain.most) {
    const { most, factor, unit, colours } = told.strain, shownMost = Number((most * factor).toPrecision(3));
    const box = make("div", legend, { id: "strain", textContent: `Surface strain along x (${unit})` });
    const stops = colours.map((c) => `rgb(${c.map((v) => Math.round(255 * v)).join(",")})`);
    make("div", box, { id: "bar" }).style.background = `linear-gradient(to right, ${stops.join(", ")})`;
    const ticks = make("div", box, { id: "ticks" });
    for (const text of [`\u2212${shownMost}`, "0", `${shownMost}`]) make("span", ticks, { textContent: text });
  }
  make("div", stage, { id: "foot", textContent: told.notes.join(" \u00b7 ") });
}

function drawPanes() {
  const width = stage.clientWidth / panes.length, height = stage.clientHeight;
  panes.forEach((pane, i) => {
    pane.update();
    pane.sun.position.copy(camera.position);
    renderer.setViewport(i * width, 0, width, height);
    renderer.setScissor(i * width, 0, width, height);
    pane.scene.traverse((o) => { if (o.isLine2) o.material.resolution.set(width, height); });
    renderer.render(pane.scene, camera);
    pane.place(i * width, width, height);
  });
}

function cannotDraw(problem) {
  make("div", null, { id: "problem", textContent: `This browser cannot draw in 3-D (${problem.message}). flexarm also writes .png, .gif and .mp4.` });
  throw problem;
}
