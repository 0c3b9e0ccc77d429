// Amounts of energy, the last of which is the sum of the others: bars about zero.
const BARS = ["start", "motor", "numerics", "losses", "energy"];

class Bars {
  constructor(carried, trace, { names, scale }, mark) {
    Object.assign(this, { carried, trace, scale });
    this.lines = names.map((name) => {
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
    const energies = amountsOf(this.carried, this.trace, time);
    for (const { name, bar, value } of this.lines) {
      const end = this.place(energies[name]);
      bar.style.left = `${Math.min(50, end)}%`;
      bar.style.width = `${Math.abs(end - 50)}%`;
      bar.classList.toggle("below", energies[name] < 0);
      value.textContent = ["start", "energy"].includes(name) ? joules(energies[name], 1).replace("+", "") : joules(energies[name], 1);
    }
  }
}

function amountsOf(carried, trace, time) {
  const found = carried.energies(trace, time);
  return { ...found, start: trace.start || 0, losses: -found.losses };
}

// The amounts that matter in any of the traces, and the largest of them, J: the scale of their bars.
function amountsIn(carried, traces) {
  const largest = Object.fromEntries(BARS.map((name) => [name, 0]));
  for (const trace of traces) {
    for (let k = 0; k < trace.n; k += 1) {
      const found = amountsOf(carried, trace, k * trace.period);
      for (const name of BARS) largest[name] = Math.max(largest[name], Math.abs(found[name]));
    }
  }
  const least = { start: carried.leastStart, losses: 0 };
  const names = BARS.filter((name) => !(name in least) || largest[name] > least[name]);
  return { names, scale: Math.max(1e-9, ...names.map((name) => largest[name])) };
}
