"""What `bench doctor` says of OmniSafe."""

import json
import sys

import pytest

from algorithms.omnisafe_library import omnisafe_module
from algorithms.registry import list_methods
from bench import doctor
from tests.optional import needs_omnisafe

BASELINES = ("cpo", "focops", "trpo-lag", "omnisafe")
INSTALL = "Install it with: pip install --no-deps omnisafe==0.5.0 pyyaml tqdm"


@pytest.fixture(autouse=True)
def only_methods_and_omnisafe(monkeypatch):
    for probe in ("_python", "_packages", "_threads", "_kernels", "_ffmpeg"):
        monkeypatch.setattr(doctor, probe, list)


def found(folder):
    checks = doctor.examine(folder)
    return checks, {check.name: check for check in checks}


@needs_omnisafe
def test_an_omnisafe_that_can_be_imported_is_usable(tmp_path):
    check = found(tmp_path)[1]["omnisafe"]
    assert (check.ok, check.found, check.remedy) == (True, "0.5.0, can be imported", "")


@pytest.mark.parametrize("missing", ["omnisafe", "yaml"])
def test_without_it_the_rest_is_healthy_and_the_methods_say_why(monkeypatch, tmp_path, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    checks, named = found(tmp_path)
    assert doctor.healthy(checks)
    assert not named["omnisafe"].ok
    assert f"'{missing}'" in named["omnisafe"].found
    assert named["omnisafe"].remedy == INSTALL
    for name in BASELINES:
        assert not named[f"method {name}"].ok
        assert INSTALL in named[f"method {name}"].found
    assert all(named[f"method {name}"].ok for name in ("sac", "safety-guard", "dd-rq"))
    assert doctor.as_text(checks).count(INSTALL) == 1 + len(BASELINES)
    json.dumps(doctor.as_values(checks))


@needs_omnisafe
def test_another_release_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr(omnisafe_module(), "__version__", "0.6.0")
    check = found(tmp_path)[1]["omnisafe"]
    assert (check.ok, check.remedy) == (False, INSTALL)
    assert check.found == "0.6.0, but the adapter is written for 0.5.0"


def test_a_release_that_fails_to_import_is_named_with_its_reason(monkeypatch, tmp_path):
    def fail(name):
        raise AttributeError("module 'numpy' has no attribute 'float_'")

    monkeypatch.setattr("algorithms.omnisafe_library.require_omnisafe", lambda: None)
    monkeypatch.delitem(sys.modules, "omnisafe", raising=False)
    monkeypatch.setattr("algorithms.omnisafe_library.importlib.import_module", fail)
    monkeypatch.setattr(doctor, "_methods", list)
    check = found(tmp_path)[1]["omnisafe"]
    assert check.found == "OmniSafe cannot be imported: AttributeError: module 'numpy' has no attribute 'float_'."
    assert check.remedy == INSTALL


def test_bench_list_gives_the_same_reason(monkeypatch):
    monkeypatch.setitem(sys.modules, "omnisafe", None)
    listed = {listing.name: listing for listing in list_methods()}
    assert all("pip install --no-deps omnisafe==0.5.0" in listed[name].reason for name in BASELINES)
