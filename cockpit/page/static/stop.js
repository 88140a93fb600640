// The stop button. One press stops; to drive on takes two, at standstill. Escape anywhere is a press.
const ANSWER_MS = 1000, RETRY_MS = 300, ARMED_MS = 4000;
const UNDELIVERED = "The car does NOT confirm the stop; it is sent again and again. Use the switch in the car.";
const element = id => document.getElementById(id);

export class StopButton {
  constructor(ask) {
    this.ask = ask;
    this.wanted = false; // pressed here, and not answered by the page process yet
    this.failure = ""; // of the last request
    this.undelivered = false;
    this.armed = -Infinity;
    element("stop").addEventListener("click", () => this.press());
    element("release").addEventListener("click", () => this.release());
    document.addEventListener("keydown", event => event.key === "Escape" && !event.repeat && this.press());
  }

  async press() {
    if (this.wanted || element("stop").disabled) return;
    this.wanted = true;
    element("stop-word").textContent = "stopping";
    while (this.wanted && !element("stop").disabled) {
      try {
        await this.ask("/stop", { stop: true }, ANSWER_MS);
        this.wanted = false;
        this.failed("");
      } catch (error) {
        this.failed(`The stop is NOT delivered (${error.message}); trying again. Use the switch in the car.`);
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
    await this.ask("/stop", { stop: false }, ANSWER_MS).then(() => this.failed(""), error => this.failed(`Not released: ${error.message}`));
  }

  // No connection: a press is tried again and again. After the end of a drive there is no car to stop.
  nothing(ended) {
    element("stop").disabled = ended;
    element("release").hidden = true;
    if (!ended) return;
    this.wanted = this.undelivered = false;
    this.failed("");
    element("stop-word").textContent = "STOP";
  }

  show(state) {
    element("stop").disabled = false;
    this.undelivered = state.stop_undelivered;
    this.alarm();
    const word = state.held ? "STOPPED" : state.stopping || this.wanted ? "stopping" : "STOP";
    if (element("stop-word").textContent !== word) element("stop-word").textContent = word;
    element("release").hidden = !(state.held && state.stands);
  }

  failed(why) {
    this.failure = why;
    this.alarm();
  }

  alarm() {
    const text = this.failure || (this.undelivered ? UNDELIVERED : "");
    if (element("alarm").textContent !== text) element("alarm").textContent = text;
    element("alarm").hidden = !text;
  }
}
