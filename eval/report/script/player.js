// Traces side by side on one clock: play, pause, scrub. `moved` hears of what the reader does.
class Player {
  constructor(carried, traces, options = {}) {
    Object.assign(this, { carried, traces, time: 0, playing: false, moved: () => {} }, options);
    this.end = Math.max(...traces.map((trace) => (trace.n - 1) * trace.period));
    const { scene } = carried;
    const amounts = amountsIn(carried, traces);
    const mark = scene && scene.upright > 0
      ? { value: scene.upright, words: `${scene.upright} J: at rest at the goal` } : null;
    this.parts = [];
    this.panes = traces.map((trace, place) => this.pane(trace, place, scene, amounts, mark));
    this.button = make("button", { type: "button", class: "play" }, "Play");
    this.button.addEventListener("click", () => {
      if (!this.playing) return this.play();
      this.pause();
      return this.moved(this.time);
    });
    this.slider = make("input", { type: "range", min: 0, max: this.end.toFixed(6),
      step: traces[0].period, value: 0, "aria-label": "time, seconds" });
    this.slider.addEventListener("input", () => {
      this.pause();
      this.show(Number(this.slider.value));
      this.moved(this.time);
    });
    this.clock = make("output", { class: "clock" });
    this.element = make("div", { class: "player" },
      make("div", { class: "clockwork" }, this.button, this.clock, this.slider),
      make("div", { class: "panes", style: `--count:${traces.length}` }, this.panes));
    if (options.curves) {
      const curves = new Curves(carried, traces, scene);
      this.parts.push(curves);
      this.element.append(curves.svg);
    }
    this.show(Math.min(options.start ?? 0, this.end));
  }

  pane(trace, place, scene, amounts, mark) {
    const children = [];
    const { skeleton } = this.carried;
    if (scene) {
      const stage = new Stage(this.carried, scene, trace);
      this.parts.push(stage);
      children.push(stage.svg);
    } else if (skeleton) {
      const robot = new Robot(this.carried, trace);
      this.parts.push(robot);
      children.push(robot.canvas);
    } else if (!this.curves) {
      const curves = new Curves(this.carried, [trace], null);
      this.parts.push(curves);
      children.push(curves.svg);
    }
    if (skeleton) {
      const followed = new Followed(this.carried, trace, this.traces);
      this.parts.push(followed);
      children.push(followed.element);
    } else if (trace.totals.every(known)) {
      const bars = new Bars(this.carried, trace, amounts, mark);
      this.parts.push(bars);
      children.push(bars.element);
    } else {
      children.push(make("p", { class: "about" }, "Its energy ledger is not known."));
    }
    const more = this.below ? this.below(trace.at[1]) : null;
    if (more) children.push(more);
    const won = trace.label === "none";
    const cell = this.carried.cells[trace.at[1]];
    const role = this.roleOf ? this.roleOf(trace.at[1]) : "";
    return make("figure", { class: `pane ${won ? "won" : "lost"}` },
      make("figcaption", {}, this.curves ? make("b", { class: `dash line-${place}` }) : null,
        make("span", { class: "name" }, cell.shown),
        make("span", { class: "end" }, won ? "✓ succeeds" : this.endOf(trace)),
        role ? make("small", {}, role) : null),
      ...children);
  }

  endOf(trace) {
    if (trace.diverged) return "✕ diverges";
    return this.carried.skeleton && trace.ended ? `✕ falls at ${trace.seconds.toFixed(1)} s` : "✕ fails";
  }

  show(time) {
    this.time = time;
    this.slider.value = time;
    this.clock.textContent = `${time.toFixed(2)} s`;
    this.slider.setAttribute("aria-valuetext", this.clock.textContent);
    for (const part of this.parts) part.show(time);
  }

  play() {
    if (this.time >= this.end - 1e-9) this.show(0);
    this.playing = true;
    this.button.textContent = "Pause";
    let last = null;
    const tick = (now) => {
      if (!this.playing || !this.element.isConnected) return;
      const passed = last === null ? 0 : (now - last) / 1000;
      // Without motion: a new picture once a second.
      if (last === null || !still.matches || passed >= 1) {
        last = now;
        this.show(Math.min(this.time + passed, this.end));
      }
      if (this.time >= this.end) this.pause();
      else requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.button.textContent = "Play";
  }
}
