"""`resting_aspects feeder_demo`: the feeder over ROS beside its forecast."""

import io
import json
import os
import signal
from types import SimpleNamespace

import pytest
from builtin_interfaces.msg import Time
from resting_aspects_interfaces.msg import DetectionArray, FeederAdvice, PickResult
from rich.console import Console
from sensor_msgs.msg import Image as ImageMsg
from std_msgs.msg import Header

from resting_aspects_ros.cli.verbs import feeder_demo
from resting_aspects_ros.client.feeder_watch import (
    FeederWatch,
    feeder_sentence,
    feeder_table,
)
from resting_aspects_ros.errors import RestingAspectsError


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

    def result(self, time, kind, image=0):
        header = Header(stamp=Time(sec=time))
        self._send[PickResult](PickResult(header=header, result=kind, image=image))


def test_camera_that_waits_for_the_watch_begins_after_all_is_heard():
    cell = Watched(without=FeederAdvice)
    assert not cell.hears_results
    cell.publishers[FeederAdvice] = 1
    cell.watch.connect()
    assert cell.hears_results


def test_picks_are_counted_in_any_order_of_messages():
    def sent(order):
        cell = Watched()
        for message in order:
            message(cell)
        assert cell.watch.done.done()
        return cell.watch.fields()

    seen = [(1, 10), (2, 40), (3, 55), (4, 60), (5, 75)]
    results = [
        (9, PickResult.PICKED, 8),  # before the first image
        (20, PickResult.PICKED, 1),
        (30, PickResult.DROPPED, 1),
        (50, PickResult.MISSED, 2),
        (65, PickResult.MOVED),
        (80, PickResult.PICKED, 5),  # after the end
        (81, PickResult.MISSED, 5),
    ]
    images = [lambda cell, each=each: cell.seen(*each) for each in seen]
    picks = [lambda cell, each=each: cell.result(*each) for each in results]
    fields = sent([*images, *picks])
    assert (fields['picks'], fields['missed'], fields['images']) == (1, 1, 4)
    assert fields['minutes'] == pytest.approx(65 / 60)
    assert sent([*picks, *images]) == fields


def test_time_begins_with_the_first_image_of_the_camera():
    cell = Watched()
    cell.image(10)
    cell.result(20, PickResult.PICKED, 1)  # the detections of the first image were lost
    cell.seen(2, 30)
    assert cell.watch.minutes == pytest.approx(20 / 60)
    assert cell.watch.picks == 1


@pytest.mark.parametrize(
    ('rate', 'minutes', 'said'),
    [(26.8, 10, 'within'), (28.4, 10, 'outside'), (26.8, 2, 'shorter')],
)
def test_run_is_compared_with_its_forecast(rate, minutes, said):
    found = SimpleNamespace(picks=270, total=10.0, rate=rate, minutes=minutes)
    forecast = SimpleNamespace(rate=26.0, prediction=(24.0, 28.0))
    assert said in feeder_sentence(found, forecast).splitlines()[0].rpartition(';')[2]


def test_live_table_has_the_run_beside_its_forecast():
    found = SimpleNamespace(minutes=10.05, total=10.0, on_tray=12, picks=270, missed=3, images=150)
    found.rate, found.advice = 26.87, SimpleNamespace(reason='Pick 2')
    forecast = SimpleNamespace(rate=26.0, prediction=(24.0, 28.0))
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(feeder_table(found, forecast))
    text = console.export_text()
    for words in ('10:03 of 10 min', '270 (3 missed)', '26.9', '26.0 (24.0 to 28.0)', 'Pick 2'):
        assert words in text


@pytest.mark.slow
@pytest.mark.parametrize(('interrupted', 'code'), [(False, 1), (True, 130)])
def test_what_was_found_is_written_at_an_early_end(run, monkeypatch, tmp_path, interrupted, code):
    def fail(demo):
        demo.watch = Watched().watch
        if interrupted:
            signal.raise_signal(signal.SIGINT)
            demo._check()
        raise RestingAspectsError('vision_example ended')

    monkeypatch.setattr(feeder_demo.FeederDemo, 'run', fail)
    found = run('feeder_demo', '--out', 'o', '--json')
    assert found.returncode == code
    last = found.stderr.splitlines()[-1]
    assert last.startswith('Written') if interrupted else last == 'error: vision_example ended'
    assert (tmp_path / 'o' / 'feeder_demo.json').read_text() == found.stdout
    assert not json.loads(found.stdout)['complete']


@pytest.mark.slow
def test_demo_compares_a_run_with_its_forecast(run, running, monkeypatch, tmp_path):
    monkeypatch.setattr(feeder_demo, 'DROPS', 200)
    monkeypatch.setattr(feeder_demo, 'PER_ASPECT', 10)
    # A small tray and a short run: few places, small images.
    ended = run('feeder_demo', '--tray', '100x100mm', '--out', '.', '--minutes', 0.3, '--json')
    assert ended.returncode == 0, ended.stderr
    assert 'simulated time' in ended.stderr
    found = json.loads(ended.stdout)
    assert found == json.loads((tmp_path / 'feeder_demo.json').read_text())
    assert found['complete']
    done, forecast = found['run'], found['forecast']
    assert done['minutes'] >= 0.3
    assert done['picks'] == pytest.approx(done['minutes'] * done['parts_per_minute'])
    assert done['picks'] > 0
    assert forecast['prediction_lower'] < forecast['parts_per_minute']
    assert (tmp_path / 'feeder_demo.png').exists()
    assert list(tmp_path.glob('logs/feeder*/*.mcap'))
    assert not running(f'__ns:=/feeder_demo_{os.getpid()}')
