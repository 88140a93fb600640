// The rule file: its sets with the values of now, its text, a check, and its replacement while the car drives.
const SVG = "http://www.w3.org/2000/svg", WIDTH = 240, HEIGHT = 84, LEVELS = ["very_low", "low", "medium", "high", "very_high"];
const element = id => document.getElementById(id);

export class Rules {
  constructor(ask) {
    this.ask = ask;
    this.text = element("text");
    this.plots = new Map();
    this.opened = false;
    this.saved = null;
    this.text.addEventListener("input", () => this.changed());
    this.text.addEventListener("scroll", () => (element("numbers").scrollTop = this.text.scrollTop));
    element("check").addEventListener("click", () => this.act("/rules/check"));
    element("apply").addEventListener("click", () => this.act("/rules/apply"));
    element("reread").addEventListener("click", () => this.reread());
    window.addEventListener("beforeunload", event => this.edited() && event.preventDefault());
    this.key();
  }

  key() {
    const key = element("set-key");
    LEVELS.forEach((_, at) => {
      const mark = document.createElement("i");
      mark.className = `risk${at + 1}`;
      key.append(mark, `risk ${at + 1}`);
    });
  }

  open() {
    if (!this.opened) this.read();
  }

  async read() {
    try {
      this.saved = await this.ask("/rules");
      this.opened = true;
      this.text.value = this.saved.text;
      element("rule-path").textContent = this.saved.path;
      element("apply").disabled = Boolean(this.saved.fixed);
      this.verdict(this.saved.fixed ? [{ text: this.saved.fixed }] : [], !this.saved.fixed);
      this.changed();
      await this.draw();
    } catch (error) {
      this.verdict([{ text: error.message }], false);
    }
  }

  edited() {
    return Boolean(this.saved) && this.text.value !== this.saved.text;
  }

  // An edit is dropped by a second press only.
  reread() {
    if (this.edited() && !this.dropping) {
      element("edited").textContent = "edited, not applied: press again to drop the edit";
      this.dropping = true;
      return;
    }
    this.read();
  }

  changed() {
    this.dropping = false;
    const lines = this.text.value.split("\n").length;
    if (lines !== this.lines) element("numbers").textContent = Array.from({ length: lines }, (_, at) => at + 1).join("\n");
    this.lines = lines;
    element("edited").textContent = this.edited() ? "edited, not applied" : "";
  }

  async act(path) {
    for (const id of ["check", "apply", "reread"]) element(id).disabled = true;
    const began = performance.now();
    const show = () => (element("edited").textContent = `checking, ${((performance.now() - began) / 1000).toFixed(1)} s`);
    show();
    const clock = setInterval(show, 100);
    const text = this.text.value;
    let note = null;
    try {
      const found = await this.ask(path, { text, sha256: this.saved?.sha256 ?? "" });
      this.verdict(found.lines, found.ok);
      if (found.sha256) {
        this.saved = { ...this.saved, text, sha256: found.sha256, path: found.path };
        element("rule-path").textContent = found.path;
        note = `applied: written to ${found.path}; the car takes it over within a second`;
        await this.draw();
      }
    } catch (error) {
      this.verdict([{ text: error.message }], false);
    }
    clearInterval(clock);
    for (const id of ["check", "reread"]) element(id).disabled = false;
    element("apply").disabled = Boolean(this.saved?.fixed);
    this.changed();
    if (note) element("edited").textContent = note;
  }

  verdict(lines, ok) {
    element("verdict").replaceChildren(...lines.map(({ line, column, text }) => {
      const item = document.createElement("li");
      if (!line) {
        item.textContent = text;
        item.className = ok ? "good" : "bad";
        return item;
      }
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = text;
      button.addEventListener("click", () => this.go(line, column));
      item.append(button);
      return item;
    }));
    const first = lines.find(({ line }) => line);
    if (!ok && first) this.go(first.line, first.column);
  }

  // Put the cursor to the place of an error, and show its line.
  go(line, column) {
    const before = this.text.value.split("\n").slice(0, line - 1), start = before.reduce((sum, one) => sum + one.length + 1, 0);
    const end = start + (this.text.value.split("\n")[line - 1] ?? "").length;
    this.text.focus();
    this.text.setSelectionRange(Math.min(start + column - 1, end), end);
    this.text.scrollTop = Math.max(0, (line - 6) * parseFloat(getComputedStyle(this.text).lineHeight));
  }

  async draw() {
    const inputs = await this.ask("/rules/sets");
    this.plots = new Map(inputs.map(input => [input.name, plot(input)]));
    element("sets").replaceChildren(...[...this.plots.values()].map(one => one.figure));
    this.values = null;
  }

  show(values) {
    if (!values || element("rules").hidden) return;
    for (const [name, one] of this.plots) {
      const value = values[name], text = value === undefined ? "not reported" : value === null ? "missing" : String(+value.toPrecision(3));
      if (one.value.textContent !== text) one.value.textContent = text;
      const known = typeof value === "number";
      one.now.classList.toggle("unseen", !known);
      if (known) for (const end of ["x1", "x2"]) one.now.setAttribute(end, one.x(value).toFixed(1));
    }
  }
}

function svg(name, attributes) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  return node;
}

function plot(input) {
  const [low, high] = input.range, x = value => (WIDTH * (Math.min(Math.max(value, low), high) - low)) / (high - low), y = degree => HEIGHT * (1 - degree);
  const figure = document.createElement("figure"), caption = document.createElement("figcaption"), meaning = document.createElement("span");
  const unit = input.unit === "1" ? "" : ` [${input.unit}]`;
  caption.textContent = `${input.name}${unit}`;
  meaning.textContent = `${input.meaning}; ${input.rising ? "more" : "less"} is worse`;
  caption.append(meaning);
  const drawing = svg("svg", { viewBox: `-2 -4 ${WIDTH + 4} ${HEIGHT + 18}`, role: "img", "aria-label": `Sets of ${input.name}` });
  drawing.append(svg("line", { class: "axis", x1: 0, x2: WIDTH, y1: HEIGHT, y2: HEIGHT }));
  LEVELS.forEach((level, at) => {
    const corners = input.sets[level].filter(([, degree]) => degree !== null).map(([value, degree]) => `${x(value).toFixed(1)},${y(degree).toFixed(1)}`);
    drawing.append(svg("polyline", { class: `risk${input.rising ? at + 1 : 5 - at}`, points: corners.join(" ") }));
  });
  const now = svg("line", { class: "now unseen", x1: 0, x2: 0, y1: -4, y2: HEIGHT + 4 });
  drawing.append(now);
  for (const [value, anchor, at] of [[low, "start", 0], [high, "end", WIDTH]]) {
    const label = svg("text", { x: at, y: HEIGHT + 13, "text-anchor": anchor });
    label.textContent = String(+value.toPrecision(3));
    drawing.append(label);
  }
  const reading = document.createElement("p"), value = document.createElement("b");
  reading.className = "reading";
  reading.append("now ", value);
  value.textContent = "–";
  value.id = `value-${input.name}`;
  figure.append(caption, drawing, reading);
  return { figure, now, value, x };
}
