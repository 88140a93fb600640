// The driven path from above, coloured by fear; north is up where the simulator gives the pose, else the first heading is right.
import { colour, fitted, onScheme, risk } from "./colours.js";

const MARGIN = 26, LEAST_M = 20, NICE = [1, 2, 5];

export class Path {
  constructor() {
    this.canvas = document.getElementById("map");
    this.note = document.getElementById("map-note");
    this.clear();
    onScheme(() => this.draw());
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  clear() {
    this.points = [];
    this.pose = null;
  }

  add(track, state) {
    if (track.anew) this.points = [];
    this.points.push(...track.points);
    const moved = track.points.length || !this.pose || !state.pose || Math.hypot(state.pose[0] - this.pose[0], state.pose[1] - this.pose[1]) > 0.3;
    if (!moved) return;
    this.pose = state.pose;
    this.true = state.true_error;
    this.driven = state.driven;
    this.draw();
  }

  draw() {
    const context = fitted(this.canvas), width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    context.clearRect(0, 0, width, height);
    if (!this.points.length) return;
    const xs = this.points.map(p => p[0]), ys = this.points.map(p => p[1]);
    const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const scale = Math.min((width - 2 * MARGIN) / Math.max(right - left, LEAST_M), (height - 2 * MARGIN) / Math.max(high - low, LEAST_M));
    const at = ([x, y]) => [width / 2 + scale * (x - (left + right) / 2), height / 2 - scale * (y - (low + high) / 2)];
    context.lineCap = context.lineJoin = "round";
    for (const [edge, thickness] of [[true, 6], [false, 3.5]]) {
      context.lineWidth = thickness;
      for (let i = 1; i < this.points.length; i++) {
        const fear = this.points[i][2];
        context.strokeStyle = edge ? colour("line") : fear === null ? colour("dim") : risk(fear);
        context.beginPath();
        context.moveTo(...at(this.points[i - 1]));
        context.lineTo(...at(this.points[i]));
        context.stroke();
      }
    }
    if (this.pose) this.car(context, at(this.pose), this.pose[2]);
    this.bar(context, scale, height);
    const how = this.true ? "the true path in the simulator" : "by speed and yaw rate";
    const text = `${how}, coloured by fear from green (none) over amber to red`;
    if (this.note.textContent !== text) this.note.textContent = text;
    this.canvas.setAttribute("aria-label", `Driven path of ${this.driven.toFixed(0)} metres, ${how}`);
  }

  car(context, [x, y], yaw) {
    context.save();
    context.translate(x, y);
    context.rotate(-yaw);
    context.beginPath();
    context.moveTo(11, 0);
    context.lineTo(-7, 7);
    context.lineTo(-3, 0);
    context.lineTo(-7, -7);
    context.closePath();
    context.fillStyle = colour("ink");
    context.strokeStyle = colour("card");
    context.lineWidth = 2;
    context.stroke();
    context.fill();
    context.restore();
  }

  bar(context, scale, height) {
    const wanted = 80 / scale, power = 10 ** Math.floor(Math.log10(wanted));
    const metres = power * NICE.filter(n => n * power <= wanted).at(-1);
    context.fillStyle = colour("dim");
    context.fillRect(10, height - 12, metres * scale, 3);
    context.font = "12px system-ui, sans-serif";
    context.fillText(`${metres} m`, 10, height - 18);
  }
}
