// "Watch it fail": one policy from one start, one discretization beside the other.
const KINDS = { worst: "its worst start", failure: "the median failure", success: "the median success" };
const MOST_PANES = 4;
const BARS_SAY = "Bars: energy since the start from the motor and from the numerics, and the energy " +
  "there is, J; a tick marks rest at the goal.";

class Watch {
  constructor(carried, root) {
    Object.assign(this, { carried, root });
    this.choice = make("select", { id: "watch-policy" }, carried.leads.map((lead, place) =>
      make("option", { value: place }, this.words(lead))));
    this.choice.addEventListener("change", () => this.open(Number(this.choice.value)));
    this.on = make("div", { class: "chips", role: "group", "aria-label": "discretizations" });
    this.stage = make("div", {});
    root.querySelector(".controls").append(
      make("label", { for: "watch-policy" }, "policy and start"), this.choice, this.on);
    root.append(this.stage);
  }

  words({ at: [r, c, s, e], kind }) {
    const { rows, cells } = this.carried;
    return `${rows[r].shown} · seed ${rows[r].policies[s].seed ?? s}, start ${e}: ` +
      `${KINDS[kind]} on ${cells[c].shown}`;
  }

  available(lead) {
    const { at: [r, , s, e], cells } = lead;
    return cells.filter((c) => this.carried.trace(r, c, s, e));
  }

  // Home and the judged cell first, then whatever else there is room for.
  usual(lead) {
    const wide = innerWidth >= 1000 ? MOST_PANES : 2;
    return this.available(lead).slice(0, Math.min(wide, 3));
  }

  open(place, on, time) {
    const lead = this.carried.leads[place] || this.carried.leads[0];
    this.lead = lead;
    this.choice.value = this.carried.leads.indexOf(lead);
    const there = this.available(lead);
    this.shown = (on || this.usual(lead)).filter((c) => there.includes(c));
    if (!this.shown.length) this.shown = this.usual(lead);
    this.on.replaceChildren(...there.map((c) => this.chip(c)));
    this.build(time || 0);
  }

  chip(c) {
    const cell = this.carried.cells[c];
    const chip = make("button", { type: "button", class: "chip",
      "aria-pressed": String(this.shown.includes(c)) }, cell.shown);
    chip.addEventListener("click", () => this.toggle(c));
    return chip;
  }

  toggle(c) {
    const at = this.shown.indexOf(c);
    if (at >= 0 && this.shown.length > 1) this.shown.splice(at, 1);
    else if (at < 0) this.shown = [...this.shown, c].slice(-MOST_PANES);
    const there = this.available(this.lead);
    this.shown.sort((a, b) => there.indexOf(a) - there.indexOf(b));
    [...this.on.children].forEach((chip, place) =>
      chip.setAttribute("aria-pressed", String(this.shown.includes(there[place]))));
    this.build(this.player.time);
    this.note();
  }

  build(time) {
    if (this.player) this.player.pause();
    const { at: [r, , s, e] } = this.lead;
    const traces = this.shown.map((c) => this.carried.trace(r, c, s, e));
    const homes = this.carried.rows[r].homes;
    this.player = new Player(this.carried, traces, {
      start: time,
      roleOf: (c) => (homes.includes(c) ? "trained here" : ""),
      moved: () => this.note(),
    });
    const episode = make("a", { href: entryHash({ r, c: this.lead.at[1], s, e }) },
      "this episode in full");
    this.stage.replaceChildren(this.player.element, make("p", { class: "legend" },
      traces.some((trace) => trace.totals.every(known)) ? make("span", {}, BARS_SAY) : null,
      make("span", {}, episode)));
  }

  note() {
    remember(watchHash(this.carried.leads.indexOf(this.lead), this.shown, this.player.time));
  }

  // Begins to move when it is first seen, unless motion is not wanted.
  startWhenSeen() {
    if (still.matches) {
      this.player.show(this.player.end);
      return;
    }
    const seen = new IntersectionObserver((found) => {
      if (!found.some((one) => one.isIntersecting)) return;
      seen.disconnect();
      if (this.player.time === 0) this.player.play();
    }, { threshold: 0.5 });
    seen.observe(this.stage);
  }
}
