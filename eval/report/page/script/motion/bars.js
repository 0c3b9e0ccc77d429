// What the motor gave, what the numerics gave, and the energy there is: bars about zero.
const BARS = ["motor", "numerics", "energy"];

class Bars {
  constructor(carried, trace, scale, mark) {
    Object.assign(this, { carried, trace, scale });
    this.lines = BARS.map((name) => {
      const bar = make("i", { class: name });
      const value = make("output", {});
      const tick = name === "energy" && mark ? make("b", { title: mark.words }) : null;
      if (tick) tick.style.left = `${this.place(mark.value)}%`;
      return { name, bar, value, row: make("div", { class: "bar-line" },
        make("span", {}, name), make("span", { class: "rail" }, bar, tick), value) };
    });
    this.element = make("div", { class: "bars" }, this.lines.map((line) => line.row));
  }

  place(value) {
    return 50 + 50 * Math.max(-1, Math.min(1, value / this.scale));
  }

  show(time) {
    const energies = this.carried.energies(this.trace, time);
    for (const { name, bar, value } of this.lines) {
      const end = this.place(energies[name]);
      bar.style.left = `${Math.min(50, end)}%`;
      bar.style.width = `${Math.abs(end - 50)}%`;
      bar.classList.toggle("below", energies[name] < 0);
      value.textContent = name === "energy" ? joules(energies[name], 1).replace("+", "") : joules(energies[name], 1);
    }
  }
}

// The largest energy that any of the traces shows, J: the scale that their bars share.
function scaleOf(carried, traces) {
  let largest = 1e-9;
  for (const trace of traces) {
    for (let k = 0; k < trace.n; k += 1) {
      const found = carried.energies(trace, k * trace.period);
      largest = Math.max(largest, ...BARS.map((name) => Math.abs(found[name])));
    }
  }
  return largest;
}
