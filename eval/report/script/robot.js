// A robot from its bodies, joints and geoms, seen from its side by a camera that follows it.
const ASIDE = 0.42; // rad, by which the camera looks from ahead of the side
const ABOVE = 0.2; // rad, by which it looks down
const TILE = 0.5; // m
const PATH = 3; // s of the way so far

const turned = ([w, x, y, z], [a, b, c]) => {
  const [p, q, r] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p];
};
const product = ([a, b, c, d], [w, x, y, z]) => [a * w - b * x - c * y - d * z,
  a * x + b * w + c * z - d * y, a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w];
const plus = (a, b, size = 1) => a.map((x, k) => x + size * b[k]);
const unit = (v) => v.map((x) => x / (Math.hypot(...v) || 1));
const rotation = (axis, angle) => [Math.cos(angle / 2), ...axis.map((x) => x * Math.sin(angle / 2))];

// Points of a geom that is no capsule, whose hull is its outline.
function corners(kind, [a, b, c]) {
  if (kind === "box") return [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [k & 1 ? a : -a, k & 2 ? b : -b, k & 4 ? c : -c]);
  const round = Array.from({ length: 14 }, (_, k) => [Math.cos((k * Math.PI) / 7), Math.sin((k * Math.PI) / 7)]);
  if (kind === "cylinder") return [-b, b].flatMap((z) => round.map(([x, y]) => [a * x, a * y, z]));
  return round.flatMap(([x, y]) => [[a * x, b * y, 0], [a * x, 0, c * y], [0, b * x, c * y]]);
}

function hull(points) {
  const sorted = [...points].sort((p, q) => p[0] - q[0] || p[1] - q[1]);
  const half = (order) => {
    const kept = [];
    for (const p of order) {
      while (kept.length > 1) {
        const [a, b] = kept.slice(-2);
        if ((b[0] - a[0]) * (p[1] - a[1]) > (b[1] - a[1]) * (p[0] - a[0])) break;
        kept.pop();
      }
      kept.push(p);
    }
    return kept.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

class Robot {
  constructor(carried, trace) {
    Object.assign(this, { carried, trace, ...carried.skeleton });
    this.canvas = make("canvas", { class: "robot", width: 720, height: 600, role: "img",
      "aria-label": `the robot on ${carried.cells[trace.at[1]].shown}` });
    this.pen = this.canvas.getContext("2d");
    this.shapes = this.geoms.filter(([body]) => body >= 0).map(([body, kind, sizes, at, spin]) => {
      const line = kind === "sphere" ? [[0, 0, 0]] : kind === "capsule" ? [[0, 0, -sizes[1]], [0, 0, sizes[1]]] : null;
      return { body, wide: line ? 2 * sizes[0] : 0,
        points: (line || corners(kind, sizes)).map((p) => plus(at, turned(spin, p))) };
    });
    // Of a body without geoms, what its joints and those of the bodies on it span.
    const bare = this.bodies.map((_, body) => body).filter((body) => !this.shapes.some((one) => one.body === body));
    const anchors = (body) => this.bodies.filter(([parent]) => parent === body).map(([, at]) => at);
    this.shapes.push(...bare.filter((body) => anchors(body).length > 1)
      .map((body) => ({ body, wide: 0, spans: true, points: [[0, 0, 0], ...anchors(body)] })));
    this.first = this.joints.length ? this.joints[0][0] : 0;
    this.free = this.joints.find(([, kind]) => kind === "free");
    this.jointed = new Set(this.joints.map(([body]) => body));
    const { places, spins } = this.pose(0);
    this.thick = 0;
    const points = this.placed(places, spins).flatMap((shape) => shape.points);
    this.ground = this.floor ?? Math.min(...points.map((p) => p[2]));
    this.high = Math.max(...points.map((p) => p[2])) - this.ground;
    const root = places[this.first];
    const reach = Math.max(...points.map((p) => Math.hypot(p[0] - root[0], p[1] - root[1])));
    this.size = Math.min((0.7 * this.canvas.height) / this.high, (0.4 * this.canvas.width) / reach);
    this.thick = Math.min(0.05, 0.045 * this.high);
  }

  // Places and rotations of all bodies.
  pose(time) {
    const q = this.coordinates.map((name) => this.carried.at(this.trace, "motion", name, time));
    const joints = new Map();
    for (const joint of this.joints) joints.set(joint[0], [...(joints.get(joint[0]) || []), joint]);
    const places = [];
    const spins = [];
    this.bodies.forEach(([parent, at, spin], body) => {
      let place = parent < 0 ? at : plus(places[parent], turned(spins[parent], at));
      let turn = parent < 0 ? spin : product(spins[parent], spin);
      for (const [, kind, k, axis, anchor, reference] of joints.get(body) || []) {
        if (kind === "free") {
          place = q.slice(k, k + 3);
          turn = unit(q.slice(k + 3, k + 7));
        } else if (kind === "slide") {
          place = plus(place, turned(turn, axis), q[k] - reference);
        } else {
          const fixed = plus(place, turned(turn, anchor));
          turn = product(turn, kind === "ball" ? unit(q.slice(k, k + 4)) : rotation(axis, q[k] - reference));
          place = plus(fixed, turned(turn, anchor), -1);
        }
      }
      places.push(place);
      spins.push(turn);
    });
    return { places, spins };
  }

  // A coordinate of the joint that leaves its body free.
  rootAt(place, time) {
    return this.carried.at(this.trace, "motion", this.coordinates[this.free[2] + place], time);
  }

  // Where it heads, over a second, so that the camera does not sway with its steps.
  heading(time) {
    if (!this.free) return [1, 0];
    const sum = [0, 0];
    for (let k = -4; k <= 4; k += 1) {
      const spin = [3, 4, 5, 6].map((n) => this.rootAt(n, Math.max(0, time + k / 8)));
      const [x, y] = turned(unit(spin), [1, 0, 0]);
      sum[0] += x;
      sum[1] += y;
    }
    return unit(sum);
  }

  show(time) {
    const { pen, canvas, ground } = this;
    const { places, spins } = this.pose(time);
    const root = places[this.first];
    const [ahead, left] = this.heading(time);
    const [cos, sin] = [Math.cos(ASIDE), Math.sin(ASIDE)];
    const right = [ahead * cos - left * sin, left * cos + ahead * sin];
    const [up, down] = [Math.cos(ABOVE), Math.sin(ABOVE)];
    this.seen = ([x, y, z]) => {
      const [dx, dy] = [x - root[0], y - root[1]];
      const far = right[0] * dy - right[1] * dx;
      return [canvas.width / 2 + this.size * (right[0] * dx + right[1] * dy),
        0.82 * canvas.height - this.size * (up * (z - ground) + down * far), far];
    };
    const style = getComputedStyle(document.documentElement);
    const [line, body, force, page, trail] = ["--line", "--h-blue", "--h-vermilion", "--page", "--accent"]
      .map((name) => style.getPropertyValue(name));
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.lineCap = "round";
    pen.lineJoin = "round";
    this.drawFloor(root, line);
    this.drawPath(time, trail);
    const shapes = this.placed(places, spins);
    pen.globalAlpha = 0.13;
    pen.fillStyle = style.getPropertyValue("--ink");
    pen.beginPath();
    for (const { points, wide } of shapes) {
      for (const [x, y] of points) {
        const [a, b] = this.seen([x, y, ground]);
        pen.moveTo(a, b);
        pen.ellipse(a, b, this.size * Math.max(wide / 2, 0.03), this.size * down * Math.max(wide / 2, 0.03), 0, 0, 7);
      }
    }
    pen.fill();
    this.drawShapes(shapes, body, page);
    this.drawForces(places, spins, time, force);
    pen.globalAlpha = 1;
  }

  // Bones and geoms in the world.
  placed(places, spins) {
    const bones = this.bodies.flatMap(([parent], body) => (parent >= 0 && this.jointed.has(body)
      ? [{ points: [places[parent], places[body]], wide: this.thick }] : []));
    return [...bones, ...this.shapes.map(({ body, points, wide, spans }) => (
      { spans, wide: spans ? this.thick : wide, points: points.map((p) => plus(places[body], turned(spins[body], p))) }))];
  }

  drawFloor([x, y], colour) {
    const { pen, ground } = this;
    const reach = 6 * TILE;
    const [a, b] = [x, y].map((at) => TILE * Math.round(at / TILE));
    pen.strokeStyle = colour;
    pen.lineWidth = 2;
    for (let k = -6; k <= 6; k += 1) {
      pen.globalAlpha = 1 - Math.abs(k) / 7;
      for (const ends of [[[a + k * TILE, b - reach], [a + k * TILE, b + reach]],
        [[a - reach, b + k * TILE], [a + reach, b + k * TILE]]]) {
        pen.beginPath();
        for (const end of ends) pen.lineTo(...this.seen([...end, ground]).slice(0, 2));
        pen.stroke();
      }
    }
  }

  // The way of its first joint's body on the floor.
  drawPath(time, colour) {
    const { pen } = this;
    pen.strokeStyle = colour;
    pen.lineWidth = 5;
    pen.globalAlpha = 0.5;
    pen.beginPath();
    for (let past = Math.min(PATH, time); past >= 0; past -= 0.1) {
      const [x, y] = this.free ? [0, 1].map((k) => this.rootAt(k, time - past))
        : this.pose(time - past).places[this.first];
      pen.lineTo(...this.seen([x, y, this.ground]).slice(0, 2));
    }
    pen.stroke();
  }

  // The farthest first and palest.
  drawShapes(shapes, colour, behind) {
    const { pen } = this;
    const found = shapes.map(({ points, wide, spans }) => {
      const seen = points.map(this.seen);
      return { seen, wide, closed: spans || !wide, far: seen.reduce((sum, p) => sum + p[2], 0) / seen.length };
    }).sort((a, b) => b.far - a.far);
    const [near, far] = [found.at(-1).far, found[0].far];
    for (const { seen, wide, closed, far: own } of found) {
      const outline = closed ? hull(seen) : seen;
      const trace = () => {
        pen.beginPath();
        for (const [x, y] of outline) pen.lineTo(x, y);
        if (outline.length === 1) pen.lineTo(outline[0][0] + 0.01, outline[0][1]);
        if (closed) pen.closePath();
      };
      const paint = (tone, more) => {
        trace();
        pen.strokeStyle = pen.fillStyle = tone;
        pen.lineWidth = wide * this.size + more;
        if (closed) pen.fill();
        if (wide || more) pen.stroke();
      };
      pen.globalAlpha = 1;
      paint(behind, 5);
      pen.globalAlpha = 1 - 0.6 * ((own - near) / (far - near || 1));
      paint(colour, 0);
    }
  }

  // The force that each foot gets from what it stands on.
  drawForces(places, spins, time, colour) {
    const { pen } = this;
    pen.strokeStyle = colour;
    pen.lineWidth = 7;
    pen.globalAlpha = 1;
    for (const [foot, body] of Object.entries(this.feet)) {
      const share = this.carried.at(this.trace, "motion", `${foot}_normal_force`, time, true) / this.weight;
      if (share < 0.02 || time > this.trace.seconds) continue;
      const sole = this.shapes.filter((shape) => shape.body === body)
        .flatMap(({ points }) => points.map((p) => plus(places[body], turned(spins[body], p))))
        .reduce((least, p) => (p[2] < least[2] ? p : least), places[body]);
      const [x, y] = this.seen([sole[0], sole[1], this.ground]);
      const tip = y - Math.min(0.5 * share, 0.9) * this.high * this.size;
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x, tip);
      pen.moveTo(x - 10, tip + 13);
      pen.lineTo(x, tip);
      pen.lineTo(x + 10, tip + 13);
      pen.stroke();
    }
  }
}

// What is commanded, and what is measured of it.
class Followed {
  constructor(carried, trace, traces) {
    Object.assign(this, { carried, trace });
    const names = Object.keys(trace.command).filter((name) => `measured_${name}` in trace.motion);
    this.lines = names.map((name) => {
      const values = traces.flatMap((one) => [one.command[name] ?? 0,
        ...carried.column(one, "motion", `measured_${name}`)]).map(Math.abs).sort((a, b) => a - b);
      const scale = Math.max(1e-9, Math.abs(trace.command[name]), values[Math.floor(0.95 * (values.length - 1))]) * 1.1;
      const bar = make("i", { class: "motor" });
      const value = make("output", {});
      const tick = make("b", { title: `commanded: ${trace.command[name]}` });
      tick.style.left = `${50 + (50 * trace.command[name]) / scale}%`;
      return { name, scale, bar, value, row: make("div", { class: "bar-line" },
        make("span", {}, spaced(name)), make("span", { class: "rail" }, bar, tick), value) };
    });
    const error = known(trace.error) ? make("p", { class: "about" },
      `off by ${trace.error.toFixed(2)} (root mean square)`) : null;
    this.element = make("div", { class: "bars followed" }, this.lines.map((line) => line.row), error);
  }

  show(time) {
    for (const { name, scale, bar, value } of this.lines) {
      const now = this.carried.at(this.trace, "motion", `measured_${name}`, time);
      const end = 50 + 50 * Math.max(-1, Math.min(1, now / scale));
      bar.style.left = `${Math.min(50, end)}%`;
      bar.style.width = `${Math.abs(end - 50)}%`;
      value.textContent = `${signed(now)} of ${signed(this.trace.command[name])}`;
    }
  }
}
const signed = (value) => value.toFixed(2).replace("-", "−");
