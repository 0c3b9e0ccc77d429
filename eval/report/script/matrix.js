// The matrix: other measures, fewer columns, and arrow keys from cell to cell.
class Grid {
  constructor(carried, root) {
    Object.assign(this, { carried, root });
    this.table = root.querySelector("table");
    this.measure = 0;
    this.links = [...this.table.querySelectorAll("td > a")];
    this.measures();
    this.filters();
    this.links.forEach((link, place) => { link.tabIndex = place ? -1 : 0; });
    this.table.addEventListener("keydown", (event) => this.move(event));
    this.table.addEventListener("focusin", (event) => this.enter(event.target.closest("td > a")));
  }

  measures() {
    const { measures } = this.carried;
    if (measures.length < 2) return;
    const box = make("div", { class: "chips", role: "group", "aria-label": "what the cells show" });
    this.chips = measures.map((measure, place) => {
      const chip = make("button", { type: "button", class: "chip", "aria-pressed": String(!place) },
        measure.name);
      chip.addEventListener("click", () => { this.show(place); this.note(); });
      return chip;
    });
    box.append(...this.chips);
    this.root.querySelector(".controls").append(box);
    this.legend = this.root.querySelector(".legend");
    this.notes = make("span", { class: "notes" });
    this.legend.append(this.notes);
  }

  show(place) {
    this.measure = place;
    const measure = this.carried.measures[place];
    this.chips.forEach((chip, k) => chip.setAttribute("aria-pressed", String(k === place)));
    this.root.querySelector(".measure").textContent = measure.about;
    for (const link of this.links) {
      const shade = measure.cells[link.hash.slice(1)] || ["–", "", "", "not known", ""];
      const [text, style, marks, words, tone] = shade;
      link.style.cssText = style;
      link.classList.remove("rate", "warm", "cool", "empty");
      if (tone) link.classList.add(tone);
      link.title = words;
      link.setAttribute("aria-label", words);
      const number = link.querySelector("b");
      number.textContent = text;
      number.classList.toggle("long", text.length > 6);
      const signs = link.querySelector("i");
      if (signs) signs.textContent = marks;
      else if (marks) link.append(make("i", {}, marks));
    }
    const ramp = this.legend.querySelector(".ramp");
    ramp.classList.toggle("energyramp", measure.signed);
    ramp.previousSibling.textContent = `${measure.ends[0]} `;
    ramp.nextSibling.textContent = ` ${measure.ends[1]}`;
    this.notes.replaceChildren(...(place ? measure.notes.map((note) => make("span", {}, note)) : []));
    this.legend.querySelectorAll(".only-success").forEach((note) => { note.hidden = place !== 0; });
  }

  filters() {
    const { groups } = this.carried;
    this.hiddenGroups = new Set();
    this.hiddenSteps = new Set();
    this.names = groups.filter((g) => !g.truth).map((g) => g.name);
    this.steps = [...new Set(groups.flatMap((g) => (g.truth ? [] : g.steps)))];
    if (groups.length < 3) return;
    const chips = (values, hidden, words) => values.map((value) => {
      const chip = make("button", { type: "button", class: "chip", "aria-pressed": "true" },
        words(value));
      chip.addEventListener("click", () => {
        if (!hidden.delete(value)) hidden.add(value);
        this.sift();
        this.note();
      });
      return { chip, pressed: () => chip.setAttribute("aria-pressed", String(!hidden.has(value))) };
    });
    const [byName, byStep] = [chips(this.names, this.hiddenGroups, String),
      chips(this.steps, this.hiddenSteps, (step) => `${step} s`)];
    this.sifting = [...byName, ...byStep];
    this.columns = make("details", { class: "filters" }, make("summary", {}, "columns"),
      make("div", { class: "chips", role: "group", "aria-label": "integrators" },
        byName.map(({ chip }) => chip)),
      make("div", { class: "chips", role: "group", "aria-label": "steps, seconds" },
        byStep.map(({ chip }) => chip)));
    this.root.querySelector(".controls").append(this.columns);
  }

  // What the URL says that is to be seen; a number that is not there is passed over.
  view({ measure, groups, steps }) {
    const found = (places, values) => places.filter((k) => k in values).map((k) => values[k]);
    const [names, hidden] = [found(groups, this.names), found(steps, this.steps)];
    if (this.sifting) {
      for (const set of [this.hiddenGroups, this.hiddenSteps]) set.clear();
      names.forEach((name) => this.hiddenGroups.add(name));
      hidden.forEach((step) => this.hiddenSteps.add(step));
      if (names.length + hidden.length) this.columns.open = true;
      this.sift();
    }
    if (this.chips && measure < this.chips.length && measure !== this.measure) this.show(measure);
    this.note();
  }

  note() {
    const places = (values, hidden) => [...hidden].map((value) => values.indexOf(value)).sort((a, b) => a - b);
    rememberView({ measure: this.measure, groups: places(this.names, this.hiddenGroups),
      steps: places(this.steps, this.hiddenSteps) });
  }

  sift() {
    for (const { pressed } of this.sifting) pressed();
    const shown = this.carried.groups.flatMap((group) => group.steps.map((step) =>
      group.truth || !(this.hiddenGroups.has(group.name) || this.hiddenSteps.has(step))));
    const [heads, steps] = this.table.tHead.rows;
    let place = 0;
    this.carried.groups.forEach((group, k) => {
      const count = shown.slice(place, place + group.steps.length).filter(Boolean).length;
      heads.cells[k + 1].hidden = !count;
      heads.cells[k + 1].colSpan = Math.max(1, count);
      place += group.steps.length;
    });
    const hide = (cells) => cells.forEach((cell, k) => { cell.hidden = !shown[k]; });
    hide([...steps.cells]);
    for (const body of this.table.tBodies) {
      for (const row of body.rows) {
        if (!row.classList.contains("kind")) hide([...row.cells].slice(1));
      }
    }
    const current = this.links.find((link) => link.tabIndex === 0);
    if (current && current.offsetParent === null) this.enter(this.visible()[0]);
  }

  visible() { return this.links.filter((link) => link.offsetParent !== null); }

  enter(link) {
    if (!link) return;
    for (const other of this.links) other.tabIndex = other === link ? 0 : -1;
    this.uncover(link);
  }

  // Brings a cell out from under the columns that stay where they are.
  uncover(link) {
    const box = this.table.closest(".scroll");
    const [own, whole] = [link.getBoundingClientRect(), box.getBoundingClientRect()];
    const left = whole.left + this.table.querySelector("tbody th[scope=row]").offsetWidth + 8;
    if (own.left < left) box.scrollLeft -= left - own.left;
    else if (own.right > whole.right - 8) box.scrollLeft += own.right - whole.right + 8;
  }

  move(event) {
    const link = event.target.closest("td > a");
    if (!link || event.ctrlKey || event.altKey || event.metaKey) return;
    const row = link.closest("tr");
    const rows = [...this.table.querySelectorAll("tbody tr")].filter((r) => r.querySelector("td > a"));
    const column = link.parentElement.cellIndex;
    const along = [...row.querySelectorAll("td > a")].filter((a) => a.offsetParent !== null);
    const at = along.indexOf(link);
    const above = (step) => {
      for (let k = rows.indexOf(row) + step; rows[k]; k += step) {
        const found = rows[k].cells[column] && rows[k].cells[column].querySelector("a");
        if (found) return found;
      }
      return null;
    };
    const next = {
      ArrowLeft: () => along[at - 1], ArrowRight: () => along[at + 1],
      ArrowUp: () => above(-1), ArrowDown: () => above(1),
      Home: () => along[0], End: () => along.at(-1),
    }[event.key];
    if (!next) return;
    event.preventDefault();
    const target = next();
    if (target) target.focus();
  }
}
