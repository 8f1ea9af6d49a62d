// What the page shows, and the filters that everything follows.

const DATA = JSON.parse(byId("data").textContent);
const EPISODES = { read: null };

/** Episodes are many: they are parsed when the first one is wanted. */
function episodes() {
  EPISODES.read ??= JSON.parse(byId("episodes").textContent);
  return EPISODES.read;
}

const RUNS = new Map(DATA.runs.map((run) => [run.id, run]));
const METHODS = unique(DATA.runs.map((run) => run.method));
const SCENARIOS = unique(DATA.runs.map((run) => run.scenario));

const Filters = {
  scenario: "", method: "", stage: "", watchers: [],

  /** Call back now and after every change. */
  follow(callback) {
    this.watchers.push(callback);
    callback();
  },

  set(name, value) {
    this[name] = value;
    this.watchers.forEach((callback) => callback());
  },

  /** Whether a row of scenario, method and stage is wanted; a row without a stage has all. */
  keep(row) {
    return (!this.scenario || row.scenario === this.scenario) && (!this.method || row.method === this.method) &&
      (!this.stage || !row.stage || row.stage === this.stage);
  },
};

function setUpFilters() {
  const fill = (id, name, values, all) => {
    const select = byId(id);
    if (values) select.append(make("option", { value: "" }, all), ...values.map((value) => make("option", { value }, value)));
    select.addEventListener("change", () => Filters.set(name, select.value));
  };
  fill("filter-scenario", "scenario", SCENARIOS, "all scenarios");
  fill("filter-method", "method", METHODS, "all methods");
  fill("filter-stage", "stage");
  const form = byId("filters");
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => {
    for (const name of ["scenario", "method", "stage"]) Filters[name] = "";
    Filters.set("stage", "");
  });
  Filters.follow(() => {
    const rows = DATA.leaderboard.filter((row) => Filters.keep(row)).length, runs = DATA.runs.filter((run) => Filters.keep(run)).length;
    byId("filter-count").textContent = `${rows} of ${DATA.leaderboard.length} rows, ${runs} of ${DATA.runs.length} runs`;
  });
}

/** Colour and mark of a method: the same everywhere on the page. */
const Style = {
  marks: ["circle", "rect", "triangle", "rectRot", "star", "crossRot", "rectRounded", "cross"],
  signs: ["●", "■", "▲", "◆", "✶", "✕", "▢", "✚"],
  dashes: [[], [7, 4], [2, 3], [9, 3, 2, 3]],
  colour(method) {
    const k = METHODS.indexOf(method), dark = matchMedia("(prefers-color-scheme: dark)").matches;
    // The golden angle keeps neighbours apart however many there are.
    return `hsl(${Math.round((212 + k * 137.508) % 360)} ${dark ? "72% 68%" : "68% 40%"})`;
  },
  mark: (method) => Style.marks[METHODS.indexOf(method) % Style.marks.length],
  dash: (method) => Style.dashes[METHODS.indexOf(method) % Style.dashes.length],
  legend(methods) {
    return methods.map((method) => {
      const sign = make("span", { class: "sign", "aria-hidden": "true" }, Style.signs[METHODS.indexOf(method) % Style.signs.length]);
      sign.style.color = Style.colour(method);
      return make("li", {}, sign, method);
    });
  },
};
