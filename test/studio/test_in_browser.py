"""The page in headless Chromium, as a person uses it."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

sync_api = pytest.importorskip('playwright.sync_api')
CHROMIUM = Path('/usr/bin/chromium')
MS = 600_000
ROOT = Path(__file__).parents[2]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.stated_requirement,
    pytest.mark.timeout(900),
    pytest.mark.skipif(not CHROMIUM.exists(), reason='chromium is not installed'),
]


@pytest.fixture(scope='module')
def address():
    """The address of a server that runs as a command, and ends with Ctrl-C."""
    words = [sys.executable, '-m', 'resting_aspects_ros.cli', 'studio', '--no-browser']
    path = os.pathsep.join([str(ROOT), os.environ.get('PYTHONPATH', '')])
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, text=True, env={**os.environ, 'PYTHONPATH': path}
    )
    try:
        yield process.stdout.readline().split()[-1]
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(600) == 0


@pytest.fixture(scope='module')
def browser():
    with sync_api.sync_playwright() as playwright:
        arguments = ['--no-sandbox', '--use-angle=swiftshader']
        made = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield made
        made.close()


@contextlib.contextmanager
def opened(browser, address, **options):
    """Open the page; nothing may be wrong on it, and no request may leave this computer."""
    context = browser.new_context(**options)
    page = context.new_page()
    page.set_default_timeout(MS)
    wrong, foreign = [], []
    page.on('console', lambda m: wrong.append(m.text) if m.type == 'error' else None)
    page.on('pageerror', lambda error: wrong.append(str(error)))
    page.on('request', lambda request: foreign.append(request.url))
    page.goto(address)
    yield page
    host = address.partition('//')[2].partition('/')[0]
    allowed = (f'http://{host}/', f'ws://{host}/', 'data:', 'blob:')
    assert not [url for url in foreign if not url.startswith(allowed)]
    assert not wrong
    context.close()


def choose(page, name='l_bracket'):
    page.locator('select[data-example=first]').first.select_option(name)
    done(page)


def done(page, drops='2,000'):
    page.locator('#panel-aspects .row .count', has_text=f'of {drops}').first.wait_for()


def share(page, row=0):
    return page.locator('#panel-aspects .row .number b').nth(row).inner_text()


def test_slider_changes_the_bars_and_a_reload_keeps_it(browser, address):
    with opened(browser, address) as page:
        choose(page)
        before = [share(page, k) for k in range(5)]
        width = page.locator('#panel-aspects .fill').first.evaluate('e => e.style.width')
        assert float(width[:-1]) == pytest.approx(float(before[0].split()[0]), abs=0.1)
        slider = page.locator('input[type=range][data-set="condition.restitution"]')
        slider.evaluate(
            "e => { e.value = 0.1; e.dispatchEvent(new Event('input', {bubbles: true})) }"
        )
        page.locator('[data-text=caption]', has_text='restitution 0.1').first.wait_for()
        assert [share(page, k) for k in range(5)] != before
        page.locator('.pick').nth(1).click()
        page.locator('[data-text=pickable]', has_text='pickable').first.wait_for()
        page.reload()
        done(page)
        field = page.locator('input[type=number][data-set="condition.restitution"]')
        assert field.input_value() == '0.1'
        assert page.locator('.pick').nth(1).get_attribute('aria-pressed') == 'true'


def test_dropped_file_and_its_3d_view(browser, address, tmp_path):
    path = tmp_path / 'My Crate.stl'
    trimesh.creation.box((10, 20, 30)).export(path)
    with opened(browser, address) as page:
        page.locator('#file').set_input_files(path)
        done(page)
        assert page.locator('#name').inner_text() == 'my_crate'
        view = page.locator('#stage canvas')
        assert view.bounding_box()['width'] > 200
        before = view.screenshot()
        page.locator('#panel-aspects .row').nth(2).click()
        assert 'aspect' in page.locator('#view-name').inner_text()
        page.wait_for_timeout(700)  # the animation of the view
        assert view.screenshot() != before
        # The view stays in sight.
        page.locator('#panel-aspects .row:visible').last.scroll_into_view_if_needed()
        assert page.locator('#stage').bounding_box()['y'] < 100
        (tmp_path / 'bad.stl').write_bytes(b'nothing')
        page.locator('#file').set_input_files(tmp_path / 'bad.stl')
        page.locator('#problem', has_text='bad.stl').wait_for()
        assert page.locator('#name').inner_text() == 'my_crate'


def test_one_body_of_a_file_and_traps_of_ones_own(browser, address, tmp_path):
    bodies = [trimesh.creation.box((10, 20, 30)), trimesh.creation.box((5, 6, 7))]
    bodies[1].apply_translation((50, 0, 0))
    trimesh.util.concatenate(bodies).export(tmp_path / 'two.stl')
    with opened(browser, address) as page:
        page.locator('#file').set_input_files(tmp_path / 'two.stl')
        page.locator('#problem', has_text='choose one').wait_for()
        page.locator('[data-again=body]').first.select_option('2: 5 x 6 x 7 mm')
        done(page)
        assert '5 x 6 x 7 mm' in page.locator('#facts').inner_text()
        assert not page.locator('#problem').is_visible()
        page.locator('#tab-track').click()
        proposed = page.locator('[data-set="trap.all"]', has_text='Change')
        proposed.click()
        page.get_by_label('Remove trap 1').wait_for()
        for kind in ('wiper', 'wiper'):  # the list is ready for the same kind again
            count = page.locator('[data-set="trap.remove"]').count()
            page.get_by_label('Add a trap').select_option(kind)
            page.locator('[data-set="trap.remove"]').nth(count).wait_for()
        page.locator('[data-set="trap.remove"]').last.click()
        page.locator('[data-set="trap.remove"]').nth(count).wait_for(state='detached')
        height = page.locator(f'input[type=number][id="trap.{count}.height"]')
        height.fill('4.5')
        page.locator('[data-slot=track]', has_text='height 4.5 mm').wait_for()


def test_keyboard_alone(browser, address):
    with opened(browser, address) as page:
        choose(page)
        page.locator('#tab-aspects').focus()
        page.keyboard.press('ArrowRight')
        assert page.locator('#tab-outlines').get_attribute('aria-selected') == 'true'
        page.locator('#panel-outlines table').first.wait_for()
        page.keyboard.press('Home')
        page.locator('input[type=range][data-set="condition.friction"]').focus()
        page.keyboard.press('ArrowRight')
        page.locator('[data-text=caption]', has_text='friction').first.wait_for()
        page.locator('.pick').first.focus()
        page.keyboard.press('Enter')
        page.locator('.pick[aria-pressed=true]').first.wait_for()
        # Every control has a name.
        unnamed = page.evaluate(
            """() => [...document.querySelectorAll('button, input, select, a')].filter((e) =>
                !e.hidden && !(e.getAttribute('aria-label') || e.labels?.length || e.innerText))
                .map((e) => e.outerHTML)"""
        )
        assert unnamed == []


def test_dark_telephone_needs_no_horizontal_scroll(browser, address):
    size = {'width': 390, 'height': 780}
    with opened(browser, address, viewport=size, color_scheme='dark') as page:
        choose(page)
        page.locator('.pick').first.click()
        for tab in page.locator('[role=tab]').all():
            tab.click()
            name = tab.get_attribute('data-tab')
            page.locator(f'[data-slot={name}] > *').first.wait_for(state='attached')
            assert page.evaluate('document.documentElement.scrollWidth') <= 390, name
        ground = page.evaluate('getComputedStyle(document.body).backgroundColor')
        assert sum(json.loads(f'[{ground[4:-1]}]')) < 200
