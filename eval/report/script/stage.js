// A picture of the plant, drawn from the links and the goal that it tells of itself.
const TRAIL = 14;
const TRAIL_STEP = 0.1;

class Stage {
  constructor(carried, scene, trace) {
    Object.assign(this, { carried, scene, trace });
    const track = scene.links.some((link) => link.joint === "slide") ? this.trackHalf() : 0;
    this.reach = scene.bob ? scene.bob.pivot : scene.hopper ? 2 * scene.hopper.leg
      : scene.links.reduce((sum, l) => sum + Math.abs(l.length), 0);
    const half = scene.flyer ? 1.04 * scene.flyer.room : (scene.bob ? 0.75 : 1.22) * this.reach;
    const wide = Math.max(half, track + 0.35);
    const middle = scene.bob ? -0.5 * this.reach : 0;
    // What never hangs needs no room below.
    const below = scene.links.length && scene.pose.every((x) => Math.abs(x) < 1) ? 0.3 * half : half;
    const box = scene.hopper ? [-1.2, -1.02, 2.4, 1.27].map((x) => x * this.reach)
      : [-wide, middle - half, 2 * wide, half + below];
    this.edges = [box[0], box[0] + box[2]];
    this.unit = 0.01 * half;
    this.svg = draw("svg", { class: "stage", viewBox: box.join(" "), "aria-hidden": "true" });
    this.ground(track, half);
    this.trail = Array.from({ length: TRAIL }, (_, k) => draw("circle", {
      class: "trail", r: 2.4 * this.unit, opacity: (0.5 * (1 - k / TRAIL)).toFixed(2),
    }));
    this.pushes = scene.controls.map(() => draw("path", { class: "push", "stroke-width": (scene.flyer || scene.hopper || scene.targets ? 2 : 4) * this.unit }));
    this.parts = scene.links.map((link) => this.part(link));
    if (scene.bob) {
      this.spring = draw("polyline", { class: "spring", "stroke-width": 2 * this.unit });
      this.bob = draw("circle", { class: "rod", r: 9 * this.unit, "stroke-width": 0 });
      this.parts = [this.spring, this.bob];
    }
    if (scene.flyer) this.parts = [this.body()];
    if (scene.hopper) this.parts = this.legged();
    this.svg.append(...(trace ? this.trail : []), ...this.parts, ...(this.aimed ? [this.aimed] : []), ...this.pushes);
    const jointed = scene.links.length || scene.hopper;
    this.svg.append(draw("circle", { class: "hinge", r: jointed ? 3.4 * this.unit : 0 }));
    this.hinge = this.svg.lastChild;
  }

  trackHalf() {
    const place = this.scene.links.findIndex((link) => link.joint === "slide");
    return this.scene.goal[place] || 2.4;
  }

  // Larger than to scale, with a rotor at either end.
  body() {
    const { unit } = this;
    const span = this.span = Math.max(2 * this.scene.flyer.arm, 14 * unit);
    const blade = (x) => `M${x - 0.45 * span} ${-4 * unit}h${0.9 * span}`;
    return draw("g", {},
      draw("path", { class: "rod", "stroke-width": 3 * unit, d: `M${-span} 0H${span}` }),
      draw("path", { class: "track", "stroke-width": 1.5 * unit, d: blade(-span) + blade(span) }),
      draw("circle", { class: "rod", r: 4 * unit, "stroke-width": 0 }));
  }

  // A springy leg with its foot, and the torso that turns about the hip.
  legged() {
    const { unit } = this;
    this.spring = draw("polyline", { class: "spring", "stroke-width": 2 * unit });
    this.foot = draw("circle", { class: "foot", r: 4 * unit });
    this.torso = draw("path", { class: "rod", "stroke-width": 18 * unit, d: `M0 ${6 * unit}V${-22 * unit}` });
    return [this.spring, this.foot, this.torso];
  }

  // The floor that passes by: where one has come far enough, and a mark each metre.
  floor() {
    const { unit, svg } = this;
    const [left, right] = this.edges;
    this.far = draw("path", { class: "goal far", "stroke-width": 6 * unit });
    this.metres = Array.from({ length: Math.ceil(right - left) + 1 }, () => draw("g", {},
      draw("path", { class: "track", "stroke-width": unit, d: `M0 0v${6 * unit}` }),
      draw("text", { y: 17 * unit, "font-size": (innerWidth <= 640 ? 13 : 8) * unit, "text-anchor": "middle" })));
    svg.append(this.far, draw("path", { class: "track", "stroke-width": 2 * unit, d: `M${left} ${unit}H${right}` }),
      ...this.metres);
  }

  pass(x) {
    const [left, right] = this.edges;
    this.metres.forEach((mark, k) => {
      const metre = Math.ceil(x + left) + k;
      mark.setAttribute("transform", `translate(${metre - x} 0)`);
      mark.setAttribute("visibility", Math.abs(metre - x) < right - 14 * this.unit ? "visible" : "hidden");
      mark.lastChild.textContent = `${metre} m`.replace("-", "−");
    });
    const { finish } = this.scene.hopper;
    const from = Math.max(left, finish - x);
    this.far.setAttribute("d", finish === null || from > right ? "" : `M${from} ${4 * this.unit}H${right}`);
  }

  // What moves by itself, and where it comes past in the whole episode.
  aims(svg) {
    const { scene, trace, unit } = this;
    const places = trace ? Array.from({ length: trace.n }, (_, k) =>
      TARGET(this.coordinates(k * trace.period)).map((x, axis) => (axis ? -x : x))) : [];
    this.aimed = draw("circle", { class: "target", r: scene.target.near });
    svg.append(draw("polyline", { class: "ring", points: places.join(" "), "stroke-width": unit }));
  }

  ground(track, half) {
    const { scene, unit, svg } = this;
    if (scene.target) this.aims(svg);
    if (scene.hopper) {
      this.floor();
      return;
    }
    if (scene.flyer) {
      const { room } = scene.flyer;
      const frame = { x: -room, y: -room, width: 2 * room, height: 2 * room };
      svg.append(draw("rect", { class: "ring", ...frame, "stroke-width": unit }));
      svg.append(draw("circle", { class: "goal", r: scene.goal[0] || 0 }));
      return;
    }
    const hinge = scene.links.findIndex((link) => link.joint === "hinge");
    if (track) {
      svg.append(draw("path", { class: "track", d: `M${-track} 0H${track}`, "stroke-width": unit }));
      for (const x of [-track, track]) {
        svg.append(draw("path", {
          class: "track", d: `M${x} ${-6 * unit}V${6 * unit}`, "stroke-width": 3 * unit,
        }));
      }
    } else if (!scene.bob) {
      svg.append(draw("circle", { class: "ring", r: this.reach, "stroke-width": unit }));
    }
    const goal = scene.bob ? scene.goal[0] : scene.goal[hinge];
    if (scene.bob && goal) {
      svg.append(draw("rect", {
        class: "goal", x: -goal, y: -2 * half, width: 2 * goal, height: 4 * half,
      }));
    } else if (goal && goal < Math.PI) {
      this.wedge = this.sector(0, goal);
      svg.append(this.wedge);
    }
  }

  sector(x, half) {
    const r = 1.14 * this.reach;
    const [dx, dy] = [r * Math.sin(half), -r * Math.cos(half)];
    return draw("path", {
      class: "goal", d: `M${x} 0L${x - dx} ${dy}A${r} ${r} 0 0 1 ${x + dx} ${dy}Z`,
    });
  }

  part(link) {
    const { unit } = this;
    if (link.joint === "slide") {
      return draw("rect", {
        class: "cart", x: -16 * unit, y: -8 * unit, width: 32 * unit, height: 16 * unit,
        rx: 3 * unit,
      });
    }
    const rod = { class: "rod", "stroke-width": (link.point ? 3 : 9) * unit };
    return draw("g", {}, draw("path", { ...rod, d: `M0 0V${-link.length}` }),
      link.point ? draw("circle", { class: "rod", cy: -link.length, r: 9 * unit, "stroke-width": 0 }) : null);
  }

  // Where links begin and end, and how far each is turned, with these coordinates.
  poses(q) {
    let [x, y, turn] = [0, 0, 0];
    return this.scene.links.map((link, place) => {
      if (link.joint === "slide") x += q[place];
      else turn += (this.scene.clockwise ? 1 : -1) * q[place];
      const from = [x, y];
      x += link.length * Math.sin(turn);
      y -= link.length * Math.cos(turn);
      return { from, tip: [x, y], turn };
    });
  }

  coordinates(time) {
    return this.scene.coordinates.map((name) => this.carried.at(this.trace, "motion", name, time));
  }

  // What leaves a trail, seen when the plant is at `here`.
  tip(q, here = q) {
    if (this.scene.hopper) return [q[0] - here[0], -q[1]];
    if (!this.scene.links.length) return [q[0], -q[1]];
    return this.poses(q).at(-1).tip;
  }

  // A still picture at these coordinates, each control at a share of its limit.
  pose(q, shares) {
    if (this.aimed) {
      const [x, y] = TARGET(q);
      this.aimed.setAttribute("transform", `translate(${x} ${-y})`);
    }
    if (this.scene.bob) {
      this.placeBob(q);
    } else if (this.scene.hopper) {
      this.placeHopper(q);
    } else if (this.scene.flyer) {
      this.parts[0].setAttribute("transform",
        `translate(${q[0]} ${-q[1]}) rotate(${(q[2] * 180) / Math.PI})`);
    } else {
      const poses = this.poses(q);
      this.parts.forEach((part, place) => {
        const { from, turn } = poses[place];
        part.setAttribute("transform",
          `translate(${from.join(" ")}) rotate(${(turn * 180) / Math.PI})`);
      });
      const hinge = poses.find((_, place) => this.scene.links[place].joint === "hinge");
      if (hinge) {
        this.hinge.setAttribute("transform", `translate(${hinge.from.join(" ")})`);
        if (this.wedge) this.wedge.setAttribute("transform", `translate(${hinge.from[0]} 0)`);
      }
    }
    this.pushes.forEach((push, k) =>
      push.setAttribute("d", this.arrow(q, this.scene.actuated[k], shares[k])));
  }

  placeBob([x, y]) {
    this.coil([0, -this.scene.bob.pivot], [x, -y]);
    this.bob.setAttribute("transform", `translate(${x} ${-y})`);
  }

  placeHopper([x, z, turn, hip, leg]) {
    const foot = [leg * Math.sin(hip - turn), leg * Math.cos(hip - turn) - z];
    this.pass(x);
    this.coil([0, -z], foot);
    this.foot.setAttribute("transform", `translate(${foot.join(" ")})`);
    this.foot.classList.toggle("touches", foot[1] > 0);
    this.torso.setAttribute("transform", `translate(0 ${-z}) rotate(${(turn * 180) / Math.PI})`);
    this.hinge.setAttribute("transform", `translate(0 ${-z})`);
  }

  // The spring between two points.
  coil([x, y], [endX, endY]) {
    const [dx, dy] = [endX - x, endY - y];
    const length = Math.hypot(dx, dy) || 1;
    const coils = Array.from({ length: 15 }, (_, k) => {
      const swing = k % 14 === 0 ? 0 : (k % 2 ? 4 : -4) * this.unit;
      return `${x + (k / 14) * dx - (swing * dy) / length},${y + (k / 14) * dy + (swing * dx) / length}`;
    });
    this.spring.setAttribute("points", coils.join(" "));
  }

  // Of a force or torque at the joint of a link, of a share of its limit.
  arrow(q, place, share) {
    const { scene } = this;
    const size = Math.max(-1, Math.min(1, share));
    if (scene.targets) return this.aim(q, place, size * scene.limits[scene.actuated.indexOf(place)]);
    if (Math.abs(size) < 0.02) return "";
    if (scene.hopper) return this.effort(q, place, size);
    if (scene.flyer) return this.thrust(q, place === scene.actuated[0] ? -1 : 1, size);
    if (scene.bob || scene.links[place].joint === "slide") {
      const [x, y] = scene.bob ? this.tip(q) : this.poses(q)[place].from;
      const tip = x + 0.6 * this.reach * size;
      const head = 5 * this.unit * Math.sign(size);
      return `M${x} ${y}H${tip}m${-head} ${-Math.abs(head)}l${head} ${Math.abs(head)}l${-head} ${Math.abs(head)}`;
    }
    const pose = this.poses(q)[place];
    return this.arc(pose.from, pose.turn + (scene.links[place].length < 0 ? Math.PI : 0),
      scene.clockwise ? size : -size);
  }

  // An arrow around a joint, that leaves a rod at an angle.
  arc([x, y], rod, size) {
    const side = Math.sign(size);
    const r = 0.42 * this.reach;
    const [a, b] = [rod + side * 0.16, rod + side * (0.16 + 2.1 * Math.abs(size))];
    const on = (angle, radius) =>
      `${x + radius * Math.sin(angle)} ${y - radius * Math.cos(angle)}`;
    const back = b - side * 0.16;
    return `M${on(a, r)}A${r} ${r} 0 0 ${side > 0 ? 1 : 0} ${on(b, r)}` +
      `M${on(back, 0.84 * r)}L${on(b, r)}L${on(back, 1.16 * r)}`;
  }

  // Where a servo is to bring a coordinate.
  aim(q, place, target) {
    if (this.scene.bob || this.scene.links[place].joint === "slide") {
      return `M${target} ${-14 * this.unit}V${14 * this.unit}`;
    }
    const { from, tip } = this.poses(q.map((x, k) => (k === place ? target : x)))[place];
    return `M${from.join(" ")}L${tip.join(" ")}`;
  }

  // Of the hip, or along the leg.
  effort([, z, turn, hip, leg], place, size) {
    const [across, down] = [Math.sin(hip - turn), Math.cos(hip - turn)];
    if (place === 3) return this.arc([0, -z], Math.PI - hip + turn, -size);
    const { unit } = this;
    const on = (along, aside) =>
      `${along * across + aside * down} ${-z + along * down - aside * across}`;
    const side = Math.sign(size);
    const [foot, head] = [leg + 6 * side * unit, 4 * unit];
    const tip = foot + (4 * side + 26 * size) * unit;
    const neck = tip - side * head;
    return `M${on(foot, 0)}L${on(tip, 0)}M${on(neck, head)}L${on(tip, 0)}L${on(neck, -head)}`;
  }

  // Of the rotor at one side of the body.
  thrust([x, z, turn], side, size) {
    const { unit, span } = this;
    const on = (along, up) => [x + along * Math.cos(turn) + up * Math.sin(turn),
      -z + along * Math.sin(turn) - up * Math.cos(turn)].join(" ");
    const [foot, top, head] = [6 * unit, (6 + 30 * size) * unit, 4 * unit];
    return `M${on(side * span, foot)}L${on(side * span, top)}` +
      `M${on(side * span - head, top - head)}L${on(side * span, top)}L${on(side * span + head, top - head)}`;
  }

  show(time) {
    const q = this.coordinates(time);
    const names = Object.keys(this.trace.control);
    this.pose(q, this.scene.limits.map((limit, k) =>
      (k in names ? this.carried.at(this.trace, "control", names[k], time, true) / limit : 0)));
    const tip = this.tip(q);
    this.trail.forEach((dot, k) => {
      const past = time - (k + 1) * TRAIL_STEP;
      const [x, y] = past < 0 ? tip : this.tip(this.coordinates(past), q);
      dot.setAttribute("cx", x);
      dot.setAttribute("cy", y);
    });
  }
}
