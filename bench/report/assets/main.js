// Routing between the overview and the pages of runs.

const redraws = [];

function route() {
  const wanted = decodeURIComponent(location.hash.slice(1)), id = wanted.startsWith("run=") ? wanted.slice(4) : null;
  const onRun = id !== null, was = !byId("run").hidden;
  byId("overview").hidden = onRun;
  byId("run").hidden = !onRun;
  if (onRun) {
    showRun(id);
    document.title = `${id} – safedrive-bench report`;
    window.scrollTo(0, 0);
    byId("main").focus({ preventScroll: true });
    return;
  }
  document.title = "safedrive-bench report";
  if (was) {
    Players.close();
    byId("run").replaceChildren();
    redraws.forEach((draw) => draw());
    if (wanted && byId(wanted)) byId(wanted).scrollIntoView();
  }
}

setUpSummary();
setUpFilters();
setUpBoard();
redraws.push(setUpPareto(), setUpCurves());
setUpTables();
setUpClaims();
setUpRuns();
// The first pair takes its place a moment later: a section that was asked for has then moved.
setUpPairs().then(() => {
  const wanted = byId(location.hash.slice(1));
  if (wanted && byId("run").hidden) wanted.scrollIntoView({ behavior: "instant" });
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => (byId("run").hidden ? redraws.forEach((draw) => draw()) : route()));
window.addEventListener("hashchange", route);
route();
document.documentElement.dataset.ready = "true";
