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


@pytest.mark.slow
def test_drift_does_not_change_the_exit_code(files, run):
    ended = run('drift', 'l_bracket', 'bad.csv', *EXPECTED)
    assert ended.returncode == 0, ended.stderr
    assert ' '.join(ended.stdout.split()).startswith(
        'Class 2 is seen in 45 % instead of 28 % (+17 points, 95 % interval +12 to +22) since '
        'part 801.'
    )
    assert ended.stdout.count('alarm\n') == 3


def test_part_is_dropped_without_expected_drops(files, run):
    words = ('drift', 'l_bracket', 'good.csv', '--drops', 100, '--window', 400, '--json')
    document = json.loads(run(*words).stdout)
    assert document['part'] == 'l_bracket'
    assert document['expected']['drops'] == 100
    again = json.loads(run(*words).stdout)
    assert again['windows'] == document['windows']
