// Episodes simulated in this browser: a policy's network, and steps written from the same equations
// of motion that made the records.
const PARTS = ["motor", "numerics", "losses"];
const MOST_DECISIONS = 100000;

class Live {
  constructor(carried) {
    this.carried = carried;
    Object.assign(this, carried.live);
    const { places, units, coordinates } = carried.scene;
    this.unit = units[places.indexOf(this.coordinate)];
    this.turns = this.unit === "rad";
    this.name = coordinates[places.indexOf(this.coordinate)];
    this.networks = new Map(this.policies.map((policy) =>
      [policy.at.join("/"), new Network(carried, policy)]));
  }

  acts(r, s) { return this.networks.has(`${r}/${s}`); }

  steps(c) { return c in STEPS; }

  wrapped(value, middle = 0) {
    if (!this.turns) return value;
    return value - 2 * Math.PI * Math.floor((value - middle + Math.PI) / (2 * Math.PI));
  }

  // The middle of the starts that can be chosen: hanging for what starts hanging, else zero.
  middle({ state: [q] }) {
    return this.turns && Math.cos(q[this.coordinate]) < 0 ? Math.PI : 0;
  }

  // Where the chosen coordinate of a trace started, less than half a turn from the middle.
  startOf(trace) { return this.wrapped(trace.state[0][this.coordinate], this.middle(trace)); }

  // The nearest start that can be chosen.
  within(trace, value) {
    const middle = this.middle(trace);
    return Math.max(middle - this.reach, Math.min(middle + this.reach, value));
  }

  // A start in words, from the middle.
  shown(value, middle = 0) {
    const text = this.turns ? `${(((value - middle) * 180) / Math.PI).toFixed(1)}°`
      : `${value.toFixed(3)} ${this.unit}`;
    return text.replace(/^-(?=0\.?0*[^\d.])/, "").replace("-", "−");
  }

  // Decision by decision, from a trace's start with the chosen coordinate at a value.
  * decisions({ at: [r, , s], state: [q, v] }, c, value) {
    const [start, step] = STEPS[c];
    const network = this.networks.get(`${r}/${s}`);
    const moved = q.map((x, k) => (k === this.coordinate && value !== null ? value : x));
    let [now, observation] = start(moved, v);
    let outcome = null;
    yield { now, outcome };
    for (let k = 0; k < MOST_DECISIONS && !(outcome && outcome.ended); k += 1) {
      const after = step(now, network.action(observation));
      if (after === null) return;
      [now, observation, outcome] = after;
      yield { now, outcome };
    }
  }

  // Whether the policy succeeds.
  succeeds(like, c, value) {
    let last = null;
    for (const { outcome } of this.decisions(like, c, value)) last = outcome;
    return Boolean(last && last.success);
  }

  // The episode, shaped like the recorded trace that it starts like.
  trace(like, c, value) {
    const [r, , s, e] = like.at;
    const found = [...this.decisions(like, c, value)];
    const [first, last] = [found[0].now, found.at(-1)];
    const { ended = false, success = false } = last.outcome || {};
    const controls = found.slice(1).map(({ outcome }) => outcome.controls);
    const columns = (names, values) => Object.fromEntries(names.map((name, k) =>
      [name, Float64Array.from(values(name, k))]));
    const summed = (name) => {
      let sum = 0;
      return found.map(({ outcome }) => { sum += outcome ? outcome[name] : 0; return sum; });
    };
    const ledger = columns(PARTS, summed);
    return {
      live: true, at: [r, c, s, e], period: this.periods[c], n: found.length,
      label: success ? "none" : "failed", diverged: !ended,
      start: first[2], end: last.now[2], totals: PARTS.map((name) => ledger[name].at(-1)),
      motion: columns(this.carried.scene.coordinates,
        (_, k) => found.map(({ now }) => now[0][this.carried.scene.places[k]])),
      control: columns(Object.keys(like.control), (_, k) =>
        [...controls.map((each) => each[k]), controls.length ? controls.at(-1)[k] : 0]),
      ledger,
    };
  }
}
