// The warning before a wheel leaves the lane: words and a bar on that side of the picture, and a sound that a press allows.
const TONE_HZ = { left: 740, right: 880 }, BEEP_S = 0.16, EVERY_MS = 500, LOUD = 0.3;
const element = id => document.getElementById(id);

export class LineWarning {
  constructor() {
    this.side = "";
    this.context = null; // a browser gives sound only after a press
    this.on = false;
    element("sound").addEventListener("click", () => this.toggle());
    this.tell();
  }

  async toggle() {
    this.on = !this.on;
    if (this.on) {
      try {
        this.context ??= new AudioContext();
        await this.context.resume();
        this.beep("left");
      } catch {
        this.on = false;
      }
    }
    this.tell(this.on && this.context.state !== "running" ? "not allowed by this browser" : "");
  }

  tell(why = "") {
    element("sound").setAttribute("aria-pressed", String(this.on));
    element("sound-state").textContent = why || (this.on ? "on" : "off");
  }

  beep(side) {
    if (!this.on || this.context.state !== "running") return;
    const tone = this.context.createOscillator(), level = this.context.createGain(), from = this.context.currentTime;
    const pan = this.context.createStereoPanner();
    tone.frequency.value = TONE_HZ[side];
    pan.pan.value = side === "left" ? -0.8 : 0.8;
    level.gain.setValueAtTime(LOUD, from);
    level.gain.linearRampToValueAtTime(0, from + BEEP_S);
    tone.connect(level).connect(pan).connect(this.context.destination);
    tone.start(from);
    tone.stop(from + BEEP_S);
  }

  show(decision) {
    const side = decision?.line_warning ?? "";
    if (side === this.side) return;
    this.side = side;
    element("picture").dataset.line = side;
    element("line").textContent = decision?.line_words ?? "";
    element("line").hidden = !side;
    clearInterval(this.timer);
    if (!side) return;
    this.beep(side);
    this.timer = setInterval(() => this.beep(side), EVERY_MS);
  }

  nothing() { this.show(null); }
}
