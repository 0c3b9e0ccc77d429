// What the page carries: JSON and numbers, deflated. The other half of packing.py.
async function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  const whole = new Uint8Array(await new Response(stream).arrayBuffer());
  const size = new DataView(whole.buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(whole.subarray(4, 4 + size)));
  return new Carried(head, whole.subarray(4 + size));
}

class Carried {
  constructor(head, numbers) {
    Object.assign(this, { traces: [], leads: [], outcomes: {}, labels: [], live: null }, head);
    this.numbers = numbers;
    this.byKey = new Map(this.traces.map((trace) => [trace.at.join("/"), trace]));
    this.read = new Map();
    this.live = this.live && this.scene ? new Live(this) : null;
  }

  // Numbers of 32 bits, stored as four planes of bytes.
  floats(place, count) {
    const bytes = new Uint8Array(4 * count);
    for (let k = 0; k < bytes.length; k += 1) bytes[k] = this.numbers[place + (k % 4) * count + (k >> 2)];
    const view = new DataView(bytes.buffer);
    return Float32Array.from({ length: count }, (_, k) => view.getFloat32(4 * k, true));
  }

  entry(r, c) { return this.entries[`${r}/${c}`]; }

  trace(r, c, s, e) { return this.byKey.get([r, c, s, e].join("/")); }

  episodes(r, c) {
    const own = this.outcomes[`${r}/${c}`];
    return own ? own.n : 0;
  }

  label(r, c, s, e) {
    const own = this.outcomes[`${r}/${c}`];
    const there = own && s in this.rows[r].policies && e >= 0 && e < own.n;
    return there ? this.labels[this.numbers[own.label + s * own.n + e]] : null;
  }

  // Motor, numerics and losses, J, rounded; exact where a trace is carried.
  ledger(r, c, s, e) {
    const trace = this.trace(r, c, s, e);
    if (trace) return trace.totals.every(known) ? trace.totals : null;
    const own = this.outcomes[`${r}/${c}`];
    if (!own || !own.ledger) return null;
    const count = this.rows[r].policies.length * own.n;
    const at = s * own.n + e;
    const found = own.ledger.map((place) => {
      const value = this.numbers[place + at] | (this.numbers[place + count + at] << 8);
      return value === 0x8000 ? null : ((value << 16) >> 16) * this.unit;
    });
    return found.includes(null) ? null : found;
  }

  // A column of a trace: levels were stored as differences, in two planes of bytes.
  column(trace, group, name) {
    if (trace.live) return trace[group][name];
    const [low, step, place] = trace[group][name];
    if (!this.read.has(place)) {
      const values = new Float64Array(trace.n);
      let level = 0;
      for (let k = 0; k < trace.n; k += 1) {
        level += this.numbers[place + k] | (this.numbers[place + trace.n + k] << 8);
        values[k] = low + step * (level & 0xffff);
      }
      this.read.set(place, values);
    }
    return this.read.get(place);
  }

  // The value at a time, s: between samples, or held from the last one.
  at(trace, group, name, time, held) {
    const values = this.column(trace, group, name);
    const place = Math.min(time / trace.period, trace.n - 1);
    const below = Math.floor(place + 1e-9);
    const above = Math.min(below + 1, trace.n - 1);
    return held ? values[below] : values[below] + (place - below) * (values[above] - values[below]);
  }

  // What the motor and the numerics gave, what was lost, and the energy there is, J.
  energies(trace, time) {
    const [motor, numerics, losses] = ["motor", "numerics", "losses"].map((name) =>
      this.at(trace, "ledger", name, time));
    return { motor, numerics, losses, energy: (trace.start || 0) + motor + numerics - losses };
  }

  // Which cells hold a trace of the same policy from the same start.
  twins(r, s, e) {
    return this.traces.filter((t) => t.at[0] === r && t.at[2] === s && t.at[3] === e)
      .map((t) => t.at[1]);
  }
}
