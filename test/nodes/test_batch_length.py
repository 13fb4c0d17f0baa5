"""The number of poses in a batch, read from its bytes, is that of the message."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from resting_aspects_interfaces.msg import (
    DropConditions,
    RestingPose,
    RestingPoses,
    RunDescription,
)
from std_msgs.msg import Header

from resting_aspects_ros.core.errors import LogError
from resting_aspects_ros.nodes.batch_length import poses_in

TEXTS = ('run_id', 'part', 'part_sha256', 'engine', 'engine_version', 'suite_version')
words = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=20)


@given(frame=words, surface=words, texts=st.tuples(*[words] * 6), count=st.integers(0, 300))
def test_whatever_the_words_before_the_poses_are(frame, surface, texts, count):
    """Their lengths decide where the number is."""
    run = RunDescription(
        conditions=DropConditions(surface=surface, height_of=1, gravity=9.81),
        seed=2**64 - 1,
        **dict(zip(TEXTS, texts, strict=True)),
    )
    batch = RestingPoses(
        header=Header(frame_id=frame), run=run, poses=[RestingPose()] * count, last=True
    )
    assert poses_in(serialize_message(batch)) == count


@pytest.mark.parametrize('size', [0, 1, 4, 40, 200])
def test_bytes_that_end_too_early_are_told(size):
    whole = serialize_message(RestingPoses(poses=[RestingPose()] * 3))
    with pytest.raises(LogError) as caught:
        poses_in(whole[:size])
    assert str(caught.value) == f'{size} bytes are no batch of resting poses'
