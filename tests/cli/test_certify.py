import importlib
import json

from slidax.certify import admissibility
from slidax.certify.printed import settling_time, ultimate_bound

from .commands import answer_of, in_process

KEYS = {"name", "holds", "grade", "since", "margin", "bound", "assumptions", "statement", "remedy"}


def only(monkeypatch, *certificates):
    monkeypatch.setattr(importlib.import_module("slidax.certify.certify"), "CERTIFICATES", certificates)


def test_json_and_page_agree_and_exit_code_is_4_if_a_certificate_fails(tmp_path, monkeypatch):
    only(monkeypatch, admissibility, settling_time, ultimate_bound)
    words = ["certify", "example-4.2", "--runs", "0", "--set", "simulation.t1=8"]
    answer = answer_of(*words, "--out", str(tmp_path), code=4)
    assert answer == json.loads((tmp_path / "certificate.json").read_text(encoding="utf-8"))
    assert list(answer) == ["certificates"]
    result = {item["name"]: item for item in answer["certificates"]}
    assert {"admissibility", "settling_time", "ultimate_bound"} <= result.keys()
    for item in result.values():
        assert item.keys() == KEYS
        assert all(text.keys() == {"text", "status", "value"} for text in item["assumptions"])
        assert {text["status"] for text in item["assumptions"]} <= {"proved", "tested", "assumed", "fails"}
        assert all(text.keys() == {"words", "set"} for text in item["remedy"])
    assert (result["admissibility"]["holds"], result["settling_time"]["holds"]) == (True, False)
    assert result["ultimate_bound"]["holds"] and len(result["ultimate_bound"]["bound"]["error"]) == 3
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert result["ultimate_bound"]["name"] in page.replace("_\u200b", "_") and "Not certified" in page
    assert (tmp_path / "figures" / "bounded-error.svg").exists()


def test_exit_code_is_0_if_all_certificates_hold(monkeypatch):
    only(monkeypatch, admissibility)
    words = ["certify", "example-4.1", "--runs", "0", "--set", "simulation.t1=0.1"]
    done = in_process(*words, code=0)
    assert "✓ Every guarantee that applies holds. Weakest grade: B." in done.stdout
    assert "proved: the start is inside" not in done.stdout
    assert "proved: the start is inside" in in_process(*words, "--long", code=0).stdout
    outside = in_process(*words, "--set", "start.q=[-1, 2.5]", code=4)
    assert "✗ Not certified: admissibility." in outside.stdout and "joint 1 begins" in outside.stdout
    assert "--set 'scheme.transformation.performance.initial=[1.5,0.6]'" in outside.stdout


def test_each_certificate_announces_itself_for_the_progress_bar(monkeypatch):
    from slidax import scenarios
    from slidax.certify import certify

    only(monkeypatch, admissibility)
    begun = []
    certify(scenarios.load("example-4.2"), runs=0, begin=lambda name, total: begun.append((name, total)))
    assert begun == [("admissibility", 1)]
