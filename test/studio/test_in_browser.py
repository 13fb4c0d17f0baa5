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


def done(page):
    page.locator('#panel-aspects .row .count', has_text='of 2,000').first.wait_for()


def shares(page):
    return page.locator('#panel-aspects .row .number b').all_inner_texts()


def test_changes_by_mouse_and_keyboard_outlive_a_reload(browser, address):
    with opened(browser, address) as page:
        choose(page)
        before = shares(page)
        slider = page.locator('input[type=range][data-set="condition.restitution"]')
        slider.evaluate(
            "e => { e.value = 0.1; e.dispatchEvent(new Event('input', {bubbles: true})) }"
        )
        page.locator('[data-text=caption]', has_text='restitution 0.1').first.wait_for()
        assert shares(page) != before
        page.locator('.pick').nth(1).click()
        page.locator('[data-text=pickable]', has_text='pickable').first.wait_for()
        page.locator('#tab-aspects').focus()
        page.keyboard.press('ArrowRight')
        assert page.locator('#tab-outlines').get_attribute('aria-selected') == 'true'
        page.locator('#panel-outlines table').first.wait_for()
        page.keyboard.press('Home')
        page.reload()
        done(page)
        field = page.locator('input[type=number][data-set="condition.restitution"]')
        assert field.input_value() == '0.1'
        assert page.locator('.pick').nth(1).get_attribute('aria-pressed') == 'true'
        # Every control has a name.
        unnamed = page.evaluate(
            """() => [...document.querySelectorAll('button, input, select, a')].filter((e) =>
                !e.hidden && !(e.getAttribute('aria-label') || e.labels?.length || e.innerText))
                .map((e) => e.outerHTML)"""
        )
        assert unnamed == []


def test_dropped_file_its_3d_view_and_its_traps(browser, address, tmp_path):
    small = trimesh.creation.box((5, 6, 7)).apply_translation((50, 0, 0))
    bodies = trimesh.util.concatenate([trimesh.creation.box((10, 20, 30)), small])
    bodies.export(tmp_path / 'My Crates.stl')
    with opened(browser, address) as page:
        page.locator('#file').set_input_files(tmp_path / 'My Crates.stl')
        page.locator('#problem', has_text='choose one').wait_for()
        page.locator('[data-again=body]').first.select_option('2: 5 x 6 x 7 mm')
        done(page)
        assert page.locator('#name').inner_text() == 'my_crates'
        assert not page.locator('#problem').is_visible()
        view = page.locator('#stage canvas')
        before = view.screenshot()
        page.locator('#panel-aspects .row').nth(2).click()
        page.wait_for_timeout(700)  # the animation of the view
        assert view.screenshot() != before
        # The view stays in sight.
        page.locator('#panel-aspects .row:visible').last.scroll_into_view_if_needed()
        assert page.locator('#stage').bounding_box()['y'] < 100
        page.locator('#tab-track').click()
        page.locator('[data-set="trap.all"]', has_text='Change').click()
        page.get_by_label('Remove trap 1').wait_for()
        traps = page.locator('[data-set="trap.remove"]')
        for _ in range(2):  # the list is ready for the same kind again
            count = traps.count()
            page.get_by_label('Add a trap').select_option('wiper')
            traps.nth(count).wait_for()
        traps.last.click()
        traps.nth(count).wait_for(state='detached')
        page.locator(f'input[type=number][id="trap.{count}.height"]').fill('4.5')
        page.locator('[data-slot=track]', has_text='height 4.5 mm').wait_for()


def test_dark_telephone_needs_no_horizontal_scroll(browser, address):
    size = {'width': 390, 'height': 780}
    with opened(browser, address, viewport=size, color_scheme='dark') as page:
        choose(page, 'hex_nut')
        page.locator('.pick').first.click()
        for tab in page.locator('[role=tab]').all():
            tab.click()
            name = tab.get_attribute('data-tab')
            page.locator(f'[data-slot={name}] > *').first.wait_for(state='attached')
            assert page.evaluate('document.documentElement.scrollWidth') <= 390, name
        ground = page.evaluate('getComputedStyle(document.body).backgroundColor')
        assert sum(json.loads(f'[{ground[4:-1]}]')) < 200
