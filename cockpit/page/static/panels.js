// Banner, figures, dial, rules that fire, and the table of processes.
const SVG = "http://www.w3.org/2000/svg";
const element = id => document.getElementById(id);

function put(id, text) {
  const node = typeof id === "string" ? element(id) : id;
  if (node.textContent !== text) node.textContent = text;
}
export const number = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));
const words = text => text.replaceAll("_", " ");

export class Panels {
  constructor() {
    this.rows = new Map();
    this.said = "";
    for (let at = 0; at <= 5; at++) this.tick(at / 5);
  }

  tick(share) {
    const angle = Math.PI * (1 - share), line = document.createElementNS(SVG, "line"), text = document.createElementNS(SVG, "text");
    const place = radius => [110 + radius * Math.cos(angle), 116 - radius * Math.sin(angle)];
    const [x1, y1] = place(99.5), [x2, y2] = place(104), [x, y] = place(112);
    for (const [name, value] of Object.entries({ x1, y1, x2, y2 })) line.setAttribute(name, value.toFixed(1));
    text.setAttribute("x", x.toFixed(1));
    text.setAttribute("y", (y + 3).toFixed(1));
    text.textContent = share.toFixed(1);
    element("ticks").append(line, text);
  }

  nothing(why, word = "NO DATA") {
    this.mode("NONE", word, why, word === "NO DATA" ? "watch the car itself" : "");
    this.fear(null);
    for (const id of ["speed", "cap", "sight"]) put(id, "–");
    put("sight-cause", "");
    put("says", "");
    this.firing([]);
    for (const cells of this.rows.values()) {
      for (const cell of cells.slice(1)) put(cell, "–");
      cells[0].parentNode.classList.remove("ill");
    }
  }

  show(state) {
    const decision = state.decision;
    put("what", state.what);
    put("says", state.says);
    put("speed", number(state.speed, 1));
    put("cap", number(decision?.cap, 1));
    put("sight", number(decision?.sight, 0));
    put("sight-cause", words(decision?.sight_cause ?? ""));
    put("driven", number(state.driven, 0));
    put("source", decision?.source ?? "none");
    const halt = state.stands ? "STOPPED" : "STOP";
    if (state.stops || (state.stopping && !state.stop_undelivered)) this.mode("STOP", halt, state.stops ? state.because : "stop button pressed", state.stops ? state.task : "");
    else if (state.waits) this.mode("NONE", "WAITING", state.waits, "keep clear: it starts by itself");
    else if (!decision) this.mode("NONE", "NO DATA", "no decision of the supervisor", state.task);
    else this.mode(decision.mode, decision.mode === "STOP" ? halt : decision.mode, state.because, state.task);
    this.fear(decision);
    this.firing(decision?.rules ?? []);
    this.processes(state.processes);
  }

  mode(kind, word, because, task) {
    element("banner").dataset.mode = kind;
    put("mode", word);
    put("because", because);
    put("task", task);
    const said = kind === "NONE" ? `${word}: ${because}` : `Mode ${word}. ${because}`;
    const headline = kind === "NONE" ? "none" : word;
    if (headline !== this.said) put("announce", said); // a change of mode is spoken, not every number
    this.said = headline;
    document.title = `${word} – Trepid`;
  }

  fear(decision) {
    const dial = element("dial"), value = decision ? decision.fear : null;
    put("fear", number(value, 2));
    put("fear-now", number(value, 2));
    put("fear-level", decision ? words(decision.level) : "");
    element("fear-figure").dataset.level = decision?.level ?? "";
    put("level", decision ? words(decision.level) : "not known");
    put("cause", decision ? cause(decision) : "");
    dial.dataset.level = decision?.level ?? "";
    dial.setAttribute("aria-valuenow", number(value ?? 0, 2));
    dial.setAttribute("aria-valuetext", decision ? `${number(value, 2)}, ${words(decision.level)}, ${cause(decision)}` : "not known");
    element("arc").style.strokeDasharray = `${100 * (value ?? 0)} 100`;
  }

  firing(rules) {
    const list = element("firing");
    while (list.children.length > rules.length) list.lastChild.remove();
    rules.forEach(([text, strength], at) => {
      const item = list.children[at] ?? list.appendChild(rule());
      put(item.querySelector(".text"), words(text));
      put(item.querySelector(".strength"), number(strength, 2));
      item.querySelector("i").style.width = `${100 * strength}%`;
    });
  }

  processes(rows) {
    const body = document.querySelector("#processes tbody");
    if (rows.map(row => row.name).join() !== [...this.rows.keys()].join()) {
      this.rows = new Map(rows.map(row => [row.name, line(row.name)]));
      body.replaceChildren(...[...this.rows.values()].map(cells => cells[0].parentNode));
    }
    for (const row of rows) {
      const cells = this.rows.get(row.name);
      const texts = [number(row.rate_hz, 1), number(row.age_s, 1), number(row.cpu_percent, 1), String(row.restarts)];
      texts.forEach((text, at) => put(cells[at + 1], text));
      put(cells[5], row.alive ? row.message : `not running${row.message ? `: ${row.message}` : ""}`);
      cells[0].parentNode.classList.toggle("ill", !row.well);
    }
  }
}

function cause(decision) {
  return decision.cause === "none" ? "no rule raises it" : decision.cause_words;
}

function rule() {
  const item = document.createElement("li"), strength = document.createElement("span"), text = document.createElement("span");
  const bar = document.createElement("span"), filled = document.createElement("i");
  strength.className = "strength";
  text.className = "text";
  bar.className = "bar";
  bar.setAttribute("aria-hidden", "true");
  bar.append(filled);
  item.append(strength, text, bar);
  return item;
}

function line(name) {
  const row = document.createElement("tr"), head = document.createElement("th");
  head.scope = "row";
  head.textContent = name;
  row.append(head, ...Array.from({ length: 5 }, () => document.createElement("td")));
  return [...row.children];
}
