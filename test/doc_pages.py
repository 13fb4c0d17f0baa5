"""Read the pages of the documentation, for the tests that hold them to the code."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# Every page, by its path from the root of the repository.
PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding='utf-8')
    for path in [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted(ROOT.glob('docs/**/*.md'))]
}


def code_blocks(page, *languages):
    """Return language and text of the code blocks of a page, in order; of some languages."""
    found = re.findall(r'^```(\w+)\n(.*?)^```$', PAGES[page], re.MULTILINE | re.DOTALL)
    return [(language, text) for language, text in found if language in languages]


def code(page, language):
    """Return the texts of the code blocks of a language."""
    return [text for _, text in code_blocks(page, language)]


def section(page, heading):
    """Return the text below a heading, up to the next heading of the same level or above."""
    level = heading.partition(' ')[0]
    _, found, text = PAGES[page].partition(f'\n{heading}\n')
    assert found, f'{page} has no heading {heading!r}'
    return re.split(rf'^#{{1,{len(level)}}} ', text, maxsplit=1, flags=re.MULTILINE)[0]


def first_cells(text):
    """Return the first cells of the rows of the tables in a text, without the header rows."""
    rows = re.findall(r'^\| ?(.*?) ?\|.*\n(?!\|--)', text + '\n', re.MULTILINE)
    return [cell for cell in rows if not cell.startswith('--')]


def anchors(page):
    """Return the names of the headings of a page, as GitHub makes them for links."""
    text = re.sub(r'^```.*?^```$', '', PAGES[page], flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r'^#+ (.*)$', text, re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}
