"""The pages of the documentation: links, length and place."""

import re

from doc_pages import PAGES, ROOT, anchors, first_cells, section

MAX_README = 150  # lines


def links(page):
    """The targets of the relative links of a page."""
    prose = re.sub(r'^```.*?^```$', '', PAGES[page], flags=re.MULTILINE | re.DOTALL)
    found = re.findall(r'\]\(([^)\s]+)\)', prose)
    return [link for link in found if not re.match('https?:', link)]


def test_every_link_leads_to_a_file_or_heading():
    broken = []
    for page, link in ((each, link) for each in PAGES for link in links(each)):
        path, _, heading = link.partition('#')
        target = ((ROOT / page).parent / path).resolve() if path else ROOT / page
        name = target.relative_to(ROOT).as_posix()
        if not target.exists() or (heading and heading not in anchors(name)):
            broken.append((page, link))
    assert broken == []


def test_the_readme_is_short():
    assert len(PAGES['README.md'].splitlines()) <= MAX_README


def test_the_index_leads_to_every_page():
    listed = {f'docs/{link.partition("#")[0]}' for link in links('docs/index.md')}
    assert listed == set(PAGES) - {'README.md', 'CONTRIBUTING.md', 'docs/index.md'}
    assert {'docs/index.md', 'CONTRIBUTING.md'} <= set(links('README.md'))


def test_the_files_that_contributors_are_sent_to_exist():
    names = re.findall(r'`([\w./]+/[\w./]*)`', PAGES['CONTRIBUTING.md'])
    found = [name for name in names if not name.startswith('.')]
    places = [ROOT, ROOT / 'resting_aspects_ros']
    assert [n for n in found if not any((place / n).exists() for place in places)] == []


def test_every_room_is_on_the_map():
    package = ROOT / 'resting_aspects_ros'
    rooms = {path.parent.name for path in package.glob('*/__init__.py')}
    listed = {cell.strip('`') for cell in first_cells(section('CONTRIBUTING.md', '## Packages'))}
    one_module = {'run_logs'}
    assert listed == rooms | one_module | {'(no room)'}
