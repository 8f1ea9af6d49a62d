"""The report's page: the same bytes from the same records, one file, texts that cannot become code."""

import html.parser
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from bench.records import collect, read_record
from bench.report import episodes, page
from bench.report.content import content
from tests.bench.policy_records import reference_policy, write_record

EVIL = "fake-learner:bias=2.0</script><script>alert(1)</script>"


class Elements(html.parser.HTMLParser):
    """Start tags of a page with their attributes, and the text of scripts by id."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: dict[str | None, str] = {}
        self._inside = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._inside = tag == "script"

    def handle_endtag(self, tag: str) -> None:
        self._inside = False

    def handle_data(self, data: str) -> None:
        if self._inside:
            name = self.tags[-1][1].get("id")
            self.scripts[name] = self.scripts.get(name, "") + data


def written(results: Path, out: Path) -> str:
    return page.write(collect(results), out, results / "cache").read_text(encoding="utf-8")


def test_the_same_records_give_the_same_page(tmp_path: Path, make_record: Callable[..., Path]) -> None:
    make_record(tmp_path, collisions=3)
    write_record(tmp_path, "cruise", reference_policy("cruise"), episodes=3)
    first = written(tmp_path, tmp_path / "one")
    # The second time the episodes come from the cache.
    assert written(tmp_path, tmp_path / "two") == first


def test_a_page_is_one_file_that_may_ask_for_nothing(tmp_path: Path, make_record: Callable[..., Path]) -> None:
    make_record(tmp_path)
    found = Elements(written(tmp_path, tmp_path / "out"))
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["index.html"]
    addresses = [attrs[key] for _, attrs in found.tags for key in ("src", "href") if key in attrs]
    assert [address for address in addresses if not str(address).startswith(("#", "data:,"))] == []
    policy = next(attrs["content"] for tag, attrs in found.tags if attrs.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none';")


def test_a_script_tag_in_a_name_ends_no_script(tmp_path: Path, make_record: Callable[..., Path]) -> None:
    make_record(tmp_path / "plain")
    make_record(tmp_path / "evil", method=EVIL)
    plain, evil = (Elements(written(tmp_path / name, tmp_path / name / "out")) for name in ("plain", "evil"))
    assert [tag for tag, _ in evil.tags] == [tag for tag, _ in plain.tags]
    assert json.loads(evil.scripts["data"])["runs"][0]["method"] == EVIL


def test_content_holds_what_the_leaderboard_and_the_records_say(
    tmp_path: Path, make_record: Callable[..., Path]
) -> None:
    path = make_record(tmp_path, collisions=2, train_collisions=5)
    make_record(tmp_path, seed=1)
    shown = content(collect(tmp_path))
    applied = next(row for row in shown["leaderboard"] if row["stage"] == "A")
    assert (applied["collisions"], applied["episodes"], applied["collision_text"][:12]) == (2, 40, "2/40 = 5.0 %")
    run = next(run for run in shown["runs"] if run["id"] == path.name)
    assert (run["stages"]["T"]["collisions"], run["stages"]["A"]["collisions"]) == (5, 2)
    assert run["config"]["steps"] == run["curve"]["steps"][-1] == 2_000
    assert run["provenance"]["git"]["commit"] == "0" * 40
    assert [table["title"] for table in shown["tables"]] == [
        "Results of the ablation experiments", "Collision rate statistics for different algorithms"
    ]  # fmt: skip
    assert {claim["claim"] for claim in shown["claims"]} >= {"C1", "C2", "C3", "C4", "C5"}
    json.dumps(shown, allow_nan=False)


def test_episodes_worth_a_look_are_the_first_a_collision_and_the_closest_call(
    tmp_path: Path, make_record: Callable[..., Path]
) -> None:
    crashed = read_record(make_record(tmp_path, collisions=1))
    least = crashed.eval_episodes().column("ttc_min").to_numpy()
    closest = min(range(1, len(least)), key=lambda number: least[number])  # 0 ended in the collision
    assert episodes.chosen(crashed) == {0: "first of the list", closest: "closest call"}
    all_crashed = read_record(make_record(tmp_path, seed=1, collisions=20))
    assert episodes.chosen(all_crashed) == {0: "first of the list"}


def test_a_guard_is_shown_at_work_where_the_unguarded_driver_did_worst(tmp_path: Path) -> None:
    plain = write_record(tmp_path, "cruise", reference_policy("cruise"), episodes=3, change={(2, "ending"): 2})
    guarded = write_record(tmp_path, "cruise+guard", reference_policy("cruise+guard"), episodes=3)
    records = collect(tmp_path).records
    (pair,) = episodes.pairs(records)
    assert (pair.first.path, pair.second.path, pair.episode) == (plain, guarded, 2)
    assert episodes.pairs(records[:1]) == []


def test_a_run_without_a_replay_says_why(tmp_path: Path, make_record: Callable[..., Path]) -> None:
    # A record whose figures were drawn, not driven.
    path = make_record(tmp_path, method="constant-speed", steps=0)
    kept = episodes.play(read_record(path), [0], tmp_path / "cache")
    assert kept["episodes"] == {}
    assert kept["reason"]
    assert not list((tmp_path / "cache" / "replays").glob("[!.]*/"))


@pytest.mark.parametrize("name", ["chart-4.6.1.umd.min.js", "chart-4.6.1.LICENSE.txt"])
def test_the_bundled_library_keeps_its_version_and_licence(name: str) -> None:
    text = (page.FOLDER / "vendor" / name).read_text(encoding="utf-8")
    assert "Chart.js v4.6.1" in text or "Permission is hereby granted, free of charge" in text
