// Colours of the style sheet, for canvases; they change with the scheme of the system.
const scheme = matchMedia("(prefers-color-scheme: dark)");
let cache = new Map();
const listeners = [];
scheme.addEventListener("change", () => {
  cache = new Map();
  listeners.forEach(listen => listen());
});

export function colour(name) {
  if (!cache.has(name)) cache.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return cache.get(name);
}
export function onScheme(listen) { listeners.push(listen); }
export function risk(fear) { return colour(`risk${1 + Math.min(4, Math.floor(5 * fear))}`); }

// The canvas at the resolution of the screen; its context in CSS pixels.
export function fitted(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return context;
}
