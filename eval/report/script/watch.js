// "Watch it fail": one policy from one start, one discretization beside the other.
const KINDS = { held: "a start from which it holds", worst: "its worst start", failure: "the median failure", success: "the median success" };
const MOST_PANES = 4;
const BARS_SAY = "Bars add up to the energy there is, J";
const TICK_SAYS = "; a tick marks rest at the goal";
const FOLLOWED_SAY = "Bars: what is measured; a tick marks what is commanded. Arrows: the force on each foot.";
const STRIPS_SAY = "Strips: from which starts it succeeds, all simulated in this browser.";

class Watch {
  constructor(carried, root) {
    Object.assign(this, { carried, root, value: null, strips: new Map() });
    this.choice = make("select", { id: "watch-policy" }, this.options());
    this.choice.addEventListener("change", () => { this.open(Number(this.choice.value)); this.note(); });
    this.on = make("div", { class: "chips", role: "group", "aria-label": "discretizations" });
    this.more = make("details", { class: "further" }, make("summary", {}, "more discretizations"),
      make("div", { class: "chips", role: "group", "aria-label": "more discretizations" }));
    this.caption = make("p", { class: "caption" });
    this.stage = make("div", {});
    this.anew = this.startControls();
    root.append(this.caption, this.stage, make("div", { class: "controls" },
      make("label", { for: "watch-policy" }, "policy and start"), this.choice, this.anew,
      make("div", { class: "controls cells" }, this.on, this.more)));
    addEventListener("beforeprint", () => this.toPrint());
    addEventListener("afterprint", () => this.fromPrint());
  }

  // Printed as it ends, unless the reader stopped it before.
  toPrint() {
    this.before = this.player.time;
    const chosen = this.before > 0 && !this.player.playing;
    this.player.pause();
    if (!chosen) this.player.show(this.player.end);
    this.caption.append(make("span", {}, ` · at ${this.player.clock.textContent}`));
  }

  fromPrint() {
    this.player.show(this.before);
    this.say();
  }

  // Leads by what their policies were trained on, apart from those that are recorded only.
  options() {
    const { leads, live, rows } = this.carried;
    const groups = new Map();
    for (const [place, lead] of leads.entries()) {
      const { at: [r, , s] } = lead;
      const label = rows[r].shown + (live && !live.acts(r, s) ? ", recorded only" : "");
      if (!groups.has(label)) groups.set(label, []);
      groups.get(label).push(make("option", { value: place }, this.words(lead)));
    }
    return [...groups].map(([label, options]) => make("optgroup", { label }, options));
  }

  words({ at: [r, c, s, e], kind }) {
    const { rows, cells } = this.carried;
    const shown = cells[c].shown;
    const where = { truth: "on the truth", limit: "at the limit" }[shown] ?? `on ${shown}`;
    return `${this.seed(r, s)}start ${e}: ${KINDS[kind]} ${where}`;
  }

  // Whether rest at the goal has an energy of its own, which bars mark.
  get ticked() {
    const { scene } = this.carried;
    return Boolean(scene && scene.upright > 0);
  }

  // Of a policy that was trained here; nothing of one that was given.
  seed(r, s) {
    const { seed } = this.carried.rows[r].policies[s];
    return seed === null ? "" : `seed ${seed}, `;
  }

  // What all panes have in common.
  say() {
    const { at: [r, , s] } = this.lead;
    const { rows } = this.carried;
    const moved = this.value === null ? this.words(this.lead)
      : `${this.seed(r, s)}${this.what()} ${this.describe(this.value)}`;
    this.caption.replaceChildren(make("b", {}, rows[r].shown), ` · ${moved}`);
  }

  what() {
    const { live } = this.carried;
    return live.middle(this.like) ? "start angle from hanging" : `start ${spaced(live.name)}`;
  }

  describe(value) {
    const { live } = this.carried;
    return live.shown(value, live.middle(this.like));
  }

  // The slider of the start, and the way back to the record.
  startControls() {
    const { live } = this.carried;
    if (!live) return make("div", { hidden: true });
    this.slider = make("input", { type: "range", id: "watch-start",
      step: live.turns ? Math.PI / 360 : live.reach / 200 });
    this.readout = make("output", { class: "angle", for: "watch-start" });
    this.back = make("button", { type: "button", class: "chip" }, "as recorded");
    this.slider.addEventListener("input", () => this.startAt(Number(this.slider.value)));
    this.slider.addEventListener("change", () => this.begin());
    this.back.addEventListener("click", () => { this.startAt(null); this.begin(); });
    this.named = make("label", { for: "watch-start" });
    return make("div", { class: "start" }, this.named, this.readout, this.slider, this.back);
  }

  get like() { return this.carried.trace(...this.lead.at); }

  recorded(c) {
    const { at: [r, , s, e] } = this.lead;
    return this.carried.trace(r, c, s, e);
  }

  // Whether the policy can be simulated in a cell.
  simulated(c) {
    const { live } = this.carried;
    const { at: [r, , s] } = this.lead;
    return Boolean(live && live.acts(r, s) && live.steps(c) && this.like.state[0].length);
  }

  available(lead) {
    const own = lead.cells.filter((c) => this.recorded(c));
    const { cells } = this.carried;
    return [...own, ...cells.map((_, c) => c).filter((c) => !own.includes(c) && this.simulated(c))];
  }

  // Home and the judged cell first, then whatever else there is room for; where it holds, these two.
  usual(lead) {
    if (this.carried.skeleton) return this.usualOfRobots(this.available(lead));
    const wide = innerWidth >= 1000 && lead.kind !== "held" ? MOST_PANES : 2;
    return this.available(lead).slice(0, Math.min(wide, 3));
  }

  // Home, where it ends otherwise, and what the lead is about, in their order.
  usualOfRobots(there) {
    const won = (c) => this.recorded(c).label === "none";
    const other = there.find((c) => won(c) !== won(there[0]));
    const chosen = [there[0], other ?? there[1], ...there.slice(1)].slice(0, innerWidth >= 1000 ? 3 : 2);
    return there.filter((c) => chosen.includes(c));
  }

  open(place, on, time, value = null) {
    const lead = this.carried.leads[place] || this.carried.leads[0];
    this.lead = lead;
    this.choice.value = this.carried.leads.indexOf(lead);
    const there = this.available(lead);
    this.shown = (on || this.usual(lead)).filter((c) => there.includes(c));
    if (!this.shown.length) this.shown = this.usual(lead);
    const [recorded, others] = [true, false].map((own) => there.filter((c) => own === Boolean(this.recorded(c))));
    this.on.replaceChildren(...recorded.map((c) => this.chip(c)));
    this.more.lastChild.replaceChildren(...others.map((c) => this.chip(c)));
    this.more.hidden = !others.length;
    if (others.some((c) => this.shown.includes(c))) this.more.open = true;
    this.anew.hidden = !this.simulated(lead.at[1]);
    this.value = this.anew.hidden || value === null ? null : this.carried.live.within(this.like, value);
    this.build(time || 0);
  }

  chip(c) {
    const cell = this.carried.cells[c];
    const chip = make("button", { type: "button", class: "chip", "data-cell": c,
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
    this.press();
    this.build(this.player.time);
    this.note();
  }

  press() {
    for (const chip of this.root.querySelectorAll(".chip[data-cell]")) {
      const c = Number(chip.dataset.cell);
      chip.setAttribute("aria-pressed", String(this.shown.includes(c)));
      chip.disabled = this.value !== null && !this.simulated(c);
    }
  }

  // Everything again from another start; null: as it was recorded.
  startAt(value) {
    this.value = value;
    this.build(0);
  }

  // After a start was chosen.
  begin() {
    if (still.matches) this.player.show(this.player.end);
    else this.player.play();
    this.note();
  }

  traceOn(c) {
    if (this.value === null && this.recorded(c)) return this.recorded(c);
    return this.simulated(c) ? this.carried.live.trace(this.like, c, this.value) : null;
  }

  build(time) {
    if (this.player) this.player.pause();
    const { at: [r, home, s, e] } = this.lead;
    const traces = this.shown.map((c) => this.traceOn(c)).filter(Boolean);
    const { homes } = this.carried.rows[r];
    this.player = new Player(this.carried, traces, {
      start: time,
      roleOf: (c) => [homes.includes(c) ? "trained here" : "", this.sourceOf(c)].filter(Boolean).join(" · "),
      below: (c) => this.strip(c),
      moved: () => this.note(),
    });
    this.press();
    const episode = make("a", { href: entryHash({ r, c: home, s, e }) }, "the recorded episode in full");
    const missing = this.shown.filter((c) => !traces.some((trace) => trace.at[1] === c))
      .map((c) => this.carried.cells[c].shown);
    this.stage.replaceChildren(this.player.element, make("p", { class: "legend" },
      this.carried.skeleton ? make("span", {}, FOLLOWED_SAY)
        : traces.some((trace) => trace.totals.every(known)) ? make("span", {}, BARS_SAY, this.ticked ? TICK_SAYS : "", ".") : null,
      this.value === null ? null : make("span", {}, STRIPS_SAY),
      missing.length ? make("span", {}, `Recorded only, so not from this start: ${missing.join(", ")}.`) : null,
      make("span", {}, episode)));
    this.say();
    if (!this.anew.hidden) this.tell();
  }

  sourceOf(c) {
    if (this.value !== null || !this.recorded(c)) return "recomputed in this browser";
    return this.carried.cells[c].shown === "limit" ? "recorded at its finest step" : "recorded";
  }

  tell() {
    const { live } = this.carried;
    const value = this.value ?? live.startOf(this.like);
    const middle = live.middle(this.like);
    this.slider.min = middle - live.reach;
    this.slider.max = middle + live.reach;
    this.slider.value = value;
    this.named.textContent = this.what();
    this.readout.textContent = this.describe(value);
    this.slider.setAttribute("aria-valuetext", this.readout.textContent);
    this.back.setAttribute("aria-pressed", String(this.value === null));
  }

  // From which starts the policy succeeds in a cell, once a start was chosen.
  strip(c) {
    if (this.value === null || !this.simulated(c)) return null;
    const { live } = this.carried;
    const key = `${this.lead.at.join("/")}/${c}`;
    if (!this.strips.has(key)) this.strips.set(key, []);
    const starts = new Starts(live, this.like, c, this.strips.get(key));
    starts.at(this.value);
    return starts.element;
  }

  focus() { (this.anew.hidden ? this.player.slider : this.slider).focus({ preventScroll: true }); }

  note() {
    remember(watchHash(this.carried.leads.indexOf(this.lead), this.shown, this.player.time, this.value));
  }

  // Begins to move when it is first seen, unless motion is not wanted.
  startWhenSeen() {
    if (still.matches) {
      this.player.show(this.player.end);
      return;
    }
    const seen = new IntersectionObserver((found) => {
      if (!found.some((one) => one.isIntersecting) || document.querySelector("dialog[open]")) return;
      seen.disconnect();
      if (this.player.time === 0) this.player.play();
    }, { threshold: 0.5 });
    seen.observe(this.stage);
  }
}
