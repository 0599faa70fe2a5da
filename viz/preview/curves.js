// The panel of curves: a list of all joints with their angles now, and a chart of every chosen one. The page calls
// `curves.show(t)` whenever the instant changes; the panel calls `seek(t)` where somebody points at an instant.
"use strict";
function curvePanel(data, $, seek) {
  const SVG = "http://www.w3.org/2000/svg", WIDTH = 328, HEIGHT = 84, EDGE = 4, CHOSEN = 4;
  const first = data.time[0], span = Math.max(1e-9, data.time[data.time.length - 1] - first);
  const x = t => WIDTH * (data.time[t] - first) / span;
  const known = value => value !== null && value !== undefined;
  const number = value => known(value) ? value.toFixed(1) : "\u2013";
  const charts = new Map();
  let now = 0;

  function shape(parent, name, attributes) {
    const element = document.createElementNS(SVG, name);
    for (const key in attributes) element.setAttribute(key, attributes[key]);
    parent.append(element);
    return element;
  }
  function element(parent, name, className, text) {
    const made = document.createElement(name);
    made.className = className;
    made.textContent = text || "";
    parent.append(made);
    return made;
  }
  // instants in a row for which `holds`, as [from, to)
  function runs(holds) {
    const found = [];
    let start = -1;
    for (let t = 0; t <= data.time.length; t++) {
      const on = t < data.time.length && holds(t);
      if (on && start < 0) start = t;
      if (!on && start >= 0) { found.push([start, t]); start = -1; }
    }
    return found;
  }
  // heights of a chart: as far as the curve and its band go, and no less than 10 degrees or 10 mm
  function scale(joint) {
    const seen = [joint.value, joint.low, joint.high].flatMap(row => row || []).filter(known);
    let low = Math.min(...seen), high = Math.max(...seen);
    if (!seen.length) { low = -5; high = 5; }
    const missing = Math.max(0, 10 - (high - low)) / 2;
    low -= missing; high += missing;
    return {low, high, y: value => HEIGHT - EDGE - (HEIGHT - 2 * EDGE) * (value - low) / (high - low)};
  }
  const line = (row, y, [from, to]) =>
    "M" + Array.from({length: to - from}, (_, i) => x(from + i).toFixed(1) + " " + y(row[from + i]).toFixed(1)).join("L");

  function drawBand(svg, joint, y) {
    if (!joint.low) return;
    for (const [from, to] of runs(t => known(joint.low[t]) && known(joint.high[t]))) {
      const back = Array.from({length: to - from}, (_, i) => to - 1 - i);
      const below = back.map(t => x(t).toFixed(1) + " " + y(joint.low[t]).toFixed(1)).join("L");
      shape(svg, "path", {d: line(joint.high, y, [from, to]) + "L" + below + "Z", class: "band"});
    }
  }
  // modes have no identity from frame to frame: dots, as dark as their weight, not curves
  function drawOthers(svg, joint, y) {
    const darkness = [0.4, 0.65, 1], dots = ["", "", ""];
    joint.modes.forEach((row, t) => row.forEach((value, k) => {
      const weight = data.weight[t][k];
      if (!known(value) || k === data.best[t] || weight === null || weight < data.nothing) return;
      dots[weight < 0.05 ? 0 : weight < 0.2 ? 1 : 2] += "M" + x(t).toFixed(1) + " " + y(value).toFixed(1) + "h0";
    }));
    const group = shape(svg, "g", {class: "others"});
    dots.forEach((d, i) => d && shape(group, "path", {d, style: "stroke:" + data.other_colour, opacity: darkness[i]}));
  }
  function draw(joint, colour) {
    const box = element($("charts"), "div", "chart"), head = element(box, "div", "head", "");
    element(head, "span", "name", joint.name.replaceAll("_", " ")).style.color = colour;
    const readout = element(head, "span", "readout");
    const svg = shape(box, "svg", {width: WIDTH, height: HEIGHT, viewBox: `0 0 ${WIDTH} ${HEIGHT}`});
    const {low, high, y} = scale(joint);
    for (const [from, to] of runs(t => data.status[t] !== "tracked")) {
      const end = to < data.time.length ? x(to) : WIDTH;
      const fill = data.status_colour[data.status[from]] || "#fff";
      shape(svg, "rect", {x: x(from), y: 0, width: Math.max(2, end - x(from)), height: HEIGHT, fill, opacity: 0.22});
    }
    for (const limit of joint.limits)
      if (known(limit) && limit > low && limit < high) shape(svg, "line", {x1: 0, x2: WIDTH, y1: y(limit), y2: y(limit), class: "limit"});
    drawBand(svg, joint, y);
    drawOthers(svg, joint, y);
    for (const part of runs(t => known(joint.value[t])))
      shape(svg, "path", {d: line(joint.value, y, part), class: "curve", style: "stroke:" + colour});
    for (const [value, at] of [[high, 11], [low, HEIGHT - 3]])
      shape(svg, "text", {x: WIDTH - 2, y: at, class: "tick"}).textContent = value.toFixed(0) + joint.unit;
    const cursor = shape(svg, "line", {y1: 0, y2: HEIGHT, class: "cursor"});
    const point = event => {
      const share = (event.clientX - svg.getBoundingClientRect().left) / WIDTH, time = first + share * span;
      let best = 0;
      data.time.forEach((value, t) => { if (Math.abs(value - time) < Math.abs(data.time[best] - time)) best = t; });
      seek(best);
    };
    svg.onpointerdown = event => { svg.setPointerCapture(event.pointerId); point(event); };
    svg.onpointermove = event => { if (event.buttons) point(event); };
    return {box, readout, cursor};
  }
  const text = (joint, t) => {
    const half = joint.low && known(joint.low[t]) && known(joint.high[t]) ? (joint.high[t] - joint.low[t]) / 2 : null;
    return number(joint.value[t]) + " " + joint.unit + (half === null ? "" : " \u00b1 " + half.toFixed(1));
  };
  const colourOf = joint => data.side_colour[joint.side] || data.best_colour;

  function choose(joint, on) {
    joint.box.checked = on;
    if (on && !charts.has(joint)) charts.set(joint, draw(joint, colourOf(joint)));
    if (!on && charts.has(joint)) { charts.get(joint).box.remove(); charts.delete(joint); }
    show(now);
  }
  function show(t) {
    now = t;
    if ($("panel").hidden) return;
    for (const joint of data.joints) joint.readout.textContent = text(joint, t);
    for (const [joint, {readout, cursor}] of charts) {
      readout.textContent = text(joint, t);
      cursor.setAttribute("x1", x(t));
      cursor.setAttribute("x2", x(t));
    }
  }
  for (const joint of data.joints) {
    joint.row = element($("joints"), "label", "joint");
    joint.box = element(joint.row, "input", "");
    joint.box.type = "checkbox";
    joint.box.onchange = () => choose(joint, joint.box.checked);
    element(joint.row, "span", "name", joint.name.replaceAll("_", " ")).style.color = colourOf(joint);
    joint.readout = element(joint.row, "span", "readout");
  }
  $("filter").oninput = () => {
    const words = $("filter").value.toLowerCase().split(/[\s_]+/);
    for (const joint of data.joints) joint.row.hidden = !words.every(word => joint.name.toLowerCase().includes(word));
  };
  const range = joint => { const seen = joint.value.filter(known); return Math.max(...seen) - Math.min(...seen); };
  return {
    show,
    // those that are named, else the ones that move most
    choose(names) {
      const wanted = names.length ? data.joints.filter(joint => names.includes(joint.name))
        : [...data.joints].sort((a, b) => range(b) - range(a)).slice(0, CHOSEN);
      for (const joint of data.joints) choose(joint, wanted.includes(joint));
    },
  };
}
