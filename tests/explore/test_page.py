"""The page in a real browser."""

import contextlib
import time

import numpy as np
import pytest

import kneejax as kj

pytest.importorskip("viser", reason="viser is not installed: kneejax[explore]")
from kneejax.explorer import Setting
from tests.explore.browser import WAIT_MS, enter, pixels
from tests.explore.waiting import settled, until


@pytest.fixture
def tab(browser, page):
    page.go(Setting())
    opened = browser.new_page(viewport={"width": 1440, "height": 900})
    opened.goto(page.link)
    opened.get_by_text("Peak pressure, medial").wait_for(timeout=WAIT_MS)
    yield opened
    opened.close()


def test_a_slider_moves_the_knee_to_the_pose_of_the_command_line(tab, page):
    time.sleep(1.0)
    before = pixels(tab)
    assert before.std() > 5.0, "the canvas is empty"
    enter(tab, page, "Flexion", 60)
    assert page.setting.given == {"flexion_deg": 60.0}
    motion = kj.passive_flexion(kj.load_knee("four_ligament"), [60.0])
    expected = np.asarray(motion.to_table())[0, 1:]
    np.testing.assert_allclose([*page.answer.coordinates.values()], expected, atol=1e-6)
    tab.get_by_text(f"{page.answer.coordinates['internal_rotation']:.2f} °").wait_for(timeout=9000)
    until(lambda: np.abs(pixels(tab) - before).mean() > 1.0)


def test_a_ligament_is_cut_restored_and_the_change_undone(tab, page):
    force = page.answer.force_N["ACL"]
    tab.get_by_role("button", name="Cut", exact=True).click()
    until(lambda: page.setting.given == {"ACL.cut": 1.0})
    settled(page)
    assert page.answer.force_N["ACL"] == 0.0 < force
    tab.get_by_role("button", name="Restore").click()
    until(lambda: page.setting == Setting())
    page.undo()
    settled(page)
    assert page.setting.given == {"ACL.cut": 1.0}
    assert page.curves.setting == page.setting


def test_a_click_on_a_fibre_tells_its_force_and_another_cuts_its_ligament(page):
    page.go(Setting())
    settled(page)
    page._clicked("MCL")
    assert not page.setting.given and page._ligament.value == "MCL"
    assert f"{page.answer.force_N['MCL']:.1f} N" in page._status.content
    page._clicked("MCL")
    assert page.setting.given == {"MCL.cut": 1.0}
    page.go(Setting())


def on_screen(tab, camera, point):
    """Pixels of a point of the scene."""
    box = tab.locator("canvas").first.bounding_box()
    towards = np.array(camera.look_at) - camera.position
    towards /= np.linalg.norm(towards)
    right = np.cross(towards, camera.up_direction)
    right /= np.linalg.norm(right)
    up, away = np.cross(right, towards), np.asarray(point) - camera.position
    half = 0.5 * box["height"] / np.tan(0.5 * camera.fov) / (away @ towards)
    middle = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    return middle[0] + half * (away @ right), middle[1] - half * (away @ up)


def test_an_end_is_dragged_on_its_bone(tab, page):
    """Upwards along the gizmo's own axis: that coordinate moves, and the knee follows."""
    page._ligament.value, page._moving.value = "ACL", True
    page._show_gizmos()
    (client,) = page._server.get_clients().values()
    gizmo, before = page._ends._shown["tibial_attachment"][1], page.answer.force_N["ACL"]
    start, end = (np.array(gizmo.position) + [0.0, mm, 0.0] for mm in (9.0, 13.0))
    name = "ACL.tibial_attachment.superior"
    for _ in range(6):  # a browser that draws by software may take seconds to show the gizmo
        time.sleep(1.5)
        tab.mouse.move(*on_screen(tab, client.camera, start))
        tab.mouse.down()
        tab.mouse.move(*on_screen(tab, client.camera, end), steps=6)
        tab.mouse.up()
        with contextlib.suppress(AssertionError):
            until(lambda: name in page.setting.given, 6.0)
            break
    assert name in page.setting.given
    settled(page)
    assert 1.0 < page.setting.given[name] - page.subject.limits[name][0] < 8.0
    assert page.answer.force_N["ACL"] < before
    page._moving.value = False
    page._show_gizmos()


def test_two_tabs_show_the_same_after_reload_and_resize(tab, page, browser):
    other = browser.new_page(viewport={"width": 390, "height": 844})
    other.goto(page.link)
    enter(tab, page, "Flexion", 45)
    value = f"{page.answer.coordinates['superior']:.2f} mm"
    tab.set_viewport_size({"width": 1024, "height": 768})
    tab.reload()
    tab.get_by_text(value).wait_for(timeout=WAIT_MS)
    # On a telephone the curves are in the one panel there is, and the whole knee above it.
    other.get_by_text(value).wait_for(timeout=WAIT_MS)
    assert other.get_by_text("Curves", exact=True).is_visible()
    assert other.get_by_text("Ligament force, N", exact=True).count() > 0
    until(lambda: len(page._charts) == 2)
    other.close()
    until(lambda: len(page._charts) == 1)


def test_a_link_holds_the_setting(tab, page, browser):
    wanted = Setting.of({"flexion_deg": 20.0, "LCL.cut": 1.0})
    other = browser.new_page()
    other.goto(f"{page.link}&{wanted.link}")
    until(lambda: page.setting == wanted)
    settled(page)
    assert page._address.value == f"{page.link}&{wanted.link}"
    other.close()


def test_a_knee_file_is_saved_into_the_folder_and_reads_as_the_setting(tab, page):
    page.set("ACL.stiffness", 3000.0)
    settled(page)
    for kind in ("Knee", "Study", "Picture"):
        tab.get_by_text(kind, exact=True).click()
        until(lambda kind=kind: [*page.folder.path.glob(f"explore-{kind.lower()}-*")], 60.0)
    time.sleep(0.5)
    path = page.folder.path / "explore-knee-1.yaml"
    assert float(kj.load_knee(path).ligaments.stiffness[0]) == pytest.approx(3000.0)
    # Poses of the setting, from which a search begins at the knee as it was read.
    study = kj.read_study(page.folder.path / "explore-study-1.yaml")
    assert study.truth == {"ACL.stiffness": 3000.0} and not study.start
    begin = page.subject.limits["ACL.stiffness"][0]
    assert float(study.knee_at_start.ligaments.stiffness[0]) == pytest.approx(begin)


def test_a_server_that_starts_again_is_found_by_the_open_tab(tab, page):
    page._server._websock_server.disconnect_all_clients()
    time.sleep(0.5)
    page.set("flexion_deg", 33.0)
    settled(page)
    words = f"{page.answer.coordinates['adduction']:.2f} °"
    shown = tab.get_by_text(words).first
    shown.wait_for(timeout=WAIT_MS)
    assert shown.is_visible()


@pytest.mark.slow
def test_thousands_of_slider_moves_leave_no_memory_behind(page):
    """Settings are replaced faster than they are solved: what is old is dropped, and forgotten."""
    import psutil

    process, rng, kept = psutil.Process(), np.random.default_rng(0), []
    for move in range(5000):
        page.set("flexion_deg", rng.uniform(0.0, 120.0))
        if move % 4 == 0:
            until(lambda: page.answer.setting == page.setting)
        if move % 1000 == 999:
            settled(page)
            kept.append(process.memory_info().rss / 2**20)
    assert kept[-1] < kept[0] + 40.0, kept
