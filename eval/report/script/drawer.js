// From a cell to its episodes, and from one of them to what happened in it.
class Drawer {
  constructor(carried, dialog, opening) {
    Object.assign(this, { carried, dialog, opening });
    this.body = dialog.querySelector(".body");
    this.title = dialog.querySelector("h2");
    dialog.querySelector(".shut").addEventListener("click", () => dialog.close());
    dialog.addEventListener("click", (event) => { if (event.target === dialog) dialog.close(); });
    dialog.addEventListener("close", () => this.closed());
  }

  // Whether there is something to open.
  open(asked) {
    const { r, c } = asked;
    if (!this.carried.entry(r, c)) return false;
    const place = this.carried.label(r, c, asked.s, asked.e) ? asked : { r, c, s: null };
    const origin = this.place ? this.origin : [r, c];
    Object.assign(this, { place, origin });
    if (this.player) this.player.pause();
    this.player = null;
    this.body.replaceChildren(...(place.s === null ? this.entry(place) : this.episode(place)));
    for (const block of this.body.querySelectorAll("pre.command")) copyable(block);
    if (!this.dialog.open) {
      this.from = document.activeElement;
      this.opening();
      this.dialog.showModal();
    }
    this.dialog.scrollTop = 0;
    const first = this.body.querySelector("[data-first]") || this.body.querySelector("button, a");
    if (first) first.focus({ preventScroll: true });
    return true;
  }

  // For another place, which the address says already.
  leave() {
    this.stop();
    this.dialog.close();
  }

  stop() {
    if (this.player) this.player.pause();
    this.player = null;
    this.place = null;
  }

  // By the reader: back to where the drawer was opened from, or to its cell of the matrix.
  closed() {
    if (!this.place) return;
    this.stop();
    remember("");
    const [r, c] = this.origin;
    const cell = document.querySelector(`table.heat a[href="#r${r}c${c}"]`);
    const seen = (one) => one && one !== document.body && one.isConnected && one.offsetParent !== null;
    const back = [this.from, cell].find(seen);
    if (back) back.focus();
  }

  names({ r, c }) {
    const { rows, cells } = this.carried;
    return [rows[r].shown, make("small", {}, " evaluated on "), cells[c].shown];
  }

  entry({ r, c }) {
    const entry = this.carried.entry(r, c);
    this.title.replaceChildren(...this.names({ r, c }));
    const first = ["success", "loss against home", "of it overfitting"];
    const chosen = entry.facts.filter(([name]) => first.includes(name));
    const facts = entry.facts.filter(([name]) => !first.includes(name)).map(([name, text]) =>
      make("div", {}, make("dt", {}, name), make("dd", {}, text)));
    return [
      make("p", { class: "summary" }, chosen.map(([name, text]) => make("span", {}, `${name} `, make("b", {}, text)))),
      ...this.episodes(r, c),
      make("h3", {}, "In numbers"),
      make("dl", { class: "facts" }, facts),
      make("p", { class: "files" }, "Records: ", entry.file.map((name, k) => [k ? ", " : "",
        make("a", { href: this.carried.files[name] }, name)])),
      ...this.command("lists these records", entry.query),
    ];
  }

  episodes(r, c) {
    const { carried } = this;
    const count = carried.episodes(r, c);
    if (!count) {
      return [make("p", { class: "about" }, "This page carries no episodes of this cell.")];
    }
    const { policies } = carried.rows[r];
    const traced = new Set(carried.traces.filter((t) => t.at[0] === r && t.at[1] === c)
      .map((t) => `${t.at[2]}/${t.at[3]}`));
    const found = new Map();
    const order = this.worstFirst(r, c);
    const first = traced.size ? [...traced][0].split("/").map(Number) : [order[0], 0];
    const acts = policies.map((_, s) => this.restartable(r, s) >= 0);
    const lines = order.map((s) => [policies[s], s]).map(([policy, s]) => make("div", { role: "row" },
      make("span", { role: "rowheader" }, policy.seed === null ? "–" : `seed ${policy.seed}`, acts[s] ? " ◆" : null),
      Array.from({ length: count }, (_, e) => {
        const label = carried.label(r, c, s, e);
        found.set(label, (found.get(label) || 0) + 1);
        const here = s === first[0] && e === first[1];
        const button = make("button", { type: "button", role: "gridcell", tabindex: here ? 0 : -1,
          "data-first": here, "data-s": s, "data-e": e,
          class: `${label === "none" ? "won" : "lost"}${traced.has(`${s}/${e}`) ? " traced" : ""}`,
          "aria-label": `seed ${policy.seed ?? s}, start ${e}: ${label === "none" ? "succeeds" : spaced(label)}` },
        signOf(label));
        return button;
      })));
    const grid = make("div", { class: "episodes", role: "grid", "aria-label": "outcome by seed and start",
      style: `--starts:${count}` }, lines);
    grid.addEventListener("click", (event) => {
      const { s, e } = event.target.dataset;
      if (s !== undefined) this.go({ r, c, s: Number(s), e: Number(e), t: 0 });
    });
    grid.addEventListener("keydown", (event) => this.walk(event, grid));
    const legend = [...found].sort((a, b) => b[1] - a[1]).map(([label, n]) =>
      make("span", {}, make("b", {}, signOf(label)), ` ${label === "none" ? "succeeds" : spaced(label)} ${n.toLocaleString("en")}`));
    if (traced.size) legend.push(make("span", {}, make("b", { class: "traced" }, "●"), " its motion is on this page"));
    if (acts.includes(true)) legend.push(make("span", {}, make("b", {}, "◆"), " its policy is on this page, to be started anywhere"));
    return [
      make("h3", {}, `Every episode: ${policies.length > 1 ? `${policies.length} seeds` : "one policy"} × ${count} starts${policies.length > 1 ? ", the largest loss first" : ""}`),
      make("p", { class: "legend" }, legend), make("div", { class: "scroll" }, grid),
    ];
  }

  // Places of the seeds, by how many successes at home are lost here; at home, by how few there are.
  worstFirst(r, c) {
    const { carried } = this;
    const { policies, homes: [home] } = carried.rows[r];
    const share = (cell, s) => {
      const n = carried.episodes(r, cell);
      let won = 0;
      for (let e = 0; e < n; e += 1) won += carried.label(r, cell, s, e) === "none";
      return n ? won / n : 1;
    };
    const lost = policies.map((_, s) => (home === undefined || home === c ? 1 : share(home, s)) - share(c, s));
    return policies.map((_, s) => s).sort((a, b) => lost[b] - lost[a]);
  }

  walk(event, grid) {
    const lines = [...grid.children].map((line) => [...line.querySelectorAll("button")]);
    const s = lines.findIndex((line) => line.includes(event.target));
    if (s < 0) return;
    const e = lines[s].indexOf(event.target);
    const next = { ArrowLeft: [s, e - 1], ArrowRight: [s, e + 1], ArrowUp: [s - 1, e],
      ArrowDown: [s + 1, e], Home: [s, 0], End: [s, lines[s].length - 1] }[event.key];
    const target = next && lines[next[0]] && lines[next[0]][next[1]];
    if (!next) return;
    event.preventDefault();
    if (!target) return;
    event.target.tabIndex = -1;
    target.tabIndex = 0;
    target.focus();
  }

  go(place) {
    remember(entryHash(place));
    this.open(place);
  }

  episode(place) {
    const { carried } = this;
    const { r, c, s, e } = place;
    const label = carried.label(r, c, s, e);
    const policy = carried.rows[r].policies[s];
    this.title.replaceChildren(...this.names(place));
    const back = make("button", { type: "button", class: "chip" }, "‹ all episodes");
    back.addEventListener("click", () => this.go({ r, c, s: null }));
    const trace = carried.trace(r, c, s, e);
    const lead = this.restartable(r, s);
    const parts = [
      make("p", { class: "crumb" }, back, `${policy.seed === null ? "" : ` seed ${policy.seed},`} start ${e}`),
      make("p", { class: `outcome ${label === "none" ? "won" : "lost"}` },
        `${label === "none" ? "✓" : "✕"} ${wordOf(label)}`,
        label === "none" ? null : make("span", {}, spaced(label))),
      trace && trace.reason ? make("p", { class: "reason" }, quoted(trace.reason))
        : label === "none" ? null : make("p", { class: "reason" }, this.carried.labelWords[label] || ""),
    ].filter(Boolean);
    if (trace) parts.push(...this.motion(place, trace));
    else parts.push(make("p", { class: "about" }, `Its motion is not on this page, which carries traces ${carried.choice}. The command below shows its record.`));
    if (lead >= 0) {
      parts.push(make("p", { class: "about" }, "This policy is on this page: ",
        make("a", { href: watchHash(lead, [...new Set([carried.leads[lead].cells[0], c])], 0, carried.live.startOf(carried.trace(...carried.leads[lead].at))) },
          "start it from anywhere, recomputed in this browser"), "."));
    }
    parts.push(...this.ledger(r, c, s, e, trace), ...this.elsewhere(place), ...this.record(place, trace));
    return parts;
  }

  // The first lead of a policy that can be simulated, or −1.
  restartable(r, s) {
    const { leads, live } = this.carried;
    return live && live.acts(r, s) ? leads.findIndex(({ at }) => at[0] === r && at[2] === s) : -1;
  }

  motion(place, trace) {
    const { carried } = this;
    const { r, c, s, e } = place;
    const others = carried.twins(r, s, e).filter((twin) => twin !== c);
    const beside = place.beside ?? others.find((twin) => carried.label(r, twin, s, e) !== trace.label) ?? others[0];
    const traces = [trace, ...(beside === undefined ? [] : [carried.trace(r, beside, s, e)])];
    const homes = carried.rows[r].homes;
    this.player = new Player(carried, traces, { start: place.t || 0, curves: true,
      roleOf: (twin) => (homes.includes(twin) ? "trained here" : twin === c ? "this episode" : ""),
      moved: (t) => remember(entryHash({ r, c, s, e, t })) });
    this.player.slider.dataset.first = "";
    if (!others.length) return [this.player.element];
    const select = make("select", { id: "beside" }, others.map((twin) =>
      make("option", { value: twin, selected: twin === beside }, carried.cells[twin].shown)));
    select.addEventListener("change", () => {
      this.open({ ...place, t: this.player.time, beside: Number(select.value) });
      this.body.querySelector("#beside").focus();
    });
    return [make("p", { class: "crumb" }, make("label", { for: "beside" }, "the same start beside it on "), select),
      this.player.element];
  }

  ledger(r, c, s, e, trace) {
    const ledger = this.carried.ledger(r, c, s, e);
    if (!ledger) return [make("p", { class: "about" }, "This page does not carry its energy ledger.")];
    const digits = trace ? 2 : Math.max(0, -Math.round(Math.log10(this.carried.unit)));
    const [motor, numerics, losses] = ledger.map((value) => Number(value.toFixed(digits)));
    const change = motor + numerics - losses;
    const scale = Math.max(...[motor, numerics, losses, change].map(Math.abs), 1e-9);
    const line = (name, value, kind) => {
      const bar = make("i", { class: `${kind}${value < 0 ? " below" : ""}` });
      bar.style.left = `${Math.min(50, 50 + (50 * value) / scale)}%`;
      bar.style.width = `${(50 * Math.abs(value)) / scale}%`;
      return make("div", { class: "bar-line", "data-ledger": name }, make("span", {}, name),
        make("span", { class: "rail" }, bar), make("output", {}, joules(value, digits)));
    };
    return [make("h3", {}, "Where the energy came from"),
      make("div", { class: "bars ledger" }, line("motor", motor, "motor"),
        line("numerics", numerics, "numerics"), line("losses", -losses, "losses"),
        line("change of energy", change, "energy"))];
  }

  // What the same policy did from the same start in every other cell.
  elsewhere({ r, c, s, e }) {
    const { carried } = this;
    const others = carried.cells.map((cell, twin) => [twin, carried.label(r, twin, s, e)])
      .filter(([twin, label]) => label && twin !== c);
    if (!others.length) return [];
    return [make("h3", {}, "The same policy, the same start"),
      make("ul", { class: "elsewhere" }, others.map(([twin, label]) => {
        const link = make("a", { href: entryHash({ r, c: twin, s, e }),
          class: label === "none" ? "won" : "lost" },
        make("b", {}, label === "none" ? "✓" : "✕"), ` ${carried.cells[twin].shown}`,
        carried.trace(r, twin, s, e) ? make("b", { class: "traced" }, " ●") : null);
        link.addEventListener("click", (event) => {
          event.preventDefault();
          this.go({ r, c: twin, s, e, t: 0 });
        });
        return make("li", {}, link);
      }))];
  }

  record({ r, c, s, e }, trace) {
    const policy = this.carried.rows[r].policies[s];
    const literal = (text) => `'${text.replaceAll("'", "''")}'`;
    const words = trace
      ? ["integ-gym", "evidence", "show", this.carried.directory, trace.id]
      : ["integ-gym", "evidence", "query", this.carried.directory,
        `SELECT * FROM records WHERE policy_id = ${literal(policy.id)} AND cell = ` +
        `${literal(this.carried.cells[c].name)} AND episode_index = ${e}`];
    return this.command("shows this record", words.map(shellWord).join(" "));
  }

  command(words, text) {
    return [make("h3", {}, `The command that ${words}`),
      make("div", { class: "run" }, make("pre", { class: "command" }, text))];
  }
}

// A word as a shell takes it, in the quotes that leave it readable.
function shellWord(word) {
  if (/^[\w@%+=:,./-]+$/.test(word)) return word;
  if (!word.includes("'")) return `'${word}'`;
  return /["$`\\!]/.test(word) ? `'${word.replaceAll("'", "'\"'\"'")}'` : `"${word}"`;
}
