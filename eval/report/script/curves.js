// Coordinates, control and energy against time, with a cursor.
// As wide as it is drawn, so that text keeps its size.
const WIDE = innerWidth <= 640 ? 350 : 640;
const LANE = 74;

class Curves {
  constructor(carried, traces, scene) {
    Object.assign(this, { carried, traces });
    this.end = Math.max(...traces.map((trace) => (trace.n - 1) * trace.period));
    const lanes = this.lanes(scene);
    const high = lanes.length * LANE + 24;
    this.svg = draw("svg", { class: "curves", viewBox: `0 0 ${WIDE} ${high}`, role: "img",
      "aria-label": `${lanes.map((lane) => lane.title).join(", ")} against time` });
    lanes.forEach((lane, place) => this.lane(lane, place * LANE));
    for (let k = 0; k <= 4; k += 1) {
      this.svg.append(draw("text", { x: this.x((k / 4) * this.end), y: high - 8,
        "text-anchor": k === 0 ? "start" : k === 4 ? "end" : "middle" },
      `${Number(((k / 4) * this.end).toFixed(2))}${k === 4 ? " s" : ""}`));
    }
    this.cursor = draw("line", { class: "cursor", y1: 0, y2: lanes.length * LANE });
    this.svg.append(this.cursor);
  }

  lanes(scene) {
    const [first] = this.traces;
    const shown = (name) => !this.carried.skeleton || name.startsWith("measured_");
    const motion = Object.keys(first.motion).filter(shown).map((name) => {
      const unit = scene ? scene.units[scene.coordinates.indexOf(name)] : "";
      const turns = unit === "rad";
      return { title: unit ? `${spaced(name)}, ${unit}${turns ? ", wrapped" : ""}` : spaced(name),
        turns, values: (trace) => this.carried.column(trace, "motion", name).map(
          turns ? (q) => q - 2 * Math.PI * Math.floor((q + Math.PI) / (2 * Math.PI)) : (q) => q) };
    });
    const control = Object.keys(first.control).map((name, k) => ({
      title: scene ? `${spaced(scene.controls[k][0])}, ${scene.controls[k][1]}` : spaced(name), held: true,
      values: (trace) => this.carried.column(trace, "control", name),
    }));
    const energy = { title: "energy, J", values: (trace) => Float64Array.from(
      { length: trace.n }, (_, k) => this.carried.energies(trace, k * trace.period).energy) };
    return [...motion, ...control, ...(first.totals.every(known) ? [energy] : [])];
  }

  x(time) { return 4 + (WIDE - 8) * (this.end ? time / this.end : 0); }

  lane({ title, values, held, turns }, top) {
    const found = this.traces.map(values);
    const low = Math.min(...found.map((column) => Math.min(...column)));
    const high = Math.max(...found.map((column) => Math.max(...column)));
    const y = (value) => top + LANE - 8 - ((LANE - 30) * (value - low)) / (high - low || 1);
    const ends = [low, high].map((end) => Number(end.toPrecision(3)).toString().replace("-", "−"));
    this.svg.append(
      draw("text", { x: 4, y: top + 14 }, title),
      draw("text", { x: WIDE - 4, y: top + 14, "text-anchor": "end" }, `${ends[0]} to ${ends[1]}`),
      draw("line", { class: "base", x1: 4, x2: WIDE - 4, y1: top + LANE - 8, y2: top + LANE - 8 }));
    found.forEach((column, which) => {
      const { period } = this.traces[which];
      const steps = Array.from(column, (value, k) => {
        // A line is broken where an angle goes once around.
        const jump = k === 0 || (turns && Math.abs(value - column[k - 1]) > Math.PI);
        const from = `${jump ? "M" : "L"}${this.x(k * period).toFixed(1)} ${y(value).toFixed(1)}`;
        return held ? `${from}H${this.x((k + 1) * period).toFixed(1)}` : from;
      });
      this.svg.append(draw("path", { class: `curve line-${which}`, d: steps.join("") }));
    });
  }

  show(time) {
    const x = this.x(Math.min(time, this.end));
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
  }
}
