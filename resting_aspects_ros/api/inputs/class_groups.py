"""Groups of symmetry classes that were counted together, because a camera confuses them."""

import re
from collections.abc import Iterable, Sequence

from resting_aspects_ros.core.statistics.counted_parts import Groups

_NUMBER = r'(?:class(?:es)?[_ ]?)?0*[1-9]\d{0,8}'
_GROUP = re.compile(rf'{_NUMBER}(?:\s*\+\s*{_NUMBER})*', re.IGNORECASE)


def parse_group(text: str) -> tuple[int, ...] | None:
    """Return the classes of '3', 'class_3' or '3+4', ascending; None for any other text.

    A text that names a class twice is not a group either.
    """
    if not _GROUP.fullmatch(text.strip()):
        return None
    numbers = sorted(int(digits) for digits in re.findall(r'\d+', text))
    return tuple(numbers) if len(set(numbers)) == len(numbers) else None


def group_name(group: Sequence[int]) -> str:
    """Return '3+4'."""
    return '+'.join(map(str, group))


def single_groups(ids: Iterable[int]) -> Groups:
    """Return groups of one class each."""
    return tuple((number,) for number in ids)


def common_groups(one: Groups, other: Groups) -> Groups:
    """Return the smallest groups that contain each group of both, in ascending order."""
    found: list[set[int]] = []
    for group in (*one, *other):
        touched = [each for each in found if not each.isdisjoint(group)]
        found = [each for each in found if each.isdisjoint(group)]
        found.append(set(group).union(*touched))
    return tuple(sorted(tuple(sorted(each)) for each in found))
