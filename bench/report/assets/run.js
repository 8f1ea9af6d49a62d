// The page of one run: results, configuration, provenance, learning curve, replays.

const STAGE_NAMES = { T: "Training (T)", A: "Application (A)" };
const STAGE_ROWS = [
  ["collisions", (s) => counted(s.collision_text || NONE)], ["finished episodes", (s) => whole(s.episodes)], ["mean speed", (s) => `${decimals(s.speed_mps, 2)} m/s`],
  ["interventions", (s) => percent(s.intervention_ratio)], ["actions really changed", (s) => percent(s.altered_share)], ["return without r_risk", (s) => decimals(s.return_without_risk, 1)],
  ["episode cost", (s) => decimals(s.episode_cost, 4)], ["reached the goal", (s) => percent(s.goal)], ["off the road", (s) => percent(s.off_road)], ["timed out", (s) => percent(s.time_out)],
  ["least TTC, median", (s) => `${decimals(s.ttc_min_median_s, 2)} s`], ["time inside S_safe", (s) => percent(s.inside_safe_gap)], ["time below 1.5 s TTC", (s) => percent(s.low_ttc)],
  ["hard braking", (s) => percent(s.hard_braking)], ["mean |jerk|", (s) => `${decimals(s.jerk_mps3, 2)} m/s³`], ["lane changes", (s) => decimals(s.lane_changes, 2)],
];

/** Nested values as pairs of dotted name and text. */
function flat(value, name = "") {
  if (value === null || typeof value !== "object") return [[name, value === null ? NONE : String(value)]];
  const entries = Object.entries(value);
  if (!entries.length) return [[name, "none"]];
  return entries.flatMap(([key, inner]) => flat(inner, name ? `${name}.${key}` : key));
}

const pairsList = (value) => make("dl", { class: "pairs" }, ...flat(value).map(([name, text]) => make("div", {}, make("dt", {}, name), make("dd", {}, text))));

function stageTable(run) {
  const stages = Object.keys(run.stages);
  const head = make("tr", {}, make("th", { scope: "col" }, "Figure"), ...stages.map((stage) => make("th", { scope: "col", class: "number" }, STAGE_NAMES[stage])));
  const rows = STAGE_ROWS.map(([name, text]) => make("tr", {}, make("th", { scope: "row" }, name), ...stages.map((stage) => make("td", { class: "number" }, text(run.stages[stage])))));
  return scroller("Results", make("table", {}, make("caption", { class: "quiet" }, "Results"), make("thead", {}, head), make("tbody", {}, ...rows)));
}

function runReplays(run) {
  const kept = episodes().runs[run.id], root = make("section", { "aria-labelledby": "replay-title" }, make("h2", { id: "replay-title" }, "Replays"));
  if (!kept || !kept.episodes.length) {
    root.append(make("p", { class: "empty" }, (kept && kept.reason) || "No episode was kept for this run."));
    return root;
  }
  const stage = make("div"), others = make("select", { "aria-label": "Beside it" });
  let number = kept.episodes[0].number;
  const show = () => {
    Players.close();
    buttons.forEach((button, k) => button.setAttribute("aria-pressed", String(kept.episodes[k].number === number)));
    return Players.show(stage, [run.id, ...(others.value ? [others.value] : [])], number);
  };
  const fill = () => {
    const able = DATA.runs.filter((other) => other.id !== run.id && other.scenario === run.scenario && episodes().runs[other.id]?.episodes.some((one) => one.number === number));
    others.replaceChildren(make("option", { value: "" }, "nothing beside it"), ...able.map((other) => make("option", { value: other.id }, `beside it: ${other.method}, seed ${other.seed}`)));
  };
  const buttons = kept.episodes.map((one) => make("button", { type: "button", "aria-pressed": "false", onclick: () => { number = one.number; fill(); show(); } }, `Episode ${one.number}: ${one.why}`));
  others.addEventListener("change", show);
  root.append(make("div", { class: "choices", role: "group", "aria-label": "Episodes" }, ...buttons, others), stage);
  fill();
  show();
  return root;
}

function runCurves(run) {
  const root = make("section", { "aria-labelledby": "curve-title" }, make("h2", { id: "curve-title" }, "Learning curve"), make("div", { class: "charts small" }));
  if (!run.curve) return null;
  const draw = () => panels(root.lastChild, Object.keys(METRICS), (canvas, metric) => curveChart(canvas, [[run]], metric), (metric) => METRICS[metric][0]);
  return { root, draw };
}

function showRun(id) {
  const run = RUNS.get(id), root = byId("run");
  Players.close();
  root.replaceChildren(make("p", {}, make("a", { href: "#runs" }, "← All runs")));
  if (!run) {
    root.append(make("h1", { id: "run-title" }, "No such run"), make("p", {}, `This report has no run ${id}.`));
    return;
  }
  const curves = runCurves(run), method = run.config.settings && settings(run);
  root.append(make("h1", { id: "run-title" }, `${run.method} on ${run.scenario}, seed ${run.seed}`), make("p", { class: "hint mono" }, [run.id, method].filter(Boolean).join(" · ")),
    runReplays(run), make("section", {}, make("h2", {}, "Results"), stageTable(run)), curves ? curves.root : "",
    make("div", { class: "halves" }, make("section", {}, make("h2", {}, "Configuration"), pairsList(run.config)),
      make("section", {}, make("h2", {}, "Provenance"), pairsList({ ...run.provenance, seconds: run.timing }))));
  if (curves) curves.draw();
}
