"""How a page begins: a result, a patella, while programs are compiled, alone, and again."""

import json
import subprocess
import sys
import threading
from urllib.parse import urlsplit

import numpy as np
import pytest

import kneejax as kj

pytest.importorskip("viser", reason="viser is not installed: kneejax[explore]")
from kneejax import report
from kneejax.cli._explore import _subject, begin
from kneejax.cli.options.knees import Explore
from kneejax.explorer import Solver
from tests.explore.browser import WAIT_MS, enter, pixels
from tests.explore.waiting import settled, until


def test_a_page_opens_while_its_programs_are_compiled(browser, monkeypatch):
    done, curves = threading.Event(), Solver.curves
    monkeypatch.setattr(Solver, "curves", lambda *given, **more: done.wait() and curves(
        *given, **more))  # fmt: skip
    served = begin(Explore.read({"subject": "four_ligament", "port": "8440"}))
    opened = browser.new_page()
    opened.goto(served.link)
    opened.get_by_text("Compiling").wait_for(timeout=WAIT_MS)
    # What is set meanwhile is what is solved.
    enter(opened, None, "Flexion", 30)
    until(lambda: served.setting.given == {"flexion_deg": 30.0})
    assert served.answer.status is None and not served.solved.is_set()
    until(lambda: served._drawing._made)
    assert not [name for name in served._drawing._made if name.startswith("/words/")]
    done.set()
    opened.get_by_text("Peak pressure, medial").wait_for(timeout=WAIT_MS)
    settled(served)
    assert served.answer.setting == served.setting
    assert opened.get_by_text("Compiling").count() == 0
    opened.close()
    served.stop()


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """What a calibration leaves, of a study beside it."""
    folder = tmp_path_factory.mktemp("result")
    study = {"title": "two", "knee": "four_ligament", "parameters": ["ACL.stiffness"],
             "synthetic": {"parameters": {"ACL.stiffness": 4000.0}, "flexion_deg": [0.0, 30.0]}}
    (folder / "study.yaml").write_text(json.dumps(study))
    said = {"title": "two", "parameters": {"ACL.stiffness": {"value": 3900.0}},
            "stiffness_of": "structure", "frame_offset": {"lateral": {"value": 0.5}},
            "settings": {"knee": "four_ligament", "path": str(folder / "study.yaml")}}  # fmt: skip
    (folder / "result.json").write_text(json.dumps(said))
    return folder / "result.json"


def test_a_result_stands_behind_the_curves_with_its_measurement(result):
    knee, _, measured, first = _subject(Explore.read({"subject": str(result)}))
    assert first == "stored fit"
    assert float(knee.ligaments.stiffness[0]) == pytest.approx(3900.0)
    seen = kj.read_study(result.parent / "study.yaml").poses()
    np.testing.assert_allclose(measured[:, :5], seen[:, :5])
    np.testing.assert_allclose(measured[:, 5], seen[:, 5] - 0.5)
    (result.parent / "study.yaml").unlink()
    assert _subject(Explore.read({"subject": str(result)}))[2] is None


def test_a_patella_is_shown_or_refused_never_left_out():
    knee, *_ = _subject(Explore.read({"subject": "average_knee", "patella": True}))
    assert knee.bodies == ("tibia", "patella")
    with pytest.raises(kj.InputProblem, match="--patella: with a study: expected a knee"):
        _subject(Explore.read({"subject": "paper1", "patella": True}))


def test_a_page_of_a_scene_draws_from_its_file_without_a_network(browser, tmp_path):
    poses = kj.Pose.from_table([[15.0, 0.9, 7.5, 1.1, 1.0, -1.1], [60.0, 3.8, 3.1, 1.7, -1.0, -1]])
    scenes = report.scenes(kj.load_knee("four_ligament"), poses)
    (tmp_path / "scene.html").write_text(report.scene_page(scenes), encoding="utf-8")
    asked = []
    alone = browser.new_context(offline=True, viewport={"width": 1440, "height": 900}).new_page()
    alone.on("request", lambda request: asked.append(request.url))
    alone.goto((tmp_path / "scene.html").as_uri())
    alone.get_by_text("the tibia held still").wait_for(timeout=WAIT_MS)
    until(lambda: pixels(alone).std() > 5.0)
    assert alone.get_by_text("Strain, %").is_visible()
    assert not [url for url in asked if url.startswith(("http", "ws"))]
    alone.context.close()


def started(port):
    """The command, in a process of its own, and the link that it prints."""
    command = [sys.executable, "-m", "kneejax", "explore", "four_ligament", "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    return process, process.stdout.readline().strip()


def stop(process):
    process.kill()
    process.wait(30.0)
    process.stdout.close()


def test_a_server_killed_and_started_again_serves_its_new_link_alone(browser):
    process, link = started(8460)
    tab = browser.new_page()
    try:
        tab.goto(link)
        tab.get_by_text("Peak pressure, medial").wait_for(timeout=WAIT_MS)
    finally:
        stop(process)
    process, again = started(8460)
    try:
        assert urlsplit(again).netloc == urlsplit(link).netloc and again != link
        assert tab.goto(link).status == 403
        tab.goto(again)
        tab.get_by_text("Peak pressure, medial").wait_for(timeout=WAIT_MS)
    finally:
        stop(process)
        tab.close()
