// Timelines of the last 90 s, by uPlot. The newest value of each stands beside it as text.
import { colour, onScheme } from "./colours.js";

const SPAN_S = 90, HEIGHT = 84;
const KINDS = [
  { title: "fear", lines: [["fear", "fear", "ink"]], range: [0, 1], digits: 2 },
  { title: "speed m/s", lines: [["speed", "speed", "ink"], ["cap", "at most", "dim"]], low: 0, least: 2, digits: 1 },
  { title: "lateral error m", lines: [["error", "error", "ink"]], around: 0.25, digits: 2 },
  { title: "confidence", lines: null, range: [0, 1], digits: 2 },
  { title: "frame to actuator ms", lines: [["latency", "median", "ink"]], low: 0, least: 20, digits: 1 },
];
const KNOWN = ["t_s", "fear", "speed", "cap", "error", "latency"];

export class Timelines {
  constructor() {
    this.place = document.getElementById("timelines");
    this.clear();
    this.charts = null;
    onScheme(() => this.build());
    new ResizeObserver(() => this.charts?.forEach(({ plot, box }) => plot.setSize({ width: Math.max(box.clientWidth, 60), height: HEIGHT }))).observe(this.place);
  }

  clear() { this.rows = []; }

  add(names, samples, now) {
    if (!this.names || this.names.join() !== names.join()) {
      this.names = names;
      this.build();
    }
    if (!samples.length) return;
    this.rows.push(...samples);
    while (this.rows.length && this.rows[0][0] < now - SPAN_S) this.rows.shift();
    this.draw();
  }

  build() {
    if (!this.names) return;
    this.charts?.forEach(({ plot }) => plot.destroy());
    this.place.replaceChildren();
    this.charts = KINDS.map((kind, at) => this.chart(kind, at === KINDS.length - 1));
    this.draw();
  }

  chart(kind, last) {
    const estimators = this.names.filter(name => !KNOWN.includes(name));
    const lines = kind.lines ?? estimators.map((name, at) => [name, name, ["cv", "cnn"].includes(name) ? name : ["path", "lead"][at % 2]]);
    const row = document.createElement("div"), names = document.createElement("div"), box = document.createElement("div");
    row.className = "line";
    names.className = "names";
    box.className = "chart";
    names.append(kind.title);
    const values = lines.map(([id, label, ink]) => {
      const entry = document.createElement("div"), dot = document.createElement("span"), value = document.createElement("b");
      dot.className = "dot";
      dot.style.color = colour(ink);
      value.id = `now-${id}`;
      entry.append(dot, value, lines.length > 1 ? ` ${label}` : "");
      names.append(entry);
      return value;
    });
    row.append(names, box);
    this.place.append(row);
    box.setAttribute("role", "img");
    const axis = { stroke: () => colour("dim"), grid: { stroke: () => colour("soft"), width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif" };
    const range = kind.range ? () => kind.range : (_, low, high) => reach(kind, low, high);
    const plot = new uPlot({
      width: Math.max(box.clientWidth, 60), height: HEIGHT, cursor: { show: false }, legend: { show: false },
      padding: [8, 8, last ? 0 : 8, 0],
      scales: { x: { time: false, range: () => [-SPAN_S, 0] }, y: { range } },
      axes: [
        { ...axis, show: last, size: 22, gap: 2, values: (_, ticks) => ticks.map(t => `${t} s`) },
        { ...axis, size: 38, gap: 4, splits: (u, _, low, high) => [low, (low + high) / 2, high], values: (_, ticks) => ticks.map(t => String(+t.toFixed(2))) },
      ],
      series: [{}, ...lines.map(([id, , ink]) => ({ stroke: () => colour(ink), width: 1.75, dash: id === "cap" ? [5, 4] : undefined, points: { show: false }, spanGaps: false }))],
    }, [[], ...lines.map(() => [])], box);
    return { kind, plot, box, values, columns: lines.map(([id]) => this.names.indexOf(id)) };
  }

  draw() {
    if (!this.charts || !this.rows.length) return;
    const newest = this.rows.at(-1)[0], times = this.rows.map(row => row[0] - newest);
    for (const { kind, plot, box, values, columns } of this.charts) {
      plot.setData([times, ...columns.map(column => this.rows.map(row => row[column]))]);
      const shown = columns.map(column => this.rows.at(-1)[column]).map(value => (value === null ? "–" : value.toFixed(kind.digits)));
      shown.forEach((text, at) => values[at].textContent !== text && (values[at].textContent = text));
      box.setAttribute("aria-label", `${kind.title} over the last ${SPAN_S} seconds; now ${shown.join(", ")}`);
    }
  }
}

function reach(kind, low, high) {
  if (kind.around) {
    const most = nice(Math.max(kind.around, Math.abs(low ?? 0), Math.abs(high ?? 0)));
    return [-most, most];
  }
  return [kind.low, nice(Math.max(kind.least, high ?? 0))];
}

function nice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10].map(n => n * power).find(n => n >= value * 0.999);
}
