"""`compare` on logs, documents and manual counts, and on wrong input."""

import dataclasses
import json

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
from resting_aspects_ros.simulation.job import RunDescription
from resting_aspects_ros.statistics.distribution import Distribution

COUNTS = [60, 55, 48, 25, 12]
BY_HAND = 'aspect,count\n1,61\n2,70\n3,50\n4,15\n5,14\nunsettled,3\n'
TOPIC = Topic('/aspect_distributions/l_bracket', DISTRIBUTION_TYPE, Qos(1))


@pytest.fixture(scope='session')
def aspects(part):
    return find_aspects(part('l_bracket'))


@pytest.fixture(scope='session')
def described(surfaces, aspects):
    """Return the description of a run of 200 drops of the L bracket."""
    run = RunDescription(
        run_id='4f1c',
        part='l_bracket',
        part_sha256=aspects.part_sha256,
        conditions=surfaces.get(''),
        seed=3,
        first_drop=0,
        drops=200,
        precision=0.0,
        engine='bullet',
        engine_version='3.2.7',
        suite_version='0.1.0',
        time_step=1 / 3000,
        started=10**18,
    )
    return lambda **changes: dataclasses.replace(run, **changes)


@pytest.fixture
def write_json(aspects, described, tmp_path):
    """Write a document like `drop`; ``fields`` replace its fields."""

    def write(name, counts=COUNTS, rest=(0, 0, 0), fields=None, complete=True, **changes):
        run = described(**changes)
        given = run.document() | {
            'method': 'drops', 'complete': complete, 'drops_asked': run.drops
        }  # fmt: skip
        document = distribution_document(Distribution(aspects, np.array(counts), *rest), given)
        (tmp_path / name).write_text(to_json(document | (fields or {})), encoding='utf-8')

    return write


@pytest.fixture
def write_log(aspects, described, tmp_path):
    """Write a log like the recorder, with distributions of counts; returns the RunLog."""

    def write(name, *many, cut=False, **changes):
        log = RunLog(tmp_path, name)
        for k, counts in enumerate(many):
            distribution = Distribution(aspects, np.array(counts), 1, 0, 0)
            complete = k == len(many) - 1 and not cut
            message = distribution_msg(distribution, described(**changes), Time(sec=k), complete)
            log.write(TOPIC, serialize_message(message), k)
            log.flush()
        if not cut:
            log.close()
        return log

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
    (tmp_path / 'a').write_text(ended.stdout, encoding='utf-8')  # any name is accepted
    write_csv(tmp_path, BY_HAND)
    found, said = compared('a', 'm.csv')
    assert said == ''
    assert counts_of(found, 'a') == [aspect['count'] for aspect in dropped['aspects']]
    assert counts_of(found, 'b') == [61, 70, 50, 15, 14]
    assert (found['a']['part_sha256'], found['b']['part_sha256']) == (dropped['part_sha256'], None)
    assert (found['a']['drops'], found['b']['drops']) == (125, 213)
    assert found['b']['unsettled'] == 3
    table = [counts_of(found, side) for side in 'ab']
    assert found['p_value'] == pytest.approx(chi2_contingency(table, correction=False).pvalue)
    a, b = (np.array(counts) / sum(counts) for counts in table)
    assert found['total_variation'] == pytest.approx(np.abs(a - b).sum() / 2)
    assert found['mean_deviation'] == pytest.approx(np.abs(a - b).mean())
    assert found['largest_deviation']['aspect'] == np.abs(a - b).argmax() + 1


def test_p_value_of_few_drops_is_exact_and_reproducible(compared, tmp_path):
    counts = [3, 1], [1, 4]
    for name, (one, two) in zip('ab', counts, strict=True):
        write_csv(tmp_path, f'aspect,count\n1,{one}\n2,{two}\n', name)
    found, _ = compared('a', 'b')
    assert found['p_by'] == 'monte carlo'
    # For 2 x 2 tables with these margins, Pearson's and Fisher's order agree.
    assert found['p_value'] == pytest.approx(fisher_exact(counts).pvalue, abs=0.02)
    assert compared('a', 'b')[0] == found


# -- logs ----------------------------------------------------------------------------------------


@pytest.mark.parametrize('place', ['run', 'run/run_0.mcap'])
def test_last_distribution_of_a_log_is_used(compared, write_json, write_log, place):
    write_log('run', [1, 0, 0, 0, 0], [70, 50, 40, 20, 19])
    write_json('b.json', seed=4)
    found, said = compared(place, 'b.json')
    assert said == ''
    assert counts_of(found, 'a') == [70, 50, 40, 20, 19]
    assert (found['a']['drops'], found['a']['unclassified'], found['a']['complete']) == (
        200, 1, True
    )  # fmt: skip
    assert found['a']['run_id'] == '4f1c'
    # A log and a document describe the aspects equally.
    swapped, _ = compared('b.json', place)
    for one, other in zip(found['aspects'], swapped['aspects'], strict=True):
        assert one['down_in_part'] == other['down_in_part']


# -- drops that are not independent --------------------------------------------------------------


@pytest.mark.parametrize(
    ('changes', 'says'),
    [
        ({}, '200 drops of A and B are the same'),
        ({'run_id': 'other', 'first_drop': 150}, '50 drops of A and B are the same'),
        ({'first_drop': 200}, ''),
        ({'seed': 4}, ''),
        ({'engine_version': '9'}, '200 drops of A and B start from the same orientations'),
        ({'engine_version': '9', 'seed': 4}, ''),
    ],
)
def test_dependent_drops_warn(compared, write_json, changes, says):
    write_json('a.json')
    write_json('b.json', **changes)
    _, said = compared('a.json', 'b.json')
    assert len(said.splitlines()) == bool(says)
    assert (f'warning: {says}' in said) == bool(says)


# -- results that cannot be compared -------------------------------------------------------------


def test_missing_or_unknown_aspects_are_refused(refused, write_json, tmp_path):
    write_json('a.json')
    write_csv(tmp_path, 'aspect,count\n1,2\n2,3\n4,4\n')
    assert refused('compare', 'a.json', 'm.csv') == (
        "error: invalid aspects 1, 2, 4 in 'm.csv': expected those in 'a.json', 1, 2, 3, 4, 5; "
        'missing: 3, 5 (an aspect that was never seen has count 0; aspects that look the same are '
        'counted by class, in a column class instead of aspect)'
    )
    write_csv(tmp_path, 'aspect,count\n1,2\n9,3\n')
    assert refused('compare', 'a.json', 'm.csv').startswith(
        "error: invalid aspects 1, 9 in 'm.csv': expected those in 'a.json', 1, 2, 3, 4, 5; "
        'not among them: 9; missing: 2, 3, 4, 5 ('
    )
    write_csv(tmp_path, 'aspect,count\n1,2\n2,3\n4,4\n')
    write_csv(tmp_path, 'aspect,count\n1,2\n2,3\n4,4\n9,1\n', 'n.csv')
    assert refused('compare', 'n.csv', 'm.csv').startswith(
        "error: invalid aspects 1, 2, 4 in 'm.csv': expected those in 'n.csv', 1, 2, 4, 9; "
    )


def test_compare_with_manual_counts_by_class(run, compared, tmp_path):
    """A person sees only whether a hexagonal nut lies flat or stands on one of six sides."""
    ended = run('drop', 'hex_nut', '--drops', 250, '--json')
    (tmp_path / 'nut.json').write_text(ended.stdout)
    document = json.loads(ended.stdout)
    write_csv(tmp_path, 'class,count\n1,350\n2,150\n')
    found, said = compared('nut.json', 'm.csv')
    assert said == ''
    assert found['by'] == 'class'
    assert [c['count'] for c in document['classes']] == [a['a']['count'] for a in found['aspects']]
    assert [a['b']['share'] for a in found['aspects']] == [0.7, 0.3]
    lying = document['classes'][0]['probability']
    assert found['total_variation'] == pytest.approx(abs(lying - 0.7))
    table = run('compare', tmp_path / 'nut.json', tmp_path / 'm.csv').stdout
    assert 'in class ' in table
    assert 'aspect ' not in table


@pytest.mark.parametrize(
    ('words', 'says'),
    [
        (['m.csv'], 'required: B'),
        (['nowhere', 'm.csv'], "counts file 'nowhere' does not exist"),
        (['m.csv', 'nowhere.json'], "counts file 'nowhere.json' does not exist"),
        (['m.csv', 'm.csv', '--confidence', '200%'], 'invalid confidence 2.0: expected more than'),
        (
            ['m.csv', 'm.csv', '--confidence', 'high'],
            "invalid --confidence 'high': expected a number",
        ),
    ],
)
def test_wrong_input_is_refused(refused, tmp_path, words, says):
    write_csv(tmp_path, BY_HAND)
    assert says in refused('compare', *words)


# -- the files -----------------------------------------------------------------------------------


@pytest.fixture
def refusal(tmp_path):
    """Return the error for a content; the file is called f in it."""

    def words(text, name='f', encoding='utf-8'):
        path = tmp_path / name
        path.write_bytes(text.encode(encoding))
        with pytest.raises(InvalidValueError) as caught:
            read_counts(path)
        return str(caught.value).replace(repr(str(path)), name)

    return words


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
    ('row', 'says'),
    [
        ('two,1', ["aspect 'two' in", 'expected the number of an aspect or unclassified,']),
        ('0,1', ["aspect '0' in", 'expected the number of an aspect']),
        ('-1,1', ["aspect '-1' in", 'expected the number of an aspect']),
        ('1,7', ["aspect '1' in", 'expected each aspect once']),
        ('2,-1', ["count '-1' in", 'expected an integer from 0 to 100000000']),
        ('2,1.5', ["count '1.5' in", 'expected an integer']),
        ('2,', ["count '' in", 'expected an integer']),
        ('2,1_0', ["count '1_0' in", 'expected an integer']),
        ('2,100000001', ["count '100000001' in", 'expected an integer']),
        ('2,' + '9' * 5000, ["count '99", "99' in", 'expected an integer']),
        ('2', ['number of columns 1 in', 'expected 2']),
        ('2,3,4', ['number of columns 3 in', 'expected 2']),
    ],
)
def test_error_names_line_and_value_of_a_wrong_count(refusal, row, says):
    words = refusal(f'aspect,count\n1,5\n{row}\n')
    assert words.startswith(f'invalid {says[0]}')
    for word in (*says, 'in f line 3: expected'):
        assert word in words


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        ('', "invalid column names '' in f line 1: expected a column aspect or class and"),
        ('1,5\n', "invalid column names '1, 5' in f line 1: expected"),
        ('aspect,counts\n1,5\n', "column names 'aspect, counts' in f line 1: expected"),
        ('aspect,count,Count\n1,5,5\n', "names 'aspect, count, Count' in f line 1: expected"),
        ('solid box\nfacet normal 0 0 1\n', '(a counts file can be a log (the folder of a run, '),
        (
            'aspect,count\n',
            'invalid counts in f: expected at least one drop in an aspect, found 0 of 0 drops',
        ),
        (
            'aspect,count\n1,0\nfailed,4\n',
            'counts in f: expected at least one drop in an aspect, found 0 of 4 drops',
        ),
        (
            'aspect,count\n1,99999999\n2,2\n',
            'invalid number of drops 100000001 in f: expected at most 100000000',
        ),
    ],
)
def test_invalid_manual_counts_are_refused(refusal, text, says):
    assert says in refusal(text)


def test_file_that_is_not_utf8_is_refused(refusal):
    words = refusal('aspect;count;Größe\n', encoding='latin-1')
    assert words == 'counts file f is not text in UTF-8'


def test_compare_reads_the_document_of_classify(run, compared, tmp_path):
    ended = run('drop', 'l_bracket', '--drops', 60, '--poses', 'p.csv', '--json')
    (tmp_path / 'a.json').write_text(ended.stdout, encoding='utf-8')
    sorted_here = run('classify', 'p.csv', '--part', 'l_bracket', '--json')
    (tmp_path / 'b.json').write_text(sorted_here.stdout, encoding='utf-8')
    found, said = compared('a.json', 'b.json')
    assert said == ''
    assert (found['total_variation'], found['p_value']) == (0, 1)


def test_classes_counted_together_are_compared_together(tmp_path):
    (tmp_path / 'a.csv').write_text('class,count\n1,30\n2+3,50\n4,20\nunclassified,2\n')
    (tmp_path / 'b.csv').write_text('class,count\n1,30\n2,20\n3,30\n4,20\nunsettled,1\n')
    result = compare(tmp_path / 'a.csv', tmp_path / 'b.csv')
    assert result.a.names == result.b.names == ('1', '2+3', '4')
    assert result.b.tally.counts.tolist() == [30, 50, 20]
    document = json.loads(result.to_json())
    assert [row['name'] for row in document['aspects']] == ['1', '2+3', '4']
    (tmp_path / 'c.csv').write_text('class,count\n1,30\n2+3,50\n3,20\n')
    with pytest.raises(InvalidValueError, match=r'the file counts 2\+3 together'):
        compare(tmp_path / 'a.csv', tmp_path / 'c.csv')
    (tmp_path / 'd.csv').write_text('class,count\n1,30\n2,50\n3,20\n')
    with pytest.raises(InvalidValueError, match='missing: 4'):
        compare(tmp_path / 'a.csv', tmp_path / 'd.csv')


@pytest.mark.parametrize(
    'text',
    [
        'batch,class,count\na,1,3\na,2,1\nb,1,2\nb,2,4\n',
        'class\n1\n1\n2\n1\n1\n1\n2\n2\n2\n2\n',
        'time;class_1;class_2\n8:00;3;1\n8:10;2;4\n',
    ],
)
def test_counts_in_batches_are_compared_together(tmp_path, text):
    write_csv(tmp_path, text)
    given = read_counts(tmp_path / 'm.csv')
    assert (given.groups, given.tally.counts.tolist()) == (((1,), (2,)), [5, 5])


def test_numbers_without_a_header_are_not_taken_for_classes(refusal):
    assert "invalid column names '1, 5' in f line 1: expected" in refusal('1,5\n2,7\n')
