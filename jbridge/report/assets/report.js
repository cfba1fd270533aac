"use strict";
(() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const find = (id) => document.getElementById(id);
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const node = (name, parent, text) => {
    const made = parent.appendChild(document.createElement(name));
    if (text) made.textContent = text;
    return made;
  };
  const format = (value) => (value == null ? "–" : String(Number(value.toPrecision(4))));
  const axis = (label, more) => {
    const thin = { stroke: colour("--line"), width: 1 };
    return { label, stroke: colour("--ink"), grid: thin, ticks: thin, ...more };
  };
  const line = (label, name, more) => ({
    label, stroke: colour(name), width: 1.5, spanGaps: true, value: (_, value) => format(value), ...more,
  });
  const width = (place) => Math.max(place.clientWidth, 240);
  const HEIGHT = 220, LEAST_DRAG = 10, UPRIGHT = { size: 62, space: 24, values: (_, ticks) => ticks.map((tick) => (tick == null ? "" : String(Number(tick.toPrecision(3))))) };
  let plots = [], panels = [], current = 0, time = 0, playing = false, last = null, pointed = false, held = false;

  function plot(place, columns, options) {
    const made = new uPlot({ width: width(place), height: HEIGHT, ...options }, columns, place);
    plots.push({ made, place });
    return made;
  }

  function zoom(chart, key) {
    if (key !== "x" || zoom.busy) return;
    zoom.busy = true;
    const { min, max } = chart.scales.x;
    for (const other of panels) if (other !== chart) other.setScale("x", { min, max });
    zoom.busy = false;
    // Once all panels are drawn anew.
    queueMicrotask(() => { if (!pointed) tell(); });
  }

  // Shows a part of the whole time that is so much longer, about the moment of the replay where that is in view.
  function magnify(factor) {
    const t = data.recordings[current].t, [start, end] = [t[0], t.at(-1)], { min, max } = panels[0].scales.x;
    const span = Math.min(factor * (max - min), end - start), middle = time >= min && time <= max ? time : (min + max) / 2;
    const low = Math.min(Math.max(middle - span / 2, start), end - span);
    panels[0].setScale("x", { min: low, max: low + span });
  }

  function point(chart) {
    const over = chart.over;
    over.addEventListener("mousedown", () => { held = true; });
    over.addEventListener("mousemove", () => { pointed = true; });
    over.addEventListener("mouseleave", tell);
    // A finger that goes sideways is no mouse to the library; one that goes up or down moves the page.
    let from = null;
    const place = (event) => Math.min(Math.max(event.clientX - over.getBoundingClientRect().left, 0), over.clientWidth);
    const select = (left, width) => chart.setSelect({ left, width, top: 0, height: width ? over.clientHeight : 0 }, false);
    over.addEventListener("pointerdown", (event) => { if (event.pointerType === "touch") from = place(event); });
    over.addEventListener("pointermove", (event) => {
      if (from !== null) select(Math.min(from, place(event)), Math.abs(place(event) - from));
    });
    over.addEventListener("pointercancel", () => { from = null; select(0, 0); });
    over.addEventListener("pointerup", (event) => {
      if (from === null) return;
      const [low, high] = [from, place(event)].sort((one, other) => one - other);
      from = null;
      select(0, 0);
      if (high - low > LEAST_DRAG) chart.setScale("x", { min: chart.posToVal(low, "x"), max: chart.posToVal(high, "x") });
    });
  }

  // The last known value up to a sample, as a slower sensor leaves gaps.
  function known(values, index) {
    for (let k = index; values && k >= 0; k--) if (values[k] != null) return k;
    return index;
  }

  const moment = () => Math.max(data.recordings[current].t.findLastIndex((t) => t <= time), 0);

  // The values of the moment stand below all curves, unless the mouse points to another one or is drawing a part.
  function tell() {
    pointed = false;
    if (held) return;
    const index = moment();
    for (const chart of panels) {
      const { min, max } = chart.scales.x, t = chart.data[0][index];
      chart.setCursor({ left: t >= min && t <= max ? chart.valToPos(t, "x") : -10, top: 0 });
      chart.setLegend({ idxs: chart.data.map((values) => known(values, index)) });
    }
  }

  // What overlaid curves hide.
  function difference({ residual, curves: [recorded, ...simulated] }) {
    if (!simulated.length) return [];
    const less = (value, k) => (value == null || recorded.values[k] == null ? null : residual.factor * (recorded.values[k] - value));
    return [{ label: residual.label, curves: simulated.map((curve) => ({ ...curve, values: curve.values.map(less) })) }];
  }

  function recordings() {
    const place = find("panels");
    panels.forEach((chart) => chart.destroy());
    plots = plots.filter(({ place: other }) => other !== place);
    panels = [];
    const run = data.recordings[current];
    for (const panel of run.panels.flatMap((panel) => [panel, ...difference(panel)])) {
      const chart = plot(place, [run.t, ...panel.curves.map((curve) => curve.values)], {
        scales: { x: { time: false } },
        cursor: { sync: { key: "recordings" }, dataIdx: (shown, series, index) => known(shown.data[series], index) },
        axes: [axis("time [s]"), axis(panel.label, UPRIGHT)],
        series: [line("t [s]"), ...panel.curves.map((curve) => line(curve.label, `--${curve.role}`, { width: curve.role === "recorded" && panel.curves.length > 1 ? 5 : 1.5 }))],
        hooks: { setScale: [zoom] },
      });
      chart.roles = [null, ...panel.curves.map((curve) => curve.role)];
      point(chart);
      chart.root.setAttribute("role", "img");
      chart.root.setAttribute("aria-label", `${panel.label} over time, ${run.name}`);
      panels.push(chart);
    }
    blend();
  }

  function blend() {
    const share = Number(find("blend").value) / 100;
    for (const chart of panels) {
      chart.roles.forEach((role, k) => {
        if (role === "before") chart.series[k].alpha = Math.min(2 - 2 * share, 1);
        if (role === "after") chart.series[k].alpha = Math.min(2 * share, 1);
      });
      chart.redraw(false);
    }
    draw();
  }

  function draw() {
    const canvas = find("rig"), run = data.recordings[current], pen = canvas.getContext("2d");
    const index = moment(), sharp = window.devicePixelRatio || 1;
    const wide = width(canvas.parentElement), half = wide / 2, high = 240, rail = 44;
    canvas.width = wide * sharp;
    canvas.height = high * sharp;
    pen.scale(sharp, sharp);
    // The whole reach of cart and load in either half.
    const { left, right, top, bottom, rope } = run.scene;
    const scale = Math.min((half - 60) / Math.max(right - left, 0.01), (high - rail - 20) / Math.max(bottom - top, 0.01));
    const share = Number(find("blend").value) / 100;
    const twin = share < 0.5 && run.panels.some(({ curves }) => curves.some((curve) => curve.role === "before")) ? "before" : "after";
    [["recorded", "rig"], [twin, `simulation, ${data.labels[twin]}`]].forEach(([role, title], k) => {
      const value = (name, otherwise) => {
        const values = run.panels.find((panel) => panel.channel === name)?.curves.find((curve) => curve.role === role)?.values;
        return values?.[known(values, index)] ?? otherwise;
      };
      const x = half / 2 + scale * (value("x", 0) - (left + right) / 2), y = rail - scale * top;
      const l = scale * value("l", rope), psi = (value("psi", 0) * Math.PI) / 180;
      pen.save();
      pen.translate(k * half, 0);
      // What leaves the scene is not drawn into the other one's.
      pen.beginPath();
      pen.rect(0, 0, half, high);
      pen.clip();
      pen.strokeStyle = pen.fillStyle = colour(`--${role}`);
      pen.lineWidth = 2;
      pen.font = "14px system-ui, sans-serif";
      pen.fillText(title, 12, 16);
      pen.fillRect(10, y, half - 20, 2);
      pen.fillRect(x - 14, y - 10, 28, 10);
      if (rope !== null) {
        pen.beginPath();
        pen.moveTo(x, y);
        pen.lineTo(x + l * Math.sin(psi), y + l * Math.cos(psi));
        pen.stroke();
        pen.beginPath();
        pen.arc(x + l * Math.sin(psi), y + l * Math.cos(psi), 7, 0, 7);
        pen.fill();
      }
      pen.restore();
    });
    find("time").value = time;
    tell();
    find("clock").textContent = `${time.toFixed(2)} s`;
  }

  function step(now) {
    if (!playing) return;
    const run = data.recordings[current];
    time += last === null ? 0 : ((now - last) / 1000) * Number(find("speed").value);
    last = now;
    if (time >= run.t.at(-1)) time = run.t[0];
    draw();
    requestAnimationFrame(step);
  }

  function play(on) {
    playing = on;
    last = null;
    find("play").textContent = on ? "Pause" : "Play";
    if (on) requestAnimationFrame(step);
  }

  function choose(number) {
    current = number;
    const run = data.recordings[current];
    time = run.t[0];
    Object.assign(find("time"), { min: run.t[0], max: run.t.at(-1), step: "any" });
    recordings();
  }

  function horizons() {
    for (const panel of data.horizons) {
      plot(find("horizons"), [panel.seconds, ...panel.curves.map((curve) => curve.values)], {
        title: panel.label,
        scales: { x: { time: false }, y: { distr: 3 } },
        axes: [axis("horizon [s]"), axis(panel.axis, UPRIGHT)],
        series: [line("horizon [s]"), ...panel.curves.map((curve) => line(curve.label, `--${curve.role}`, { points: { show: true } }))],
      });
    }
  }

  function maps() {
    for (const map of data.maps) {
      plot(find("maps"), [map.places, ...map.curves.map((curve) => curve.values)], {
        title: map.label,
        scales: { x: { time: false } },
        axes: [axis(map.place), axis(map.force, UPRIGHT)],
        series: [line(map.place), ...map.curves.map((curve) => line(curve.label, `--${curve.role}`, curve.bound ? { dash: [4, 4] } : {}))],
      });
    }
  }

  find("interactive").hidden = false;
  document.body.classList.add("live");
  data.recordings.forEach((run, k) => { node("option", find("recording"), run.name).value = k; });
  find("recording").onchange = (event) => choose(Number(event.target.value));
  find("blend").oninput = blend;
  find("play").onclick = () => play(!playing);
  find("time").oninput = (event) => { time = Number(event.target.value); draw(); };
  find("reset").onclick = () => panels[0]?.setScale("x", { min: data.recordings[current].t[0], max: data.recordings[current].t.at(-1) });
  find("closer").onclick = () => magnify(0.5);
  find("wider").onclick = () => magnify(2);
  document.addEventListener("mouseup", () => { held = false; });
  const keys = { k: "play", r: "reset", "+": "closer", "=": "closer", "-": "wider" };
  document.addEventListener("keydown", (event) => {
    // What is typed into a list chooses from it.
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || event.target.closest("select")) return;
    const key = keys[event.key.toLowerCase()];
    if (key) find(key).click();
  });
  const all = () => { plots = []; find("horizons").replaceChildren(); find("maps").replaceChildren(); recordings(); horizons(); maps(); };
  choose(0);
  horizons();
  maps();
  window.addEventListener("resize", () => { plots.forEach(({ made, place }) => made.setSize({ width: width(place), height: HEIGHT })); queueMicrotask(draw); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", all);
})();
