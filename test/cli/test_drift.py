"""The command `drift` with simulated and with given drops."""

import json

import pytest

GOOD, BAD = '54,56,48,26,16', '40,90,40,20,10'
BY_CLASS = '1,2,3,4,5'


@pytest.fixture
def files(tmp_path):
    """Write counts with and without drift, and the drops that are expected."""
    (tmp_path / 'good.csv').write_text('\n'.join([BY_CLASS, *[GOOD] * 4]))
    (tmp_path / 'bad.csv').write_text('\n'.join([BY_CLASS, *[GOOD] * 4, *[BAD] * 3]))
    rows = ['class,count', '1,2700', '2,2800', '3,2400', '4,1300', '5,800']
    (tmp_path / 'expected.csv').write_text('\n'.join(rows))


EXPECTED = ('--expected', 'expected.csv', '--window', 200)


def test_sentence_is_the_first_line(files, run):
    ended = run('drift', 'l_bracket', 'good.csv', *EXPECTED)
    assert ended.returncode == 0, ended.stderr
    first, *rest = ended.stdout.splitlines()
    assert first == 'No drift in 4 windows of 200 parts.'
    assert 'one in 20000' in ' '.join(rest)
    assert sum(line.lstrip().startswith(f'{n} to ') for line in rest for n in (1, 601)) == 2
    assert max(map(len, rest)) <= 80


def test_drift_does_not_change_the_exit_code(files, run):
    ended = run('drift', 'l_bracket', 'bad.csv', *EXPECTED)
    assert ended.returncode == 0, ended.stderr
    assert ' '.join(ended.stdout.split()).startswith(
        'Class 2 is seen in 45 % instead of 28 % (+17 points, 95 % interval +12 to +22) since '
        'part 801.'
    )
    assert ended.stdout.count('alarm\n') == 3


def test_document_is_printed_and_written(files, run, tmp_path):
    ended = run('drift', 'l_bracket', 'bad.csv', *EXPECTED, '--json', '--out', 'o')
    assert ended.returncode == 0, ended.stderr
    assert json.loads(ended.stdout)['drift']['symmetry_class'] == 2
    assert (tmp_path / 'o' / 'drift.json').read_text() == ended.stdout
    assert (tmp_path / 'o' / 'drift.png').read_bytes().startswith(b'\x89PNG')


def test_part_is_dropped_without_expected_drops(files, run):
    words = ('drift', 'l_bracket', 'good.csv', '--drops', 100, '--window', 400, '--json')
    document = json.loads(run(*words).stdout)
    assert document['part'] == 'l_bracket'
    assert document['expected']['drops'] == 100
    again = json.loads(run(*words).stdout)
    assert again['windows'] == document['windows']


@pytest.mark.slow
def test_document_of_drop_can_be_expected(files, run, tmp_path):
    assert run('drop', 'l_bracket', '--drops', 100, '--out', 'd').returncode == 0
    words = ('--expected', 'd/distribution.json', '--window', 400, '--level', '5%', '--json')
    document = json.loads(run('drift', 'l_bracket', 'good.csv', *words).stdout)
    assert (document['expected']['drops'], document['level']) == (100, 0.05)


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (('good.csv', '--expected', 'none.json'), "'none.json' does not exist"),
        (('good.csv', *EXPECTED, '--drops', 50), "invalid --drops '50': expected only without"),
        (('good.csv', *EXPECTED, '--height', '1m'), "--height '1m': expected only without"),
        (('good.csv', '--window', 900), 'invalid window 900: expected an integer from 1 to 800'),
        (('good.csv', '--shift', '5'), 'expected at most 1; 5 percent is 5% or 0.05'),
        (('good.csv', '--level', 'x'), "invalid --level 'x': expected a number"),
        (('bad.csv', '--cumulative'), 'because cumulative counts cannot go down'),
        (('expected.csv', '--expected', 'good.csv'), 'invalid column names'),
    ],
)  # fmt: skip
def test_wrong_values_are_refused(files, refused, words, message):
    assert message in refused('drift', 'l_bracket', *words)


def test_drops_of_another_part_are_refused(files, run, refused):
    assert run('drop', 'washer', '--drops', 20, '--out', 'd').returncode == 0
    line = refused('drift', 'l_bracket', 'good.csv', '--expected', 'd/distribution.json')
    assert 'these are different parts' in line


def test_totals_of_the_counting_sheet_are_tested(run, tmp_path):
    # With a byte order mark and the line ends of Windows; classes 1 and 4 have the same outline.
    sheet = '\ufeffclass;count\r\n1;50\r\n2;170\r\n3;40\r\n4;20\r\nunclassified;3\r\n'
    (tmp_path / 'sheet.csv').write_bytes(sheet.encode())
    (tmp_path / 'expected.csv').write_text('class,count\n1,223\n2,577\n3,127\n4,73\n')
    ended = run('drift', 'u_bracket', 'sheet.csv', '--expected', 'expected.csv')
    text = ' '.join(ended.stdout.split())
    assert text.startswith('No drift in 1 window of 280 parts.')
    assert '3 unclassified parts are not tested: 1.1 % of the counted parts.' in text
    assert text.endswith('can be counted together as 1+4.')


def test_part_with_a_single_class_is_refused(tmp_path, refused):
    (tmp_path / 'one.csv').write_text('class,count\n1,50\n')
    assert 'expected two or more classes' in refused('drift', 'tetrahedron', 'one.csv')
