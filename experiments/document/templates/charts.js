// Channels over time, one below the other, with one span and one cursor for all.

const MARGIN = { left: 52, right: 8, top: 6, bottom: 20 };
const DASHES = [[], [], [6, 3], [2, 3], [8, 3, 2, 3]];

class Charts {
  constructor(panels, data, onTime) {
    Object.assign(this, { panels, data, onTime, cursor: data.time[0], shown: data.curves.map((_, k) => k < 3) });
    this.whole();
    panels.forEach((canvas, channel) => this.listen(canvas, channel));
  }

  listen(canvas) {
    let start = null;
    canvas.addEventListener("pointerdown", (event) => {
      start = event.offsetX;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointerup", (event) => {
      const ends = [start, event.offsetX].sort((a, b) => a - b).map((x) => this.timeAt(canvas, x));
      if (Math.abs(event.offsetX - start) > 8) this.zoom(...ends);
      else this.onTime(ends[0]);
    });
    canvas.addEventListener("dblclick", () => this.whole());
  }

  timeAt(canvas, x) {
    const width = canvas.clientWidth - MARGIN.left - MARGIN.right;
    const share = Math.max(0, Math.min(1, (x - MARGIN.left) / width));
    return this.span[0] + share * (this.span[1] - this.span[0]);
  }

  whole() {
    this.zoom(this.data.time[0], this.data.time[this.data.time.length - 1]);
  }

  // By a factor around the cursor, or around the middle if that is out of sight.
  magnify(factor) {
    const [from, to] = this.span;
    const middle = this.cursor > from && this.cursor < to ? this.cursor : (from + to) / 2;
    const { time } = this.data;
    this.zoom(
      Math.max(time[0], middle + (from - middle) / factor),
      Math.min(time[time.length - 1], middle + (to - middle) / factor),
    );
  }

  zoom(from, to) {
    this.span = [from, to];
    this.draw();
  }

  draw() {
    this.panels.forEach((canvas, channel) => this.panel(canvas, channel));
  }

  panel(canvas, channel) {
    const density = window.devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = canvas;
    [canvas.width, canvas.height] = [width * density, height * density];
    const context = canvas.getContext("2d");
    context.scale(density, density);
    const colors = paints(canvas);
    const [low, high] = this.range(channel);
    const across = (t) => MARGIN.left + ((t - this.span[0]) / (this.span[1] - this.span[0])) * (width - MARGIN.left - MARGIN.right);
    const down = (y) => MARGIN.top + ((high - y) / (high - low)) * (height - MARGIN.top - MARGIN.bottom);
    const { spans, curves, values, time } = this.data;
    context.font = "12px sans-serif";
    this.ticks(context, colors, { across, down, low, high, width, height });
    context.save();
    context.beginPath();
    context.rect(MARGIN.left, MARGIN.top, width - MARGIN.left - MARGIN.right, height - MARGIN.top - MARGIN.bottom);
    context.clip();
    context.fillStyle = colors.line;
    context.globalAlpha = 0.5;
    for (const [from, to] of spans) context.fillRect(across(from), 0, across(to) - across(from), height);
    context.globalAlpha = 1;
    curves.forEach((_, k) => {
      if (!this.shown[k]) return;
      context.beginPath();
      let drawing = false;
      time.forEach((t, i) => {
        const y = values[k][channel][i];
        if (y === null) drawing = false;
        else if (drawing) context.lineTo(across(t), down(y));
        else context.moveTo(across(t), down(y));
        drawing = y !== null;
      });
      context.strokeStyle = inkOf(canvas, this.data.inks[k]);
      context.setLineDash(DASHES[k % DASHES.length]);
      context.lineWidth = k ? 1.3 : 2;
      context.stroke();
    });
    context.setLineDash([]);
    context.fillStyle = colors.force;
    context.fillRect(across(this.cursor) - 0.75, 0, 1.5, height);
    context.restore();
  }

  // Smallest and largest value in sight, with some room.
  range(channel) {
    let [low, high] = [Infinity, -Infinity];
    this.data.time.forEach((t, i) => {
      if (t < this.span[0] || t > this.span[1]) return;
      this.data.values.forEach((curve, k) => {
        const y = curve[channel][i];
        if (!this.shown[k] || y === null) return;
        low = Math.min(low, y);
        high = Math.max(high, y);
      });
    });
    if (!(low <= high)) return [-1, 1];
    const room = 0.05 * (high - low) || 0.1 * Math.abs(high) || 1;
    return [low - room, high + room];
  }

  ticks(context, colors, { across, down, low, high, width, height }) {
    context.strokeStyle = colors.line;
    context.fillStyle = colors.quiet;
    context.lineWidth = 1;
    const line = (x0, y0, x1, y1) => {
      context.beginPath();
      context.moveTo(x0, y0);
      context.lineTo(x1, y1);
      context.stroke();
    };
    context.textAlign = "right";
    for (const y of steps(low, high, 5)) {
      line(MARGIN.left, down(y), width - MARGIN.right, down(y));
      context.fillText(shortly(y), MARGIN.left - 5, down(y) + 4);
    }
    context.textAlign = "center";
    for (const t of steps(...this.span, width / 90)) {
      line(across(t), MARGIN.top, across(t), height - MARGIN.bottom);
      if (across(t) < width - 24) context.fillText(shortly(t), across(t), height - 5);
    }
    context.textAlign = "right";
    context.fillText("s", width - MARGIN.right, height - 5);
  }
}

// Round numbers in a range, about so many.
function steps(low, high, number) {
  const raw = (high - low) / Math.max(number, 1);
  const size = 10 ** Math.floor(Math.log10(raw));
  const step = size * ([1, 2, 5].find((k) => k * size >= raw) || 10);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step);
  return found;
}

const shortly = (x) => String(Number(x.toPrecision(6))).replace("-", "\u2212");

const inkOf = (element, k) => getComputedStyle(element).getPropertyValue(`--curve${k}`).trim();
