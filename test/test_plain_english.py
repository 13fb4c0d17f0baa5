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
    r'to be had\b': 'available',
    r'of which it\b': 'name the thing again',
    r'\b(most|least)_(?!squares)[a-z]': 'MAX_, MIN_, max_, min_',
    r'\b(nobody|somebody|whoever)\b': 'no client, a user',
    r'\bbegun\b': 'started',
    r'\btold\b': 'notified, reported, distinguished',
    r'whatever\b': 'regardless of, any',
    r'under way\b': 'active, running',
    r'that which\b': 'name the thing',
    r'whole number\b': 'an integer',
    r'likewise\b': 'the same',
    r'held against\b': 'compared with',
    r'\bas (its|their) own\b': 'its',
    r'\bso many\b': 'this number of, or the name of the number',
    r'\bclass(es)? (that )?(is|are) off\b': 'deviates',
    r'\bis no (group|known|longer one|terminal)\b': 'is not a',
    r'\bone alone\b': 'a single one',
    r'\balso (if|none)\b': 'even if, including none',
}


def constructions(text):
    """Each construction in a text with its line, and what to write instead."""
    for pattern, better in CONSTRUCTIONS.items():
        for match in re.finditer(pattern, text, re.IGNORECASE):
            yield f'{text.count(chr(10), 0, match.start()) + 1}: {match[0]!r}, write: {better}'


def test_no_odd_construction_is_left():
    assert list(constructions('Who asks hears of it'))
    names = subprocess.check_output(['git', 'ls-files'], cwd=ROOT, text=True).splitlines()
    for path in {ROOT / name for name in names} - {Path(__file__)}:
        if path.suffix in ENDINGS or path.name == 'Makefile':
            assert not list(constructions(path.read_text('utf-8'))), path
