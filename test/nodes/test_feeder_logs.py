"""Logs of the topics of a feeder: recorded at once, readable, replayed in order."""

import json
import os

import pytest
from rclpy.serialization import deserialize_message
from resting_aspects_interfaces.msg import (
    Detection,
    DetectionArray,
    FeederAdvice,
    ObservedCounts,
    PartDescription,
    PickResult,
    Posterior,
)
from rosbags.highlevel import AnyReader

from resting_aspects_ros.api.count_files import read_observed
from resting_aspects_ros.cli.main import main
from resting_aspects_ros.errors import InvalidValueError
from resting_aspects_ros.logs.reader import Recording, messages
from resting_aspects_ros.ros.conversions import part_msg
from resting_aspects_ros.ros.interface import CELL, LATCHED, offered_qos

PART = 'hex_nut'
SMALL = {
    'nodes.drop_recorder.node.MAX_MESSAGES': 12,
    'nodes.drop_recorder.node.RETRY': 0.2,
    'ros.health.DIAGNOSTICS_PERIOD': 0.1,
}
TOPICS = {
    'detections': (DetectionArray, CELL),
    'pick_result': (PickResult, CELL),
    f'feeder_advice/{PART}': (FeederAdvice, LATCHED),
    f'observed_counts/{PART}': (ObservedCounts, LATCHED),
    f'posterior/{PART}': (Posterior, LATCHED),
    f'parts/{PART}': (PartDescription, LATCHED),
}


class Cell:
    """A feeder that is recorded."""

    def __init__(self, client, folder, description):
        self.client, self.folder = client, folder
        self.outputs = {
            name: client.node.create_publisher(kind, name, qos)
            for name, (kind, qos) in TOPICS.items()
        }
        self.outputs[f'parts/{PART}'].publish(description)
        self.sent = []
        for output in self.outputs.values():
            client.wait(output.get_subscription_count, 'recorder')

    def send(self, name, **fields):
        """Publish a message, and wait until it is in a log."""
        message = TOPICS[name][0](**fields)
        self.outputs[name].publish(message)
        self.client.wait(lambda: message in self.logged(TOPICS[name][0]), name)
        self.sent.append(message)

    def logs(self):
        return sorted(self.folder.glob('feeder-*'))

    def logged(self, kind):
        """Return all messages of a type, also of a log that is being written."""
        return [
            deserialize_message(data, kind)
            for log in self.folder.glob('feeder-*/')
            for data in messages(log, f'resting_aspects_interfaces/msg/{kind.__name__}')
        ]


@pytest.fixture(scope='module')
def shift(start, connect, part, tmp_path_factory):
    """The folder with the logs of a shift of two images, two sessions and a change of the log."""
    namespace = f'/test_feeder_logs_{os.getpid()}'
    folder = tmp_path_factory.mktemp('logs')
    recorder = start('drop_recorder', namespace, {'log_folder': folder}, SMALL)
    cell = Cell(connect(namespace), folder, part_msg(part(PART)))
    for k, total in enumerate(([1, 0], [3, 4], [5, 5], [5, 9]), 1):
        cell.send('detections', image=k, detections=[Detection(part=PART)])
        cell.send(f'feeder_advice/{PART}', part=PART, image=k, choice=FeederAdvice.PICK)
        cell.send('pick_result', image=k, result=PickResult.PICKED)
        cell.send(f'observed_counts/{PART}', part=PART, supplied=total, session='a')
        cell.send(f'posterior/{PART}', part=PART, parts=sum(total), observed=total)
    cell.send('pick_result', image=4, result=PickResult.MISSED, detection=1)
    recorder.end()
    return cell


@pytest.mark.slow
def test_logs_have_every_message_and_what_is_latched(shift):
    assert len(shift.logs()) == 3
    for each in shift.sent:
        assert each in shift.logged(type(each))
    for log in shift.logs():
        with AnyReader([log]) as bag:
            assert {each.topic.rpartition('/')[2] for each in bag.connections} >= {PART}
            first = next(bag.messages())[0]
            if log != shift.logs()[0]:
                assert first.msgtype.endswith('PartDescription')
        for topic in Recording(log).topics.values():
            of_cell = topic.topic.endswith(('/detections', '/pick_result'))
            assert topic.qos == offered_qos(CELL if of_cell else LATCHED)


def test_counts_are_read_from_the_logs(shift, capsys):
    picks = 0
    for log in shift.logs():
        assert main(['info', str(log), '--json']) == 0
        topics = json.loads(capsys.readouterr().out)['topics']
        picks += sum(number for name, number in topics.items() if name.endswith('/pick_result'))
    assert picks == 5
    observed = read_observed(shift.folder, [1, 2], part=PART)
    assert observed.windows(4)[0].tolist() == [[3, 4], [2, 5]]
    assert observed.totals.tolist() == [5, 9]
    # The last log by itself begins with the totals up to then.
    assert read_observed(shift.logs()[-1], [1, 2]).totals.tolist() == [5, 9]
    with pytest.raises(InvalidValueError, match=r'observed_counts of cube, found .hex_nut'):
        read_observed(shift.folder, [1, 2], part='cube')
