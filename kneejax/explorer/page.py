"""The page: sliders, curves and bars beside the knee."""

__all__ = ["Page"]

import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.explorer import panels
from kneejax.explorer.server import Latest
from kneejax.explorer.setting import Answer, Curves, Folder, Setting, Subject
from kneejax.explorer.solving import Solver
from kneejax.mechanics import NAMED_LOADS
from kneejax.report import BoneMesh, scenes
from kneejax.report.scene.drawing import SceneView, look_at
from kneejax.report.scene.scene import Scene

#: Points on each articular surface.
_POINTS = (28, 28)
#: A change of the same number within this time of the last is one step of undo, s.
_ONE_STEP_S = 1.5
_MOST_PAST = 1000
#: A setting that stays for so long is computed as the command line does, s.
_REST_S = 0.6
#: Width over height of a screen below which the panel lies at its foot; how much farther the knee
#: then is, times that; and how much lower the middle, of that way.
_NARROW, _FARTHER, _LOWER = 0.8, 0.7, 0.1


class Page:
    """One knee on one page; every tab shows the same.

    Attributes:
        setting: the latest one.
        answer: of the setting that is shown.
        curves: likewise; None until there are some.
        solved: set while nothing is left to solve.
    """

    def __init__(
        self, server: Any, subject: Subject, document: dict[str, Any], link: str = "",
        out: Path | None = None, measured: np.ndarray | None = None,
        bones: Sequence[BoneMesh] = (), first: str = "as read",
    ):  # fmt: skip
        """Show a knee as it is.

        Args:
            server: from `kneejax.explorer.serve`.
            subject: the knee and what can be set of it.
            document: of its knee file, for one that is saved.
            link: to the page.
            out: folder into which files are saved; None where none may be.
            measured: poses behind the curves, `(n, 6)`, degrees and mm.
            bones: meshes to show.
            first: what the knee as it is, is called in the curves: "stored fit" of a result.
        """
        self.subject, self.first, self._picked = subject, first, ""
        self.measured = np.empty((0, 6)) if measured is None else measured
        self.folder = None if out is None else Folder(out, subject, document, self.measured)
        self.setting, self.bones, self.link = Setting(), bones, link
        self._server, self._solver = server, Solver(subject)
        self._past: deque[Setting] = deque(maxlen=_MOST_PAST)
        self._changed = ("", 0.0)
        self._kept: tuple[Answer, Curves | None, Any] | None = None
        self._latest = Latest(self._solve, self._failed)
        self.solved = self._latest.settled
        self._drawing = SceneView(server.scene, self._clicked)
        self._ends = panels.Ends(server.scene, subject, self.set)
        self.answer = self._solver.unsolved()
        self._scene: Scene | None = None
        self._own: Curves | None = None
        self.curves: Curves | None = None
        self._sliders: dict[str, Any] = {}
        self._charts: dict[Any, panels.Charts] = {}
        self._test = ""
        self._build()
        server.on_client_connect(self._make_room)
        server.on_client_disconnect(lambda client: self._charts.pop(client.client_id, None))
        self._again()

    def stop(self) -> None:
        """End the thread and the server."""
        self._latest.end()
        self._server.stop()

    # What a person does.

    def set(self, name: str, number: float | None) -> None:
        """Another number of the setting."""
        with self._latest.lock:
            wanted, now = self.subject.within(self.setting.to(name, number)), time.monotonic()
            if wanted == self.setting:
                return
            # A slider that is dragged is one step, and so is each click on a button.
            dragged = name == self._changed[0] and not name.endswith(".cut")
            if not dragged or now - self._changed[1] > _ONE_STEP_S:
                self._past.append(self.setting)
            self._changed = name, now
            self._to(wanted)

    def go(self, setting: Setting) -> None:
        """Another setting, as a link or a button gives it; one step of undo."""
        with self._latest.lock:
            setting = self.subject.within(setting)
            if setting != self.setting:
                self._past.append(self.setting)
                self._to(setting)
        self._show_numbers()

    def undo(self) -> None:
        """The setting before the last change."""
        with self._latest.lock:
            if self._past:
                self._to(self._past.pop())
        self._show_numbers()

    def _to(self, setting: Setting) -> None:
        self.setting = setting
        self._latest.want()

    def _again(self) -> None:
        """Solve the same setting again: another test was chosen."""
        with self._latest.lock:
            self._to(self.setting)

    def _clicked(self, fibre: str) -> None:
        """A first click tells a fibre's force, and another one cuts or restores its ligament."""
        ligament = self._solver.owner[fibre]
        if fibre == self._picked and self._ligament.value == ligament:
            self._cut(ligament)
        self._picked, self._ligament.value = fibre, ligament
        self._show_numbers()
        self._show_answer()

    def _cut(self, ligament: str) -> None:
        is_cut = ligament in self.subject.cut_in(self.setting)
        self.set(f"{ligament}.cut", 0.0 if is_cut else 1.0)

    # What is solved: the latest setting, then its curves if it still is the latest.

    def _solve(self) -> None:
        latest, solver = self._latest, self._solver
        if self._own is None:
            compiling = latest.aside.submit(solver.ready)
            # Forces at the reference pose are those of no equilibrium.
            words, self._drawing.words = self._drawing.words, False
            self._pose(self.answer)
            self._drawing.words = words
            self._own = solver.curves(Setting())
            compiling.result()
            self._show_curves()
        with latest.lock:
            setting, test = self.setting, self._test
        self._pose(solver.answer(setting, self.curves or self._own))
        latest.go_on()
        latest.meanwhile(lambda progress: self.answer.slopes)
        self._show_bars()
        self.curves = latest.meanwhile(solver.curves, setting, test, self.curves)
        self._show_curves()
        latest.rest(_REST_S)
        sure = latest.meanwhile(solver.answer, setting, None, True)
        if solver.differs(self.answer, sure):
            solver.go_on_from(sure)
            self._pose(sure)
            self._show_bars()
            self.curves = latest.meanwhile(solver.curves, setting, test, None)
            self._show_curves()

    def _failed(self) -> None:
        self._status.content = panels.sentence("This setting could not be computed.", True)

    def _pose(self, answer: Answer) -> None:
        if answer.found is not None or self._scene is None:
            first = self._scene is None
            self._scene = scenes(answer.knee, answer.state, self.bones, _POINTS)[0]
            if first:
                look_at(self._server, self._scene)
                for client in self._server.get_clients().values():
                    self._aim(client)
        self.answer = answer
        setting, kept = answer.setting, None if self._kept is None else self._kept[2]
        gone = self.subject.cut_in(setting)
        with self._server.atomic():
            self._drawing.show(
                self._scene, self.subject.loads(setting), kept, answer.found is None,
                [fibre for fibre, owner in self._solver.owner.items() if owner in gone],
            )  # fmt: skip
            self._show_answer()
        self._server.flush()

    # What the page shows.

    def _build(self) -> None:
        gui = self._server.gui
        self._theme(False)
        gui.set_panel_label(f"{self.subject.knee.name}, {self.subject.knee.side} knee")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(380)
        self._slider("flexion_deg", "Flexion, °", 1.0)
        self._status = gui.add_html("")
        with gui.add_folder("Loads"):
            for name, load in NAMED_LOADS.items():
                unit = load.unit.replace(" ", "")
                label = f"{load.positive.capitalize()}, {unit}"
                self._slider(name, label, 0.1 if unit == "Nm" else 1.0)
            if "quadriceps_N" in self.subject.limits:
                self._slider("quadriceps_N", "Quadriceps, N", 1.0)
        with gui.add_folder("Ligament"):
            self._build_ligament(gui)
        with gui.add_folder("Compare and save"):
            self._build_saving(gui)
        with gui.add_folder("Look", expand_by_default=False):
            self._build_look(gui)
        panel = gui.add_panel()
        panel.dock_below(gui.main_panel)
        self._add_charts(None, gui, panel)
        self._show_numbers()
        self._show_answer()

    def _theme(self, dark: bool) -> None:
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=dark,
                                         control_width="large", brand_color=(0, 114, 178))

    def _build_ligament(self, gui: Any) -> None:
        self._ligament = gui.add_dropdown("Ligament", self.subject.ligaments)
        self._stiffness = gui.add_slider("Stiffness, % of own", 10.0, 400.0, 1.0, 100.0)
        self._strain = gui.add_slider("Reference strain, %", -30.0, 30.0, 0.1, 0.0)
        self._cutting = gui.add_button("Cut")
        self._moving = gui.add_checkbox("Move its ends", False)
        self._ligament.on_update(lambda _: self._show_numbers())
        self._moving.on_update(lambda _: self._show_gizmos())
        self._cutting.on_click(lambda _: (self._cut(self._ligament.value), self._show_numbers()))

        def stiffness() -> tuple[str, float]:
            name = f"{self._ligament.value}.stiffness"
            return name, self.subject.limits[name][0] * self._stiffness.value / 100.0

        def strain() -> tuple[str, float]:
            return f"{self._ligament.value}.reference_strain", self._strain.value / 100.0

        self._moved_by_hand(self._stiffness, stiffness)
        self._moved_by_hand(self._strain, strain)

    def _moved_by_hand(self, slider: Any, number: Callable[[], tuple[str, float]]) -> None:
        """Set a number whenever a person, and not the page itself, moves a slider."""

        @slider.on_update
        def _(event: Any) -> None:
            if event.client is not None:
                self.set(*number())

    def _build_saving(self, gui: Any) -> None:
        actions = {"Undo": self.undo, "Reset": lambda: self.go(Setting()), "Keep as A": self.keep,
                   "Swap with A": self.swap}  # fmt: skip
        buttons = gui.add_button_group("Setting", tuple(actions))
        buttons.on_click(lambda event: actions[event.target.value]())
        self._address = gui.add_text("Link", "", disabled=True)
        folder = self.folder
        if folder is None:
            gui.add_markdown("To save files, start with `--out FOLDER`.")
        else:
            save = {"Knee": lambda _: folder.knee(self.setting),
                    "Study": lambda _: folder.study(self.setting),
                    "Picture": folder.picture}  # fmt: skip
            files = gui.add_button_group("Save", tuple(save))
            files.on_click(lambda event: self._saved(save[event.target.value], event.client))

    def _build_look(self, gui: Any) -> None:
        labels, dark = gui.add_checkbox("Labels", True), gui.add_checkbox("Dark", False)
        strain = gui.add_slider("Strain colours to, %", 1.0, 20.0, 1.0, 100 * self._drawing.strain)
        pressure = gui.add_slider("Pressure to, MPa", 1.0, 20.0, 1.0, self._drawing.pressure)
        dark.on_update(lambda _: self._theme(dark.value))

        def changed(_: Any) -> None:
            own = self._drawing
            own.words, own.strain, own.pressure = labels.value, strain.value / 100, pressure.value
            self._again()

        for one in (labels, strain, pressure):
            one.on_update(changed)

    def _slider(self, name: str, label: str, step: float) -> None:
        own, low, high = self.subject.limits[name]
        handle = self._server.gui.add_slider(label, low, high, step, own)
        self._sliders[name] = handle
        self._moved_by_hand(handle, lambda: (name, handle.value))

    def _show_numbers(self) -> None:
        """Put every slider where the setting is."""
        setting, name = self.setting, self._ligament.value
        for one, handle in self._sliders.items():
            handle.value = self.subject.value(setting, one)
        stiffness = f"{name}.stiffness"
        own = self.subject.limits[stiffness][0]
        self._stiffness.value = 100.0 * self.subject.value(setting, stiffness) / own
        self._strain.value = 100.0 * self.subject.value(setting, f"{name}.reference_strain")
        self._cutting.label = "Restore" if name in self.subject.cut_in(setting) else "Cut"
        self._show_gizmos()

    def _show_gizmos(self) -> None:
        name = self._ligament.value if self._moving.value else ""
        self._ends.show(name, self.setting, self.answer)

    def _show_answer(self) -> None:
        own, fibres = self._drawing, () if self._scene is None else self._scene.fibres
        picked = [x for x in fibres if x.name == self._picked]
        self._status.content = panels.numbers(self.answer, own.strain, own.pressure, picked)
        query = self.answer.setting.link
        self._address.value = f"{self.link}&{query}" if query else self.link

    def _show_bars(self) -> None:
        for charts in (*self._charts.values(),):
            charts.explain(self.answer)

    def _show_curves(self) -> None:
        kept = self._kept[1] if self._kept else None
        every = {self.first: self._own, "A": kept, "now": self.curves or self._own}
        with self._server.atomic():
            for charts in (*self._charts.values(),):
                charts.draw(every)

    def _make_room(self, client: Any) -> None:
        """On a narrow screen what stands below the panel elsewhere is in it."""
        camera, own = client.camera, self._server.initial_camera
        if camera.aspect >= _NARROW:
            return
        self._aim(client)

        @camera.on_update
        def _(_: Any) -> None:
            if np.allclose(camera.position, own.position):  # as a page begins, or is told to
                self._aim(client)

        tabs = client.gui.add_tab_group(order=self._status.order + 0.5)
        self._add_charts(client.client_id, client.gui, tabs)
        self._show_curves()
        self._show_bars()

    def _aim(self, client: Any) -> None:
        """Look at the whole knee: from farther and lower where the panel lies upon it."""
        camera, own = client.camera, self._server.initial_camera
        away, middle = np.array(own.position) - own.look_at, np.array(own.look_at)
        if camera.aspect < _NARROW:
            away = _FARTHER / camera.aspect * away
            middle = middle - [0.0, _LOWER * np.linalg.norm(away), 0.0]
        camera.position, camera.look_at, camera.fov = middle + away, middle, own.fov

    def _add_charts(self, key: Any, gui: Any, tabs: Any) -> None:
        self._charts[key] = panels.Charts(gui, tabs, self._solver, self.measured, self._ask)

    def _ask(self, test: str) -> None:
        """Another test of laxity, or none."""
        self._test = test
        self._again()

    # Settings side by side, and files.

    def keep(self) -> None:
        """Keep what is shown as A, behind what comes."""
        self._kept = self.answer, self.curves, self._scene
        self._again()

    def swap(self) -> None:
        """Show A, and keep what was shown."""
        if self._kept is not None:
            setting = self._kept[0].setting
            self._kept = self.answer, self.curves, self._scene
            self.go(setting)

    def _saved(self, save: Callable[[Any], Path], client: Any) -> None:
        try:
            words = f"Written: {save(client)}"
        except (OSError, ValueError) as problem:
            words = f"Not written: {problem}"
        client.add_notification("Save", words, auto_close_seconds=8.0)
