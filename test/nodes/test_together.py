"""Requests that come at the same time, and suites side by side."""

from resting_aspects_interfaces.msg import Status


def test_identical_concurrent_requests_share_a_run(suite, counts):
    received = suite.client.poses()
    asked = [suite.client.asking('tetrahedron', 50_000, seed=[3]) for _ in range(12)]
    suite.client.wait(lambda: all(answer.done() for answer in asked), 'answers')
    answers = [answer.result() for answer in asked]
    assert {answer.status.code for answer in answers} == {Status.OK}
    (run_id,) = {answer.distribution.run.run_id for answer in answers}
    assert len({counts(answer.distribution) for answer in answers}) == 1

    def of_the_seed():
        return [batch for batch in received if batch.run.seed == 3 and batch.run.drops == 50_000]

    suite.client.wait(lambda: of_the_seed() and of_the_seed()[-1].last, 'batches')
    assert {batch.run.run_id for batch in of_the_seed()} == {run_id}


def test_known_answer_does_not_wait_for_an_active_run(suite):
    assert suite.client.ask('tetrahedron', 5, seed=[6]).status.code == Status.OK
    long = suite.client.dropping('tetrahedron', 2_000_000, seed=61)
    suite.client.wait(lambda: long.accepted, 'long goal')
    assert suite.client.ask('tetrahedron', 5, seed=[6]).status.code == Status.OK
    assert not long.done
    long.cancel()
    suite.client.wait(lambda: long.done, 'canceled goal')


def test_suites_in_two_namespaces_are_independent(suite, fresh_suite):
    other = fresh_suite()
    here, there = suite.client.poses(), other.client.poses()
    run_id = other.client.ask('tetrahedron', 6, seed=[5501]).distribution.run.run_id
    other.client.wait(lambda: there and there[-1].last, 'batches there')
    answer = suite.client.ask('tetrahedron', 6, seed=[5501], only_known=True)
    assert answer.status.code == Status.NOT_AVAILABLE
    # What is dropped here now comes after anything that could have come from there.
    mine = suite.client.drop('tetrahedron', 1, seed=56).result.run_id
    suite.client.wait(lambda: here and here[-1].run.run_id == mine, 'batches here')
    assert run_id not in {batch.run.run_id for batch in here}
    assert [batch.run.run_id for batch in there] == [run_id]
    log = other.log_of(run_id)
    assert other.logs.samefile(log.parent)
    assert not list(suite.logs.glob(f'*_{run_id}*'))
