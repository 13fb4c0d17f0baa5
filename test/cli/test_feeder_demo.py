"""`resting_aspects feeder_demo`: the feeder over ROS beside its forecast."""

import json
import os
import signal
from types import SimpleNamespace

import pytest
from builtin_interfaces.msg import Time
from PIL import Image
from resting_aspects_interfaces.msg import DetectionArray, FeederAdvice, PickResult
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image as ImageMsg
from std_msgs.msg import Header

from resting_aspects_ros.cli import feeder_display, node_processes
from resting_aspects_ros.cli.feeder_demo_run import FeederDemo
from resting_aspects_ros.cli.feeder_display import check_silence
from resting_aspects_ros.cli.node_processes import NodeProcesses, log_of
from resting_aspects_ros.client.feeder_watch import FeederWatch
from resting_aspects_ros.errors import RestingAspectsError

NODES = 6
# A small tray and a short run: few places, small images.
FEW = ('feeder_demo', '--tray', '100x100mm', '--out')
PICK, FLIP, SPREAD = FeederAdvice.PICK, FeederAdvice.FLIP, FeederAdvice.SPREAD


class Watched:
    """A watch of a minute, and the messages for it; times in s."""

    def __init__(self, without=None):
        self._send = {}
        self.publishers = {k: k is not without for k in (DetectionArray, ImageMsg, FeederAdvice)}
        self.watch = FeederWatch(self, 'cube', 1.0)
        self.watch.connect()

    @property
    def hears_results(self):
        return PickResult in self._send

    def create_subscription(self, kind, topic, callback, qos):
        assert kind not in self._send
        self._send[kind] = callback
        return SimpleNamespace(get_publisher_count=lambda: self.publishers.get(kind, 1))

    def image(self, time):
        self._send[ImageMsg](ImageMsg(header=Header(stamp=Time(sec=time))))

    def seen(self, number, time):
        header = Header(stamp=Time(sec=time))
        self._send[DetectionArray](DetectionArray(header=header, image=number))

    def advise(self, number, choice, **fields):
        self._send[FeederAdvice](FeederAdvice(image=number, choice=choice, **fields))

    def result(self, time, kind, image=0):
        header = Header(stamp=Time(sec=time))
        self._send[PickResult](PickResult(header=header, result=kind, image=image))

    def tick(self, time):
        self._send[Clock](Clock(clock=Time(sec=time)))


def test_camera_that_waits_for_the_watch_begins_after_all_is_heard():
    cell = Watched()
    assert cell.hears_results
    cell.watch.connect()  # again, which does not subscribe twice
    for kind in cell.publishers:
        unconnected = Watched(without=kind)
        assert not unconnected.hears_results
        unconnected.publishers[kind] = 1
        unconnected.watch.connect()
        assert unconnected.hears_results


def test_only_actions_that_happened_are_counted():
    cell = Watched()
    cell.seen(1, 10)
    cell.advise(1, PICK, then=FLIP, supply=5)
    cell.result(11, PickResult.PICKED, 1)
    cell.result(12, PickResult.PICKED, 1)
    cell.result(14, PickResult.MOVED)
    cell.seen(2, 14)
    cell.advise(2, PICK, then=FLIP, supply=9)
    cell.result(15, PickResult.MISSED, 2)  # therefore, no flip and no supply
    cell.seen(3, 15)
    cell.result(18, PickResult.MOVED)
    cell.seen(4, 18)
    cell.advise(3, SPREAD, supply=1)  # advice and detections may arrive in any order
    cell.advise(4, FeederAdvice.SUPPLY, supply=3)
    cell.seen(5, 80)
    cell.result(70, PickResult.MOVED)
    cell.result(90, PickResult.MOVED)  # after the minute
    fields = cell.watch.fields()
    assert cell.watch.done.done()
    assert fields['choices'] == {'pick': 2, 'flip': 1, 'spread': 1, 'supply': 1}
    assert (fields['supplied'], fields['picks'], fields['missed']) == (9, 2, 1)


def test_messages_in_any_order_give_the_same_counts():
    def sent(order):
        cell = Watched()
        cell.advise(1, PICK, then=FLIP, supply=5)
        cell.advise(2, PICK, then=FLIP, supply=9)
        for message in order:
            message(cell)
        return cell.watch.done.done(), cell.watch.fields()

    messages = [
        lambda cell: cell.result(9, PickResult.PICKED, 8),  # before the first image
        lambda cell: cell.seen(1, 10),
        lambda cell: cell.result(20, PickResult.PICKED, 1),
        lambda cell: cell.result(30, PickResult.DROPPED, 1),
        lambda cell: cell.result(40, PickResult.MOVED),
        lambda cell: cell.seen(2, 40),
        lambda cell: cell.result(60, PickResult.MISSED, 2),
        lambda cell: cell.seen(3, 75),
        lambda cell: cell.result(80, PickResult.PICKED, 3),  # after the end
        lambda cell: cell.result(81, PickResult.MISSED, 3),
        lambda cell: cell.result(82, PickResult.MOVED),
    ]
    seen, results = (
        [messages[k] for k in (1, 5, 7)],
        [messages[k] for k in (0, 2, 3, 4, 6, 8, 9, 10)],
    )
    done, fields = sent(messages)
    assert done
    assert (fields['picks'], fields['missed'], fields['supplied']) == (1, 1, 5)
    assert fields['choices'] == {'pick': 2, 'flip': 1, 'spread': 0, 'supply': 0}
    assert fields['minutes'] == pytest.approx(65 / 60)
    assert sent([*results, *seen]) == sent([*seen, *results]) == (done, fields)


def test_time_begins_with_the_first_image_of_the_camera():
    cell = Watched()
    cell.image(10)
    cell.result(20, PickResult.PICKED, 1)  # the detections of the first image were lost
    cell.seen(2, 30)
    assert cell.watch.minutes == pytest.approx(20 / 60)
    assert cell.watch.picks == 1


def test_nodes_are_waited_for_until_they_are_ready(tmp_path):
    nodes = NodeProcesses(tmp_path)
    nodes._running = {'slow': None, 'other': None}
    log_of(tmp_path, 'other').write_text('[INFO] [1.0] [other]: ready: 6 parts\n')
    log_of(tmp_path, 'slow').touch()
    checks = []

    def check():
        checks.append(len(checks))
        if len(checks) == 2:
            log_of(tmp_path, 'slow').write_text('[INFO] [1.0] [slow]: ready\n')

    nodes.wait_until_ready(check)
    assert len(checks) == 2


def test_node_that_is_never_ready_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(node_processes, 'START_TIMEOUT', 0.0)
    nodes = NodeProcesses(tmp_path)
    nodes._running = {'slow': None}
    log_of(tmp_path, 'slow').write_text('[WARN] already here\n')
    with pytest.raises(RestingAspectsError, match=r'slow is not ready after 0 s: see .*slow\.log'):
        nodes.wait_until_ready(lambda: None)


def test_demo_without_progress_names_the_silent_node(tmp_path, monkeypatch):
    cell = Watched()
    check_silence(cell.watch, tmp_path)
    monkeypatch.setattr(feeder_display, 'MAX_SILENCE', -1.0)

    def silent():
        with pytest.raises(RestingAspectsError, match=r'is silent: no .*see') as error:
            check_silence(cell.watch, tmp_path)
        assert str(tmp_path / str(error.value).split()[0]) in str(error.value)
        return str(error.value).split()[0]

    assert silent() == 'feeder_controller'
    cell.advise(0, FeederAdvice.WAIT)
    assert silent() == 'camera_simulator'
    cell.image(10)
    assert silent() == 'vision_example'
    cell.seen(1, 10)
    assert silent() == 'feeder_controller'
    cell.advise(1, FLIP)
    assert silent() == 'camera_simulator'
    # Simulated time that passes is progress, its repetition is none.
    before = cell.watch._clock_changed
    cell.tick(11)
    changed = cell.watch._clock_changed
    cell.tick(11)
    assert before < changed == cell.watch._clock_changed


@pytest.mark.slow
@pytest.mark.parametrize('has_begun', [True, False])
def test_what_was_found_is_written_if_a_node_ends(run, monkeypatch, tmp_path, has_begun):
    def fail(demo, _layout):
        demo._watch = Watched().watch if has_begun else None
        raise RestingAspectsError('vision_example ended')

    monkeypatch.setattr(FeederDemo, 'run', fail)
    found = run('feeder_demo', '--out', 'o', '--json')
    assert (found.returncode, found.stderr.splitlines()[-1]) == (1, 'error: vision_example ended')
    assert (tmp_path / 'o' / 'feeder_demo.json').exists() == has_begun
    assert bool(found.stdout) == has_begun


@pytest.mark.slow
def test_demo_compares_a_run_with_its_forecast(begin, running, tmp_path):
    demo = begin(*FEW, tmp_path, '--minutes', '1', '--json')
    printed, said = demo.communicate()
    assert demo.returncode == 0, said
    found = json.loads(printed)
    assert found == json.loads((tmp_path / 'feeder_demo.json').read_text())
    assert found['complete']
    run, forecast = found['run'], found['forecast']
    assert run['minutes'] >= 1
    assert run['picks'] == pytest.approx(run['minutes'] * run['parts_per_minute'])
    assert run['picks'] > 0
    assert run['choices']['pick'] > 0
    assert run['supplied'] >= run['picks']
    assert forecast['prediction_lower'] < forecast['parts_per_minute']
    assert 'the robot picked' in said
    with Image.open(tmp_path / 'feeder_demo.png') as picture:
        assert min(picture.size) > 500
    assert list(tmp_path.glob('logs/feeder*/*.mcap'))
    layout = (tmp_path / 'foxglove.json').read_text()
    assert f'/feeder_demo_{demo.pid}/feeder_advice/l_bracket' in layout
    assert not running(f'__ns:=/feeder_demo_{demo.pid}')


@pytest.mark.slow
def test_ctrl_c_ends_all_processes_and_keeps_the_result(begin, running, wait_until, tmp_path):
    demo = begin(*FEW, tmp_path, '--minutes', '9999')
    wait_until(lambda: len(running(f'__ns:=/feeder_demo_{demo.pid}')) == NODES)
    os.kill(demo.pid, signal.SIGINT)
    _, said = demo.communicate()
    assert demo.returncode == 130, said
    assert 'interrupted' in said
    assert 'Traceback' not in said
    assert not json.loads((tmp_path / 'feeder_demo.json').read_text())['complete']
    assert not running(f'__ns:=/feeder_demo_{demo.pid}')
