// One cursor and one zoom over all charts; values, the frame and the place at the cursor.
const data = JSON.parse(document.getElementById("curves").textContent);
const { span, time, charts, thumbs, path } = data;
const plots = [...document.querySelectorAll(".plot[tabindex]")];
const [peek, all] = ["peek", "all"].map((id) => document.getElementById(id));
const full = [0, span || 1];
let view = full, at = null, drag = null;

function nearest(times, seconds) {
  let low = 0, high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] < seconds) low = middle; else high = middle;
  }
  return seconds - times[low] < times[high] - seconds ? low : high;
}

function clock(seconds, step) {
  if (span < 120) return `${+seconds.toFixed(step < 1 ? 2 : 0)} s`;
  const minutes = Math.floor(seconds / 60), rest = seconds - 60 * minutes;
  return `${minutes}:${rest.toFixed(step < 1 ? 1 : 0).padStart(step < 1 ? 4 : 2, "0")}`;
}

function niceStep(rough) {
  const decade = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((m) => m * decade).find((step) => step >= rough * (1 - 1e-9));
}

const part = (seconds) => (seconds - view[0]) / (view[1] - view[0]);

function zoom(from, to) {
  const width = Math.min(Math.max(to - from, Math.min(full[1], 0.2)), full[1]);
  const start = Math.min(Math.max(from, 0), full[1] - width);
  view = [start, start + width];
  all.hidden = width > full[1] * 0.999;
  const step = niceStep(width / 7);
  for (const plot of plots) {
    const svg = plot.querySelector("svg"), height = svg.viewBox.baseVal.height;
    svg.setAttribute("viewBox", `${1000 * start / full[1]} 0 ${1000 * width / full[1]} ${height}`);
    if (!plot.querySelector(".x")) continue;
    plot.querySelectorAll(".x").forEach((label) => label.remove());
    for (let k = Math.ceil(start / step); k * step <= view[1] + 1e-9; k += 1) {
      const label = document.createElement("span");
      label.className = "x";
      label.textContent = clock(k * step, step);
      label.style.left = `${100 * part(k * step)}%`;
      plot.append(label);
    }
  }
  show(at, null);
}

function text(curve, index) {
  const value = curve.values[index];
  if (value === null) return `${curve.name} –`;
  const sigma = curve.sigma && curve.sigma[index] !== null ? ` ± ${curve.sigma[index]}` : "";
  return `${curve.name} ${value}${sigma}`;
}

function show(index, pointer) {
  at = index;
  for (const plot of plots) {
    const cursor = plot.querySelector(".cursor"), x = index === null ? -1 : part(time[index]);
    cursor.style.display = x < 0 || x > 1 ? "none" : "block";
    cursor.style.left = `${100 * x}%`;
    const output = plot.parentElement.querySelector("output");
    if (!output) continue;
    const curves = charts[output.dataset.chart];
    output.value = index === null ? "" :
      `${time[index]} s: ` + curves.map((curve) => text(curve, index)).join(", ");
  }
  const here = document.querySelector(".here");
  if (here && path[0].length) {
    const k = index === null ? -1 : nearest(path[0], time[index]);
    here.setAttribute("d", k < 0 ? "" : `M${path[1][k]} ${-path[2][k]}h0`);
  }
  glance(index, pointer);
}

// The frame beside the cursor: the film's picture nearest in time.
function glance(index, pointer) {
  peek.hidden = index === null || pointer === null || !thumbs.length;
  if (peek.hidden) return;
  const [seconds, source] = thumbs[nearest(thumbs.map((thumb) => thumb[0]), time[index])];
  if (peek.dataset.time !== String(seconds)) {
    peek.dataset.time = seconds;
    const picture = new Image(), words = document.createElement("span");
    picture.src = source;
    picture.alt = "";
    words.textContent = `frame at ${seconds} s`;
    peek.replaceChildren(picture, words);
  }
  const room = document.documentElement.clientWidth, width = Math.min(360, room - 24);
  peek.style.width = `${width}px`;
  peek.style.left = `${Math.max(12, Math.min(pointer.x + 16, room - width - 12))}px`;
  const above = pointer.y > window.innerHeight / 2;
  peek.style.top = above ? "" : `${pointer.y + 24}px`;
  peek.style.bottom = above ? `${window.innerHeight - pointer.y + 24}px` : "";
}

function secondsAt(plot, clientX) {
  const box = plot.getBoundingClientRect();
  const x = Math.min(Math.max((clientX - box.left) / box.width, 0), 1);
  return view[0] + x * (view[1] - view[0]);
}

function onKey(event, plot) {
  const middle = at === null ? (view[0] + view[1]) / 2 : time[at];
  const width = view[1] - view[0], index = at === null ? nearest(time, middle) : at;
  const moves = { ArrowRight: 1, ArrowLeft: -1, PageDown: 10, PageUp: -10 };
  const last = time.length - 1;
  if (event.key in moves) at = Math.min(Math.max(index + moves[event.key], 0), last);
  else if (event.key === "Home") at = nearest(time, view[0]);
  else if (event.key === "End") at = nearest(time, view[1]);
  else if (event.key === "+" || event.key === "=") zoom(middle - width / 4, middle + width / 4);
  else if (event.key === "-") zoom(middle - width, middle + width);
  else if (event.key === "Escape") { at = null; zoom(...full); }
  else return;
  event.preventDefault();
  if (at !== null && (time[at] < view[0] || time[at] > view[1])) {
    zoom(time[at] - width / 2, time[at] + width / 2);
  }
  const box = plot.getBoundingClientRect();
  show(at, at === null ? null : { x: box.left + part(time[at]) * box.width, y: box.bottom });
}

for (const plot of plots) {
  const output = plot.parentElement.querySelector("output");
  const mark = document.createElement("i");
  mark.className = "chosen";
  plot.append(mark);
  plot.addEventListener("pointermove", (event) => {
    const seconds = secondsAt(plot, event.clientX);
    show(nearest(time, seconds), { x: event.clientX, y: event.clientY });
    if (drag === null) return;
    const [from, to] = [part(drag), part(seconds)].sort((a, b) => a - b);
    mark.style.cssText = `display:block;left:${100 * from}%;width:${100 * (to - from)}%`;
  });
  plot.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "mouse" && event.button === 0) drag = secondsAt(plot, event.clientX);
    show(nearest(time, secondsAt(plot, event.clientX)), { x: event.clientX, y: event.clientY });
  });
  plot.addEventListener("pointerup", (event) => {
    mark.style.display = "none";
    if (drag === null) return;
    const [from, to] = [drag, secondsAt(plot, event.clientX)].sort((a, b) => a - b);
    drag = null;
    if (part(to) - part(from) > 0.02) zoom(from, to);
  });
  plot.addEventListener("pointerleave", () => {
    mark.style.display = "none";
    drag = null;
    show(null, null);
  });
  plot.addEventListener("dblclick", () => zoom(...full));
  plot.addEventListener("keydown", (event) => onKey(event, plot));
  // A screen reader speaks the values of the chart that has the focus, not of all of them.
  plot.addEventListener("focus", () => output && output.setAttribute("aria-live", "polite"));
  plot.addEventListener("blur", () => {
    if (output) output.setAttribute("aria-live", "off");
    show(null, null);
  });
}
all.addEventListener("click", () => zoom(...full));
