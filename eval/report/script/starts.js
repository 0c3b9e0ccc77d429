// From which starts a policy succeeds: a strip that fills while the browser has time.
const ANGLES = 121;
const AT_ONCE = 12; // ms

class Starts {
  constructor(live, like, c, known) {
    Object.assign(this, { live, like, c, known });
    this.middle = live.middle(like);
    this.values = Array.from({ length: ANGLES }, (_, k) =>
      this.middle + live.reach * (2 * k / (ANGLES - 1) - 1));
    this.fill = draw("path", { class: "succeeds" });
    this.miss = draw("path", { class: "misses" });
    this.mark = draw("path", { class: "now" });
    this.svg = draw("svg", { class: "strip", viewBox: `0 0 ${ANGLES} 10`, preserveAspectRatio: "none",
      role: "img" }, this.miss, this.fill, this.mark);
    this.words = make("output", {});
    this.element = make("div", { class: "starts" }, make("span", {}, "starts"), this.svg, this.words);
    this.draw();
    this.later();
  }

  go() {
    const until = performance.now() + AT_ONCE;
    while (this.known.length < ANGLES && performance.now() < until) {
      this.known.push(this.live.succeeds(this.like, this.c, this.values[this.known.length]));
    }
    this.draw();
    this.later();
  }

  // As long as somebody looks.
  later() {
    if (this.known.length < ANGLES) setTimeout(() => { if (this.element.isConnected) this.go(); });
  }

  draw() {
    const bars = (wanted) => this.known.map((found, k) => (found === wanted ? `M${k} 0h1v10h-1z` : "")).join("");
    this.fill.setAttribute("d", bars(true));
    this.miss.setAttribute("d", bars(false));
    const done = this.known.length === ANGLES;
    const share = `${Math.round((100 * this.known.filter(Boolean).length) / ANGLES)} %`;
    this.words.textContent = done ? `${share} ✓` : "…";
    this.svg.setAttribute("aria-label", done
      ? `succeeds from ${share} of ${ANGLES} starts of ${this.live.name}, ` +
        `${this.live.shown(this.live.reach)} to either side of ${this.middle ? "hanging" : this.live.shown(0)}`
      : "being simulated");
  }

  at(value) {
    const x = (((value - this.middle) / this.live.reach + 1) / 2) * (ANGLES - 1) + 0.5;
    this.mark.setAttribute("d", `M${x - 0.4} 0h.8v10h-.8z`);
  }
}
