// Summary, the guard at work, the paper's tables, claims.

const Players = {
  open: [],
  async show(root, ids, number) {
    const texts = ids.map((id) => episodes().runs[id].episodes.find((one) => one.number === number).data);
    const packed = (await Promise.all(texts.map(Replays.inflate))).flat();
    const player = new Replays.Player(root, packed, DATA.road);
    this.open.push(player);
    return player;
  },
  close() {
    this.open.splice(0).forEach((player) => player.close());
  },
};

function setUpSummary() {
  const applied = DATA.runs.map((run) => run.stages.A).filter(Boolean), trained = DATA.runs.map((run) => run.stages.T).filter(Boolean);
  const sum = (stages, key) => stages.reduce((total, stage) => total + stage[key], 0);
  const verdicts = DATA.claims.map((claim) => claim.verdict);
  const count = (verdict) => verdicts.filter((one) => one === verdict).length;
  const tiles = [
    ["runs", whole(DATA.runs.length)],
    ["methods", whole(METHODS.length)],
    ["scenarios", whole(SCENARIOS.length)],
    ["held-out episodes driven", whole(sum(applied, "episodes"))],
    ["hours driven", whole(Math.round(sum(applied, "hours") + sum(trained, "hours")))],
    ["claims reproduced / not / undecided", `${count("reproduced")} / ${count("not reproduced")} / ${count("undecided")}`],
  ];
  byId("summary").append(...tiles.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))));
}

/** Resolves once the first pair has taken its place. */
async function setUpPairs() {
  const pairs = episodes().pairs.filter((pair) =>
    [pair.first, pair.second].every((id) => episodes().runs[id].episodes.some((one) => one.number === pair.number)));
  if (!pairs.length) {
    byId("guard").hidden = true;
    document.querySelector('nav a[href="#guard"]').hidden = true;
    return;
  }
  const stage = make("div"), buttons = pairs.map((pair) =>
    make("button", { type: "button", "aria-pressed": "false", onclick: () => choose(pair) }, `Scenario ${pair.scenario}: ${RUNS.get(pair.first).method} and ${RUNS.get(pair.second).method}`));
  const choose = async (pair) => {
    Players.close();
    buttons.forEach((button, k) => button.setAttribute("aria-pressed", String(pairs[k] === pair)));
    const player = await Players.show(stage, [pair.first, pair.second], pair.number);
    const first = player.lanes[0].episode;
    player.seek(Math.max(0, (first.closest ?? first.steps) - 30));
  };
  byId("pair").append(make("div", { class: "choices", role: "group", "aria-label": "Pairs of runs" }, ...buttons), stage);
  return choose(pairs[pairs.length - 1]);
}

function setUpTables() {
  for (const table of DATA.tables) {
    const head = make("tr", {}, make("th", { scope: "col" }, "Figure"), make("th", { scope: "col" }, "Stage"), make("th", { scope: "col" }, ""), ...table.columns.map((name) => make("th", { scope: "col", class: "number" }, name)));
    const seeds = make("tr", { class: "seeds" }, make("th", { scope: "row" }, "Seeds"), make("td"), make("td", {}, "ours"), ...table.seeds.map((n) => make("td", { class: "number" }, n || NONE)));
    const lines = table.rows.flatMap(({ row, stage, cells }) => [
      make("tr", { class: "ours" }, make("th", { scope: "row", rowspan: "2" }, row), make("td", { rowspan: "2" }, stage), make("td", {}, "ours"), ...cells.map(ourCell)),
      make("tr", { class: "paper" }, make("td", {}, "paper"), ...cells.map((cell) => make("td", { class: "number" }, cell.paper || NONE))),
    ]);
    const notes = table.notes.length ? make("details", {}, make("summary", {}, `${table.notes.length} notes`), make("ol", {}, ...table.notes.map((note) => make("li", {}, note)))) : null;
    byId("paper-tables").append(make("h3", {}, table.title), make("p", { class: "hint" }, table.caption),
      scroller(table.title, make("table", { class: "paper-table" }, make("caption", { class: "quiet" }, table.title), make("thead", {}, head), make("tbody", {}, seeds, ...lines))),
      ...table.remarks.map((remark) => make("p", {}, remark)), notes ?? "");
  }
}

function ourCell(cell) {
  const [head, ...rest] = counted(cell.ours).split(" (");
  return make("td", { class: "number" }, cell.ours ? head : NONE, rest.length ? make("span", { class: "bracket" }, `(${rest.join(" (")}`) : null,
    cell.note ? make("sup", {}, `[${cell.note}]`) : null);
}

const VERDICTS = { reproduced: ["✓", "yes"], "not reproduced": ["✗", "no"], undecided: ["?", "open"] };

function setUpClaims() {
  byId("claim-cards").append(...DATA.claims.map((claim) => {
    const [sign, kind] = VERDICTS[claim.verdict];
    const effect = claim.effect === null ? null : `${claim.effect} ${claim.unit}${claim.interval ? `, 95 %: ${claim.interval.map((bound) => bound ?? "∞").join(" to ")}` : ""}`;
    const parts = claim.parts.map((part) => make("tr", {}, make("th", { scope: "row" }, part.part), make("td", {}, part.verdict),
      make("td", { class: "number" }, part.effect === null ? NONE : String(part.effect)), make("td", { class: "number" }, part.interval ? part.interval.map((bound) => bound ?? "∞").join(" to ") : NONE),
      make("td", { class: "number" }, part.paper === null ? NONE : String(part.paper)), make("td", { class: "number" }, whole(part.n))));
    const table = make("table", {}, make("caption", { class: "quiet" }, `Comparisons behind ${claim.claim}`),
      make("thead", {}, make("tr", {}, ...["comparison", "verdict", "effect", "95 % interval", "paper", "episodes"].map((name, k) => make("th", { scope: "col", class: k > 1 ? "number" : null }, name)))), make("tbody", {}, ...parts));
    return make("section", { class: `card ${kind}`, "aria-label": `Claim ${claim.claim}` },
      make("p", { class: "verdict" }, make("span", { "aria-hidden": "true" }, sign), ` ${claim.verdict}`),
      make("h3", {}, `${claim.claim}: ${claim.method}`), make("p", {}, claim.statement), effect && make("p", { class: "effect" }, effect), make("p", { class: "hint" }, claim.reason),
      make("details", {}, make("summary", {}, `${claim.parts.length} comparisons`), scroller(`Comparisons behind ${claim.claim}`, table)));
  }));
}
