"""feeder_controller over ROS: messages of a vision system and a robot in, advice out."""

import math
import os
import re

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from resting_aspects_interfaces.msg import (
    AspectDistribution,
    Detection,
    DetectionArray,
    FeederAdvice,
    PartDescription,
    PickResult,
    TransitionMatrix,
)
from ros_graph import Diagnostics
from scipy.stats import binomtest
from std_msgs.msg import Header

from resting_aspects_ros.api.identify import known_part
from resting_aspects_ros.ros.conversions import part_msg, pose_msg, time_msg
from resting_aspects_ros.ros.distribution_conversions import distribution_msg, transitions_msg
from resting_aspects_ros.ros.interface import ALL_LATCHED, CELL, LATCHED

MISSING_PART = r'parts/\w+ has (no publisher|not arrived yet)'
PART = 'l_bracket'
SECOND = 10**9
# A test may take long on a busy machine; only the test of a stopped camera needs a short time.
TIMEOUT = 'nodes.feeder_controller.node.IMAGE_TIMEOUT'
QUICK = {
    'ros.health.DIAGNOSTICS_PERIOD': 0.1,
    'nodes.feeder_controller.node.CHECK_PERIOD': 0.1,
    'nodes.feeder_controller.model_updates.REQUEST_PERIOD': 0.2,
}
PATIENT = {TIMEOUT: 1e6, **QUICK}
DROPS = [28, 27, 25, 13, 7]
CHOICES = {'WAIT': 0, 'PICK': 1, 'FLIP': 2, 'SPREAD': 3, 'SUPPLY': 4}


class Cell:
    """A vision system, a robot and a simulator around a controller."""

    def __init__(self, client):
        self.client = client
        publish = client.node.create_publisher
        self.images = publish(DetectionArray, 'detections', CELL)
        self.results = publish(PickResult, 'pick_result', CELL)
        self.parts = publish(PartDescription, f'parts/{PART}', LATCHED)
        self.drops = publish(AspectDistribution, f'aspect_distributions/{PART}', LATCHED)
        self.flips = publish(TransitionMatrix, f'transitions/{PART}', LATCHED)
        self.received = client.listen(FeederAdvice, f'feeder_advice/{PART}', ALL_LATCHED)
        self.number = 0
        for output in (self.images, self.results):
            client.wait(output.get_subscription_count, 'controller')

    def header(self, age=0.0):
        now = self.client.node.get_clock().now().nanoseconds
        return Header(stamp=time_msg(now - round(age * SECOND)), frame_id='tray')

    def show(self, *detections, age=0.0):
        """Publish an image; return its number."""
        self.number += 1
        message = DetectionArray(image=self.number, detections=detections)
        message.header = self.header(age)
        self.images.publish(message)
        return self.number

    def report(self, result, image=0, detection=0):
        given = {'result': result, 'image': image, 'detection': detection}
        self.results.publish(PickResult(header=self.header(), **given))

    def advice(self, choice, holds=lambda _: True):
        """Return the newest advice once it is as expected."""

        def found():
            *_, newest = self.received or [FeederAdvice(choice=255)]
            return newest if newest.choice == CHOICES[choice] and holds(newest) else None

        return self.client.wait(found, f'{choice}')

    def advice_for(self, *detections, choice):
        number = self.show(*detections)
        return self.advice(choice, lambda advice: advice.image == number)


def seen(class_id='1', x=0.0, clearance=0.05, **fields):
    fields = {'part': PART, 'score': 0.99, 'y': 0.0, 'yaw': 0.0, **fields}
    return Detection(class_id=class_id, x=x, clearance=clearance, **fields)


@pytest.fixture
def begin(start, connect, namespace):
    """Start a controller and return its cell."""

    def begin(constants=PATIENT, **parameters):
        node = start('feeder_controller', namespace, {'part': PART, **parameters}, constants)
        return Cell(connect(namespace)), node

    return begin


@pytest.fixture(scope='module')
def running(start, connect, part, drops_of):
    """A controller that knows drops of its part, in a module."""
    namespace = f'/test_feeder_controller_{os.getpid()}'
    start('feeder_controller', namespace, {'part': PART, 'spread_time': 0.4}, PATIENT)
    cell = Cell(connect(namespace))
    cell.parts.publish(part_msg(part(PART)))
    cell.drops.publish(drops_of(DROPS))
    cell.advice('WAIT', lambda advice: 'no image' in advice.reason)
    return cell


@pytest.fixture
def cell(running):
    """Its cell, with an empty tray."""
    epoch = running.received[-1].epoch
    running.report(PickResult.MOVED)
    running.advice('WAIT', lambda advice: advice.epoch == epoch + 1)
    running.advice_for(choice='SUPPLY')
    return running


@pytest.fixture(scope='module')
def drops_of(invented):
    """Return a function that makes a distribution of drops, of which one did not come to rest."""

    def drops_of(counts, run_id='a'):
        found = invented(PART, counts, np.zeros((5, 5), int), run_id=run_id, unsettled=1)
        return distribution_msg(found.drop, found.run, Time(sec=1), complete=True)

    return drops_of


def test_picks_are_sorted_and_have_the_poses_of_the_part(cell, part):
    advice = cell.advice_for(
        seen('1', 0.01, score=0.9, yaw=1.0),
        seen('2', 0.05),
        seen('1', 0.15, score=0.98, y=0.02, yaw=-2.0),
        choice='PICK',
    )
    assert [(pick.detection, pick.symmetry_class) for pick in advice.picks] == [(2, 1), (0, 1)]
    (expected,) = known_part(part(PART), {1: 1.0}).placements[0].poses(0.15, 0.02, -2.0)
    assert advice.picks[0].poses == [pose_msg(expected.position, expected.orientation)]
    assert advice.header.frame_id == 'tray'


def test_picks_are_worked_off_and_the_action_follows(cell):
    first = cell.advice_for(seen('1', 0.0), seen('1', 0.05), choice='PICK')
    left = [pick.detection for pick in first.picks]
    for epoch in (first.epoch + 1, first.epoch + 2):
        cell.report(PickResult.PICKED, first.image, left.pop(0))
        cell.client.wait(lambda e=epoch: cell.received[-1].epoch == e, 'next epoch')
        assert [pick.detection for pick in cell.received[-1].picks] == left
    advice = cell.received[-1]
    assert (advice.choice, advice.supply) == (first.then, first.supply)


def test_invalid_input_is_reported_and_makes_nothing_valid(cell):
    diagnostics = Diagnostics(cell.client)

    def reported(text):
        return diagnostics.wait('feeder_controller', lambda _, found, __: text in found, text)

    before = cell.advice_for(seen(), choice='PICK')
    refused = cell.show(seen(), age=-60.0)
    level, text, _ = reported('in the future')
    assert (level, f'image {refused}' in text) == (b'\x01', True)
    assert cell.received[-1].image == before.image
    cell.report(0, before.image, 0)
    advice = cell.advice('WAIT', lambda advice: advice.epoch == before.epoch + 1)
    assert 'stale' in advice.reason
    reported('invalid result of a pick')
    cell.advice_for(seen(), choice='PICK')


@pytest.mark.slow
def test_model_follows_drops_and_flips(begin, part, invented, drops_of):
    def flips_of(action):
        found = invented(PART, np.ones(5, int), np.full((5, 5), 4), action, 'flips')
        return transitions_msg(found, Time(sec=1), ended=True)

    cell, process = begin(pickable_classes=[1, 3])
    # It depends on what the node has discovered yet.
    cell.advice('WAIT', lambda advice: re.search(MISSING_PART, advice.reason))
    cell.parts.publish(part_msg(part(PART)))
    cell.advice('WAIT', lambda advice: 'get_distribution is not served' in advice.reason)
    assert math.isnan(cell.received[-1].pickable_share)
    cell.drops.publish(drops_of([10, 20, 30, 40, 99]))
    advice = cell.advice('WAIT', lambda advice: advice.drops == 199)
    interval = binomtest(40, 200).proportion_ci(method='wilson')
    found = [advice.pickable_share, advice.lower, advice.upper]
    assert found == pytest.approx([0.2, interval.low, interval.high])

    # Fewer drops, and another action.
    cell.drops.publish(drops_of([1, 0, 0, 0, 0], 'b'))
    cell.flips.publish(flips_of('tap'))
    cell.client.wait(lambda: 'invalid action tap: expected flip' in process.output, 'its refusal')
    cell.flips.publish(flips_of('flip'))
    advice = cell.advice('WAIT', lambda advice: advice.actions == 100)
    assert advice.drops == 199


@pytest.mark.slow
def test_drops_are_requested_once_if_none_are_known(fresh_suite, start):
    suite = fresh_suite()
    runs = suite.client.poses()
    received = suite.client.listen(FeederAdvice, 'feeder_advice/tetrahedron', ALL_LATCHED)
    start('feeder_controller', suite.namespace, {'part': 'tetrahedron'}, PATIENT)
    suite.client.wait(lambda: received and received[-1].drops == 1000, 'all drops')
    (run,) = {each.run.run_id: each.run for each in runs}.values()
    assert (run.part, run.drops, run.conditions.surface) == ('tetrahedron', 1000, 'rubber_mat')


def test_class_that_the_part_lacks_is_an_error(begin, part):
    cell, _ = begin(pickable_classes=[1, 6])
    diagnostics = Diagnostics(cell.client)
    cell.parts.publish(part_msg(part(PART)))
    message = f'invalid pickable_classes [1, 6]: expected symmetry classes of {PART}, 1 to 5'
    cell.advice('WAIT', lambda advice: message in advice.reason)
    level, *_ = diagnostics.wait('feeder_controller', lambda _, text, __: message in text, 'error')
    assert level == b'\x02'


@pytest.mark.slow
def test_camera_that_stops_is_reported_and_may_continue(begin, part, drops_of):
    times = dict.fromkeys(('robot_time', 'vibrate_time', 'settle_time', 'image_time'), 0.01)
    cell, process = begin({TIMEOUT: 0.3, **QUICK}, **times)
    cell.parts.publish(part_msg(part(PART)))
    cell.drops.publish(drops_of(DROPS))
    cell.advice('WAIT', lambda advice: 'If the tray is empty, supply' in advice.reason)
    image = cell.show(*(seen('1', 0.05 * k) for k in range(3)))
    advice = cell.advice('WAIT', lambda advice: 'no valid image has arrived for' in advice.reason)
    assert [len(a.picks) for a in cell.received if a.image == image] == [3, 0]
    assert advice.reason.endswith('Before, the advice was to pick parts.')
    image = cell.show(seen())
    cell.client.wait(lambda: any(a.image == image and a.picks for a in cell.received), 'picks')
    assert 'check the camera' in process.output
