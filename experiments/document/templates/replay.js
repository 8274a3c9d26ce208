// What moves on the page: view, charts, and what tables and findings tell of them.

const byId = (name) => document.getElementById(name);

class Replay {
  constructor(data) {
    this.data = data;
    this.slider = byId("slider");
    this.view = new View(byId("view"), data);
    this.charts = new Charts([...document.querySelectorAll("canvas.chart")], data, (t) => this.goTo(t));
    this.controls();
    this.tables();
    this.show(0);
    const again = () => this.draw();
    window.addEventListener("resize", again);
    // In a fold it has no size to be drawn in.
    byId("moving").closest("details").addEventListener("toggle", again);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
    // Paper is white, whatever the screen is.
    for (const [event, printing] of [["beforeprint", true], ["afterprint", false]]) {
      window.addEventListener(event, () => {
        document.documentElement.classList.toggle("printing", printing);
        again();
      });
    }
  }

  controls() {
    const on = (name, act) => byId(name).addEventListener("click", act);
    this.slider.addEventListener("input", () => this.show(Number(this.slider.value)));
    on("play", () => this.play(!this.playing));
    on("nearer", () => this.view.magnify(1.25));
    on("farther", () => this.view.magnify(0.8));
    on("zoom-in", () => this.charts.magnify(2));
    on("zoom-out", () => this.charts.magnify(0.5));
    on("zoom-all", () => this.charts.whole());
    document.querySelectorAll("input[data-curve]").forEach((box) => {
      box.checked = this.charts.shown[box.dataset.curve];
      box.addEventListener("change", () => {
        this.charts.shown[box.dataset.curve] = box.checked;
        this.charts.draw();
      });
    });
  }

  // First cells of parameters' rows become buttons, and findings that are somewhere get one.
  tables() {
    this.data.parameters.forEach((parameter, k) => {
      const row = document.querySelector(`[data-table="table_base_parameters"] [data-row="${k}"]`);
      if (!row) return;
      const cell = row.firstElementChild;
      const named = button("plain", () => this.tell(parameter.text, parameter.body));
      named.append(...cell.childNodes);
      cell.append(named);
    });
    const items = document.querySelectorAll(".findings details");
    this.data.findings.forEach((finding, k) => {
      if (!finding.where) return;
      const show = button("show", () => this.point(finding));
      show.append("Show in the replay");
      items[k].append(show);
    });
  }

  tell(text, body) {
    byId("told").textContent = text;
    this.view.chosen = body ?? null;
    unfold("moving").scrollIntoView({ block: "nearest" });
    this.draw();
  }

  point({ where, body, span, channels }) {
    this.tell(where, body);
    document.querySelectorAll("[data-channel]").forEach((panel) => {
      panel.classList.toggle("meant", channels.includes(panel.dataset.channel));
    });
    if (span) {
      this.charts.zoom(...span);
      this.goTo(span[0]);
    }
  }

  goTo(time) {
    const { frames } = this.data;
    let nearest = 0;
    frames.forEach((t, k) => {
      if (Math.abs(t - time) < Math.abs(frames[nearest] - time)) nearest = k;
    });
    this.show(nearest);
  }

  show(frame) {
    const time = this.data.frames[frame];
    this.view.frame = frame;
    this.charts.cursor = time;
    this.slider.value = frame;
    this.slider.setAttribute("aria-valuetext", `${time.toFixed(2)} s`);
    byId("time").textContent = `${time.toFixed(2)} s`;
    this.draw();
  }

  draw() {
    this.view.draw();
    this.charts.draw();
  }

  // As fast as it was recorded.
  play(playing) {
    this.playing = playing;
    byId("play").textContent = playing ? "Pause" : "Play";
    if (!playing) return;
    const { frames } = this.data;
    const last = frames.length - 1;
    const from = this.view.frame === last ? 0 : this.view.frame;
    const start = performance.now() / 1000 - frames[from];
    const step = (now) => {
      if (!this.playing) return;
      this.goTo(now / 1000 - start);
      if (this.view.frame === last) this.play(false);
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }
}

function button(className, act) {
  const element = document.createElement("button");
  Object.assign(element, { className, type: "button" });
  element.addEventListener("click", act);
  return element;
}

new Replay(JSON.parse(byId("replay").textContent));
