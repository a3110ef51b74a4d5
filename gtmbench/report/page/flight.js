"use strict";
// The lines stand in the units of their data: to zoom is to move the window of every panel, and to name its axes anew.
const all = document.querySelector(".panels");
const begins = Number(all.dataset.start), whole = [Number(all.dataset.from), Number(all.dataset.to)];
const panels = [...all.querySelectorAll(".panel")].map((figure) => ({
  figure, svg: figure.querySelector("svg"), plot: figure.querySelector(".plot"), axis: figure.querySelector(".y"),
  said: figure.querySelector("output"), isLog: figure.dataset.log === "1", lines: null,
}));
let view = whole, cursor = null;
const hours = begins + whole[1] >= 3600, stepsS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400];
const [, date, zero, zone] = all.dataset.zero.match(/^(\S+ )?(\S+?)( UTC)?$/) ?? [];  // what the log's stamps read at 0 s

// A line's points, read from its path once.
function linesOf(panel) {
  panel.lines ??= [...panel.svg.querySelectorAll("path.line")].map((path) => {
    const times = [], values = [];
    for (const stroke of (path.getAttribute("d") ?? "").split("M").slice(1)) {
      for (const point of stroke.trim().split(" ")) {
        const [time, value] = point.split(",");
        times.push(Number(time)), values.push(Number(value));
      }
    }
    return { name: path.dataset.name, times, values };
  });
  return panel.lines;
}

// The first place whose time isn't before an instant.
function placeOf(times, time) {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] < time) low = middle + 1; else high = middle;
  }
  return low;
}

function roundValues([low, high], steps = []) {
  const apart = (high - low) / 3, unit = 10 ** Math.floor(Math.log10(apart));
  const step = steps.findLast((each) => each <= apart) ?? Math.max(...[1, 2, 5].map((each) => each * unit).filter((each) => each <= apart));
  const values = [];
  for (let count = Math.ceil(low / step - 1e-9); count * step <= high + 1e-9 * step; count++) values.push(Number((count * step).toPrecision(10)));
  return values;
}

function powers(low, high) {
  const values = [];
  for (let power = Math.ceil(low); power <= high; power++) values.push(power);
  return values;
}

function label(axis, side, values, [low, high], name) {
  axis.replaceChildren(...values.map((value) => {
    const tick = document.createElement("span");
    tick.style[side] = `${(100 * (value - low)) / (high - low)}%`;
    tick.textContent = name(value);
    return tick;
  }));
}

// A time as hours, minutes and seconds.
function inHours(time, digits) {
  const tenths = Math.round(Math.abs(time) * 10 ** digits), seconds = tenths / 10 ** digits;
  const rest = (seconds % 60).toFixed(digits).padStart(digits ? 3 + digits : 2, "0");
  return `${time < 0 && tenths ? "-" : ""}${Math.floor(seconds / 3600)}:${String(Math.floor(seconds / 60) % 60).padStart(2, "0")}:${rest}`;
}

// What stands beside seconds: the log's own stamp, else hours.
function beside(time) {
  if (!zero) return hours ? ` (${inHours(time, 0)})` : "";
  const at = new Date(Date.parse(`${(date ?? "1970-01-01 ").trim()}T${zero}Z`) + 1000 * time).toISOString();
  return ` (${at.slice(11, 21)}${zone ?? ""})`;
}

const short = (value) => String(Number(value.toPrecision(6)));

// The lines' reach within the view; the panel's own where it shows all, or holds nothing there.
function reach(panel) {
  let [low, high] = [Infinity, -Infinity];
  for (const { times, values } of linesOf(panel)) {
    for (let i = placeOf(times, view[0]); i < times.length && times[i] <= view[1]; i++) {
      if (values[i] < low) low = values[i];
      if (values[i] > high) high = values[i];
    }
  }
  if (panel.isLog) [low, high] = [Math.min(low, 0), Math.max(high, 0)];
  if (!(low <= high)) return [0, 1];
  const room = 0.06 * (high - low) || 0.5 * Math.abs(high) || 1;
  return [low - room, high + room];
}

function show(from, to) {
  const least = Math.max((whole[1] - whole[0]) * 1e-5, 0.02);
  const width = Math.min(Math.max(to - from, least), whole[1] - whole[0]);
  const start = Math.min(Math.max((from + to - width) / 2, whole[0]), whole[1] - width);
  view = [start, start + width];
  for (const panel of panels) {
    if (!panel.axis) {
      panel.svg.setAttribute("viewBox", `${view[0]} 0 ${width} 1`);
      continue;
    }
    const [low, high] = reach(panel);
    panel.svg.setAttribute("viewBox", `${view[0]} ${-high} ${width} ${high - low}`);
    const marks = panel.isLog ? powers(low, high) : roundValues([low, high]);
    label(panel.axis, "bottom", marks, [low, high], (value) => short(panel.isLog ? 10 ** value : value));
  }
  const clock = view.map((time) => time + begins);
  const named = (time) => (hours ? inHours(time, width < 3 ? 1 : 0) : String(Number(time.toPrecision(12))));
  label(all.querySelector(".x"), "left", roundValues(clock, hours ? stepsS : []), clock, named);
  point(cursor);
}

// Say what every line reads at an instant, and mark it.
function point(time) {
  cursor = time;
  for (const panel of panels) {
    panel.plot.querySelector(".cursor")?.remove();
    if (time === null || time < view[0] || time > view[1]) {
      if (panel.said) panel.said.textContent = "";
      continue;
    }
    const mark = document.createElement("div");
    mark.className = "cursor";
    mark.style.left = `${(100 * (time - view[0])) / (view[1] - view[0])}%`;
    panel.plot.append(mark);
    if (!panel.said) continue;
    const read = linesOf(panel).map(({ name, times, values }) => {
      const next = placeOf(times, time), near = next > 0 && (next === times.length || time - times[next - 1] < times[next] - time) ? next - 1 : next;
      if (!times.length || Math.abs(times[near] - time) > Math.max(0.02 * (view[1] - view[0]), 0.2)) return `${name} -`;
      return `${name} ${short(panel.isLog ? 10 ** values[near] : values[near]).slice(0, 8)}`;
    });
    panel.said.textContent = `${(time + begins).toFixed(2)} s${beside(time + begins)}: ${read.join(", ")}`;
  }
}

function timeAt(plot, x) {
  const box = plot.getBoundingClientRect();
  return view[0] + ((view[1] - view[0]) * Math.min(Math.max(x - box.left, 0), box.width)) / box.width;
}

for (const panel of panels) {
  let from = null, chosen = null;
  panel.svg.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    from = event.clientX;
    chosen = document.createElement("div");
    chosen.className = "chosen";
    panel.plot.append(chosen);
    panel.svg.setPointerCapture(event.pointerId);
  });
  panel.svg.addEventListener("pointermove", (event) => {
    point(timeAt(panel.plot, event.clientX));
    if (from === null) return;
    const left = panel.plot.getBoundingClientRect().left;
    chosen.style.left = `${Math.min(from, event.clientX) - left}px`;
    chosen.style.width = `${Math.abs(event.clientX - from)}px`;
  });
  const end = (event) => {
    if (from === null) return;
    const ends = [from, event.clientX].sort((a, b) => a - b), begun = from;
    chosen.remove();
    from = null;
    if (event.type === "pointerup" && Math.abs(event.clientX - begun) > 5) show(timeAt(panel.plot, ends[0]), timeAt(panel.plot, ends[1]));
  };
  panel.svg.addEventListener("pointerup", end);
  panel.svg.addEventListener("pointercancel", end);
  panel.svg.addEventListener("pointerleave", () => from === null && point(null));
  panel.svg.addEventListener("dblclick", () => show(...whole));
  panel.svg.addEventListener("keydown", (event) => {
    const middle = cursor ?? (view[0] + view[1]) / 2, step = (view[1] - view[0]) / 100;
    const zoom = (times) => show(middle - (middle - view[0]) * times, middle + (view[1] - middle) * times);
    const moves = {
      ArrowLeft: () => point(Math.max(middle - step, view[0])), ArrowRight: () => point(Math.min(middle + step, view[1])),
      "+": () => zoom(0.5), "=": () => zoom(0.5), "-": () => zoom(2), "0": () => show(...whole),
    };
    if (!moves[event.key] || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    moves[event.key]();
  });
}
for (const button of document.querySelectorAll(".tools button")) {
  button.addEventListener("click", () => {
    if (button.dataset.zoom) {
      const middle = cursor ?? (view[0] + view[1]) / 2, half = ((view[1] - view[0]) / 2) * Number(button.dataset.zoom);
      show(middle - half, middle + half);
    } else show(Number(button.dataset.from), Number(button.dataset.to));
  });
}
