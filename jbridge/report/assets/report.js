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
  const HEIGHT = 220, UPRIGHT = { size: 62, space: 24, values: (_, ticks) => ticks.map((tick) => (tick == null ? "" : String(Number(tick.toPrecision(3))))) };
  let plots = [], panels = [], current = 0, time = 0, playing = false, last = null;

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
  }

  // What overlaid curves hide.
  function difference({ label, curves: [recorded, ...simulated] }) {
    if (!simulated.length) return [];
    const less = (value, k) => (value == null || recorded.values[k] == null ? null : recorded.values[k] - value);
    return [{ label: `residual ${label.slice(label.indexOf("["))}`, curves: simulated.map((curve) => ({ ...curve, values: curve.values.map(less) })) }];
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
        cursor: { sync: { key: "recordings" } },
        axes: [axis("time [s]"), axis(panel.label, UPRIGHT)],
        series: [line("t [s]"), ...panel.curves.map((curve) => line(curve.label, `--${curve.role}`, { width: curve.role === "recorded" && panel.curves.length > 1 ? 5 : 1.5 }))],
        hooks: { setScale: [zoom] },
      });
      chart.roles = [null, ...panel.curves.map((curve) => curve.role)];
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

  function at(values, index) {
    for (let k = index; values && k >= 0; k--) if (values[k] != null) return values[k];
    return null;
  }

  function draw() {
    const canvas = find("rig"), run = data.recordings[current], pen = canvas.getContext("2d");
    const index = Math.max(run.t.findLastIndex((t) => t <= time), 0), sharp = window.devicePixelRatio || 1;
    const wide = width(canvas.parentElement), high = 240;
    canvas.width = wide * sharp;
    canvas.height = high * sharp;
    pen.scale(sharp, sharp);
    const reach = run.reach, scale = Math.min((wide / 2 - 40) / (reach.x[1] - reach.x[0] + 0.2), (high - 60) / (reach.l + 0.05));
    const share = Number(find("blend").value) / 100;
    const twin = share < 0.5 && run.motion.before ? "before" : "after";
    [["recorded", "rig", 0], [twin, `simulation, ${data.labels[twin]}`, wide / 2]].forEach(([role, title, left]) => {
      const motion = run.motion[role] || {}, value = (name, otherwise) => at(motion[name], index) ?? otherwise;
      const x = left + 20 + scale * (value("x", reach.x[0]) - reach.x[0] + 0.1);
      const l = scale * value("l", reach.l), psi = value("psi", 0);
      pen.strokeStyle = pen.fillStyle = colour(`--${role}`);
      pen.lineWidth = 2;
      pen.font = "14px system-ui, sans-serif";
      pen.fillText(title, left + 12, 16);
      pen.fillRect(left + 10, 40, wide / 2 - 20, 2);
      pen.fillRect(x - 14, 30, 28, 10);
      if (!run.swings) return;
      pen.beginPath();
      pen.moveTo(x, 40);
      pen.lineTo(x + l * Math.sin(psi), 40 + l * Math.cos(psi));
      pen.stroke();
      pen.beginPath();
      pen.arc(x + l * Math.sin(psi), 40 + l * Math.cos(psi), 7, 0, 7);
      pen.fill();
    });
    find("time").value = time;
    // The values of this moment stand below the curves.
    panels[0]?.setCursor({ left: panels[0].valToPos(time, "x"), top: 0 });
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
        axes: [axis("horizon [s]"), axis("rms error", UPRIGHT)],
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
  document.addEventListener("keydown", (event) => {
    if (event.key === "k" && !event.ctrlKey && !event.metaKey) play(!playing);
    if (event.key === "r" && !event.ctrlKey && !event.metaKey) find("reset").click();
  });
  const all = () => { plots = []; find("horizons").replaceChildren(); find("maps").replaceChildren(); recordings(); horizons(); maps(); };
  choose(0);
  horizons();
  maps();
  window.addEventListener("resize", () => { plots.forEach(({ made, place }) => made.setSize({ width: width(place), height: HEIGHT })); draw(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", all);
})();
