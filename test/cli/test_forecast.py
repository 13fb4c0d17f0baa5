"""Sizes on the command line of `forecast`; its documents are in test_same_as_functions.py."""

import pytest

from resting_aspects_ros.cli.verbs.forecast import parse_gripper, parse_tray
from resting_aspects_ros.errors import InvalidValueError


def test_sizes_have_units():
    assert parse_tray('200x150mm') == pytest.approx((0.2, 0.15))
    assert parse_tray('0.2m x 150mm') == pytest.approx((0.2, 0.15))
    disc = parse_gripper('20mm')
    assert (disc.length, disc.width, disc.radius) == (0, 0, pytest.approx(0.01))
    for parse, text in (
        (parse_tray, '10mm x'),
        (parse_tray, '10'),
        (parse_gripper, '-5mm'),
        (parse_gripper, '1x2x3mm'),
    ):
        with pytest.raises(InvalidValueError, match=f'{text!r}: expected'):
            parse(text)
