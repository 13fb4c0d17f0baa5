"""How long the page for designers takes to answer, in headless Chromium."""

import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import trimesh
from playwright.sync_api import Page, sync_playwright
from rich.progress import track
from validation.document import paragraphs, table

import resting_aspects_ros as ra
from bench.case import EXAMPLE

CHROMIUM = '/usr/bin/chromium'
REPEATS = 5
# Minimum number of triangles of the file, and drops of an answer.
TRIANGLES, DROPS = 5000, 2000
# Time in which a person finds the file, s.
PAUSE = 5.0
# Restitutions to which the slider is moved one after the other.
STEPS = [0.30 + 0.01 * k for k in range(20)]
# Moves the slider, and returns the ms until the caption and the bars are those of its value.
MOVE = """async (value) => {
  const slider = document.querySelector('input[type=range][data-set="condition.restitution"]')
  const caption = document.querySelector('[data-text=caption]')
  const count = () => document.querySelector('#panel-aspects .row .count').innerText
  const begin = performance.now()
  slider.value = value
  slider.dispatchEvent(new Event('input', {bubbles: true}))
  const text = 'restitution ' + value
  while (!caption.innerText.includes(text) || !count().includes('of DROPS'))
    await new Promise((resolve) => requestAnimationFrame(resolve))
  return performance.now() - begin
}""".replace('DROPS', f'{DROPS:,}')


def studio() -> Iterator[str]:
    """Measure the start, an upload, and changes of a slider."""
    part = ra.load_part(EXAMPLE)
    mesh = trimesh.Trimesh(1000 * part.vertices, part.faces)
    while len(mesh.faces) < TRIANGLES:
        mesh = mesh.subdivide()
    times: dict[str, list[float]] = {'page': [], 'file': [], 'slider': []}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = Path(folder) / 'bracket.stl'
        mesh.export(path)
        arguments = ['--no-sandbox', '--use-angle=swiftshader']
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        for _ in track(range(REPEATS), 'studio', transient=True):
            page = browser.new_page()
            begin = time.perf_counter()
            words = [sys.executable, '-m', 'resting_aspects_ros.cli', 'studio', '--no-browser']
            server = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
            assert server.stdout
            try:
                page.goto(server.stdout.readline().split()[-1])
                times['page'].append(time.perf_counter() - begin)
                time.sleep(PAUSE)
                _measure(page, path, times)
            finally:
                page.close()
                server.send_signal(signal.SIGINT)
                server.wait()
        browser.close()
    yield from paragraphs(
        '## The page for designers',
        'In headless Chromium, which draws without a GPU. *Page*: from the command `studio` to '
        f'the loaded page. *File*: from the drop of an STL file of {len(mesh.faces)} triangles, '
        f'{EXAMPLE} with finer triangles, {PAUSE:g} s after the page, to its '
        f'aspects with {DROPS} drops and pictures. '
        f'*Slider*: from a change of the restitution to the bars with {DROPS} drops, '
        f'{len(STEPS)} changes in each of {REPEATS} runs.',
    )
    rows = [
        [name, f'{statistics.median(each):.2f}', f'{max(each):.2f}', aim]
        for (name, each), aim in zip(times.items(), ('1', '2', '0.3'), strict=True)
    ]
    yield from table(['', 'median (s)', 'longest (s)', 'aim'], rows, numbers=True)


def _measure(page: Page, path: Path, times: dict[str, list[float]]) -> None:
    begin = time.perf_counter()
    page.locator('#file').set_input_files(path)
    page.locator('#panel-aspects .row .count', has_text=f'of {DROPS:,}').first.wait_for()
    times['file'].append(time.perf_counter() - begin)
    times['slider'] += [page.evaluate(MOVE, f'{value:.2g}') / 1000 for value in STEPS]
