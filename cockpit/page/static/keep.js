// The record button: the last minutes become a recording that nothing deletes.
const element = id => document.getElementById(id);

export class KeepButton {
  constructor(ask) {
    this.ask = ask;
    this.busy = false;
    this.whyNot = null;
    element("keep").addEventListener("click", () => this.press());
  }

  async press() {
    if (this.busy) return;
    this.busy = true;
    element("keep").setAttribute("aria-disabled", "true");
    this.say("keeping the last minutes …");
    try {
      const { file } = await this.ask("/keep", {});
      this.say(`kept: ${file}`);
    } catch (error) {
      this.say(`not kept: ${error.message}`);
    }
    this.busy = false;
    element("keep").removeAttribute("aria-disabled");
  }

  show(state) {
    if (state.no_keep === this.whyNot) return;
    this.whyNot = state.no_keep; // another drive: its reason, or none
    element("keep").hidden = Boolean(state.no_keep);
    this.say(state.no_keep);
  }

  say(text) {
    if (element("kept").textContent !== text) element("kept").textContent = text;
  }
}
