// The picture with the lane of each estimator, the fused path and the vehicle ahead.
import { fitted } from "./colours.js";
import { number } from "./panels.js";

// On a picture, whatever the scheme of the page: light lines with a dark edge.
const COLOURS = { cv: "#4aaef5", cnn: "#ff6fb3", other: "#d8d8d8", path: "#38cbe8", lead: "#cf8cf5", people: "#ffffff", edge: "rgba(0,0,0,.6)" };
const DASHES = { cv: [], cnn: [9, 6], other: [2, 5] };

const OLD_S = 1;

export class Camera {
  constructor() {
    this.canvas = document.getElementById("camera");
    this.legend = document.getElementById("legend");
    this.picture = document.getElementById("picture");
    this.old = document.getElementById("old");
    this.named = new Map();
    this.told = -Infinity;
    this.shown = null;
    setInterval(() => this.age(), 250);
  }

  // A picture that stands still must not look like the present.
  age() {
    if (this.shown === null) return;
    const seconds = (performance.now() - this.shown) / 1000, old = seconds > OLD_S;
    this.picture.dataset.old = String(old);
    const text = old ? `no new picture for ${seconds.toFixed(0)} s` : "";
    if (this.old.textContent !== text) this.old.textContent = text;
  }

  show(picture, drawn, state) {
    this.canvas.style.aspectRatio = `${drawn.width} / ${drawn.height}`;
    const context = fitted(this.canvas);
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    context.imageSmoothingQuality = "high";
    context.drawImage(picture, 0, 0, width, height);
    context.save();
    context.scale(width / drawn.width, height / drawn.height);
    const unit = drawn.width / width; // a pixel of the page in pixels of the picture
    if (drawn.path) this.path(context, drawn.path, unit);
    for (const [name, lane] of Object.entries(drawn.lanes)) {
      this.line(context, lane.left, name, unit, lane.confidence);
      this.line(context, lane.right, name, unit, lane.confidence);
    }
    if (drawn.lead) this.box(context, drawn.lead, unit, COLOURS.lead, state.lead ? `${number(state.lead.distance, 0)} m` : "");
    for (const { kind, distance, box } of drawn.people ?? []) this.box(context, box, unit, COLOURS.people, `${kind} ${number(distance, 0)} m`);
    context.restore();
    this.shown = performance.now();
    this.age();
    this.tell(drawn, state);
  }

  path(context, outline, unit) {
    context.beginPath();
    outline.forEach(([x, y], at) => (at ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.closePath();
    context.globalAlpha = 0.55;
    context.fillStyle = COLOURS.path;
    context.fill();
    context.globalAlpha = 1;
    context.lineWidth = unit;
    context.strokeStyle = COLOURS.edge;
    context.stroke();
  }

  line(context, points, name, unit, confidence) {
    if (points.length < 2) return;
    const style = name in DASHES ? name : "other";
    context.beginPath();
    points.forEach(([x, y], at) => (at ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.lineJoin = "round";
    context.globalAlpha = 0.35 + 0.65 * confidence;
    context.setLineDash([]);
    context.lineWidth = 5 * unit;
    context.strokeStyle = COLOURS.edge;
    context.stroke();
    context.setLineDash(DASHES[style].map(length => length * unit));
    context.lineWidth = 2.5 * unit;
    context.strokeStyle = COLOURS[style];
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  box(context, [left, top, right, bottom], unit, colour, text) {
    context.strokeStyle = COLOURS.edge;
    context.lineWidth = 5 * unit;
    context.strokeRect(left, top, right - left, bottom - top);
    context.strokeStyle = colour;
    context.lineWidth = 2.5 * unit;
    context.strokeRect(left, top, right - left, bottom - top);
    if (!text) return;
    context.font = `600 ${13 * unit}px system-ui, sans-serif`;
    context.lineWidth = 4 * unit;
    context.strokeStyle = "rgba(0,0,0,.8)";
    context.strokeText(text, left, top - 5 * unit);
    context.fillStyle = "#fff";
    context.fillText(text, left, top - 5 * unit);
  }

  // Without a connection nothing is known of the present.
  nothing() {
    for (const value of this.named.values()) if (value.textContent !== "–") value.textContent = "–";
    document.getElementById("source").textContent = "–";
  }

  // The legend: a line for each estimator, with its confidence now.
  names(state) {
    for (const [name, estimate] of Object.entries(state.estimates)) {
      const text = estimate === null ? "none" : number(estimate.confidence, 2);
      entry(this.named, this.legend, name, name in DASHES ? name : "other", `${name} `, text);
    }
    if (state.lead || this.named.has("lead")) {
      const text = state.lead ? `${number(state.lead.distance, 1)} m` : "none";
      entry(this.named, this.legend, "lead", "lead", "vehicle ahead ", text);
    }
  }

  tell(drawn, state) {
    if (performance.now() - this.told < 2000) return; // a screen reader needs no text at every picture
    this.told = performance.now();
    const lanes = Object.entries(state.estimates).map(([name, one]) => `${name} ${one ? `confidence ${number(one.confidence, 2)}` : "no estimate"}`);
    const path = drawn.path ? `path from ${state.decision?.source ?? "none"}` : "no path";
    const lead = state.lead ? `, vehicle ahead at ${number(state.lead.distance, 0)} metres` : "";
    const people = (drawn.people ?? []).map(one => `, ${one.kind} at ${number(one.distance, 0)} metres`).join("");
    this.canvas.setAttribute("aria-label", `Camera picture; ${lanes.join(", ")}; ${path}${lead}${people}`);
  }
}

function entry(known, list, id, style, label, text) {
  if (!known.has(id)) {
    const item = document.createElement("li"), swatch = document.createElement("span"), value = document.createElement("b");
    swatch.className = `swatch ${style}`;
    value.id = `legend-${id}`;
    item.append(swatch, label, value);
    list.append(item);
    known.set(id, value);
  }
  const value = known.get(id);
  if (value.textContent !== text) value.textContent = text;
}
