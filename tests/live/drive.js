// node drive.js core.js told.json: runs a page's core without a page, as told on stdin, and prints what it reaches.
const fs = require("fs");
const { Core, Run, Numbers, unpacked } = require(fs.realpathSync(process.argv[2]));
const live = JSON.parse(fs.readFileSync(process.argv[3], "utf-8")).live;
const { variant, values, steps, push, advance, document } = JSON.parse(fs.readFileSync(0, "utf-8"));

(async () => {
  const core = await Core.load(await unpacked(live.core)), numbers = new Numbers(live.variants[variant]);
  const mine = (x) => numbers.sliders.map((k) => x[k]);
  const own = live.sliders.map((s) => s.value);
  const json = document || numbers.json(mine(values || own), mine(own));
  const { t, q0, v0 } = JSON.parse(json), out = { version: core.version, q: [], t: [], slice: [] };
  try {
    const run = new Run(core, json, { t: t[0], q: q0, v: v0 });
    if (push) run.push(live.loads[0], push);
    const end = run.slice(live.bent[0].link, JSON.parse(json).arm.links[live.bent[0].link].beam.length);
    for (let k = 0; k < steps; k++) {
      if (advance) run.advance(run.t + advance); else run.step();
      out.t.push(run.t);
      out.q.push(Array.from(run.q));
      out.slice.push(Array.from(run.atSlice(end)));
    }
    run.free();
  } catch (problem) {
    out.error = problem.message;
  }
  console.log(JSON.stringify(out));
})();
