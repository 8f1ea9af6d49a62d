"""The report in a browser: filters, sorting, replays, keyboard, widths; no request, no complaint on the console."""

import json
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from algorithms.safety_guard import SafetyGuard
from bench.records import collect
from bench.report import content, episodes, page
from tests.bench.policy_records import network_policy, reference_policy, risk_policy, write_record

pytestmark = pytest.mark.browser

CHROMIUM = "/usr/bin/chromium"
ARGUMENTS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
MANY = 200
INTERACTIVE_S = 3.0
SIZE_MAX = 15_000_000
EVIL = "evil</script><script>window.broken = 1</script><img src=x onerror='window.broken = 1'>"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    path = CHROMIUM if Path(CHROMIUM).exists() else shutil.which("chromium")
    assert path, "Chromium is missing: apt-get install chromium"
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield started
        started.close()


@pytest.fixture(scope="module")
def values(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a report of four runs holds."""
    results = tmp_path_factory.mktemp("results")
    write_record(results, "cruise", reference_policy("cruise", "b"), "b", 4)
    write_record(results, "cruise+guard", reference_policy("cruise+guard", "b"), "b", 4)
    write_record(results, "dd-rq", risk_policy("b"), "b", 4)
    write_record(results, "safety-guard:tc=1.0", network_policy(SafetyGuard(1.0)), "a", 4)
    collection = collect(results)
    return content.content(collection), episodes.collect_episodes(collection.records, results / "cache")


def many(values: tuple[dict[str, Any], dict[str, Any]]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The same runs over and over, each under a name of its own, with a learning curve each."""
    shown, kept = json.loads(json.dumps(values))
    steps = [12_500 * k for k in range(1, 41)]
    metrics = {
        name: [0.01 * k for k in range(40)] for name in ("return", "collision_rate", "speed_mps", "intervention_ratio")
    }
    runs = []
    for k in range(MANY):
        run = json.loads(json.dumps(shown["runs"][k % 4]))
        run |= {"id": f"run-{k}", "method": f"{run['method']}-{k // 20}", "curve": {"steps": steps, **metrics}}
        run["config"] |= {"method": run["method"], "seed": k % 5}
        runs.append(run)
        kept["runs"][run["id"]] = kept["runs"][shown["runs"][k % 4]["id"]]
    board = [{**row, "method": f"{row['method']}-{k}"} for k in range(20) for row in shown["leaderboard"]]
    return {**shown, "runs": [*shown["runs"], *runs], "leaderboard": [*shown["leaderboard"], *board]}, kept


@pytest.fixture
def open_report(browser: Browser, values: Any, tmp_path: Path) -> Iterator[Callable[..., Page]]:
    """Opens a report and fails if anything was printed on the console, raised or asked for from elsewhere."""
    complaints: list[str] = []
    opened: list[Page] = []

    def start(shown: Any = None, anchor: str = "", **context: Any) -> Page:
        path = tmp_path / "index.html"
        path.write_text(page.render(*(shown or values)), encoding="utf-8")
        made = browser.new_page(**{"viewport": {"width": 1280, "height": 900}, **context})
        made.on("console", lambda message: complaints.append(message.text))
        made.on("pageerror", lambda error: complaints.append(str(error)))
        made.on(
            "request",
            lambda request: (
                None if request.url.startswith(("file:", "data:", "blob:")) else complaints.append(request.url)
            ),
        )
        made.goto(path.as_uri() + anchor)
        made.wait_for_selector("html[data-ready]", state="attached")
        opened.append(made)
        return made

    yield start
    for made in opened:
        made.close()
    assert complaints == []


def column(shown: Page, table: str, k: int) -> list[str]:
    return shown.locator(f"{table} tbody tr > *:nth-child({k})").all_text_contents()


def test_browser_filters_leave_what_was_asked_for(open_report: Callable[..., Page], values: Any) -> None:
    shown = open_report()
    assert len(column(shown, "#board", 1)) == len(values[0]["leaderboard"]) == 4
    shown.get_by_label("Scenario", exact=False).first.select_option("b-v1")
    assert set(column(shown, "#board", 2)) == {"b-v1"}
    assert len(column(shown, "#run-table", 1)) == 3
    shown.locator("#filter-method").select_option("dd-rq")
    assert column(shown, "#board", 1) == ["dd-rq"]
    assert "1 of 4 rows" in shown.locator("#filter-count").inner_text()
    shown.locator("#filter-stage").select_option("T")
    assert column(shown, "#board", 1) == []
    shown.get_by_role("button", name="Clear").click()
    assert len(column(shown, "#board", 1)) == 4


def test_browser_headings_sort_by_number_and_say_so(open_report: Callable[..., Page]) -> None:
    shown = open_report()
    head = shown.locator("#board th", has_text="speed")
    place = 1 + head.evaluate("th => [...th.parentNode.children].indexOf(th)")
    as_ranked = column(shown, "#board", place)
    head.get_by_role("button").focus()
    shown.keyboard.press("Enter")
    assert head.get_attribute("aria-sort") == "descending"
    speeds = [float(text) for text in column(shown, "#board", place)]
    assert speeds == sorted(speeds, reverse=True)
    shown.keyboard.press("Enter")
    assert head.get_attribute("aria-sort") == "ascending"
    assert [float(text) for text in column(shown, "#board", place)] == sorted(speeds)
    shown.keyboard.press("Enter")
    assert head.get_attribute("aria-sort") == "none"
    assert column(shown, "#board", place) == as_ranked


def test_browser_a_replay_plays_pauses_and_seeks(open_report: Callable[..., Page], values: Any) -> None:
    run = next(run for run in values[0]["runs"] if run["method"] == "dd-rq")
    shown = open_report(anchor=f"#run={run['id']}")
    assert shown.locator("h1:visible").inner_text() == "dd-rq on b-v1, seed 0"
    slider, clock = shown.locator("#run .play-slider"), shown.locator("#run .play-clock")
    slider.wait_for()
    before = shown.locator("#run .play-scene").evaluate("canvas => canvas.toDataURL()")
    shown.locator("#run .play-speed").select_option("4")
    shown.locator("#run .play-button").click()
    expect(clock).not_to_have_text(re.compile(r"^0\.0 / "))
    shown.locator("#run .play-button").click()
    stopped = clock.inner_text()
    assert shown.locator("#run .play-button").get_attribute("aria-label") == "Play"
    shown.wait_for_timeout(150)
    assert clock.inner_text() == stopped
    assert shown.locator("#run .play-scene").evaluate("canvas => canvas.toDataURL()") != before
    slider.fill("20")
    assert clock.inner_text().startswith("2.0 / ")
    assert "RQ" in shown.locator("#run .play-facts").inner_text()
    shown.locator("#run .play").focus()
    shown.keyboard.press("ArrowRight")
    assert clock.inner_text().startswith("3.0 / ")
    shown.keyboard.press("End")
    end, last = clock.inner_text().removesuffix(" s").split(" / ")
    assert end == last
    shown.keyboard.press("Space")
    assert shown.locator("#run .play-button").get_attribute("aria-label") == "Pause"
    shown.keyboard.press("Space")


def test_browser_two_methods_run_side_by_side(open_report: Callable[..., Page]) -> None:
    shown = open_report()
    shown.locator("#pair .play-scene").nth(1).wait_for()
    titles = shown.locator("#pair .play-title").all_text_contents()
    assert [title.split(" on ")[0] for title in titles] == ["cruise", "cruise+guard"]
    assert len({title.rpartition("episode ")[2] for title in titles}) == 1


def test_browser_texts_from_plugins_are_shown_as_text(open_report: Callable[..., Page], values: Any) -> None:
    shown_values, kept = json.loads(json.dumps(values))
    shown_values["runs"][0]["method"] = shown_values["leaderboard"][0]["method"] = EVIL
    shown_values["runs"][0]["provenance"]["cpu"] = shown_values["tables"][0]["notes"][0] = EVIL
    shown_values["missing"] = [{"run": EVIL, "reason": EVIL}]
    shown_values["claims"][0]["reason"] = EVIL
    kept["runs"][shown_values["runs"][0]["id"]] = {"episodes": [], "reason": EVIL}
    shown = open_report((shown_values, kept))
    assert EVIL in column(shown, "#board", 1)
    shown.goto(shown.url.partition("#")[0] + f"#run={shown_values['runs'][0]['id']}")
    shown.locator("#run-title").wait_for()
    assert EVIL in shown.locator("#run-title").inner_text()
    assert EVIL in shown.locator("#run .pairs").last.inner_text()
    assert shown.evaluate("window.broken") is None


def test_browser_200_runs_are_interactive_in_time_and_small(
    browser: Browser, values: tuple[dict[str, Any], dict[str, Any]], tmp_path: Path
) -> None:
    path = tmp_path / "index.html"
    path.write_text(page.render(*many(values)), encoding="utf-8")
    assert path.stat().st_size < SIZE_MAX
    shown = browser.new_page()
    session = shown.context.new_cdp_session(shown)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    shown.goto(path.as_uri())
    shown.wait_for_selector("html[data-ready]", state="attached")
    spent = {metric["name"]: metric["value"] for metric in session.send("Performance.getMetrics")["metrics"]}
    # Processor time of the page's thread: what a machine with nothing else to do needs.
    assert spent["ThreadTime"] < INTERACTIVE_S
    assert len(column(shown, "#run-table", 1)) == MANY + 4
    shown.close()


@pytest.mark.parametrize(("width", "scheme"), [(360, "light"), (360, "dark"), (1280, "dark")])
def test_browser_nothing_runs_over_the_edge_and_colours_follow(
    open_report: Callable[..., Page], values: Any, width: int, scheme: str
) -> None:
    shown = open_report(viewport={"width": width, "height": 800}, color_scheme=scheme)
    shown.locator("#pair .play-scene").first.wait_for()
    assert shown.evaluate("document.documentElement.scrollWidth") <= width
    light = shown.evaluate("getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)[0]")
    assert (light > 200) == (scheme == "light")
    shown.goto(shown.url.partition("#")[0] + f"#run={values[0]['runs'][0]['id']}")
    shown.locator("#run .play-scene").first.wait_for()
    assert shown.evaluate("document.documentElement.scrollWidth") <= width


def test_browser_everything_has_a_name_and_the_keyboard_reaches_it(open_report: Callable[..., Page]) -> None:
    shown = open_report()
    nameless = """[...document.querySelectorAll('button, select, input, a, canvas, [role=region]')]
        .filter(e => e.offsetParent && !e.textContent.trim() && !e.getAttribute('aria-label') && !e.labels?.length)
        .length"""
    assert shown.evaluate(nameless) == 0
    assert shown.evaluate("document.documentElement.lang") == "en"
    shown.keyboard.press("Tab")
    assert shown.evaluate("document.activeElement.className") == "skip"
    shown.keyboard.press("Enter")
    assert shown.evaluate("document.activeElement.id") == "main"
