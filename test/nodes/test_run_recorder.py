"""Problems reported for a log that cannot be completed."""

import resource
from pathlib import Path

import pytest

from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.logs.topics import POSES_TYPE, Qos, Topic
from resting_aspects_ros.nodes.drop_recorder.log_folder import absolute_folder
from resting_aspects_ros.run_logs.recorder import RunRecorder
from resting_aspects_ros.simulation.job import RunDescription

TOPIC = Topic('/resting_poses', POSES_TYPE, Qos(10))


@pytest.fixture
def failed(surfaces, tmp_path):
    """Record drops of a run, then let the disk be full; gives the log."""

    def record(recorded, asked):
        values = {'seed': 1, 'first_drop': 0, 'drops': asked, 'precision': 0.0, 'started': 10**18}
        texts = ('engine', 'engine_version', 'suite_version', 'part_sha256')
        run = RunDescription(
            run_id='4f1c', part='nut', conditions=surfaces.get(''), time_step=1e-3,
            **values, **dict.fromkeys(texts, 'x'),
        )  # fmt: skip
        log = RunRecorder(tmp_path, run)
        if recorded:
            log.write_poses(TOPIC, bytes(100), 1, 1, recorded)
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
        try:
            log.write(TOPIC, bytes(100_000), 2, 2)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert log.error.endswith('cannot be written: File too large')
        return log

    return record


@pytest.mark.parametrize(
    ('recorded', 'asked', 'expected'),
    [
        (
            4000,
            4000,
            'all 4000 drops of run 4f1c of nut are recorded, but the log has no end: log ',
        ),
        (1, 1, 'all 1 drops of run 4f1c of nut are recorded, but the log has no end: log '),
        (3999, 4000, 'only 3999 drops of run 4f1c of nut are recorded: log '),
        (0, 4000, 'run 4f1c of nut is not recorded: log '),
    ],
)
def test_problem_states_the_number_of_recorded_drops(failed, recorded, asked, expected):
    assert failed(recorded, asked).problem().startswith(expected)


def test_deleted_working_folder_is_an_error(tmp_path, monkeypatch):
    (tmp_path / 'gone').mkdir()
    monkeypatch.chdir(tmp_path / 'gone')
    (tmp_path / 'gone').rmdir()
    with pytest.raises(InvalidValueError, match='the working folder no longer exists'):
        absolute_folder('logs')
    assert absolute_folder('/logs') == Path('/logs')
