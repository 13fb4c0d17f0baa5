"""Texts are plain technical English: constructions that readers stumbled over do not come back."""

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ENDINGS = {
    '.py', '.md', '.msg', '.srv', '.action', '.cpp', '.js', '.yaml', '.toml', '.xml', '.in', '.cfg'
}  # fmt: skip
# Each with what to write instead.
CONSTRUCTIONS = {
    r'allowed (is|are|only)\b': 'invalid <name> <value>: expected <what>',
    r'heeded': 'respected',
    r'\bwho(ever)? (asks|comes|hears|reads|takes|wants|waits|writes)\b': 'a user',
    r'\bto be had\b': 'available',
    r'\bof which it\b': 'name the thing again',
    r'\b(most|least)_(?!squares)[a-z]': 'MAX_, MIN_, max_, min_',
    r'\b(nobody|somebody|whoever)\b': 'no client, a user',
    r'\bbegun\b': 'started',
    r'\btold\b': 'notified, reported, distinguished',
    r'\bwhatever\b': 'regardless of, any',
    r'\bunder way\b': 'active, running',
    r'\bthat which\b': 'name the thing',
    r'\bwhole number\b': 'an integer',
    r'\blikewise\b': 'the same',
    r'\bheld against\b': 'compared with',
    r'\bas (its|their) own\b': 'its',
    r'\bso many\b': 'this number of, or the name of the number',
    r'\bclass(es)? (that )?(is|are) off\b': 'deviates',
    r'\bis no (group|known|longer one|terminal)\b': 'is not a',
    r'\bone alone\b': 'a single one',
    r'\balso (if|none)\b': 'even if, including none',
}
PATTERNS = {re.compile(each, re.IGNORECASE): better for each, better in CONSTRUCTIONS.items()}


def texts():
    """Name and text of each file of the project."""
    names = subprocess.run(
        ['git', 'ls-files'], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    for name in names:
        path = ROOT / name
        if path != Path(__file__) and (path.suffix in ENDINGS or path.name == 'Makefile'):
            yield name, path.read_text('utf-8')


def constructions(text):
    """Each construction in a text with its line, and what to write instead."""
    for pattern, better in PATTERNS.items():
        for match in pattern.finditer(text):
            yield text.count('\n', 0, match.start()) + 1, match[0], better


def odd_lines():
    for name, text in texts():
        for number, found, better in constructions(text):
            yield f'{name}:{number}: {found!r}, write: {better}'


def test_no_odd_construction_is_left():
    assert list(odd_lines()) == []
    assert list(constructions('Who asks hears of it'))
