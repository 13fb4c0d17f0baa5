"""`compare` on logs, documents and manual counts, and the files of counts."""

import dataclasses
import json
from contextlib import closing

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from scipy.stats import chi2_contingency, fisher_exact

from resting_aspects_ros.api.compare import compare
from resting_aspects_ros.api.count_files import read_counts
from resting_aspects_ros.aspects.find import find_aspects
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.logs.topics import DISTRIBUTION_TYPE, Qos, Topic
from resting_aspects_ros.logs.writer import RunLog
from resting_aspects_ros.report.document import distribution_document, to_json
from resting_aspects_ros.ros.distribution_conversions import distribution_msg
from resting_aspects_ros.simulation.job import plan_run
from resting_aspects_ros.statistics.distribution import Distribution

COUNTS = [60, 55, 48, 25, 12]
TOPIC = Topic('/aspect_distributions/l_bracket', DISTRIBUTION_TYPE, Qos(1))


@pytest.fixture(scope='module')
def counted(part):
    """Return the distribution of counts of the L bracket."""
    aspects = find_aspects(part('l_bracket'))
    return lambda counts, *rest: Distribution(aspects, np.array(counts), *(rest or (0, 0, 0)))


@pytest.fixture(scope='module')
def described(part, surfaces):
    """Return the description of a run of 200 drops of the L bracket."""
    _, run = plan_run(
        part('l_bracket'), surfaces.get(), seed=3, drops=200, run_id='4f1c', started=10**18
    )
    return lambda **changes: dataclasses.replace(run, **changes)


@pytest.fixture
def write_json(counted, described, tmp_path):
    """Write a document like `drop`."""

    def write(name, **changes):
        run = described(**changes)
        given = {'method': 'drops', 'complete': True, 'drops_asked': run.drops}
        document = distribution_document(counted(COUNTS), run.document() | given)
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


def counts_of(document, side):
    return [aspect[side]['count'] for aspect in document['aspects']]


# -- the comparison ------------------------------------------------------------------------------


def test_compare_drops_with_manual_counts(run, compared, tmp_path):
    ended = run('drop', 'l_bracket', '--drops', 125, '--seed', 3, '--json')
    dropped = json.loads(ended.stdout)
    write_csv(tmp_path, ended.stdout, 'a')  # any name is accepted
    write_csv(tmp_path, 'aspect,count\n1,61\n2,70\n3,50\n4,15\n5,14\nunsettled,3\n')
    found, said = compared('a', 'm.csv')
    assert said == ''
    assert counts_of(found, 'a') == [aspect['count'] for aspect in dropped['aspects']]
    assert counts_of(found, 'b') == [61, 70, 50, 15, 14]
    assert (found['a']['drops'], found['b']['drops'], found['b']['unsettled']) == (125, 213, 3)
    table = [counts_of(found, side) for side in 'ab']
    assert found['p_value'] == pytest.approx(chi2_contingency(table, correction=False).pvalue)
    a, b = (np.array(counts) / sum(counts) for counts in table)
    assert found['total_variation'] == pytest.approx(np.abs(a - b).sum() / 2)


def test_p_value_of_few_drops_is_exact_and_reproducible(tmp_path):
    counts = [3, 1], [1, 4]
    paths = [tmp_path / 'a', tmp_path / 'b']
    for path, (one, two) in zip(paths, counts, strict=True):
        path.write_text(f'aspect,count\n1,{one}\n2,{two}\n')
    found = compare(*paths).comparison
    assert found.p_by == 'monte carlo'
    # For 2 x 2 tables with these margins, Pearson's and Fisher's order agree.
    assert found.p_value == pytest.approx(fisher_exact(counts).pvalue, abs=0.02)
    assert compare(*paths).comparison.p_value == found.p_value


def test_last_distribution_of_a_log_is_used(compared, write_json, counted, described, tmp_path):
    with closing(RunLog(tmp_path, 'run')) as log:
        for k, counts in enumerate(([1, 0, 0, 0, 0], [70, 50, 40, 20, 19])):
            message = distribution_msg(counted(counts, 1, 0, 0), described(), Time(sec=k), k == 1)
            log.write(TOPIC, serialize_message(message), k)
    write_json('b.json', seed=4)
    found, said = compared('run/run_0.mcap', 'b.json')
    assert said == ''
    assert counts_of(found, 'a') == [70, 50, 40, 20, 19]
    side = found['a']
    assert (side['drops'], side['unclassified'], side['complete']) == (200, 1, True)


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({}, '200 drops of A and B are the same'),
        ({'run_id': 'other', 'first_drop': 150}, '50 drops of A and B are the same'),
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
    with pytest.raises(InvalidValueError, match=r'2\+3'):
        compare(tmp_path / 'a.csv', tmp_path / 'c.csv')
    (tmp_path / 'd.csv').write_text('class,count\n1,30\n2,50\n3,20\n')
    with pytest.raises(InvalidValueError, match='4'):
        compare(tmp_path / 'a.csv', tmp_path / 'd.csv')


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
        'time;class_1;class_2\n8:00;3;1\n8:10;2;4\n',
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
