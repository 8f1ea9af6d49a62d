"""Names of methods and scenarios: two claims to one name, broken packages, and files that register themselves."""

import importlib
import sys

import pytest

from algorithms import registry
from algorithms.registry import get_method, list_methods, register
from envs.plugins import DuplicateNameError, UnavailableError
from envs.scenario import Scenario, UnknownNameError, get_scenario, scenario_names

MODULE = """
from algorithms.reference_drivers import IDM
from envs.scenario import PedestrianRule, Scenario

class Mine(IDM):
    pass

NIGHT = Scenario("night-for-tests", vehicles=7, pedestrian_rule=PedestrianRule.FAIR)
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Installs a package with the given entry points; may be called more than once."""

    def install(name, methods=(), scenarios=(), text=MODULE):
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (tmp_path / f"{name}.py").write_text(text)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        lines = ["[bench.methods]", *methods, "[bench.scenarios]", *scenarios, ""]
        (info / "entry_points.txt").write_text("\n".join(lines))
        importlib.invalidate_caches()

    monkeypatch.syspath_prepend(tmp_path)
    before = set(sys.modules)
    yield install
    for name in set(sys.modules) - before:
        if "for_tests" in name:
            del sys.modules[name]


def listed():
    return {listing.name: listing for listing in list_methods()}


def test_an_entry_point_makes_a_method_known(package):
    package("mine_for_tests", ["mine-for-tests = mine_for_tests:Mine"])
    assert get_method("mine-for-tests").spec == "mine-for-tests"
    assert listed()["mine-for-tests"].origin == "mine_for_tests:Mine"


def test_a_name_with_two_claims_names_both_and_hides_no_other(package):
    package("one_for_tests", ["mine-for-tests = one_for_tests:Mine"])
    package("two_for_tests", ["mine-for-tests = two_for_tests:Mine"])
    with pytest.raises(DuplicateNameError, match="claimed by one_for_tests:Mine and by two_for_tests:Mine: rename"):
        get_method("mine-for-tests")
    names = listed()
    assert not names["mine-for-tests"].available
    assert "one_for_tests:Mine and by two_for_tests:Mine" in names["mine-for-tests"].reason
    assert names["sac"].available
    assert get_method("idm").name == "idm"


def test_a_package_cannot_take_a_built_in_name_in_silence(package):
    package("thief_for_tests", ["sac = thief_for_tests:Mine"])
    with pytest.raises(DuplicateNameError, match=r"algorithms\.sac:SAC and by thief_for_tests:Mine"):
        get_method("sac")
    assert listed()["idm"].available


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("raise RuntimeError('no licence')", "RuntimeError: no licence"),
        ("import sys; sys.exit(3)", "SystemExit: 3"),
        ("x = 1", "has no attribute 'Mine'"),
        ("def Mine(): pass", "AttributeError"),
        ("import a_module_that_is_not_there_for_tests", "ModuleNotFoundError"),
    ],
)
def test_a_broken_package_is_listed_with_its_reason_and_hides_no_other(package, text, reason):
    package("broken_for_tests", ["broken-for-tests = broken_for_tests:Mine"], text=text)
    with pytest.raises(UnavailableError, match="broken_for_tests:Mine failed to load"):
        get_method("broken-for-tests")
    assert reason in listed()["broken-for-tests"].reason
    assert listed()["sac"].available


def test_register_names_both_origins_of_a_taken_name(monkeypatch):
    monkeypatch.setattr(registry, "_registered", {})

    with pytest.raises(DuplicateNameError, match=r"algorithms\.sac:SAC and by .*Mine"):

        @register("sac")
        class Mine(get_method("idm").__class__):
            pass

    @register("registered-for-tests")
    class Other(get_method("idm").__class__):
        pass

    assert get_method("registered-for-tests").spec == "registered-for-tests"


def test_a_file_of_the_package_that_registers_a_class_needs_no_other_entry(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text('"""x."""\n\n\n@register("mine-for-tests")\nclass Mine(Method):\n    pass\n')
    monkeypatch.setattr(registry, "__file__", str(tmp_path / "registry.py"))
    registry._in_files.cache_clear()
    try:
        assert registry._origins()["mine-for-tests"] == ["algorithms.mine:Mine"]
    finally:
        registry._in_files.cache_clear()


def test_an_entry_point_makes_a_scenario_known_with_its_parameters(package):
    package("night_for_tests", scenarios=["night-for-tests = night_for_tests:NIGHT"])
    assert get_scenario("night-for-tests").vehicles == 7
    assert get_scenario("night-for-tests:vehicles=3").id == "night-for-tests:vehicles=3-v1"
    assert "night-for-tests" in scenario_names()


@pytest.mark.parametrize(
    ("points", "text", "message"),
    [
        (["x-for-tests = night_for_tests:NIGHT"], MODULE, "must be a Scenario whose name is 'x-for-tests'"),
        (["x-for-tests = night_for_tests:NIGHT"], "NIGHT = 1", "must be a Scenario"),
        (["x-for-tests = night_for_tests:NIGHT"], "raise OSError('disk')", "OSError: disk"),
        (["a = night_for_tests:NIGHT"], MODULE, "'a' is claimed by envs.scenario and by night_for_tests:NIGHT"),
    ],
)
def test_a_scenario_that_cannot_be_used_says_why_and_hides_no_other(package, points, text, message):
    package("night_for_tests", scenarios=points, text=text)
    name = points[0].split()[0]
    with pytest.raises(UnavailableError, match=message):
        get_scenario(name)
    from bench import listing

    assert message in listing.as_text()
    assert message in listing.as_json()
    assert get_scenario("b") == Scenario("b", pedestrian_rule=get_scenario("b").pedestrian_rule)
    with pytest.raises(UnknownNameError):
        get_scenario("nowhere-for-tests")
