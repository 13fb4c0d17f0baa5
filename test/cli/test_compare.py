"""`compare` on logs, documents and manual counts, and the files of counts."""

import dataclasses
import json

import pytest
from scipy.stats import chi2_contingency

import resting_aspects_ros as ra
from resting_aspects_ros.api.compare import compare
from resting_aspects_ros.api.count_files import read_counts
from resting_aspects_ros.errors import InvalidValueError


@pytest.fixture(scope='module')
def dropped():
    return ra.drop('l_bracket', 200, seed=3, keep_poses=False, model_range=False)


@pytest.fixture
def write_json(dropped, tmp_path):
    """Write the document of 200 drops, with changes of its run."""

    def write(name, **changes):
        run = dataclasses.replace(dropped.run, **changes)
        dataclasses.replace(dropped, run=run).save_json(tmp_path / name)

    return write


def test_compare_drops_with_manual_counts(run, dropped, write_json, tmp_path):
    write_json('a')  # any name is accepted
    counted = 'aspect,count\n1,61\n2,70\n3,50\n4,15\n5,14\nunsettled,3\n'
    (tmp_path / 'm.csv').write_text(counted)
    ended = run('compare', 'a', 'm.csv', '--json')
    assert (ended.returncode, ended.stderr) == (0, '')
    found = json.loads(ended.stdout)
    table = [[aspect[side]['count'] for aspect in found['aspects']] for side in 'ab']
    assert table == [dropped.distribution.counts.tolist(), [61, 70, 50, 15, 14]]
    assert (found['a']['drops'], found['b']['drops'], found['b']['unsettled']) == (200, 213, 3)
    assert found['p_value'] == pytest.approx(chi2_contingency(table, correction=False).pvalue)


@pytest.mark.parametrize(
    ('changes', 'same'), [({'run_id': 'other', 'first_drop': 150}, '50 '), ({'seed': 4}, '')]
)
def test_drops_that_start_alike_give_a_warning(run, write_json, changes, same):
    write_json('a.json')
    write_json('b.json', **changes)
    warned = run('compare', 'a.json', 'b.json').stderr
    assert warned.startswith(f'warning: {same}drops of A and B' if same else '')
    assert len(warned.splitlines()) == bool(same)


def test_classes_counted_together_are_compared_together(tmp_path):
    (tmp_path / 'a.csv').write_text('class,count\n1,30\n2+3,50\n4,20\nunclassified,2\n')
    (tmp_path / 'b.csv').write_text('class,count\n1,30\n2,20\n3,30\n4,20\nunsettled,1\n')
    result = compare(tmp_path / 'a.csv', tmp_path / 'b.csv')
    assert result.a.names == result.b.names == ('1', '2+3', '4')
    assert result.b.tally.counts.tolist() == [30, 50, 20]
    (tmp_path / 'c.csv').write_text('class,count\n1,30\n2+3,50\n3,20\n')
    with pytest.raises(InvalidValueError, match='in one group'):
        compare(tmp_path / 'a.csv', tmp_path / 'c.csv')


def test_wrong_aspects_are_those_of_the_manual_counts(write_json, tmp_path):
    write_json('a.json')
    (tmp_path / 'm.csv').write_text('aspect,count\n1,61\n2,70\n3,50\n')
    paths = [tmp_path / 'a.json', tmp_path / 'm.csv']
    for pair in (paths, paths[::-1]):
        with pytest.raises(InvalidValueError, match=r'aspects 1, 2, 3 in .*m\.csv.*a\.json.*4, 5'):
            compare(*pair)


def test_any_spelling_of_manual_counts(tmp_path):
    rows = '3;;failed\r\n0;"a;b";2\r\n\n5;;1\r\n2;;Unsettled\r\n1;;unclassified'
    (tmp_path / 'm.csv').write_text(f'Count;day; Aspect\r\n{rows}')
    given = read_counts(tmp_path / 'm.csv')
    assert (given.ids, given.tally.counts.tolist()) == ((1, 2), [5, 0])
    tally = given.tally
    assert (tally.unclassified, tally.unsettled, tally.failed, given.drops) == (1, 2, 3, 11)


def test_counts_in_batches_are_added_up(tmp_path):
    (tmp_path / 'm.csv').write_text('batch,class,count\na,1,3\na,2,1\nb,1,2\nb,2,4\n')
    given = read_counts(tmp_path / 'm.csv')
    assert (given.groups, given.tally.counts.tolist()) == (((1,), (2,)), [5, 5])


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('aspect,count\n1,5\n1,7\n', ["'1'", 'line 3', 'once']),
        ('aspect,count\n1,5\n2,-1\n', ["'-1'", 'line 3', '0 to 100000000']),
        ('aspect,count\n1,5\n2,' + '9' * 5000, ["'99", "99'", 'line 3']),
        ('aspect,count,Count\n1,5,5\n', ["'aspect, count, Count'", 'line 1']),
        ('aspect,count\n1,99999999\n2,2\n', ['100000001', '100000000']),
        ('aspect;count;Größe\n', ['UTF-8']),
    ],
)
def test_error_names_file_line_and_value(tmp_path, text, said):
    path = tmp_path / 'm.csv'
    path.write_bytes(text.encode('latin-1'))
    with pytest.raises(InvalidValueError) as caught:
        read_counts(path)
    for words in (repr(str(path)), *said):
        assert words in str(caught.value)
