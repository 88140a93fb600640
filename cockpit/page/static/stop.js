// The stop button. One press stops; to drive on takes two, at standstill. Escape anywhere is a press.
const RETRY_MS = 300, ARMED_MS = 4000, STANDS_MPS = 0.1;
const element = id => document.getElementById(id);

export class StopButton {
  constructor(ask) {
    this.ask = ask;
    this.wanted = false; // pressed here, and not delivered yet
    this.armed = -Infinity;
    element("stop").addEventListener("click", () => this.press());
    element("release").addEventListener("click", () => this.release());
    document.addEventListener("keydown", event => event.key === "Escape" && !event.repeat && this.press());
  }

  async press() {
    if (this.wanted) return;
    this.wanted = true;
    element("stop-word").textContent = "stopping";
    while (this.wanted) {
      try {
        await this.ask("/stop", { stop: true });
        this.wanted = false;
        this.alarm("");
      } catch (error) {
        this.alarm(`The stop is NOT delivered (${error.message}); trying again. Use the switch in the car.`);
        await new Promise(done => setTimeout(done, RETRY_MS));
      }
    }
  }

  async release() {
    const button = element("release");
    if (performance.now() - this.armed > ARMED_MS) {
      this.armed = performance.now();
      button.textContent = "Press again to drive on";
      setTimeout(() => (button.textContent = "Drive on"), ARMED_MS);
      return;
    }
    this.armed = -Infinity;
    button.textContent = "Drive on";
    await this.ask("/stop", { stop: false }).catch(error => this.alarm(`Not released: ${error.message}`));
  }

  show(state) {
    const word = state.held ? "STOPPED" : state.stopping || this.wanted ? "stopping" : "STOP";
    if (element("stop-word").textContent !== word) element("stop-word").textContent = word;
    element("release").hidden = !(state.held && state.speed !== null && Math.abs(state.speed) < STANDS_MPS);
  }

  alarm(text) {
    element("alarm").textContent = text;
    element("alarm").hidden = !text;
  }
}
