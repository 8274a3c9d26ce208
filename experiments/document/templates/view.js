// The mechanism in orthographic projection, nearer faces painted over farther ones.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, s) => a.map((x) => s * x);
const sum = (a, b) => a.map((x, k) => x + b[k]);
const triple = (flat, k) => [flat[3 * k], flat[3 * k + 1], flat[3 * k + 2]];

// Columns of the rotation of a unit quaternion w, x, y, z.
function columns([w, x, y, z]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
    [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
  ];
}

const turned = (axes, p) => [0, 1, 2].map((k) => axes[0][k] * p[0] + axes[1][k] * p[1] + axes[2][k] * p[2]);

class View {
  constructor(canvas, data) {
    Object.assign(this, { canvas, data, frame: 0, chosen: null, yaw: 0.6, pitch: 0.3, zoom: 1 });
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) this.turn(event.movementX / 120, event.movementY / 120);
    });
    canvas.addEventListener("keydown", (event) => {
      const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
      if (turns[event.key]) this.turn(...turns[event.key]);
      else if (event.key === "+" || event.key === "-") this.magnify(event.key === "+" ? 1.2 : 1 / 1.2);
      else return;
      event.preventDefault();
    });
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + pitch));
    this.draw();
  }

  magnify(factor) {
    this.zoom *= factor;
    this.draw();
  }

  // Directions of the screen: to the right, upwards, and towards the reader.
  look() {
    const { up } = this.data;
    const side = Math.abs(up[0]) > 0.9 ? [0, 1, 0] : [1, 0, 0];
    const raw = cross(up, side);
    const front = scaled(raw, -1 / Math.hypot(...raw));
    const left = cross(up, front);
    const ahead = sum(scaled(front, Math.cos(this.yaw)), scaled(left, Math.sin(this.yaw)));
    const right = cross(up, ahead);
    const toward = sum(scaled(ahead, Math.cos(this.pitch)), scaled(up, Math.sin(this.pitch)));
    return [right, cross(toward, right), toward];
  }

  // Position and axes of a body in this frame; those of the base, body -1, do not move.
  pose(body) {
    if (body < 0) return { p: [0, 0, 0], axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] };
    const x = this.data.poses[this.frame].slice(7 * body, 7 * body + 7);
    return { p: x.slice(0, 3), axes: columns(x.slice(3)) };
  }

  draw() {
    const { canvas, data } = this;
    const density = window.devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = canvas;
    [canvas.width, canvas.height] = [width * density, height * density];
    this.context = canvas.getContext("2d");
    this.context.scale(density, density);
    this.screen = this.look();
    this.unit = (this.zoom * 0.5 * Math.min(width, height)) / data.radius;
    this.onScreen = (p) => {
      const d = sum(p, scaled(data.center, -1));
      return [width / 2 + this.unit * dot(this.screen[0], d), height / 2 - this.unit * dot(this.screen[1], d)];
    };
    this.colors = paints(canvas);
    this.poses = data.bodies.map((_, k) => this.pose(k));
    this.labels = [];
    this.faces();
    data.bodies.forEach((body, k) => this.body(body, k));
    data.axes.forEach((axis) => this.axis(axis));
    data.arrows.forEach((arrow) => this.arrow(arrow));
  }

  faces() {
    const drawn = [];
    for (const { body, vertices, faces } of this.data.shapes) {
      const { p, axes } = body < 0 ? this.pose(-1) : this.poses[body];
      const at = [];
      for (let k = 0; 3 * k < vertices.length; k++) at.push(sum(p, turned(axes, triple(vertices, k))));
      for (let k = 0; 3 * k < faces.length; k++) {
        const [a, b, c] = triple(faces, k).map((i) => at[i]);
        const normal = cross(sum(b, scaled(a, -1)), sum(c, scaled(a, -1)));
        const facing = dot(normal, this.screen[2]) / (Math.hypot(...normal) || 1);
        if (facing > 0) drawn.push([dot(sum(sum(a, b), c), this.screen[2]), [a, b, c], body, facing]);
      }
    }
    drawn.sort((a, b) => a[0] - b[0]);
    for (const [, corners, body, facing] of drawn) {
      const faint = this.chosen !== null && this.chosen !== body;
      this.context.globalAlpha = faint ? 0.15 : 1;
      const paint = this.shade(body, 0.55 + 0.45 * facing);
      // Its own edge covers the seam to its neighbours.
      this.line(corners, { fill: paint, stroke: faint ? null : paint, width: 0.7, close: true });
    }
    this.context.globalAlpha = 1;
  }

  // Colour of a body by how well it is known, darker where it is turned away from the reader.
  shade(body, light) {
    const share = body < 0 ? null : this.data.bodies[body].told;
    const { fixed, unknown, known } = this.colors;
    const base = share === null ? fixed : unknown.map((x, k) => x + share * (known[k] - x));
    return `rgb(${base.map((x) => Math.round(light * x))})`;
  }

  body(body, k) {
    const { p, axes } = this.poses[k];
    if (body.parent >= 0) this.line([this.poses[body.parent].p, p], { stroke: this.colors.quiet, width: 1 });
    const faint = this.chosen !== null && this.chosen !== k;
    this.context.globalAlpha = faint ? 0.25 : 1;
    if (body.prior) this.ellipsoid(p, axes, body.prior, { dash: [4, 3] });
    if (body.estimate) this.ellipsoid(p, axes, body.estimate, { fill: this.shade(k, 1) });
    this.context.globalAlpha = 1;
    if (this.chosen === k) this.label(p, body.name);
  }

  // The outline of an ellipsoid: three semi-axes and its centre, in a body's frame.
  ellipsoid(p, axes, [ax, ay, az, centre], { dash = [], fill = null }) {
    const [x, y] = this.onScreen(sum(p, turned(axes, centre)));
    const across = [ax, ay, az].map((a) => this.screen.slice(0, 2).map((s) => dot(s, turned(axes, a))));
    const [xx, xy, yy] = [[0, 0], [0, 1], [1, 1]].map(([i, j]) => across.reduce((s, a) => s + a[i] * a[j], 0));
    const middle = (xx + yy) / 2;
    const spread = Math.hypot((xx - yy) / 2, xy);
    const radii = [middle + spread, middle - spread].map((x) => this.unit * Math.sqrt(Math.max(x, 0)));
    const { context } = this;
    context.beginPath();
    context.ellipse(x, y, ...radii, -Math.atan2(2 * xy, xx - yy) / 2, 0, 2 * Math.PI);
    context.setLineDash(dash);
    context.strokeStyle = this.colors.ink;
    context.lineWidth = 1.2;
    if (fill) {
      context.fillStyle = fill;
      context.fill();
    }
    context.stroke();
    context.setLineDash([]);
  }

  axis({ body, point, direction, slides }) {
    const { p, axes } = this.poses[body];
    const at = sum(p, turned(axes, point));
    const reach = scaled(turned(axes, direction), 0.12 * this.data.radius);
    const ends = [sum(at, scaled(reach, -1)), sum(at, reach)];
    this.line(ends, { stroke: this.colors.axis, width: 2, dash: slides ? [2, 2] : [] });
  }

  arrow({ name, points, forces }) {
    const { largest, radius } = this.data;
    const from = triple(points, this.frame);
    const force = triple(forces, this.frame);
    if (Math.hypot(...force) <= 0.01 * largest) return;
    const to = sum(from, scaled(force, (0.8 * radius) / largest));
    const [[x0, y0], [x1, y1]] = [from, to].map(this.onScreen);
    const angle = Math.atan2(y1 - y0, x1 - x0);
    const { context } = this;
    this.line([from, to], { stroke: this.colors.force, width: 2.5 });
    context.beginPath();
    context.moveTo(x1, y1);
    for (const turn of [2.7, -2.7]) context.lineTo(x1 + 10 * Math.cos(angle + turn), y1 + 10 * Math.sin(angle + turn));
    context.fillStyle = this.colors.force;
    context.fill();
    this.label(to, `${name} ${Math.hypot(...force).toPrecision(3)} N`);
  }

  // Beside a point, below those that are in its place already; within the canvas across, but not down.
  label(point, text) {
    const { context, labels } = this;
    context.font = "13px sans-serif";
    const { width } = context.measureText(text);
    const [across, down] = this.onScreen(point);
    const x = Math.max(2, Math.min(across + 8, this.canvas.clientWidth - width - 2));
    let y = Math.max(14, down - 4);
    while (labels.some((other) => Math.abs(other.y - y) < 16 && x < other.x + other.width && other.x < x + width)) y += 4;
    labels.push({ x, y, width });
    context.lineWidth = 3;
    context.strokeStyle = this.colors.paper;
    context.strokeText(text, x, y);
    context.fillStyle = this.colors.ink;
    context.fillText(text, x, y);
  }

  line(points, { stroke = null, fill = null, width = 1, dash = [], close = false }) {
    const { context } = this;
    context.beginPath();
    points.map(this.onScreen).forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
    if (close) context.closePath();
    context.setLineDash(dash);
    if (fill) {
      context.fillStyle = fill;
      context.fill();
    }
    if (stroke) {
      context.lineWidth = width;
      context.strokeStyle = stroke;
      context.stroke();
    }
    context.setLineDash([]);
  }
}

// The colours of the page's scheme; those that are mixed as red, green and blue.
function paints(element) {
  const style = getComputedStyle(element);
  const read = (name) => style.getPropertyValue(`--${name}`).trim();
  const mixed = (name) => read(name).split(" ").map(Number);
  const whole = Object.fromEntries(["ink", "quiet", "paper", "line", "box", "axis", "force"].map((k) => [k, read(k)]));
  return { ...whole, fixed: mixed("fixed"), unknown: mixed("unknown"), known: mixed("known") };
}
