"""A room: the settings, the parts and the results of one tab of the browser, and its threads.

The event loop changes settings and never computes. A thread of the room works on the newest
settings; a task sees in `stopped` that there are newer ones, so that no queue builds up. Another
thread shows the newest settings, also while a task is done.
"""

import dataclasses
import logging
import shutil
import threading
import time
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from resting_aspects_ros.api.conditions import shipped_surfaces
from resting_aspects_ros.errors import (
    InvalidValueError,
    RestingAspectsError,
    RestingAspectsWarning,
    StoppedError,
    one_line,
    shown,
)
from resting_aspects_ros.part.loading import CHOOSE, SeparateBodiesError
from resting_aspects_ros.part.mesh_files import MESH_FORMATS
from resting_aspects_ros.part.part import DEFAULT_UNIT, UNITS
from resting_aspects_ros.report.page import Text, items_html
from resting_aspects_ros.simulation.workers import Workers
from resting_aspects_ros.studio.opening import Opener
from resting_aspects_ros.studio.page import controls_html, examples
from resting_aspects_ros.studio.rows import Opened, Source
from resting_aspects_ros.studio.settings import (
    PRECISIONS,
    Settings,
    changed,
    condition_sliders,
    control_values,
    dimension_sliders,
    surroundings_choices,
)
from resting_aspects_ros.studio.tabs import TABS
from resting_aspects_ros.studio.work import Publish, Work

# Results that are kept for when settings are chosen again.
KEPT = 8
# A task is stopped for newer settings only after it has worked so long, s: while a slider is
# moved, its bars are those of whole runs.
UNDISTURBED = 0.15
SIDES = ('first', 'second')


class Room:
    """The state of a tab of the browser.

    Parameters
    ----------
    workers : Workers
        Of all rooms.
    opener : Opener
    publish : callable
        Called from any thread.
    folder : Path
        For the files of the room; it is removed at the end.
    clock : callable
        Returns seconds.
    """

    def __init__(
        self,
        workers: Workers,
        opener: Opener,
        publish: Publish,
        folder: Path,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.settings = Settings()
        self.folder = folder
        self._workers, self._opener, self._clock = workers, opener, clock
        self._publish = publish
        self._parts: dict[str, Opened | None] = dict.fromkeys(SIDES)
        self._files: dict[str, Source] = {}  # the newest, even if its body is not chosen
        self._opening = dict.fromkeys(SIDES, 0)  # numbers of the newest requests
        self._changed = threading.Condition()
        self._requested, self._closed = 0, False
        self._number: int | None = None  # of the last change
        self._results: OrderedDict[Any, Any] = OrderedDict()
        self._revision = 1  # of the settings
        self._threads = [
            threading.Thread(target=task, name='room', daemon=True)
            for task in (self._run, self._display)
        ]
        for thread in self._threads:
            thread.start()

    # -- What the event loop calls ------------------------------------------------------------

    def change(self, name: str, value: Any, number: int | None = None) -> None:
        """Change a setting; raises InvalidValueError.

        ``number`` is that of the change, with which the browser knows its answer.
        """
        with self._changed:
            self.settings = changed(self.settings, name, value)
            # Without "live", changed conditions wait for the button.
            if self.settings.live or name in ('tab', 'more') or name.startswith('pickable'):
                self._wake()
            else:
                self._publish('progress', {'text': 'changed; press "Drop now"'})
            self._number = number
            self._revise()

    def work_now(self) -> None:
        """Work on the settings, even if they are not live."""
        with self._changed:
            self._wake()

    def open(self, source: Source, side: str = 'first') -> None:
        """Open a part, which replaces the one of that side as soon as it is known to be good."""
        with self._changed:
            self._opening[side] += 1
            number = self._opening[side]
        threading.Thread(
            target=self._open, args=(source, side, number), name='opening', daemon=True
        ).start()

    def open_example(self, name: Any, side: str = 'first') -> None:
        """Open an example part; raises InvalidValueError."""
        if name not in examples():
            raise InvalidValueError(
                f'invalid example {shown(name)}: expected one of {", ".join(examples())}'
            )
        self.open(Source(name), side)

    def open_again(self, name: Any, value: Any, side: str = 'first') -> None:
        """Open the file of a side in another unit or as another body; 0: all bodies.

        Raises InvalidValueError.
        """
        source = self._files.get(side)
        is_good = value in tuple(UNITS) if name == 'unit' else type(value) is int
        if name not in ('unit', 'body') or not is_good or source is None or source.path is None:
            raise InvalidValueError(
                f'invalid choice {shown(value)}: expected a unit or the number of a body, for a '
                'mesh file'
            )
        changes: dict[str, Any] = {name: value or None}
        self.open(dataclasses.replace(source, **changes), side)

    def cancel(self) -> None:
        """Cancel the opening of parts."""
        with self._changed:
            for side in SIDES:
                self._opening[side] += 1
        self._publish('opening', {'text': ''})

    def forget_second(self) -> None:
        """Compare the part with itself again."""
        with self._changed:
            self._opening['second'] += 1  # what is being opened comes too late
            self._parts['second'] = None
            self._files.pop('second', None)
        self._publish('opening', {'text': ''})
        self._publish('second', {'unit': '', 'bodies': [], 'body': 0})
        self.work_now()

    def close(self) -> None:
        """End the thread and remove the files."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self.cancel()
        for thread in self._threads:
            thread.join()
        shutil.rmtree(self.folder, ignore_errors=True)

    def work(self, stopped: Callable[[], bool] | None = None) -> Work:
        """Return a task with the current settings; raises InvalidValueError without a part."""
        with self._changed:
            settings, opened, second = self.settings, self._parts['first'], self._parts['second']
        if opened is None:
            raise InvalidValueError('missing part: open a file or an example first')
        stopped = stopped or (lambda: self._closed)

        def keep(key: Any, make: Callable[[], Any]) -> Any:
            return self._kept(key, make, stopped)

        return Work(
            settings, opened, second, self._workers, stopped, self._publish, keep, self.folder
        )

    # -- The threads --------------------------------------------------------------------------

    def _revise(self) -> None:
        self._revision += 1
        self._changed.notify_all()

    def _display(self) -> None:
        shown = 0
        while True:
            with self._changed:
                while not self._closed and self._revision == shown:
                    self._changed.wait()
                if self._closed:
                    return
                shown = self._revision
            with self._reported(''):
                self._show_settings()

    def _wake(self) -> None:
        self._requested += 1
        self._changed.notify_all()

    def _run(self) -> None:
        done = 0
        while True:
            with self._changed:
                while not self._closed and self._requested == done:
                    self._changed.wait()
                if self._closed:
                    return
                done = self._requested
                has_part = self._parts['first'] is not None
            if has_part:
                self._do(done)

    def _do(self, number: int) -> None:
        begin = self._clock()

        def stopped() -> bool:
            newer = self._requested != number and self._clock() - begin >= UNDISTURBED
            return newer or self._closed

        with self._reported('problem') as notes:
            work = self.work(stopped)
            TABS[work.settings.tab].show(work)
            texts = [*work.opened.part.warnings, *notes]
            self._publish('notes', {'html': items_html([_note(text) for text in texts])})
        if self._requested == number:
            self._publish('progress', {'text': ''})

    def _open(self, source: Source, side: str, number: int) -> None:
        def newer() -> bool:
            return self._closed or self._opening[side] != number

        def step(text: str) -> None:
            if not newer():
                self._publish('opening', {'text': text})

        with self._reported('problem'):
            try:
                opened = self._opener.open(source, step, newer)
            except SeparateBodiesError as error:
                if not newer():
                    self._offer(side, source, ['choose ...', *error.bodies])
                raise
            with self._changed:
                if newer():
                    return
                self._parts[side] = opened
                bodies = opened.part.bodies
                self._offer(side, opened.source, ['all bodies', *bodies] if bodies else [])
                if side == 'first':
                    self.settings = self.settings.for_part(len(opened.names))
                    self._show_part(opened)
                else:
                    # What another part changes shows only under the same conditions.
                    self.settings = self.settings.same_conditions()
                self._revise()
                self._wake()
        if not newer():
            self._publish('opening', {'text': ''})

    @contextmanager
    def _reported(self, topic: str) -> Iterator[list[str]]:
        """Publish an error as a sentence if there is a topic; collect warnings of this thread."""
        with collected_warnings() as notes:
            problem = ''
            try:
                yield notes
            except StoppedError:
                pass
            except RestingAspectsError as error:
                problem = str(error)
            except Exception as error:
                logging.getLogger(__name__).exception('a tab failed')
                problem = one_line(f'this could not be made ({type(error).__name__}: {error})')
            if topic:
                self._publish(topic, {'text': _sentence(problem)})

    def _kept(self, key: Any, make: Callable[[], Any], stopped: Callable[[], bool]) -> Any:
        """Return the value of a key, or make it, and keep it if it is complete."""
        with self._changed:
            if key in self._results:
                self._results.move_to_end(key)
                return self._results[key]
        value = make()
        if getattr(value, 'complete', True) and not stopped():
            with self._changed:
                self._results[key] = value
                while len(self._results) > KEPT:
                    self._results.popitem(last=False)
        return value

    # -- What is shown ------------------------------------------------------------------------

    def _offer(self, side: str, source: Source, bodies: Sequence[str]) -> None:
        """Offer the units and the bodies of a file."""
        self._files[side] = source
        has_unit = source.path is None or source.path.suffix[1:] not in MESH_FORMATS
        unit = '' if has_unit else source.unit or DEFAULT_UNIT
        self._publish(side, {'unit': unit, 'bodies': bodies, 'body': source.body or 0})

    def _show_part(self, opened: Opened) -> None:
        self._publish(
            'part',
            {
                'name': opened.part.name,
                'file': opened.source.given,
                'facts': ' · '.join(f'{label}: {value}' for label, value in opened.facts),
            },
        )
        self._publish('aspects', {'html': opened.rows})
        self._publish('scene', {'scene': opened.scene})
        self._publish('bars', {'rows': []})

    def _show_settings(self) -> None:
        with self._changed:
            settings, opened, number = self.settings, self._parts['first'], self._number
        surfaces = shipped_surfaces()
        html = controls_html(
            'conditions',
            surfaces=surfaces.names(),
            sliders=condition_sliders(settings.conditions),
            surroundings=surroundings_choices(),
            dimensions=dimension_sliders(settings),
            precisions=PRECISIONS,
        )
        self._publish('conditions', {'html': html})
        self._publish('resembles', {'text': _resembles(settings.conditions.surface)})
        if opened is not None:
            controls = TABS[settings.tab].controls(settings, opened)
            self._publish(f'{settings.tab}-controls', {'html': controls})
        message = {'tab': settings.tab, 'values': dict(control_values(settings))}
        self._publish('values', message if number is None else {**message, 'number': number})


def _resembles(surface: str) -> str:
    """Return what a surface resembles: the first clause of its source."""
    if not surface:
        return 'Own conditions.'
    return _sentence(shipped_surfaces().source(surface).partition('. ')[0].partition(': ')[0])


def _note(text: str) -> Text:
    return Text(_sentence(text), 'note')


def _sentence(text: str) -> str:
    if not text:
        return ''
    text = text.replace(CHOOSE, '')  # the page has a list
    return f'{text[0].upper()}{text[1:]}{"" if text.endswith((".", "?")) else "."}'


# -- Warnings -------------------------------------------------------------------------------------


_local = threading.local()


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Collect the warnings of the suite in this thread; see route_warnings."""
    _local.notes = notes = list[str]()
    try:
        yield notes
    finally:
        _local.notes = None


def route_warnings() -> None:
    """Pass each warning of the suite to the room in whose thread it occurs.

    The filters and the handler of warnings belong to the whole process, so that they cannot be
    set for a thread.
    """
    before = warnings.showwarning

    def show(message: Any, category: Any, *where: Any, **more: Any) -> None:
        notes = getattr(_local, 'notes', None)
        if notes is None or not issubclass(category, RestingAspectsWarning):
            before(message, category, *where, **more)
        elif str(message) not in notes:
            notes.append(str(message))

    warnings.simplefilter('always', RestingAspectsWarning)
    warnings.showwarning = show
