// Charts: safety against speed, and learning curves.

const METRICS = {
  return: ["mean return without r_risk", (value) => value],
  collision_rate: ["collision rate, %", (value) => 100 * value],
  speed_mps: ["mean speed, m/s", (value) => value],
  intervention_ratio: ["intervention ratio, %", (value) => 100 * value],
};
const RATES = [0, 0.001, 0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 1];
const drawn = new Map();

const cssColour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const faded = (colour, share) => colour.replace(/\)$/, ` / ${share})`);

/** Draw a chart in place of the one that the canvas had. */
function chart(canvas, configuration) {
  if (drawn.has(canvas)) drawn.get(canvas).destroy();
  Chart.defaults.color = cssColour("--muted");
  Chart.defaults.borderColor = cssColour("--rule");
  Chart.defaults.font.family = "system-ui, sans-serif";
  const reduced = matchMedia("(prefers-reduced-motion: reduce)").matches;
  const made = new Chart(canvas, { ...configuration, options: { maintainAspectRatio: false, animation: reduced ? false : { duration: 250 }, ...configuration.options } });
  drawn.set(canvas, made);
}

/** One labelled canvas for each name that has something to show. */
function panels(root, names, draw, title = (name) => `Scenario ${name}`) {
  for (const canvas of root.querySelectorAll("canvas")) {
    if (drawn.has(canvas)) drawn.get(canvas).destroy();
    drawn.delete(canvas);
  }
  root.replaceChildren();
  if (!names.length) root.append(make("p", { class: "empty" }, "Nothing to show for these filters."));
  // All of them take their places before the first is drawn: a chart has the size of its place.
  const canvases = names.map(() => make("canvas", { role: "img" }));
  root.append(...names.map((name, k) => make("figure", {}, make("figcaption", {}, title(name)), make("div", { class: "canvas" }, canvases[k]))));
  names.forEach((name, k) => canvases[k].setAttribute("aria-label", draw(canvases[k], name)));
}

/** Interval of each point, as a bar through it. */
const intervalBars = {
  id: "intervalBars",
  beforeDatasetsDraw(shown) {
    const c = shown.ctx, axis = shown.scales.x;
    shown.data.datasets.forEach((set, k) => {
      if (!set.bars || !shown.isDatasetVisible(k)) return;
      shown.getDatasetMeta(k).data.forEach((point, i) => {
        const [low, high] = set.bars[i];
        if (low === null || high === null) return;
        c.strokeStyle = faded(set.borderColor, 0.55);
        c.lineWidth = 2;
        c.beginPath();
        c.moveTo(axis.getPixelForValue(Math.sqrt(low)), point.y);
        c.lineTo(axis.getPixelForValue(Math.sqrt(high)), point.y);
        c.stroke();
      });
    });
  },
};

/** Rows that no other row beats on both: from the safest on, each faster than all before. */
function front(rows) {
  const kept = [];
  for (const row of [...rows].sort((a, b) => a.collision_rate - b.collision_rate || b.speed_mps - a.speed_mps))
    if (!kept.length || row.speed_mps > kept[kept.length - 1].speed_mps) kept.push(row);
  return kept;
}

function paretoChart(canvas, rows) {
  const place = (row) => ({ x: Math.sqrt(row.collision_rate), y: row.speed_mps, row });
  const points = rows.map((row) => ({
    type: "scatter", data: [place(row)], bars: [[row.collision_seeds_low, row.collision_seeds_high]], label: row.method,
    borderColor: Style.colour(row.method), backgroundColor: faded(Style.colour(row.method), 0.65),
    pointStyle: Style.mark(row.method), radius: 7, hoverRadius: 10, borderWidth: 2, clip: false,
  }));
  const best = front(rows);
  chart(canvas, {
    plugins: [intervalBars],
    data: { datasets: [...points, { type: "line", data: best.map(place), borderColor: cssColour("--muted"), borderDash: [5, 5], borderWidth: 1.5, pointRadius: 0, pointHitRadius: 0, label: "front" }] },
    options: {
      interaction: { mode: "nearest", intersect: true },
      plugins: {
        legend: { display: false },
        tooltip: { filter: (item) => item.dataset.label !== "front", callbacks: {
          label: ({ raw }) => `${raw.row.method}: ${counted(raw.row.collision_text)}, ${decimals(raw.row.speed_mps, 2)} m/s`,
          afterLabel: ({ raw }) => `${whole(raw.row.steps)} steps, ${raw.row.seeds} seed${raw.row.seeds === 1 ? "" : "s"}` } },
      },
      scales: {
        x: { type: "linear", min: 0, max: Math.min(1, Math.max(...rows.map((row) => Math.sqrt(row.collision_seeds_high ?? row.collision_rate))) * 1.06 + 0.02),
          title: { display: true, text: "collision rate, % (square-root axis)" },
          afterBuildTicks: (axis) => { axis.ticks = RATES.map((rate) => ({ value: Math.sqrt(rate) })).filter((tick) => tick.value <= axis.max); },
          ticks: { callback: (value) => `${+(100 * value * value).toFixed(1)}` } },
        y: { title: { display: true, text: "mean speed, m/s" }, grace: "8%" },
      },
    },
  });
  return `${rows.length} methods by collision rate and mean speed. Not beaten on both: ${best.map((row) => row.method).join(", ") || "none"}. The leaderboard holds the figures.`;
}

function setUpPareto() {
  const draw = () => {
    const stage = Filters.stage || "A";
    const rows = DATA.leaderboard.filter((row) => Filters.keep(row) && row.stage === stage && row.collision_rate !== null && row.speed_mps !== null);
    panels(byId("pareto-charts"), unique(rows.map((row) => row.scenario)), (canvas, scenario) => paretoChart(canvas, rows.filter((row) => row.scenario === scenario)));
    byId("pareto-legend").replaceChildren(...Style.legend(unique(rows.map((row) => row.method))));
  };
  Filters.follow(draw);
  return draw;
}

/** Runs that differ in their seed only. */
function groups(runs) {
  const found = new Map();
  for (const run of runs) {
    const { seed, ...rest } = run.config;
    const key = JSON.stringify(rest);
    if (!found.has(key)) found.set(key, []);
    found.get(key).push(run);
  }
  return [...found.values()];
}

/** Mean, lowest and highest of the seeds at each point; null where no seed has a value. */
function overSeeds(runs, metric, scale) {
  return runs[0].curve.steps.map((step, i) => {
    const values = runs.map((run) => run.curve[metric][i]).filter((value) => value !== null).map(scale);
    return { step, mean: values.length ? values.reduce((a, b) => a + b) / values.length : null, low: values.length ? Math.min(...values) : null, high: values.length ? Math.max(...values) : null };
  });
}

function curveSets(runs, metric) {
  const [, scale] = METRICS[metric], method = runs[0].method, colour = Style.colour(method), points = overSeeds(runs, metric, scale);
  const line = (key, extra) => ({ data: points.map((point) => ({ x: point.step, y: point[key] })), borderColor: colour, pointRadius: 0, spanGaps: true, ...extra });
  const name = [method, settings(runs[0]), `${runs.length} seed${runs.length === 1 ? "" : "s"}`].filter(Boolean).join(", ");
  const edge = { borderWidth: 0, pointHitRadius: 0, band: true };
  const sets = [line("mean", { label: name, borderWidth: 2, borderDash: Style.dash(method), backgroundColor: colour, pointHitRadius: 8 })];
  if (runs.length > 1) sets.push(line("low", { ...edge, label: "low", fill: false }), line("high", { ...edge, label: "high", fill: "-1", backgroundColor: faded(colour, 0.16) }));
  return sets;
}

function curveChart(canvas, gathered, metric) {
  chart(canvas, {
    type: "line",
    data: { datasets: gathered.flatMap((runs) => curveSets(runs, metric)) },
    options: {
      parsing: true,
      interaction: { mode: "nearest", axis: "xy", intersect: false },
      plugins: { legend: { display: false }, tooltip: { filter: (item) => !item.dataset.band, callbacks: { title: (items) => (items.length ? `${whole(items[0].parsed.x)} steps` : ""), label: (item) => `${item.dataset.label}: ${item.parsed.y.toFixed(2)}` } } },
      scales: {
        x: { type: "linear", title: { display: true, text: "simulation steps of 0.1 s" }, ticks: { maxTicksLimit: 6, callback: (value) => (value >= 1e6 ? `${value / 1e6}M` : value >= 1e3 ? `${value / 1e3}k` : value) } },
        y: { title: { display: true, text: METRICS[metric][0] } },
      },
    },
  });
  return `Learning curves of ${gathered.length} groups of runs: ${METRICS[metric][0]} over training steps.`;
}

function setUpCurves() {
  const select = byId("curve-metric");
  select.append(...Object.entries(METRICS).map(([key, [label]]) => make("option", { value: key }, label)));
  const draw = () => {
    const runs = DATA.runs.filter((run) => run.curve && Filters.keep(run));
    panels(byId("curve-charts"), unique(runs.map((run) => run.scenario)), (canvas, scenario) => curveChart(canvas, groups(runs.filter((run) => run.scenario === scenario)), select.value));
    byId("curve-legend").replaceChildren(...Style.legend(unique(runs.map((run) => run.method))));
  };
  select.addEventListener("change", draw);
  Filters.follow(draw);
  return draw;
}
