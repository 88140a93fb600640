// The live page: one stream of state in, drawn, acknowledged. No queue: the server sends the next when this is drawn.
import { Camera } from "./camera.js";
import { Path } from "./path.js";
import { Timelines } from "./timelines.js";
import { Panels } from "./panels.js";
import { Rules } from "./rules.js";
import { StopButton } from "./stop.js";
import { KeepButton } from "./keep.js";
import { LineWarning } from "./warning.js";
import { tabs } from "./tabs.js";

const WRONG_TOKEN = 4401, WRONG_ORIGIN = 4403, TOO_MANY = 4429, ENDED = 4410;
const SILENT_MS = 1500, FIRST_RETRY_MS = 250, LAST_RETRY_MS = 2000, NOTICE_MS = 60000;
const BRIEF_S = 1; // a shorter loss of the connection needs no notice
const element = id => document.getElementById(id);

function token() {
  const given = location.hash.slice(1);
  try {
    if (given) localStorage.setItem("token", given);
    if (given) history.replaceState(null, "", location.pathname); // the address bar is seen by others
    return given || localStorage.getItem("token") || "";
  } catch {
    return given; // storage is forbidden: the token lives as long as the page
  }
}

const key = token();
async function ask(path, body, patience_ms) {
  const headers = { authorization: `Bearer ${key}` };
  const options = body === undefined ? { headers } : { headers, method: "POST", body: JSON.stringify(body) };
  if (patience_ms) options.signal = AbortSignal.timeout(patience_ms);
  const answer = await fetch(path, options);
  const found = await answer.json();
  if (!answer.ok) throw new Error(found.error ?? answer.statusText);
  return found;
}

const camera = new Camera(), path = new Path(), timelines = new Timelines(), panels = new Panels();
const rules = new Rules(ask), stop = new StopButton(ask), keep = new KeepButton(ask), warning = new LineWarning();
const glass = []; // from capture to picture on the glass [ms], where the clocks are one
window.trepid = { glass, messages: 0, firstPicture: null };
tabs(shown => shown === "rules" && rules.open());

let retry = FIRST_RETRY_MS, heard = 0, refused = "", drive = null, lost = 0, driven = 0, ended = "";

function connection(text, well) {
  const shown = element("connection");
  if (shown.textContent !== text) shown.textContent = text;
  shown.dataset.well = String(well);
}

function notice(text) {
  element("notice").textContent = text;
  element("notice").hidden = !text;
  clearTimeout(notice.timer);
  if (text) notice.timer = setTimeout(() => notice(""), NOTICE_MS);
}

function found(state) {
  const clock = new Date().toLocaleTimeString([], { hour12: false }), gone_s = (performance.now() - lost) / 1000;
  if (drive !== null && drive !== state.drive) notice(`New drive: ${state.what}, since ${clock}. The values of the drive before are gone.`);
  else if (lost && gone_s >= BRIEF_S) notice(`Connected again at ${clock}, after ${gone_s.toFixed(0)} s.`);
  drive = state.drive;
  lost = 0;
}

function lose(text) {
  if (drive !== null) lost ||= performance.now();
  connection(ended ? "drive ended" : text, false);
  if (ended) panels.nothing(ended, "ENDED");
  else panels.nothing(text);
  camera.nothing();
  warning.nothing();
  stop.nothing(Boolean(ended));
}

function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0);
  const state = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { state, jpeg: new Uint8Array(buffer, 4 + length) };
}

async function receive(socket, buffer) {
  heard = performance.now();
  retry = FIRST_RETRY_MS;
  window.trepid.messages += 1;
  const { state, jpeg } = unpack(buffer);
  const picture = jpeg.length ? await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })).catch(() => null) : null;
  requestAnimationFrame(() => {
    if (socket.readyState !== WebSocket.OPEN) return; // what closed it is newer than this state
    try {
      draw(state, picture);
    } catch (error) { // half of the values may be old ones
      lose(`this page fails, reload it: ${error.message}`);
      throw error;
    } finally { // the server waits for it
      socket.send("drawn");
    }
  });
}

function draw(state, picture) {
  connection("live", true);
  driven = state.driven;
  ended = "";
  if (lost || drive !== state.drive) found(state);
  panels.show(state);
  stop.show(state);
  keep.show(state);
  warning.show(state.decision);
  path.add(state.track, state);
  timelines.add(state.series, state.samples, state.now);
  rules.show(state.decision?.inputs);
  camera.names(state);
  if (!picture) return;
  camera.show(picture, state.picture, state);
  picture.close();
  glass.push(Date.now() - 1000 * state.picture.t);
  if (glass.length > 3000) glass.shift();
  window.trepid.firstPicture ??= performance.now();
}

function connect() {
  const socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/stream`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    timelines.clear(); // the server sends them from the beginning
    path.clear();
    heard = performance.now();
    socket.send(JSON.stringify({ token: key }));
  };
  socket.onmessage = event => receive(socket, event.data);
  socket.onclose = ({ code, reason }) => {
    if (code === WRONG_TOKEN || code === WRONG_ORIGIN) {
      refused = "wrong token: open the address that trepid drive, or trepid status, prints";
      lose(refused);
      return;
    }
    if (code === ENDED) ended = `drive ended at ${new Date().toLocaleTimeString([], { hour12: false })}, after ${driven.toFixed(0)} m${reason ? `: ${reason}` : ""}; start the next with trepid drive`;
    lose(code === TOO_MANY ? "too many viewers" : "no connection to the drive");
    setTimeout(connect, retry);
    retry = Math.min(2 * retry, LAST_RETRY_MS);
  };
}

setInterval(() => {
  const silent = performance.now() - heard;
  if (!refused && heard && silent > SILENT_MS && !document.hidden) lose(`no news for ${(silent / 1000).toFixed(0)} s`);
}, 500);
connect();
