"""`compare` on logs, documents and manual counts, and the files of counts."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.stats import chi2_contingency

from resting_aspects_ros.api.compare import compare
from resting_aspects_ros.api.count_files import read_counts
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.report.document import distribution_document, to_json
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.statistics.distribution import Distribution

COUNTS = [60, 55, 48, 25, 12]


@pytest.fixture
def write_json(part, surfaces, tmp_path):
    """Write a document of 200 drops of the L bracket like `drop`."""
    bracket = part('l_bracket')
    _, planned = plan_run(
        bracket, surfaces.get(), seed=3, drops=200, run_id='4f1c', started=10**18
    )
    counted = Distribution(find_aspects(bracket), np.array(COUNTS), 0, 0, 0)

    def write(name, **changes):
        run = dataclasses.replace(planned, **changes)
        given = {'method': 'drops', 'complete': True, 'drops_asked': run.drops}
        document = distribution_document(counted, run.document() | given)
        (tmp_path / name).write_text(to_json(document), encoding='utf-8')

    return write


@pytest.fixture
def compared(run):
    """Compare with --json; returns the document and standard error."""

    def document(*words):
        ended = run('compare', *words, '--json')
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout), ended.stderr

    return document


def write_csv(folder, text, name='m.csv'):
    (folder / name).write_text(text, encoding='utf-8')


# -- the comparison ------------------------------------------------------------------------------


def test_compare_drops_with_manual_counts(compared, write_json, tmp_path):
    write_json('a')  # any name is accepted
    write_csv(tmp_path, 'aspect,count\n1,61\n2,70\n3,50\n4,15\n5,14\nunsettled,3\n')
    found, said = compared('a', 'm.csv')
    assert said == ''
    table = [[aspect[side]['count'] for aspect in found['aspects']] for side in 'ab']
    assert table == [COUNTS, [61, 70, 50, 15, 14]]
    assert (found['a']['drops'], found['b']['drops'], found['b']['unsettled']) == (200, 213, 3)
    assert found['p_value'] == pytest.approx(chi2_contingency(table, correction=False).pvalue)


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'run_id': 'other', 'first_drop': 150}, '50 drops of A and B start from the same'),
        ({'seed': 4}, ''),
        ({'engine_version': '9'}, '200 drops of A and B start from the same orientations'),
    ],
)
def test_dependent_drops_warn(compared, write_json, changes, said):
    write_json('a.json')
    write_json('b.json', **changes)
    _, warned = compared('a.json', 'b.json')
    assert len(warned.splitlines()) == bool(said)
    assert said in warned


def test_classes_counted_together_are_compared_together(tmp_path):
    (tmp_path / 'a.csv').write_text('class,count\n1,30\n2+3,50\n4,20\nunclassified,2\n')
    (tmp_path / 'b.csv').write_text('class,count\n1,30\n2,20\n3,30\n4,20\nunsettled,1\n')
    result = compare(tmp_path / 'a.csv', tmp_path / 'b.csv')
    assert result.a.names == result.b.names == ('1', '2+3', '4')
    assert result.b.tally.counts.tolist() == [30, 50, 20]
    (tmp_path / 'c.csv').write_text('class,count\n1,30\n2+3,50\n3,20\n')
    with pytest.raises(InvalidValueError, match='in one group'):
        compare(tmp_path / 'a.csv', tmp_path / 'c.csv')
    (tmp_path / 'd.csv').write_text('class,count\n1,30\n2,50\n3,20\n')
    with pytest.raises(InvalidValueError, match='4'):
        compare(tmp_path / 'a.csv', tmp_path / 'd.csv')


def test_wrong_aspects_are_those_of_the_manual_counts(write_json, tmp_path):
    write_json('a.json')
    write_csv(tmp_path, 'aspect,count\n1,61\n2,70\n3,50\n')
    paths = [tmp_path / 'a.json', tmp_path / 'm.csv']
    for pair in (paths, paths[::-1]):
        with pytest.raises(InvalidValueError, match=r'aspects 1, 2, 3 in .*m\.csv.*a\.json.*4, 5'):
            compare(*pair)


# -- the files -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    'text',
    [
        'aspect,count\n1,5\n2,0\nunclassified,1\nunsettled,2\nfailed,3\n',
        'Count;day; Aspect\r\n3;;failed\r\n0;"a;b";2\r\n\n5;;1\r\n2;;Unsettled\r\n1;;unclassified',
        '\ufeffaspect,count\n2, 0\n1 ,05\nfailed,3\nunsettled,2\n,\nunclassified,1',
    ],
)
def test_accepted_spellings_of_manual_counts(tmp_path, text):
    write_csv(tmp_path, text)
    given = read_counts(tmp_path / 'm.csv')
    assert (given.ids, given.tally.counts.tolist()) == ((1, 2), [5, 0])
    tally = given.tally
    assert (tally.unclassified, tally.unsettled, tally.failed, given.drops) == (1, 2, 3, 11)


@pytest.mark.parametrize(
    'text',
    [
        'batch,class,count\na,1,3\na,2,1\nb,1,2\nb,2,4\n',
        'class\n1\n1\n2\n1\n1\n1\n2\n2\n2\n2\n',
    ],
)
def test_counts_in_batches_are_added_up(tmp_path, text):
    write_csv(tmp_path, text)
    given = read_counts(tmp_path / 'm.csv')
    assert (given.groups, given.tally.counts.tolist()) == (((1,), (2,)), [5, 5])


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('aspect,count\n1,5\ntwo,1\n', ["'two'", 'line 3']),
        ('aspect,count\n1,5\n1,7\n', ["'1'", 'line 3', 'once']),
        ('aspect,count\n1,5\n2,-1\n', ["'-1'", 'line 3', '0 to 100000000']),
        ('aspect,count\n1,5\n2,1.5\n', ["'1.5'", 'line 3']),
        ('aspect,count\n1,5\n2,' + '9' * 5000, ["'99", "99'", 'line 3']),
        ('aspect,count\n1,5\n2\n', ['columns 1', 'line 3']),
        ('', ["''", 'line 1']),
        ('aspect,count,Count\n1,5,5\n', ["'aspect, count, Count'", 'line 1']),
        ('aspect,count\n1,0\nfailed,4\n', ['0 of 4 drops']),
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
