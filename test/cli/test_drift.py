"""The command `drift` with the drops that are expected."""

import pytest


@pytest.mark.slow
def test_drift_does_not_change_the_exit_code(run, tmp_path):
    good, bad = (54, 56, 48, 26, 16), (40, 90, 40, 20, 10)
    counted = ['batch,class,count']
    for batch, counts in enumerate([good] * 4 + [bad] * 3):
        counted += [f'{batch},{k},{number}' for k, number in enumerate(counts, 1)]
    (tmp_path / 'bad.csv').write_text('\n'.join(counted))
    expected = ['class,count', '1,2700', '2,2800', '3,2400', '4,1300', '5,800']
    (tmp_path / 'expected.csv').write_text('\n'.join(expected))
    words = ('--expected', 'expected.csv', '--window', 200)
    ended = run('drift', 'l_bracket', 'bad.csv', *words)
    assert ended.returncode == 0, ended.stderr
    assert ' '.join(ended.stdout.split()).startswith(
        'Class 2 is seen in 45 % instead of 28 % (+17 points, 95 % interval +12 to +22) since '
        'part 801 (4).'
    )
    assert ended.stdout.count('alarm\n') == 3
