// The leaderboard and the list of runs.

/** A collision rate as a bar from the lower to the upper end of its interval, on a square-root axis. */
function rateBar(low, high, value) {
  if (low === null || high === null) return null;
  const at = (rate) => 100 * Math.sqrt(Math.min(1, Math.max(0, rate)));
  const bar = make("span", { class: "rate", "aria-hidden": "true" }, make("span", { class: "rate-span" }), make("span", { class: "rate-dot" }));
  bar.firstChild.style.left = `${at(low)}%`;
  bar.firstChild.style.width = `${Math.max(1.5, at(high) - at(low))}%`;
  bar.lastChild.style.left = `${at(value)}%`;
  return bar;
}

const number = (key, label, text) => ({ label, title: DATA.columns[key], numeric: true, value: (row) => row[key], text: (row) => text(row[key]) });

function boardColumns() {
  return [
    { label: "method", title: DATA.columns.method, value: (row) => row.method,
      text: (row) => named(row.settings ? `${row.method} ${row.settings}` : row.method) },
    { label: "scenario", title: DATA.columns.scenario, value: (row) => row.scenario, text: (row) => row.scenario },
    { label: "stage", title: DATA.columns.stage, value: (row) => row.stage, text: (row) => row.stage },
    { ...number("rank", "rank", whole), value: (row) => -row.rank },
    { label: "collisions", title: `${DATA.columns.collision_rate}; ${DATA.columns.collision_low}`, numeric: true, value: (row) => row.collision_rate,
      text: (row) => make("span", { class: "stack" }, counted(row.collision_text), rateBar(row.collision_seeds_low, row.collision_seeds_high, row.collision_rate)) },
    number("speed_mps", "speed m/s", (value) => decimals(value, 2)),
    number("intervention_ratio", "interventions", percent),
    number("return_without_risk", "return", (value) => decimals(value, 0)),
    number("goal", "goal", (value) => percent(value, 1)),
    number("ego_at_fault", "at fault", whole),
    number("collisions_per_1000_km", "per 1,000 km", (value) => decimals(value, 1)),
    number("ttc_min_median_s", "least TTC s", (value) => decimals(value, 2)),
    number("hard_braking", "hard braking", percent),
    number("jerk_mps3", "jerk m/s³", (value) => decimals(value, 2)),
    number("seeds", "seeds", whole),
    number("steps", "steps", whole),
    number("episodes", "episodes", whole),
    { label: "cost limit", title: DATA.columns.cost_limit, numeric: true, value: (row) => row.cost_limit,
      text: (row) => (row.cost_signal === "collision" ? String(row.cost_limit) : `${row.cost_limit} ${row.cost_signal}`) },
  ];
}

function setUpBoard() {
  byId("ranking").textContent = `${counted(DATA.ranking)} The bars are intervals for new seeds on a square-root axis from 0 to 100 %.`;
  const table = new SortedTable("Leaderboard", boardColumns());
  byId("board").append(table.root);
  Filters.follow(() => table.show(DATA.leaderboard.filter((row) => Filters.keep(row))));
}

const runLink = (run) => make("a", { href: `#run=${encodeURIComponent(run.id)}` }, named(run.method));

function setUpRuns() {
  const applied = (key) => (run) => run.stages.A && run.stages.A[key];
  const table = new SortedTable("Runs", [
    { label: "method", value: (run) => run.method, text: runLink },
    { label: "scenario", value: (run) => run.scenario, text: (run) => run.scenario },
    { label: "seed", numeric: true, value: (run) => run.seed, text: (run) => String(run.seed) },
    { label: "steps", numeric: true, value: (run) => run.config.steps, text: (run) => whole(run.config.steps) },
    { label: "collisions (A)", numeric: true, value: (run) => applied("collisions")(run) / applied("episodes")(run), text: (run) => counted(applied("collision_text")(run) || NONE) },
    { label: "speed (A) m/s", numeric: true, value: applied("speed_mps"), text: (run) => decimals(applied("speed_mps")(run), 2) },
    { label: "return (A)", numeric: true, value: applied("return_without_risk"), text: (run) => decimals(applied("return_without_risk")(run), 0) },
    { label: "settings", value: (run) => settings(run), text: (run) => settings(run) || NONE },
  ]);
  byId("run-table").append(table.root);
  Filters.follow(() => table.show(DATA.runs.filter((run) => Filters.keep(run))));
  if (!DATA.missing.length) return;
  byId("missing").append(make("h3", {}, "Without a finished record"), make("ul", {}, ...DATA.missing.map((one) => make("li", {}, `${one.run}: ${one.reason}`))));
}

const settings = (run) => Object.entries(run.config.settings || {}).map(([key, value]) => `${key}=${value}`).join(" ");
